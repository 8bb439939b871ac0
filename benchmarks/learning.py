"""Cost of steps for learning: the environment over the plain Python API, and many environments at once."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from rich.progress import Progress

from benchmarks.measure import BenchmarkError, Effort, interleave, note_on_load
from benchmarks.report import Part, Table, Value
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

SCENARIO, DRIVEN, SPEED = "single_span", "cabin", 5.0  # m/s
PERIOD = 0.01  # s, of a step
STEPS, QUICK_STEPS = 5000, 500
ENVIRONMENTS = 16  # at once


def run(effort: Effort, progress: Progress) -> Part:
    """Time the same trip through the API and through the environment."""
    try:
        from cable_twin.gym import RopewayEnv, vector_env  # noqa: PLC0415 - an extra
    except ImportError as error:
        raise BenchmarkError(f"{error}: pip install '.[gym]'") from error
    steps = QUICK_STEPS if effort.quick else STEPS
    environment = RopewayEnv(SCENARIO, period=PERIOD, duration=1e6)
    simulation = Simulation(load_scenario(SCENARIO))

    def prepare_environment() -> Callable[[], None]:
        environment.reset()
        action = np.array([SPEED])

        def drive() -> None:
            for _ in range(steps):
                environment.step(action)

        return drive

    start = simulation.capture()

    def prepare_api(*, read: bool) -> Callable[[], None]:
        simulation.restore(start)
        simulation.command(DRIVEN, speed=SPEED)

        def drive() -> None:
            for step in range(steps):
                if read:
                    simulation.command(DRIVEN, speed=SPEED)
                snapshot = simulation.advance_to((step + 1) * PERIOD)
                if read:
                    seen = snapshot.carriages[DRIVEN]
                    _ = seen.arc_length, seen.speed, [body.pitch for body in seen.bodies.values()]

        return drive

    measured = interleave(
        {
            "advance_to alone": lambda: prepare_api(read=False),
            "command, advance_to, place, speed and pitches read": lambda: prepare_api(read=True),
            "the environment": prepare_environment,
        },
        effort.repetitions,
        progress,
        "steps for learning",
    )
    rows: list[dict[str, Value]] = [
        {
            "what": name,
            "steps per second of the clock": steps / timing.wall,
            "steps per second of the processor": steps / timing.processor,
        }
        for name, timing in measured.items()
    ]
    many = {
        name: vector_env(ENVIRONMENTS, SCENARIO, processes=processes, period=PERIOD, duration=1e6)
        for name, processes in (("one ensemble, threads on all cores", False), ("a process each", True))
    }
    together, actions = steps // ENVIRONMENTS, np.full((ENVIRONMENTS, 1), SPEED)

    def prepare_many(name: str) -> Callable[[], None]:
        many[name].reset()
        many[name].step(actions)

        def drive() -> None:
            for _ in range(together):
                many[name].step(actions)

        return drive

    try:
        contestants = {name: (lambda name=name: prepare_many(name)) for name in many}
        at_once = interleave(contestants, effort.repetitions, progress, "environments at once")
    finally:
        for one in many.values():
            one.close()
    vectors: list[dict[str, Value]] = [
        {"environments": name, "steps of one per second of the clock": together * ENVIRONMENTS / timing.wall}
        for name, timing in at_once.items()
    ]
    in_threads, in_processes = (timing.wall for timing in at_once.values())
    notes = [
        f"{SCENARIO}, steps of {PERIOD * 1e3:g} ms, a trip at {SPEED:g} m/s; one environment on one core.",
        f"{ENVIRONMENTS} environments on one ensemble take {in_processes / in_threads:.2f} times the steps of as many "
        "processes.",
    ]
    return Part(
        "Steps for learning",
        [Table("API and environment", rows), Table(f"{ENVIRONMENTS} environments", vectors)],
        [*notes, note_on_load([*measured.values(), *at_once.values()])],
    )
