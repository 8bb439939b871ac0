"""The plots of `review`: what shares an axis is of one size."""

import numpy as np

from cable_twin.offline.plots import _panels
from cable_twin.plotted_signals import SIGNALS


class Line:
    def line(self):
        return np.array([0.0, 1.0]), np.array([1.0, 2.0])


class Signals:
    def __init__(self, *names):
        self.series = {name: Line() for name in names}


class Run:
    def __init__(self, *names):
        self.signals = Signals(*names)


def test_towers_are_not_on_the_axis_of_the_ends_which_bear_ten_times_as_much():
    runs = [Run("support_force/start", "support_force/end", "support_force/tower_1", "support_force/tower_2")]
    ends, towers = _panels(runs, SIGNALS["support_force"])
    assert [name for _, name in ends.lines] == ["support_force/start", "support_force/end"]
    assert [name for _, name in towers.lines] == ["support_force/tower_1", "support_force/tower_2"]
    assert (ends.label, towers.label) == ("support on rope", "tower on rope")
    (alone,) = _panels([Run("support_force/start")], SIGNALS["support_force"])
    assert alone.label == "support on rope"
    assert _panels(runs, SIGNALS["tension"]) == []
