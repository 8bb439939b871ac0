"""Picture of a run: drawn numbers equal simulated ones, and rerun's own tools open the file."""

import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from bags import rerun_command

rr = pytest.importorskip("rerun")

from drawn_run import (  # noqa: E402
    FRAMES,
    HORIZONTAL,
    OUTLINES,
    RATE,
    SPAN,
    column,
    draw,
    rope_height,
    snapshot_at,
)
from hand_made_snapshot import body_in_plane, snapshot_of  # noqa: E402
from rerun.chunk import RrdReader  # noqa: E402

from cable_twin.frame.commands import describe_command  # noqa: E402
from cable_twin.frame.records import (  # noqa: E402
    AppliedCommand,
    CableSamples,
    CarriageState,
    Command,
    PlantEstimates,
    SupportState,
    TensionAhead,
    TowerState,
)
from cable_twin.scenario.builders.outlines import outline_from_pivots  # noqa: E402
from cable_twin.view.rerun_view import RerunView  # noqa: E402

RENDERER = Path(__file__).parents[2] / "examples" / "render_recording.py"


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("rerun") / "run.rrd"
    return path, draw(path)


def test_rerun_accepts_the_file(recording):
    path, _ = recording
    assert "without error" in rerun_command("rrd", "verify", path)
    stats = rerun_command("rrd", "stats", path)
    assert "Blueprint" in stats
    assert "/track/rope" in stats


def test_every_snapshot_is_on_sim_time_with_its_speed(recording):
    path, snapshots = recording
    times, speeds = column(path, "/plots/speed/cabin", "Scalars:scalars")
    assert len(times) == FRAMES
    np.testing.assert_allclose(times, [snapshot.time for snapshot in snapshots], atol=1e-9)
    np.testing.assert_array_equal([s[0] for s in speeds], [s.carriages["cabin"].speed for s in snapshots])


def test_nothing_but_sim_time(recording):
    path, _ = recording
    timelines = {name for chunk in RrdReader(path).stream() if not chunk.is_static for name in chunk.timeline_names}
    assert timelines == {"sim_time"}


def test_command_and_reference_are_those_of_the_frames(recording):
    path, snapshots = recording
    _, speeds = column(path, "/plots/speed/cabin", "Scalars:scalars")
    columns = [snapshot.columns for snapshot in snapshots]
    np.testing.assert_array_equal(np.array(speeds)[:, 1], [c.commanded_speed[0] for c in columns])
    np.testing.assert_array_equal(np.array(speeds)[:, 2], [c.reference_speed[0] for c in columns])
    times, texts = column(path, "/commands", "TextLog:text")
    np.testing.assert_allclose(times, [0.5, 13.0])
    assert texts == [["speed cabin 12 m/s (topic)"], ["emergency stop (service)"]]


def test_payload_and_gusts_are_listed(tmp_path):
    path = tmp_path / "loads.rrd"
    view = RerunView(
        "test ropeway", OUTLINES, path=path, live=False, ground=[(0.0, -60.0), (500.0, -20.0), (SPAN, 90.0)]
    )
    drive = Command("speed", {"cabin": 12.0})
    gusts = [Command("wind", {"x": 5.0 + 0.4 * k, "z": 0.0}) for k in range(6)]
    orders = [Command("payload", {"cabin": 640.0}), *(order for gust in gusts for order in (drive, gust))]
    orders += [Command("temperature", {"ropes": 8.0 - 0.4 * k}) for k in range(4)]
    for index, order in enumerate(orders):
        view.log_command(AppliedCommand(0.1 * index, order, "desk"))
        view.log(snapshot_at(0.1 * index))
    view.close()
    _, texts = column(path, "/commands", "TextLog:text")
    shown = ["payload cabin 640 kg", "speed cabin 12 m/s", *(f"wind x {x:g} m/s, z 0 m/s" for x in (5.0, 6.2))]
    shown += ["temperature ropes 8 degC", "temperature ropes 6.8 degC"]
    assert [text[0] for text in texts] == [f"{line} (desk)" for line in shown]


def test_repeated_commands_of_several_drives_are_listed_once_until_a_stop(tmp_path):
    path = tmp_path / "drives.rrd"
    view = RerunView("test ropeway", OUTLINES, path=path, live=False)
    both = [Command("speed", {"cabin": 12.0}), Command("speed", {"other": 3.0})]
    orders = [*both, *both, *both, Command("emergency_stop", {}), Command("release", {}), *both, *both]
    for index, order in enumerate(orders):
        view.log_command(AppliedCommand(0.1 * index, order, "desk"))
    view.log(snapshot_at(2.0))
    view.close()
    _, texts = column(path, "/commands", "TextLog:text")
    speeds = ["speed cabin 12 m/s (desk)", "speed other 3 m/s (desk)"]
    assert [text[0] for text in texts] == [*speeds, "emergency stop (desk)", "release (desk)", *speeds]


def test_tension_and_swing_have_the_units_of_their_titles(recording):
    path, snapshots = recording
    _, tensions = column(path, "/plots/tension", "Scalars:scalars")
    _, swings = column(path, "/plots/swing/cabin", "Scalars:scalars")
    drawn = snapshots[700]
    rope = drawn.cable.tensions / 1e3
    np.testing.assert_allclose(tensions[700], [rope.max(), rope[0], rope[-1]])
    bodies = drawn.carriages["cabin"].bodies
    np.testing.assert_allclose(swings[700], np.rad2deg([bodies["hanger"].pitch, bodies["cabin"].pitch]))


def test_towers_are_drawn_with_their_loads_and_counterweights_with_their_travel(tmp_path):
    place = [700.0, rope_height(np.array(700.0), 700.0, HORIZONTAL)]
    view = RerunView("towers", OUTLINES, path=tmp_path / "run.rrd", live=False, support_positions={"tower": place})
    loads = [2e5, 1.5e5, 0.0]
    for index, load in enumerate(loads):
        tower = SupportState(np.array([0.0, load]), TowerState(load, min(loads[: index + 1]), 2e5, load == 0.0))
        end = SupportState(np.array([HORIZONTAL, 4e4]), travel=-0.25)
        view.log(snapshot_at(0.2 * index, more_supports={"end": end, "tower": tower}))
    view.close()
    _, drawn = column(tmp_path / "run.rrd", "/plots/tower_load", "Scalars:scalars")
    np.testing.assert_allclose(drawn, np.array(loads)[:, None] / 1e3)
    _, texts = column(tmp_path / "run.rrd", "/readout", "TextDocument:text")
    assert "| tower | **200 kN** |" in texts[0][0]
    assert "| tower | **lifted off** |" in texts[-1][0]
    assert "| counterweight | **-0.250 m** |" in texts[0][0]
    assert "tower" in rerun_command("rrd", "print", "-vvv", tmp_path / "run.rrd")


def test_bodies_are_drawn_where_they_are(recording):
    path, snapshots = recording
    joint_times, joints = column(path, "/track/carriages/cabin", "Transform3D:translation")
    times, positions = column(path, "/track/carriages/cabin/hanger", "Transform3D:translation")
    _, turns = column(path, "/track/carriages/cabin/hanger", "Transform3D:quaternion")
    np.testing.assert_array_equal(times, joint_times)
    assert len(times) == pytest.approx(FRAMES / RATE * 20.0, abs=1)
    for row in (0, 100, 290):
        state = snapshots[round(times[row] * RATE)].carriages["cabin"]
        body = state.bodies["hanger"]
        angle = 2.0 * np.arctan2(turns[row][0][2], turns[row][0][3])
        upper = OUTLINES["cabin"]["hanger"][0] * (1.0, -1.0)
        cos, sin = np.cos(angle), np.sin(angle)
        drawn = np.array([cos * upper[0] - sin * upper[1], sin * upper[0] + cos * upper[1]])
        drawn += np.array(joints[row][0][:2]) + np.array(positions[row][0][:2])
        x, z = OUTLINES["cabin"]["hanger"][0]
        pitch = body.pitch
        world = [body.x + x * np.cos(pitch) + z * np.sin(pitch), body.z - x * np.sin(pitch) + z * np.cos(pitch)]
        np.testing.assert_allclose(drawn * (1.0, -1.0), world, atol=1e-3)
        np.testing.assert_allclose(world, state.position[[0, 2]], atol=1e-9)  # the hanger hangs from the joint


def test_rope_is_whole_and_has_its_kink(recording):
    path, snapshots = recording
    times, frames = column(path, "/track/rope", "LineStrips2D:strips")
    _, colors = column(path, "/track/rope", "LineStrips2D:colors")
    assert len(times) == pytest.approx(FRAMES / RATE * 10.0, abs=1)
    for row in (0, 100):
        snapshot = snapshots[round(times[row] * RATE)]
        lines = [np.array(line) for line in frames[row]]
        assert len(lines) == len(colors[row]) > 1
        for one, following in pairwise(lines):
            np.testing.assert_array_equal(one[-1], following[0])
        rope = np.vstack([lines[0], *(line[1:] for line in lines[1:])]) * (1.0, -1.0)
        joint = snapshot.carriages["cabin"].position
        expected = np.vstack([snapshot.cable.positions, joint])[:, [0, 2]]
        np.testing.assert_allclose(rope, expected[np.argsort(expected[:, 0])], atol=1e-3)
        assert all(color != other for color, other in pairwise(colors[row]))


def test_small_scenes_in_three_dimensions_are_drawn_in_newtons(tmp_path):
    """Plane of x and z in either dimension; bodies without outline, free ends, and ropes without pull."""
    path = tmp_path / "run.rrd"
    view = RerunView("test rope", {}, path=path, live=False)
    arc = np.linspace(0.0, 4.0, 9)
    positions = np.column_stack([np.zeros(9), np.full(9, 7.0), -arc])
    bodies = {"rod": body_in_plane(0.0, -2.5, 0.0)}
    carriage = CarriageState(2.0, 0.0, 5.0, np.zeros(3), positions[4], bodies)
    supports = {"start": SupportState(np.zeros(3))}
    for index in range(5):
        cable = CableSamples(arc, positions, np.full(9, 40.0 * index))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            view.log(snapshot_of(0.05 * index, {"a/b c": carriage}, supports, cable))
    view.close()
    _, tensions = column(path, "/plots/tension", "Scalars:scalars")
    assert tensions[-1] == [160.0, 160.0, 160.0]
    _, strips = column(path, "/track/rope", "LineStrips2D:strips")
    np.testing.assert_allclose(strips[0][0][-1], [0.0, 4.0])
    rerun_command("rrd", "verify", path)


def test_outlines_from_pivots():
    np.testing.assert_array_equal(outline_from_pivots((0, 2), (0, -3)), [(0, 2), (0, 0), (0, -3)])
    rod = outline_from_pivots((0, 0.5), gyration_radius=np.sqrt(1 / 12))
    np.testing.assert_allclose(rod, [(0, 0.5), (0, -0.5)])
    box = outline_from_pivots((0, 4), gyration_radius=1.0)
    side = np.ptp(box[1:, 0])
    assert np.ptp(box[1:, 1]) == pytest.approx(side)
    assert side**2 / 6.0 == pytest.approx(1.0)  # inertia over mass of a square


def test_commands_in_one_line():
    command = Command("force", {"cabin": 1500.0, "other": -2.5})
    assert describe_command(AppliedCommand(1.0, command, "file")) == "force cabin 1500 N, other -2.5 N (file)"


def test_renderer_explains_itself(tmp_path, ended):
    code, said, _ = ended(RENDERER, "--help")
    assert code == 0
    assert "without a screen" in said
    code, _, errors = ended(RENDERER, tmp_path / "none.rrd")
    assert code == 1
    assert "no such recording" in errors
    (tmp_path / "notes.rrd").write_text("no recording")
    code, _, errors = ended(RENDERER, tmp_path / "notes.rrd")
    assert code == 1
    assert "notes.rrd: not a rerun recording (.rrd)" in errors


def test_estimates_of_a_plant_are_a_table_and_lines_with_bands(tmp_path):
    view = RerunView("test", {"cabin": {}}, path=tmp_path / "run.rrd", live=False)
    for number in range(3):
        view.log(snapshot_at(number / RATE))
        found = {"cabin/payload": (4200.0 + number, 10.0, "kg"), "cabin/pitch": (np.pi / 180.0, 0.0, "rad")}
        view.log_estimates(PlantEstimates(number / RATE, found))
    view.close()
    times, tables = column(tmp_path / "run.rrd", "/estimates", "TextDocument:text")
    np.testing.assert_allclose(times, [0.0, 1.0 / RATE, 2.0 / RATE], atol=1e-9)
    assert "| cabin/payload | **4202 ± 20 kg** |" in tables[-1][0]
    assert "| cabin/pitch | **1.000000 ± 0.000000 deg** |" in tables[-1][0]
    _, bands = column(tmp_path / "run.rrd", "/estimate/cabin\\/payload", "Scalars:scalars")
    np.testing.assert_allclose(bands[-1], [4202.0, 4202.0 - 19.59964, 4202.0 + 19.59964])


def test_an_outlook_is_a_band_around_the_tensions(tmp_path):
    view = RerunView("test", {"cabin": {}}, path=tmp_path / "run.rrd", live=False)
    for number in range(3):
        view.log(snapshot_at(number / RATE))
        view.log_ahead(TensionAhead(number / RATE, np.array([1e5 + number]), np.array([2e5])))
    view.close()
    times, band = column(tmp_path / "run.rrd", "/plots/tension/ahead", "Scalars:scalars")
    np.testing.assert_allclose(times, [0.0, 1.0 / RATE, 2.0 / RATE], atol=1e-9)
    scale = 2e5 / np.array(band)[0, 1]
    np.testing.assert_allclose(np.array(band) * scale, [[1e5 + number, 2e5] for number in range(3)])
