"""Picture of carriers, drawn together, and of incomplete logs."""

import warnings

import numpy as np
import pytest

pytest.importorskip("rerun")

from bags import rerun_command
from drawn_run import RATE, column
from hand_made_snapshot import body_in_plane, snapshot_of
from rerun.chunk import RrdReader

from cable_twin.frame.records import CableSamples, CarriageState, DriveState, SupportState
from cable_twin.frame.snapshot import Snapshot
from cable_twin.scenario.builders.outlines import outline_from_pivots
from cable_twin.view.rerun_view import RerunView

CHAIRS = tuple(f"chair_{number}" for number in range(1, 13))


CHAIR_OUTLINE = outline_from_pivots((0.0, 2.6), gyration_radius=0.6)


def chairlift_at(moment, count=12):
    """Snapshot of a moving rope with chairs of individual swing, from the tenth on in a station."""
    stations = np.linspace(0.0, 200.0, 50)
    chairs = {}
    for index, name in enumerate(CHAIRS[:count]):
        x, pitch = 15.0 * index + 2.0 * moment, 0.01 * (index + 1) * np.cos(moment)
        chair = body_in_plane(x - 2.6 * np.sin(pitch), -2.6 * np.cos(pitch), pitch)
        state = CarriageState(x, 2.0, 0.0, np.zeros(2), np.array([x, 0.0]), {"chair": chair}, attached=index < 9)
        chairs[name] = state
    supports = {"start": SupportState(np.array([-1e5, 0.0])), "end": SupportState(np.array([1e5, 0.0]))}
    cable = CableSamples(stations, np.column_stack([stations, 0.0 * stations]), np.linspace(1e5, 1.1e5, 50))
    return snapshot_of(moment, chairs, supports, cable, {"haul_rope": DriveState(2.0 * moment, 2.0, 1e4)})


def draw_chairlift(path, snapshots, outlines=None, **options):
    if outlines is None:
        outlines = {name: {"chair": CHAIR_OUTLINE} for name in CHAIRS}
    view = RerunView("chairlift", outlines, path=path, live=False, carriers=CHAIRS, **options)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for snapshot in snapshots:
            view.log(snapshot)
        view.close()


def test_carriers_are_drawn_together_each_where_it_is(tmp_path):
    snapshots = [chairlift_at(0.01 * index) for index in range(200)]
    draw_chairlift(tmp_path / "run.rrd", snapshots, batch_frames=70)
    rerun_command("rrd", "verify", tmp_path / "run.rrd")
    times, frames = column(tmp_path / "run.rrd", "/track/carriers", "LineStrips2D:strips")
    _, joints = column(tmp_path / "run.rrd", "/track/carriers", "Points2D:positions")
    assert len(times) == 40
    for row in (0, 30):
        drawn = snapshots[round(times[row] * RATE)]
        assert len(frames[row]) == len(CHAIRS)
        for line, joint, state in zip(frames[row], joints[row], drawn.carriages.values(), strict=True):
            np.testing.assert_allclose(line[0], state.position[[0, 2]] * (1.0, -1.0), atol=1e-4)  # it hangs there
            np.testing.assert_allclose(joint, line[0], atol=1e-4)
            body = state.bodies["chair"]
            np.testing.assert_allclose(np.mean(line[2:6], axis=0), [body.x, -body.z], atol=1e-4)
    times, places = column(tmp_path / "run.rrd", "/track/close_ups/chair_3", "Transform3D:translation")
    shown = snapshots[round(times[-1] * RATE)].carriages["chair_3"].position
    np.testing.assert_allclose(places[-1][0], [shown[0], -shown[2], 0.0], atol=1e-4)


@pytest.mark.parametrize("count", [0, 1, 3, 4])
def test_few_carriers_and_none_are_drawn(tmp_path, count):
    draw_chairlift(tmp_path / "run.rrd", [chairlift_at(0.0, count)])
    rerun_command("rrd", "verify", tmp_path / "run.rrd")


def test_carriers_without_outline_are_dots(tmp_path):
    draw_chairlift(tmp_path / "run.rrd", [chairlift_at(0.0)], outlines={})
    _, dots = column(tmp_path / "run.rrd", "/track/carriers", "Points2D:positions")
    assert len(dots[0]) == 2 * len(CHAIRS)  # joints and bodies


def test_swing_of_carriers_is_that_of_those_on_the_rope(tmp_path):
    draw_chairlift(tmp_path / "run.rrd", [chairlift_at(0.5), chairlift_at(2.5)])
    _, swings = column(tmp_path / "run.rrd", "/plots/swing/carriers", "Scalars:scalars")
    expected = np.rad2deg([[0.01 * np.cos(0.5), 0.09 * np.cos(0.5)], [0.09 * np.cos(2.5), 0.01 * np.cos(2.5)]])
    np.testing.assert_allclose(np.array(swings)[:, :2], expected)
    np.testing.assert_allclose(np.array(swings)[:, 2], np.rad2deg(0.01 * np.cos([0.5, 2.5])))


def test_entities_do_not_grow_with_carriers(tmp_path):
    draw_chairlift(tmp_path / "run.rrd", [chairlift_at(0.0)])
    paths = {chunk.entity_path for chunk in RrdReader(tmp_path / "run.rrd").stream()}
    assert sum("chair" in path for path in paths) == 6  # close-ups


@pytest.mark.parametrize("batch_frames", [7, 500])
def test_what_a_log_does_not_hold_stays_as_last_known(tmp_path, batch_frames):
    """Rope and vehicles at every third frame from the seventh on."""
    snapshots = []
    for index in range(60):
        snapshot = chairlift_at(0.01 * index)
        numbers = snapshot.numbers.copy()
        c = snapshot.layout.columns(numbers)
        if index < 6 or index % 3:
            bodies = (c.joint_position, c.body_position, c.body_angles)
            for missing in (
                *bodies,
                c.rope_position,
                c.rope_tension,
                c.lowest_tension,
                c.highest_tension,
                c.drive_speed,
            ):
                missing[...] = np.nan
        snapshots.append(Snapshot(snapshot.layout, numbers, snapshot.solver))
    known = [chairlift_at(0.01 * (index - index % 3)) for index in range(60)]
    path = tmp_path / "run.rrd"
    draw_chairlift(path, snapshots, batch_frames=batch_frames)
    rerun_command("rrd", "verify", path)
    times, frames = column(path, "/track/carriers", "LineStrips2D:strips")
    rows = np.rint(times * RATE).astype(int)
    assert rows.min() == 10  # the first that is due and known
    for row, lines in zip(rows, frames, strict=True):
        joint = known[row].carriages["chair_2"].position
        np.testing.assert_allclose(lines[1][0], [joint[0], 0.0], atol=1e-4)
    assert len(column(path, "/track/rope", "LineStrips2D:strips")[0]) == 5
    _, tensions = column(path, "/plots/tension", "Scalars:scalars")
    assert np.isnan(tensions[5]).all()
    np.testing.assert_allclose(tensions[6:], [[110.0, 100.0, 110.0]] * 54)
    _, texts = column(path, "/readout", "TextDocument:text")
    assert "speed" not in texts[0][0]
    assert "| speed | **2.00 m/s** |" in texts[1][0]


def test_a_log_without_rope_and_vehicles_is_drawn_without_them(tmp_path):
    snapshot = chairlift_at(0.0)
    numbers = snapshot.numbers.copy()
    numbers[1:] = np.nan
    snapshot = Snapshot(snapshot.layout, numbers, snapshot.solver)
    draw_chairlift(tmp_path / "run.rrd", [snapshot])
    rerun_command("rrd", "verify", tmp_path / "run.rrd")
    assert column(tmp_path / "run.rrd", "/track/rope", "LineStrips2D:strips")[1] == []
