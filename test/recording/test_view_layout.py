"""How the picture is laid out: numbers on every axis, names that do not meet, vehicles that can be seen."""

import subprocess
import warnings

import numpy as np
import pytest

pytest.importorskip("rerun")

from drawn_run import OUTLINES, RERUN, column, draw, rerun_command, snapshot_at
from rerun.chunk import RrdReader
from twin_process import wait_until

from cable_twin.recording.rerun_view import RerunView
from cable_twin.recording.view_layout import MOST_TICKS, TICKS, _plot_view, with_ticks
from cable_twin.recording.view_scene import LETTER, name_rows
from cable_twin.recording.web_view import free_port


def written(low, high):
    """Multiples of the smallest power of ten for which an axis has room: what rerun writes beside it."""
    step = 10.0 ** np.ceil(np.log10((high - low) / MOST_TICKS / 1.25))
    return np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step


@pytest.mark.parametrize("span", [*np.geomspace(1e-3, 1e6, 61), 0.0])
@pytest.mark.parametrize("low", [0.0, -0.7, 12.3, 1305.0])
def test_every_axis_has_four_numbers_and_all_that_is_plotted(low, span):
    first, last = with_ticks(low, low + span)
    assert first <= low <= low + span <= last
    assert TICKS <= len(written(first, last)) <= 1.25 * MOST_TICKS + 1


def test_names_of_supports_do_not_meet():
    names = ["start", "tower_1", "tower_2", "end"]
    places = np.array([0.0, 0.03, 0.5, 0.52])
    rows = name_rows(places, names)
    np.testing.assert_array_equal(rows, [0.0, 1.0, 0.0, 1.0])
    np.testing.assert_array_equal(name_rows(places[::-1], names[::-1]), rows[::-1])
    apart = LETTER * 12
    np.testing.assert_array_equal(name_rows(np.arange(4) * apart, names), 0.0)


def test_a_box_stands_for_the_cabin_in_the_overview_and_legends_are_beside_the_plots(tmp_path):
    path = tmp_path / "run.rrd"
    draw(path, 60)
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert "/track/carriages/cabin/(box)" in {entity.replace("\\", "") for entity in entities}
    assert {"/legends/speed", "/legends/tension", "/legends/swing"} <= entities
    blueprint = rerun_command("rrd", "print", "-vvv", path)
    assert "- /track/carriages/cabin/\\(box\\)" in blueprint  # not in the close-up, where the cabin itself is
    assert "/legends/speed" in blueprint


def test_plots_show_the_last_seconds_up_to_the_cursor_or_the_whole_run():
    whole = _plot_view("plots/speed", "Speed [m/s]", [1], None, None)
    assert "VisibleTimeRanges" not in whole.properties
    live = _plot_view("plots/speed", "Speed [m/s]", [1], 30.0, None)
    (axis,) = live.properties["TimeAxis"].view_range.as_arrow_array().to_pylist()
    ((shown,),) = [live.properties["VisibleTimeRanges"].ranges.as_arrow_array().to_pylist()]
    assert axis == shown["range"]
    assert axis["start"] == -30_000_000_000  # ns
    assert 0 < axis["end"] < 2_000_000_000  # the future is not half of it


@pytest.mark.long
def test_a_late_viewer_is_sent_a_bounded_past_and_the_numbers_of_the_colours(tmp_path):
    port, late = free_port(), tmp_path / "late.rrd"
    view = RerunView("test ropeway", OUTLINES, path=None, live=True, live_port=port)
    for moment in np.arange(400) * 0.1:  # s
        view.log(snapshot_at(moment, samples=4000))
    view.flush()
    viewer = subprocess.Popen(
        [RERUN, view.url, "--port", "auto", "--save", late], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )

    def times(entity, component):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # the file is not finished
            try:
                return column(late, entity, component)[0]
            except (OSError, RuntimeError, ValueError):  # it is being written, and ends within a message
                return []

    try:
        drawn = lambda: times("/track/rope", "LineStrips2D:strips")  # noqa: E731
        wait_until(lambda: len(drawn()) and drawn()[-1] > 39.0, what="a picture of the last second")
        assert drawn()[0] > 5.0  # not all 40 s, which were 13 MB
        assert len(times("/track/tension_colors", "Points2D:labels"))
    finally:
        viewer.kill()
        viewer.wait()
        view.close()
