"""Labels of the view without overlap on a screen of 1280 x 800, in a plane and in space."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

pytest.importorskip("rerun")

from drawn_run import column, static

from cable_twin.recording.run import open_view
from cable_twin.scenario import load_scenario, scenario_names
from cable_twin.simulation import Simulation
from cable_twin.view.labels import apart, label_sizes
from cable_twin.view.space import Lens

NARROWER = 0.95  # times the width that is reckoned with: as rerun draws them at least
IN_SPACE = {"space": 3}


def overlapping(boxes):
    """Pairs of names whose boxes (name, middle, top, width, height) share some of the screen."""
    return [
        (one[0], other[0])
        for one, other in combinations(boxes, 2)
        if abs(one[1] - other[1]) < (one[3] + other[3]) / 2.0
        and one[2] < other[2] + other[4]
        and other[2] < one[2] + one[4]
    ]


def boxes(names, tops):
    """Boxes of labels by name, below points (n, 2) in pixels."""
    sizes = label_sizes(names) * (NARROWER, 1.0) - (0.0, 1.0)
    return [(name, *top, *size) for name, top, size in zip(names, tops, sizes, strict=True)]


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        *((name, {}) for name in scenario_names()),
        ("chairlift", IN_SPACE),
        pytest.param("gondola", IN_SPACE, marks=pytest.mark.long),
    ],
    ids=lambda value: value if isinstance(value, str) else "space" if value else "shipped",
)
def test_no_label_of_a_shipped_scenario_covers_another(tmp_path, name, changes):
    scenario = load_scenario(name, changes)
    snapshot = Simulation(scenario).snapshot
    path = tmp_path / "run.rrd"
    view = open_view(scenario, path)
    view.log(snapshot)
    view.close()
    picture = view._picture
    framed, (width, height) = picture._framed, picture._sizes.track
    assert (framed.high - framed.low <= framed.pixel * np.array([width, height]) * 1.01).all()  # it is all in sight

    shown = boxes(static(path, "/track/names", "Points2D:labels"), on_screen(path, "/track/names", framed.pixel))
    legend = [label for labels in column(path, "/track/tension_colors", "Points2D:labels")[1][:1] for label in labels]
    shown += boxes(legend, moving(path, "/track/tension_colors", framed.pixel))
    shown += boxes(
        static(path, "/track/vehicle_names", "Points2D:labels"), moving(path, "/track/vehicle_names", framed.pixel)
    )
    assert len(shown) > len(legend)
    assert overlapping(shown) == []

    places = np.array(static(path, "/space/names", "Points3D:positions"))
    assert bool(len(places)) is snapshot.layout.space or not len(places) or scenario.ropes
    if len(places):
        lens = Lens.of(picture._space.overview, height)
        shown = boxes(static(path, "/space/names", "Points3D:labels"), lens.seen(places)[0])
        assert overlapping(shown) == []
        for _, middle, top, wide, high in shown:
            assert abs(middle) + wide / 2.0 < width / 2.0
            assert -height / 2.0 < top < top + high < height / 2.0

    for signal, cell in zip(picture._plots.signals, cells(picture), strict=True):
        names = static(path, f"/legends/{signal}", "Points2D:labels")
        shown = boxes(names, static(path, f"/legends/{signal}", "Points2D:positions") if names else [])
        assert overlapping(shown) == []
        assert all(0.0 <= middle - wide / 2.0 < middle + wide / 2.0 <= cell[0] for _, middle, _, wide, _ in shown)


def cells(picture):
    first = sum(picture._sizes.rows) - len(picture._plots.signals)
    return [picture._sizes.cell(first + number) for number in range(len(picture._plots.signals))]


def on_screen(path, entity, pixel):
    return np.array(static(path, entity, "Points2D:positions")).reshape(-1, 2) / pixel


def moving(path, entity, pixel):
    places = column(path, entity, "Points2D:positions")[1][:1]
    return np.array(places).reshape(-1, 2) / pixel


def test_names_of_vehicles_that_meet_stand_above_each_other():
    anchors = np.array([[[0.0, 50.0], [400.0, 50.0]], [[200.0, 50.0], [201.0, 55.0]]])  # two frames
    sizes = label_sizes(["cabin_1", "cabin_2"])
    placed = apart(anchors, sizes)
    np.testing.assert_array_equal(placed[0], anchors[0])
    np.testing.assert_array_equal(placed[1], [[200.0, 55.0 + sizes[1, 1]], [201.0, 55.0]])


def test_only_neighbours_on_a_slope_share_rows_and_what_is_taken_stays():
    anchors = np.column_stack([50.0 * np.arange(8), -10.0 * np.arange(8)])
    sizes = np.full((8, 2), (60.0, 20.0))
    placed = apart(anchors, sizes)
    assert (placed[:, 1] - anchors[:, 1] <= 40.0).all()
    again = apart(anchors, sizes, taken=np.array([[100.0, -25.0, 60.0, 20.0]]))
    for row in again:
        assert abs(row[0] - 100.0) >= 60.0 or row[1] >= -5.0 or row[1] + 20.0 <= -25.0
    lost = anchors.copy()
    lost[3] = np.nan
    assert np.isnan(apart(lost, sizes)[3]).all()
