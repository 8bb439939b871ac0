"""Highest and least forces of ropes on supports over frames and load cases."""

import json

import numpy as np

from cable_twin.offline.envelopes.ranges import Ranges, SupportForces, ranges_of_plain, united


def test_forces_are_those_of_the_highest_and_of_the_least_load():
    forces = SupportForces(2)
    for down, up in ((3.0, 1.0), (2.0, np.nan), (5.0, 4.0)):
        forces.take(np.array([[1.0, 0.0, down], [0.0, 0.0, up]]))
    np.testing.assert_array_equal(forces.most, [[-1.0, 0.0, -5.0], [0.0, 0.0, -4.0]])
    np.testing.assert_array_equal(forces.least, [[-1.0, 0.0, -2.0], [0.0, 0.0, -1.0]])


def test_least_forces_are_united_and_read_back():
    cases = [Ranges({}, {"towers.t": np.array([0.0, 0.0, -3.0 * one])}, {"towers.t": np.array([one, 0.0, 0.0])})
             for one in (2.0, 1.0)]  # fmt: skip
    found = united(cases)
    assert (found.forces["towers.t"][2], found.least_forces["towers.t"][0]) == (-6.0, 1.0)
    plain = json.loads(json.dumps(found.plain()))
    assert ranges_of_plain(plain).least_forces["towers.t"].tolist() == [1.0, 0.0, 0.0]
    del plain["least_forces"]  # of an earlier version
    assert ranges_of_plain(plain).least_forces == {}
