"""Rests that the usual search misses: a cabin just on a sheave, and slack carriers that roll far along their rope."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.mechanics.solution import equilibrium
from cable_twin.mechanics.solution.relaxation import Relaxed
from cable_twin.scenario import load_scenario
from cable_twin.simulation import EquilibriumError, Simulation
from verification import JIT

THICK = {"mass_per_length": 56.885, "axial_stiffness": 587.005e6, "bending_stiffness": 274664.0, "diameter": 0.123}
pytestmark = pytest.mark.skipif(not JIT, reason="minutes without compilation")


def thick(length, first, mass=48.0e3):
    """Gondola with a rope of 123 mm, `length` (m) of each strand, the first cabin at `first` (m), mass in kg."""
    rope = {**THICK, "breaking_force": 9561530.0, "unstrained_length": length}
    changes = {f"ropes.{strand}.{key}": value for strand in ("up", "down") for key, value in rope.items()}
    changes |= {"carriers.first": first, "sheaves.return.counterweight.mass": mass}
    return Simulation(load_scenario("gondola", changes), on_demand=True)


def moved(lift):
    """Largest displacement (m) of the rope within the first half second."""
    before = [state.nodes.position[:, 0].copy() for state in lift.engine.states]
    lift.advance_to(0.5)
    pairs = zip(lift.engine.states, before, strict=True)
    return max(float(np.abs(state.nodes.position[:, 0] - was).max()) for state, was in pairs)


@pytest.mark.parametrize(
    ("length", "first", "mass"),
    [
        pytest.param(1254.97, 35.02, 48299.0, id="strand by itself"),
        pytest.param(1256.05, 87.17, 48372.0, id="strands over their bullwheels"),
    ],
)
def test_a_lift_rests_with_a_cabin_on_a_sheave(length, first, mass):
    """Its forces are those of the cabins half a metre farther, and nothing jumps when it begins to run."""
    lift, beside = thick(length, first, mass), thick(length, first + 0.5, mass)
    tensions = [one.snapshot.cable.tensions for one in (lift, beside)]
    assert tensions[0] == pytest.approx(tensions[1], rel=0.03)
    assert moved(lift) < 2e-3


@pytest.mark.parametrize(("ropes", "stiffness"), [("haul", 20e6), ("track", 170e6)])
def test_slack_carriers_of_soft_ropes_roll_to_their_places(ropes, stiffness):
    """Half as stiff a rope is more than a metre longer at its loose end; carriers hold it as they would else."""
    changes = {f"ropes.{ropes}_{side}.axial_stiffness": stiffness for side in ("up", "down")}
    lift = Simulation(load_scenario("bicable", changes), on_demand=True)
    forces = lift.snapshot.columns.connector_force
    assert forces.min() > 300.0
    assert forces.max() < 2000.0
    assert moved(lift) < 2e-3


def test_a_search_that_failed_leaves_clamps_to_those_after_it(monkeypatch):
    """Each iteration that goes too far halves what later ones close of a clamp's gap at once, at last to nothing."""
    lift = Simulation(load_scenario("jig_back"), on_demand=True)
    found, closing = lift.snapshot.numbers.tobytes(), lift.engine._ropes.scratch.closing
    elements, search = sum(len(state.nodes.position) - 1 for state in lift.engine.states), equilibrium.relax_in_parts

    def fails(relax, count, *begin):
        if count < elements:
            return search(relax, count, *begin)
        closing[:] = 0.0
        return Relaxed(False, 1, 1.0)

    with monkeypatch.context() as patched:
        patched.setattr(equilibrium, "relax_in_parts", fails)
        with pytest.raises(EquilibriumError, match="of the ropes together"):
            lift.with_values(lift.scenario)
    assert closing[0] > 0.0
    assert lift.with_values(lift.scenario).snapshot.numbers.tobytes() == found
