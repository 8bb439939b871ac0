"""Commanded speeds beside the driven ones: over time, and bounded while time stands."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.recording.view_plots import CommandedSpeeds
from cable_twin.records import AppliedCommand, Command

NAMES = ["cabin", "load"]


def note(commanded, *given):
    for time, kind, values in given:
        commanded.note(AppliedCommand(time, Command(kind, values), "test"))


def test_each_command_holds_from_its_time_on():
    commanded = CommandedSpeeds()
    note(commanded, (0.0, "speed", {"cabin": 2.0}), (0.2, "speed", {"load": 1.0}), (0.2, "force", {"cabin": 9.0}))
    note(commanded, (0.4, "wind", {"x": 1.0, "z": 0.0}), (0.6, "emergency_stop", {}), (0.8, "release", {}))
    speeds = commanded.at(np.array([0.0, 0.1, 0.2, 0.4, 0.6]), NAMES)
    np.testing.assert_array_equal(speeds, [[2.0, np.nan], [2.0, np.nan], [np.nan, 1.0], [np.nan, 1.0], [0.0, 0.0]])
    assert np.isnan(commanded.at(np.array([0.8]), NAMES)).all()


@pytest.mark.parametrize("count", [1, 10_000])
def test_a_paused_twin_that_is_commanded_on_and_on_remembers_what_it_comes_to(count):
    commanded = CommandedSpeeds()
    for number in range(count):
        note(commanded, (5.0, "speed", {"cabin": float(number)}))
    assert len(commanded._waiting) == 1
    np.testing.assert_array_equal(commanded.at(np.array([5.0]), ["cabin"]), [[count - 1.0]])
