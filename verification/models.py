"""Common models and measures of the cases in motion."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from typing import Any

import numpy as np

from cable_twin.mechanics.language.declared import write
from cable_twin.mechanics.solution.equations_of_motion import solve_accelerations
from cable_twin.mechanics.state import State, Workspace, allocate_workspace
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import Simulation

GRAVITY = 9.81  # m/s^2


def seed(**overrides: Any) -> Simulation:
    """The example of the paper; `cable__elements=96` overrides `cable.elements`."""
    return Simulation(
        load_scenario("seed_example", {key.replace("__", "."): value for key, value in overrides.items()})
    )


def beam(
    *,
    length: float,
    mass_per_length: float,
    axial: float,
    bending: float,
    elements: int,
    end: tuple[float, float] | None = None,
    supports: tuple[str, str] = ("pinned", "free"),
    shape: str = "straight",
    damping_time: float = 0.0,
    gravity: float = GRAVITY,
    carriages: dict[str, Any] | None = None,
    loads: list[dict[str, Any]] | None = None,
    cable: dict[str, Any] | None = None,
    air: dict[str, Any] | None = None,
    terrain: list[list[float]] | None = None,
    **solver: Any,
) -> Simulation:
    """A cable from the origin, by default unstrained and level, pinned at its start and free at its end.

    `cable` has what else its section of the scenario is to hold.
    """
    place = (length, 0.0) if end is None else end
    return Simulation(
        load_scenario(
            {
                "gravity": gravity,
                "cable": {
                    "unstrained_length": length,
                    "mass_per_length": mass_per_length,
                    "axial_stiffness": axial,
                    "bending_stiffness": bending,
                    "elements": elements,
                    "damping_time": damping_time,
                    "initial_shape": shape,
                    "start": {"position": [0.0, 0.0], "support": supports[0]},
                    "end": {"position": list(place), "support": supports[1]},
                    "loads": loads or [],
                    **(cable or {}),
                },
                "air": air or {},
                "terrain": terrain or [],
                "carriages": carriages or {},
                "solver": solver,
            }
        )
    )


def moving_scenario(
    *,
    unstrained_length: float,
    end: tuple[float, float],
    mass_per_length: float = 5.0,
    axial: float = 1e7,
    bending: float = 0.0,
    elements: int = 40,
    damping_time: float = 0.0,
    gravity: float = GRAVITY,
    cable: dict[str, Any] | None = None,
    limits: dict[str, float] | None = None,
    carriages: dict[str, Any] | None = None,
    carriers: dict[str, Any] | None = None,
    **solver: Any,
) -> Scenario:
    """A cable from the origin that moves along itself, pinned at both ends; its drive is `haul_rope`."""
    return load_scenario(
        {
            "gravity": gravity,
            "cable": {
                "unstrained_length": unstrained_length,
                "mass_per_length": mass_per_length,
                "axial_stiffness": axial,
                "bending_stiffness": bending,
                "elements": elements,
                "damping_time": damping_time,
                "start": {"position": [0.0, 0.0]},
                "end": {"position": list(end)},
                **(cable or {}),
            },
            "drives": {"haul_rope": {"kind": "moving_cable", "limits": limits or {}}},
            "carriages": carriages or {},
            "carriers": carriers,
            "solver": solver,
        }
    )


def moving(**changes: Any) -> Simulation:
    """The cable of `moving_scenario`."""
    return Simulation(moving_scenario(**changes))


def chairlift(**changes: Any) -> Simulation:
    """One span of 800 m with a rise of 200 m, chairs of 500 kg every 62 m: 13 or 14 of 27 on it."""
    chair = {"mass": 500.0, "inertia": 200.0, "upper_pivot": [0.0, 2.5]}
    lift: dict[str, Any] = {
        "unstrained_length": 838.0,
        "end": (800.0, 200.0),
        "mass_per_length": 6.6,
        "axial": 70e6,
        "bending": 3e3,
        "elements": 80,
        "damping_time": 0.004,
        "limits": {"speed": 2.5, "acceleration": 0.15, "jerk": 0.3, "emergency_deceleration": 1.2},
        "carriers": {"name": "chair", "count": 27, "spacing": 62.0, "bodies": {"chair": chair}},
        "step": 0.01,
    }
    return moving(**(lift | changes))


@contextmanager
def changing(simulation: Simulation) -> Iterator[State]:
    """Context of a writable copy of the state, restored at its end."""
    full = simulation.capture()
    yield full.state
    simulation.restore(full)


@lru_cache(maxsize=1)
def _room(simulation: Simulation) -> tuple[State, Workspace]:
    """State and workspace for all calls of kernels, as passing new ones takes milliseconds."""
    return simulation.capture().state, allocate_workspace(simulation.system)


def for_kernels(simulation: Simulation) -> tuple[State, Workspace]:
    """Copy of the present state and a workspace, valid until the next call."""
    state, work = _room(simulation)
    write(simulation.state, state)
    return state, work


def start_moving(simulation: Simulation) -> None:
    """Give the start the accelerations that belong to it, and have the first step use them as all others do."""
    with changing(simulation) as state:
        assert solve_accelerations(simulation.system, state, 0.0, allocate_workspace(simulation.system))
        state.nodes.algorithmic[:] = state.nodes.acceleration
        state.bodies.algorithmic[:] = state.bodies.acceleration
        state.newton_ratio[0] = np.inf


def pendulum(
    body: dict[str, Any], swing: float, *, axial: float = 1e8, step: float = 1e-3, **solver: Any
) -> Simulation:
    """A body on an arm above its centre, fixed to a taut rope at 5 m of 10, put aside by `swing` (rad) and at rest."""
    simulation = beam(
        length=10.0,
        mass_per_length=0.01,
        axial=axial,
        bending=1.0,
        elements=10,
        end=(10.05, 0.0),
        supports=("pinned", "pinned"),
        shape="equilibrium",
        carriages={"car": {"arc_length": 5.0, "joint": "fixed", "bodies": {"body": body}}},
        step=step,
        **solver,
    )
    joint_x, _, joint_z = simulation.snapshot.carriages["car"].position
    arm = body["upper_pivot"][1]
    # the pivot is at the centre of mass plus (sin, cos) of the pitch times the arm
    with changing(simulation) as state:
        state.bodies.position[0] = [joint_x - arm * np.sin(swing), joint_z - arm * np.cos(swing), swing]
    return simulation


def observed_order(errors: list[float], ratio: float = 2.0) -> float:
    """Order of convergence from the last two errors, of steps or elements that differ by `ratio`."""
    return float(np.log(errors[-2] / errors[-1]) / np.log(ratio))
