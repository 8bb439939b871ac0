"""Rails of stations, which hand the weight of a carrier with a detachable grip over to its rope and take it back."""

import numpy as np
import pytest
from strands import one_strand
from test_scenario_faults import faults_of

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

RAILS = 12.0  # m
PLACE = 4.0  # m, of a carrier from the end of its rope


def share(distance):
    """Share of the weight that rails carry, at a distance (m) from the end: half in the middle of them."""
    u = distance / RAILS
    return 1.0 - 10.0 * u**3 + 15.0 * u**4 - 6.0 * u**5


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("name", ["gondola", "one strand of it"])
def test_a_rope_at_rest_bears_what_rails_leave_it(name, space):
    scenario = "gondola" if name == "gondola" else one_strand("gondola")
    simulation = Simulation(
        load_scenario(scenario, {"carriers.station_rails": RAILS, "carriers.first": PLACE, "space": space})
    )
    columns, rope = simulation.snapshot.columns, next(iter(simulation.parts.values())).system
    carriages, length = rope.carriages, rope.cable.unstrained_length
    on = np.flatnonzero(columns.attached == 1.0)
    weights = 9.81 * np.add.reduceat(carriages.mass, carriages.body_offset[:-1])
    ends = np.minimum(columns.arc_length, length - columns.arc_length)
    left = np.where(ends < RAILS, 1.0 - share(np.minimum(ends, RAILS)), 1.0)
    assert 0.0 < left[on].min() < 0.3  # one is on the rails
    np.testing.assert_allclose(columns.contact_force[on, 2], (left * weights)[on], rtol=1e-6)


def test_a_cabin_that_comes_to_the_end_at_full_speed_is_not_thrown_up():
    """Without rails it is a mass that moves over a held point: 24 kN for a weight of 15.7 kN on the last metre."""
    simulation = Simulation(load_scenario("gondola", {"drives.haul_rope.speed": 6.0}))
    most, length = 0.0, simulation.parts["up"].system.cable.unstrained_length
    for step in range(1, 3001):
        columns = simulation.advance_to(0.01 * step).columns
        near = (columns.attached == 1.0) & (columns.vehicle_rope == 0.0) & (columns.arc_length > length - 2.0)
        most = max(most, np.linalg.norm(columns.contact_force[near], axis=1).max(initial=0.0))
    assert 100.0 < most < 0.8 * 1600.0 * 9.81


def test_tracks_have_rails_of_their_own():
    (fault,) = faults_of("bicable", {"carriers.station_rails": 5.0})
    assert "carriers.station_rails: given 5.0 m: the tracks have rails" in fault
