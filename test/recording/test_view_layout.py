"""How the picture is laid out: numbers on every axis, names that do not meet, vehicles that can be seen."""

import numpy as np
import pytest

pytest.importorskip("rerun")

from drawn_run import draw, rerun_command
from rerun.chunk import RrdReader

from cable_twin.recording.view_layout import MOST_TICKS, TICKS, with_ticks
from cable_twin.recording.view_scene import LETTER, name_rows


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
