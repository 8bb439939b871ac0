"""Plots of `review`: lines on one axis have values of similar size."""

import numpy as np
import pytest

pytest.importorskip("matplotlib")
import matplotlib.pyplot as plt

from cable_twin.frame.plotted_signals import ENDS_OF_LINES, LINES, SIGNALS
from cable_twin.offline.plots import MANY, PlottedRun, _panel, _panels, _time_plot
from cable_twin.offline.reporting.texts import Texts
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation


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


class Wave(Line):
    def __init__(self, size, mean=0.0):
        self.size, self.mean = size, mean

    def line(self):
        times = np.linspace(0.0, 10.0, 101)
        return times, self.mean + self.size * np.sin(times)


@pytest.mark.parametrize(("size", "fills"), [(4e-9, False), (4.0, True)])
def test_rounding_of_a_constant_force_does_not_fill_its_axis(size, fills):
    run = Run("contact_force/cabin")
    run.signals.series = {"contact_force/cabin": Wave(size, 100.0)}
    (panel,) = _panels([run], SIGNALS["contact_force"])
    _, axes = plt.subplots()
    _panel(axes, [PlottedRun("", "lift", "run", run.signals)], panel)
    low, high = axes.get_ylim()
    assert (high - low < 3.0 * size) == fills
    plt.close()


def test_a_panel_of_zeros_alone_is_left_out_unless_something_else_was_commanded():
    run = Run("speed/cabin", "commanded_speed/cabin")
    run.signals.series = {"speed/cabin": Wave(4e-12), "commanded_speed/cabin": Wave(1.0)}
    (panel,) = _panels([run], SIGNALS["speed"])
    assert len(panel.lines) == 2
    run.signals.series["commanded_speed/cabin"] = Wave(0.0)
    assert _panels([run], SIGNALS["speed"]) == []


def test_places_of_many_vehicles_which_fill_a_loop_at_all_times_are_left_out():
    places = [f"arc_length/chair_{number}" for number in range(MANY + 1)]
    assert len(_panels([Run(*places[:MANY])], SIGNALS["arc_length"])) == 1
    assert _panels([Run(*places)], SIGNALS["arc_length"]) == []


def test_legends_have_words_and_not_the_ends_of_names():
    run = Run("sheave_tension/drive_on", "sheave_tension/drive_off")
    (panel,) = _panels([run], SIGNALS["sheave_tension"])
    _, axes = plt.subplots()
    _panel(axes, [PlottedRun("", "lift", "run", run.signals)], panel)
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    assert shown == ["drive, incoming strand", "drive, outgoing strand"]
    assert SIGNALS["tension"].words("haul_1_highest") == "haul_1, highest"
    plt.close()


def test_lines_of_wind_and_of_the_tensions_of_one_rope_have_words_everywhere():
    """One source of legends, for plots, reports in any language, and rerun."""
    wind, tension = SIGNALS["wind"], SIGNALS["tension"]
    assert [wind.words(axis) for axis in "xyz"] == ["x, along", "y, from the right", "z, up"]
    assert [tension.words(name) for name in ("highest", "start", "end")] == ["highest", "at the start", "at the end"]
    assert wind.words("y", Texts("de")) == "y, von rechts"
    texts = Texts("de")
    for signal in SIGNALS.values():
        for line in (*ENDS_OF_LINES.get(signal.whose, {}), *LINES.get(signal.whose, {})):
            signal.words(line, texts)
    assert not texts.missing


def test_many_lines_are_a_band_with_those_by_name_that_reach_farthest():
    names = [f"contact_force/chair_{number}" for number in range(1, MANY + 4)]
    run = Run(*names)
    run.signals.series = {name: Wave(float(size)) for size, name in enumerate(names, start=1)}
    (panel,) = _panels([run], SIGNALS["contact_force"])
    _, axes = plt.subplots()
    _panel(axes, [PlottedRun("", "lift", "run", run.signals)], panel)
    last = names[-1].removeprefix("contact_force/")
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    assert shown == [f"all {len(names)}", f"{last}, highest", f"{last}, lowest"]
    (band,) = axes.collections
    heights = band.get_paths()[0].vertices[:, 1]
    assert heights.max() == pytest.approx(len(names), rel=1e-3)
    assert len(axes.get_lines()) == 2
    plt.close()


def test_long_names_of_several_runs_leave_the_axes_their_width_and_stay_in_the_picture():
    names = [f"contact_force/cabin_{number}" for number in range(1, MANY + 4)]
    runs = []
    for label in ("runs_of_the_gondola", "emergency_stop_from_there"):
        run = Run(*names)
        run.signals.series = {name: Wave(float(size)) for size, name in enumerate(names, start=1)}
        runs.append(PlottedRun(label, "gondola", "2026-11-28_17-07-14", run.signals))
    figure = _time_plot(runs, "Forces", _panels(runs, SIGNALS["contact_force"]))
    (axes,) = figure.axes
    figure.draw_without_rendering()
    assert axes.get_position().width > 0.8
    assert axes.get_legend().get_window_extent().x1 < figure.bbox.x1
    plt.close()


def test_tension_of_several_ropes_says_of_which():
    of_several = SIGNALS["tension"].names(Simulation(load_scenario("chairlift")).layout)
    assert of_several == ["up_highest", "down_highest"]
    assert SIGNALS["tension"].names(Simulation(load_scenario("single_span")).layout) == ("highest", "start", "end")
