"""Random ropes with loads in still air without any damping: none may gain energy, and no step may fail.

`python -m verification.random_loads` runs 200 of them for 60 s, each from rest and after a push, and names those that
gain energy or fail. The energy of an integrator of second order varies by its own error, with h²: where it rises by
more than is allowed, a run with a quarter of the step tells what is left of the gain without that, and where that is
still too much, one with a sixteenth.
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import track

from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, SolverError
from cable_twin.terminal.command_line import Filled
from verification import Result, case
from verification.point_loads import GRAVITY, Rope, hung, plain, rest_place, solve, with_tension

KINDS = ("fixed", "driven", "free", "clamped")
STARTS = ("rest", "push")
FRAME = 0.05  # s, between looks at the energy
FINER, FINEST = 4.0, 16.0  # times as many steps where energy is gained
OF_KINETIC = 1e-6  # of the largest kinetic energy of a run, which it may gain
ROUNDING = 1e-11  # of the energy of a rope, which is a sum of hundreds of terms
COUNT, DURATION = 200, 60.0  # -, s
SAMPLE, SAMPLE_DURATION = 24, 20.0  # -, s: of the case


@dataclass(frozen=True)
class RandomSystem:
    """A rope with loads, or two with a load between them."""

    name: str
    scenario: dict[str, Any]
    pushed: dict[str, Any]  # keys that give it a push at the start
    loads: tuple[str, ...]  # whose payload changes at once for a push


@dataclass(frozen=True)
class Run:
    """Motion of a system."""

    name: str
    gained: float  # J, highest energy less that of the start, where that is too much without the error of the step
    allowed: float  # J
    kinetic: float  # J, largest
    lost: float  # J, energy of the start less that of the end
    later: float  # J, highest energy after the first second less that of this second
    fault: str = ""

    @property
    def passed(self) -> bool:
        """Whether it went on to its end without a gain."""
        return not self.fault and self.gained <= self.allowed


def light_rope(elements: int, place: float, dim: int = 2) -> RandomSystem:
    """600 kg at a fixed joint of a light rope, 101 m long on 100 m, at a place (m)."""
    end = (100.0, 0.0) if dim == 2 else (80.0, 60.0, 0.0)
    rope = Rope(end, 101.0, 2.0 * GRAVITY, 1e7, (place,), (600.0 * GRAVITY,))
    return _system(
        f"600 kg at {place:g} m, {elements} elements, {'plane' if dim == 2 else 'space'}",
        rope,
        "fixed",
        elements,
        0.7,
        0.005,
    )


def drawn(seed: int) -> RandomSystem:
    """System number `seed` of the random ones."""
    draw = np.random.default_rng([32, seed])
    kind, dim = KINDS[seed % len(KINDS)], 2 + (seed // 4) % 2
    stiff = float(np.exp(draw.uniform(np.log(0.01), np.log(500.0))))  # EA F² / T³
    # strains of at most 4 %, and rope that is not far stiffer than steel
    least, most = max(0.01, np.sqrt(stiff / 1e4)), min(0.6, np.sqrt(stiff / 25.0))
    ratio = float(np.exp(draw.uniform(np.log(least), np.log(most))))
    elements = int(np.exp(draw.uniform(np.log(10.0), np.log(200.5))))
    radius, step = float(draw.uniform(0.6, 0.9)), float(draw.choice([0.002, 0.005, 0.01]))
    span, tension = float(draw.uniform(60.0, 1000.0)), float(np.exp(draw.uniform(np.log(1e4), np.log(1e6))))
    weight = float(np.exp(draw.uniform(np.log(0.02), np.log(0.5)))) * tension / span
    rise = 0.0 if kind == "free" else float(draw.uniform(-0.3, 0.3)) * span
    turn = 0.0 if dim == 2 else float(draw.uniform(-0.7, 0.7))
    end = (span, rise) if dim == 2 else (float(span * np.cos(turn)), float(span * np.sin(turn)), rise)
    count = 1 if kind in ("free", "clamped") else int(draw.integers(1, 5))
    apart = float(draw.choice([0.25, 0.8, 2.5])) / elements  # of the length, between loads
    first = float(draw.uniform(0.15, 0.85 - min(0.5, count * apart)))
    shares = tuple(first + k * min(apart, 0.5 / count) for k in range(count))
    load = ratio * tension
    rope = Rope(end, span, weight, stiff * tension**3 / load**2, shares, (load / count,) * count)
    rope = with_tension(rope, tension)
    if kind == "free":
        aside = float(draw.uniform(-0.15, 0.15)) * rope.length
        rope = replace(rope, places=(rest_place(rope) + aside,))
    name = f"{seed}: {kind}, {'plane' if dim == 2 else 'space'}, {elements} elements, {count} loads"
    name += f" {apart * elements:.2g} apart" if count > 1 else ""
    name += f", F/T {ratio:.3g}, EA F²/T³ {stiff:.3g}, radius {radius:.2f}, {1e3 * step:g} ms"
    return _system(name, rope, kind, elements, radius, step)


def _system(name: str, rope: Rope, kind: str, elements: int, radius: float, step: float) -> RandomSystem:
    room = {"capacity": 0.5 * rope.loads[0] / GRAVITY, "station_distance": 0.5 * rope.length, "station_speed": 100.0}
    room["position"] = [0.3] + [0.1] * (len(rope.end) - 2) + [-0.5]  # aside, so that bodies swing too
    data = plain(rope, elements, "fixed" if kind == "clamped" else kind)
    cars = hung(rope, "fixed" if kind == "clamped" else kind, more={"payload": room})
    for car in cars.values():
        if len(rope.end) == 3:
            car["bodies"]["body"]["turns"] = "universal"
    ropes: dict[str, Any] = {"cable": data["cable"]}
    if kind == "clamped":
        haul = {"mass_per_length": 0.3, "axial_stiffness": 0.3} | {"unstrained_length": 0.9995}
        data["cable"]["joint"] = "paper"
        beside = {**data["cable"], **{key: share * data["cable"][key] for key, share in haul.items()}}
        ropes = {"ropes": {"track": data["cable"], "haul": beside}}
        for car in cars.values():
            del car["joint"]
            car |= {"rope": "track", "clamped_to": {"haul": 0.9995 * car["arc_length"]}}
    solver = {"step": step, "spectral_radius": radius}
    scenario = {"gravity": GRAVITY, **ropes, "carriages": cars, "solver": solver}
    pushed = {}
    if kind == "free":  # as fast as it is after a fall by a third of its sag
        tension = solve(rope).tension(rope.places[0])
        sag = rope.length * (rope.loads[0] / 4.0 + rope.weight * rope.length / 8.0) / tension
        pushed = {"carriages.load_1.speed": float(np.sqrt(2.0 * GRAVITY * sag / 3.0))}
    return RandomSystem(name, scenario, pushed, tuple(cars))


def run(system: RandomSystem, start: str, duration: float = DURATION) -> Run:
    """Let a system go from rest, or after a push: half as heavy again from one instant to the next."""
    found = coarse = _run(system, start, duration)
    step = system.scenario["solver"]["step"]
    for times in (FINER, FINEST):
        if found.fault or found.passed:
            return found
        solver = {**system.scenario["solver"], "step": step / times}
        fine = _run(replace(system, scenario={**system.scenario, "solver": solver}), start, duration)
        limit = fine.gained - (coarse.gained - fine.gained) / (FINER**2 - 1.0)  # for steps towards 0
        found, coarse = replace(found, gained=max(limit, 0.0), fault=fine.fault), fine
    return found


def _run(system: RandomSystem, start: str, duration: float) -> Run:
    name = f"{system.name}, from {start}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of large bends, and of what may grow: this is what is tried
        try:
            scenario = load_scenario(system.scenario, system.pushed if start == "push" else {})
            simulation = Simulation(scenario, on_demand=True)
        except EquilibriumError as error:
            return Run(name, 0.0, 0.0, 0.0, 0.0, 0.0, str(error))
    if start == "push":
        for load in system.loads:
            simulation.payload(load, simulation.scenario.carriages[load].payload.capacity)
    fault, energies, kinetic = "", [simulation.energy().total], [0.0]
    scale = sum(abs(part) for part in (simulation.energy().elastic, simulation.energy().gravitational))
    with suppress(KeyboardInterrupt):
        for frame in range(1, round(duration / FRAME) + 1):
            try:
                simulation.advance_to(frame * FRAME)
            except SolverError as error:
                fault = str(error)
                break
            energy = simulation.energy()
            energies.append(energy.total)
            kinetic.append(energy.kinetic)
    gained, most = max(energies) - energies[0], max(kinetic)
    allowed = OF_KINETIC * most + ROUNDING * scale
    second = round(1.0 / FRAME) + 1
    later = max(energies[second:], default=-np.inf) - max(energies[:second])
    return Run(name, gained, allowed, most, energies[0] - energies[-1], later, fault)


def systems(count: int = COUNT) -> Iterator[RandomSystem]:
    """Light ropes under a large load, then random ones: `count` in all."""
    first = [
        light_rope(elements, place, dim) for dim in (2, 3) for place in (10.0, 40.0) for elements in (80, 100, 120)
    ]
    yield from first[:count]
    for seed in range(count - len(first)):
        yield drawn(seed)


@case("random ropes with loads", "no drive, no friction, no damping: energy is never gained", needs_jit=True, long=True)
def random_loads() -> Iterator[Result]:
    """Light ropes under a large load, and random ropes, from rest and after a push; no step fails."""
    chosen = [light_rope(elements, 10.0, dim) for dim in (2, 3) for elements in (80, 100, 120)]
    chosen += [drawn(seed) for seed in range(SAMPLE - len(chosen))]
    for start in STARTS:
        runs = [run(system, start, SAMPLE_DURATION) for system in chosen]
        failed = sum(bool(one.fault) for one in runs)
        yield Result(f"from {start}: runs that fail, of {len(runs)}", "-", 0.0, float(failed), 0.0)
        most = max(one.gained / one.allowed for one in runs)
        yield Result(
            f"from {start}: largest gain without the error of the step, over what is allowed",
            "-",
            0.0,
            max(most, 0.0),
            1.0,
        )


def main() -> int:
    """Run the command line: 1 when a system gains energy or fails."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.random_loads", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--count", type=int, default=COUNT, metavar="N", help=f"systems; default: {COUNT}")
    parser.add_argument(
        "--seconds", type=float, default=DURATION, metavar="S", help=f"of each run; default: {DURATION:g}"
    )
    parser.add_argument("--only", type=int, action="append", metavar="N", help="the random system of this number alone")
    options = parser.parse_args()
    if options.count < 1 or not options.seconds >= FRAME:
        parser.error(f"given {options.count} systems, {options.seconds:g} s; allowed: at least 1, at least {FRAME:g} s")
    chosen = [drawn(number) for number in options.only] if options.only else list(systems(options.count))
    begun, runs = time.perf_counter(), []
    for system in track(chosen, description="random loads", console=Console(stderr=True)):
        for start in STARTS:
            runs.append(run(system, start, options.seconds))
            one = runs[-1]
            if not one.passed or options.only:
                ratio = one.gained / max(one.kinetic, 1e-300)
                print(
                    f"{'kept' if one.passed else 'MISSED'}: {one.name}: gained {one.gained:.3g} J, {ratio:.2g} of the "
                    f"kinetic energy, {max(one.later, 0.0):.3g} J after the first second; allowed: "
                    f"{one.allowed:.3g} J; lost {one.lost:.3g} J {one.fault}",
                    flush=True,
                )
    failed, gaining = sum(bool(one.fault) for one in runs), sum(not one.passed and not one.fault for one in runs)
    print(
        f"{len(runs)} runs of {options.seconds:g} s in {time.perf_counter() - begun:.0f} s: "
        f"{failed} failed, {gaining} gained energy, {len(runs) - failed - gaining} kept it"
    )
    return int(failed + gaining > 0)


if __name__ == "__main__":
    sys.exit(main())
