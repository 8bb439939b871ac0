"""Cases of grooves: what a tower bears sideways of a rope bent in plan and in wind, and when the rope comes out."""

from __future__ import annotations

from collections.abc import Iterator
from math import asin, hypot, sin, sqrt
from typing import Any

import numpy as np

from cable_twin.mechanics.solution.catenary import rest_over_supports
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import Result, case
from verification.models import GRAVITY

HALF = 100.0  # m, of each of two level spans
DRAG = 0.5 * 1.225 * 1.2 * 0.05  # kg/m², of the rope below


def over_a_tower(aside: float, height: float, *, wind: float = 0.0, **tower: Any) -> Simulation:
    """Two spans over a tower in their middle, `aside` (m) of the line of both ends, at rest in a wind across (m/s)."""
    rope = {
        "unstrained_length": 200.3,
        "mass_per_length": 5.0,
        "axial_stiffness": 2e7,
        "bending_stiffness": 10.0,
        "diameter": 0.05,
        "elements": {"target": 4.0, "at_towers": 0.5, "growth": 1.5},
        "start": {"position": [0.0, 0.0, 0.0]},
        "end": {"position": [2.0 * HALF, 0.0, 0.0]},
    }
    one = {"position": [HALF, aside, height], "stiffness": 1e7, "groove": 200.0, "groove_height": 0.05, **tower}
    air = {"wind": [0.0, wind, 0.0]}
    return Simulation(load_scenario({"cable": rope, "towers": {"tower": one}, "air": air, "solver": {"step": 0.002}}))


@case(
    "groove of a rope bent in plan",
    "2 T sin(δ/2) sideways, of T level; Irvine's catenaries on both sides for T and the normal force",
    needs_jit=True,
)
def bent_in_plan() -> Iterator[Result]:
    """Three angles in plan, and a groove that leans as the force does, in which nothing is left sideways."""
    for aside in (1.0, 2.0, 4.0):
        simulation = over_a_tower(aside, 2.0)
        tower = simulation.snapshot.supports["tower"].tower
        assert tower is not None
        place = simulation.cable_positions(simulation.state.contact_arc_length)  # a little off the top
        system = simulation.system
        rest = rest_over_supports(system._replace(towers=system.towers._replace(top=place)))
        level, load = float(rest.pull[0, 0]), rest.load()[0]
        turn = 2.0 * asin(float(place[0, 1]) / hypot(HALF, float(place[0, 1])))
        label = f"{1e3 * turn:.3g} mrad in plan"
        side = 2.0 * level * sin(0.5 * turn)
        yield Result(f"side force, {label}", "N", side, tower.lateral_force, 2e-3 * side)
        yield Result(f"ratio, {label}", "-", side / float(load[2]), tower.lateral_ratio, 2e-3 * side / float(load[2]))
    leaning = over_a_tower(4.0, 2.0, groove_direction=load.tolist()).snapshot.supports["tower"].tower
    assert leaning is not None
    yield Result("ratio, in a groove that leans like the force", "-", 0.0, leaning.lateral_ratio, 2e-3)


@case(
    "derailment in a wind across",
    "ratio q / w of drag and weight; out beyond v = √(ratio w / ½ρ c_d d)",
    needs_jit=True,
)
def wind_across() -> Iterator[Result]:
    """Level spans, whose tower bears half the load of each: at rest in its wind, the rope stays or is out at once."""
    weight, allowed = 5.0 * GRAVITY, 0.5
    ratio = over_a_tower(0.0, 0.0, wind=15.0).snapshot.supports["tower"].tower
    assert ratio is not None
    expected = DRAG * 15.0**2 / weight
    yield Result("ratio at 15 m/s", "-", expected, ratio.lateral_ratio, 3e-3 * expected)
    limit = sqrt(allowed * weight / DRAG)
    for share, out in ((0.99, 0), (1.01, 1)):
        simulation = over_a_tower(0.0, 0.0, wind=-share * limit, derailment_ratio=allowed)
        snapshot = simulation.advance_to(1.0)
        yield Result(f"towers out at {100 * share:.0f} % of that wind", "-", out, len(snapshot.derailments), 0.0)
    (one,) = snapshot.derailments
    yield Result("time of that", "s", simulation.step, one.time, 1e-12)
    tension = float(np.linalg.norm(snapshot.supports["tower"].force))
    yield Result("force of the tower after it", "N", 0.0, tension, 0.0)
