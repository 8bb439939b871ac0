"""Layout of the picture: numbers on every axis, visible vehicles."""

import subprocess
import warnings

import numpy as np
import pytest

pytest.importorskip("rerun")

from bags import RERUN, rerun_command
from drawn_run import OUTLINES, column, draw, snapshot_at
from rerun.chunk import RrdReader
from twin_process import wait_until

from cable_twin.view.picture import HEIGHT, WIDTH, _plot_view, divided, table_columns
from cable_twin.view.plots import TICKS, LiveAxis, with_ticks
from cable_twin.view.rerun_view import RerunView
from cable_twin.view.web_view import free_port

HEIGHTS = (60.0, 110.0, 175.0, 400.0)  # pixels
PALE = 20.0  # pixels between two numbers, below which rerun writes none: its own


def written(low, high, height):
    """Tick labels of an axis in multiples of the smallest power of ten that fits, as by rerun."""
    step = 10.0 ** np.ceil(np.log10(PALE * (high - low) / height))
    return np.arange(np.ceil(low / step), np.floor(high / step) + 1) * step


@pytest.mark.parametrize("height", HEIGHTS)
@pytest.mark.parametrize("span", [*np.geomspace(1e-3, 1e6, 46), 0.0])
@pytest.mark.parametrize("low", [0.0, -0.7, 12.3, 1305.0])
def test_every_axis_has_three_numbers_and_all_that_is_plotted(low, span, height):
    first, last = with_ticks(low, low + span, "m/s", height)
    assert first <= low <= low + span <= last
    assert TICKS <= len(written(first, last, height)) <= height / PALE + 1
    assert low < 0.0 or not span or first > -0.5 * (last - first)  # little of it is below 0


@pytest.mark.parametrize(("unit", "least"), [("m/s", 0.1), ("deg", 0.1), ("m", 0.01), ("kN", 0.1), ("N", 1.0)])
def test_what_rests_is_a_line_and_no_noise(unit, least):
    low, high = with_ticks(-1e-9, 2e-9, unit, 110.0)
    assert least <= high - low <= 10.0 * least
    assert with_ticks(0.0, 0.0, unit, 110.0)[0] == pytest.approx(-with_ticks(0.0, 0.0, unit, 110.0)[1])


def test_a_live_axis_has_three_numbers_at_any_time_and_follows_what_is_in_sight():
    axis, sent = LiveAxis("kN", 110.0, 30.0), []
    rng = np.random.default_rng(5)
    for time in np.arange(0.0, 300.0, 0.2):
        level = 20.0 if time < 100.0 else 20.4 if time < 200.0 else 2000.0
        low = level * (1.0 + 0.02 * rng.random())
        sent.append((time, *axis.fitted(time, low, 1.01 * low)))
        seen = [one for one in sent if one[0] >= time - 30.0]
        low, high = min(one[1] for one in seen), max(one[2] for one in seen)
        margin = 0.05 * (high - low)  # rerun's
        assert len(written(low - margin, high + margin, 110.0)) >= TICKS
    assert sent[400][2] - sent[400][1] < 5.0
    assert sent[-1][1] > 100.0
    assert axis.fitted(0.0, 1.0, 2.0)[1] < 10.0  # time goes back with a reset


def test_the_picture_fills_the_screen_and_the_readout_has_room_for_its_table():
    text = "## lift\n| time | 1.00 s |\n| :-- | --: |\n| rollers_2_haul_down | **134.8 kN** |"
    assert table_columns(text) == (19, 10)
    sizes = divided(9, space=True, table=(19, 10))
    assert sizes.rows == (3, 3, 3)
    assert sizes.main + sizes.side == WIDTH
    assert sizes.side > 19 * 6.4 + 10 * 6.4 + 30.0
    assert 4 * sizes.row < HEIGHT
    assert divided(0, space=False, table=(4, 10)).rows == (0,)
    assert divided(1, space=False, table=(400, 10)).side == WIDTH / 3.0


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
    whole = _plot_view("plots/speed", "Speed [m/s]", 0, (260.0, 150.0), None, None)
    assert "VisibleTimeRanges" not in whole.properties
    live = _plot_view("plots/speed", "Speed [m/s]", 0, (260.0, 150.0), 30.0, None)
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
