"""Measured scenarios: the example of the paper, and a rope of 1 km with many carriages."""

from __future__ import annotations

from typing import Any

from cable_twin.scenario import Scenario, load_scenario

SPAN = 1000.0  # m
ROPE_LENGTH = 1002.0  # m, unstrained: a sag of about 4 % of the span under its carriages


def seed_example(elements: int, **solver: Any) -> Scenario:
    """The example of the paper on a mesh of `elements`; `solver` overrides its integration, as `step=0.001` (s)."""
    return load_scenario(
        "seed_example", {"cable.elements": elements, **{f"solver.{key}": value for key, value in solver.items()}}
    )


def ropeway(elements: int, carriages: int, **solver: Any) -> Scenario:
    """A level span of 1 km with `carriages` that hang along it and slide freely, all numbers assumed.

    A rope of 10 kg/m and 190 MN carries 5 t in all, in equal carriages, each a single body that swings 3 m below the
    rope; none starts where it would rest. No friction and no damping, so that two programs have the same equations.
    """
    mass = 5000.0 / carriages
    return load_scenario(
        {
            "name": f"ropeway, {elements} elements, {carriages} carriages",
            "cable": {
                "unstrained_length": ROPE_LENGTH,
                "mass_per_length": 10.0,
                "axial_stiffness": 1.9e8,
                "bending_stiffness": 5000.0,
                "elements": elements,
                "start": {"position": [0.0, 0.0]},
                "end": {"position": [SPAN, 0.0]},
            },
            "carriages": {
                f"carriage_{index + 1}": {
                    "arc_length": ROPE_LENGTH * (0.04 + 0.9 * (index + 0.3) / carriages),
                    "bodies": {"cabin": {"mass": mass, "inertia": mass, "upper_pivot": [0.0, 3.0]}},
                }
                for index in range(carriages)
            },
            "solver": {"step": 0.01, **solver},
        }
    )
