"""The picture of a run: what is drawn is what was simulated, and the file opens with rerun's own tools."""

import socket
import subprocess
import sys
import time
import warnings
from itertools import pairwise
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest

rr = pytest.importorskip("rerun")
psutil = pytest.importorskip("psutil")  # rerun brings it

from drawn_run import FRAMES, HORIZONTAL, OUTLINES, RATE, SPAN, draw, rope_height, snapshot_at  # noqa: E402
from hand_made_snapshot import body_in_plane, snapshot_of  # noqa: E402
from rerun.chunk import RrdReader  # noqa: E402

from cable_twin.geometry.outlines import outline_from_pivots  # noqa: E402
from cable_twin.recording.rerun_view import RerunView  # noqa: E402
from cable_twin.recording.view_readout import describe_command  # noqa: E402
from cable_twin.records import (  # noqa: E402
    AppliedCommand,
    CableSamples,
    CarriageState,
    Command,
    DriveState,
    SupportState,
    TowerState,
)
from cable_twin.snapshot import Snapshot  # noqa: E402

RERUN = Path(sys.executable).with_name("rerun")
RENDERER = Path(__file__).parents[2] / "examples" / "render_recording.py"


def column(path, entity, component):
    """Return times (s) and values of one component in a file, rows in the order of time."""
    times, values = [], []
    for chunk in RrdReader(path).stream():
        if chunk.entity_path == entity and not chunk.is_static:
            batch = chunk.to_record_batch()
            if component in batch.schema.names:
                times += batch.column("sim_time").cast(pa.int64()).to_pylist()
                values += batch.column(component).to_pylist()
    order = np.argsort(times, kind="stable")
    return np.array(times)[order] / 1e9, [values[index] for index in order]


def rerun_command(*arguments):
    run = subprocess.run([RERUN, *map(str, arguments)], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout + run.stderr


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


def test_commanded_speed_holds_from_its_command_on(recording):
    path, _ = recording
    times, speeds = column(path, "/plots/speed/cabin", "Scalars:scalars")
    commanded = np.array([speed[1] for speed in speeds])
    assert np.isnan(commanded[times < 0.5]).all()
    np.testing.assert_array_equal(commanded[(times >= 0.5) & (times < 13.0)], 12.0)
    np.testing.assert_array_equal(commanded[times >= 13.0], 0.0)
    times, texts = column(path, "/commands", "TextLog:text")
    np.testing.assert_allclose(times, [0.5, 13.0])
    assert texts == [["speed cabin 12 m/s (topic)"], ["emergency stop (service)"]]


def test_payload_and_gusts_are_listed_and_leave_the_commanded_speed_alone(tmp_path):
    path = tmp_path / "loads.rrd"
    view = RerunView(
        "test ropeway", OUTLINES, path=path, live=False, ground=[(0.0, -60.0), (500.0, -20.0), (SPAN, 90.0)]
    )
    drive = Command("speed", {"cabin": 12.0})
    gusts = [Command("wind", {"x": 5.0 + 0.4 * k, "z": 0.0}) for k in range(6)]
    orders = [Command("payload", {"cabin": 640.0}), *(order for gust in gusts for order in (drive, gust))]
    for index, order in enumerate(orders):
        view.log_command(AppliedCommand(0.1 * index, order, "desk"))
        view.log(snapshot_at(0.1 * index))
    view.close()
    _, texts = column(path, "/commands", "TextLog:text")
    shown = ["payload cabin 640 kg", "speed cabin 12 m/s", *(f"wind x {x:g} m/s, z 0 m/s" for x in (5.0, 6.2))]
    assert [text[0] for text in texts] == [f"{line} (desk)" for line in shown]
    _, speeds = column(path, "/plots/speed/cabin", "Scalars:scalars")
    assert [speed[1] for speed in speeds[1:]] == [12.0] * (len(orders) - 1)


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


CHAIRS = tuple(f"chair_{number}" for number in range(1, 13))
CHAIR_OUTLINE = outline_from_pivots((0.0, 2.6), gyration_radius=0.6)


def chairlift_at(moment, count=12):
    """A rope that goes by with chairs, each with a swing of its own; from the tenth on they hang in a station."""
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
    """Rope and vehicles of every third frame from the seventh on."""
    snapshots = []
    for index in range(60):
        snapshot = chairlift_at(0.01 * index)
        numbers = snapshot.numbers.copy()
        c = snapshot.layout.columns(numbers)
        if index < 6 or index % 3:
            bodies = (c.joint_position, c.body_position, c.body_angles)
            for missing in (*bodies, c.rope_position, c.rope_tension, c.drive_speed):
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


def test_a_command_counts_from_its_frame_on_within_a_batch(tmp_path):
    path = tmp_path / "run.rrd"
    view = RerunView("test ropeway", OUTLINES, path=path, live=False)
    for index in range(10):
        view.log(snapshot_at(0.01 * index))
    view.log_command(AppliedCommand(0.05, Command("speed", {"cabin": 3.0}), "desk"))
    view.log_command(AppliedCommand(0.2, Command("speed", {"cabin": 4.0}), "desk"))
    view.close()
    _, speeds = column(path, "/plots/speed/cabin", "Scalars:scalars")
    np.testing.assert_array_equal([speed[1] for speed in speeds], [np.nan] * 5 + [3.0] * 5)


def test_flushed_frames_survive_without_close(tmp_path):
    path = tmp_path / "run.rrd"
    view = RerunView("test ropeway", OUTLINES, path=path, live=False)
    for index in range(60):
        view.log(snapshot_at(index / RATE))
    view.flush()
    copy = tmp_path / "torn.rrd"
    copy.write_bytes(path.read_bytes())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it has no footer yet
        times, _ = column(copy, "/plots/tension", "Scalars:scalars")
    assert len(times) == 60
    view.close()


def test_close_is_final_and_may_be_repeated(tmp_path):
    view = RerunView("test ropeway", OUTLINES, path=tmp_path / "run.rrd", live=False)
    view.log(snapshot_at(0.0))
    view.close()
    view.close()
    with pytest.raises(RuntimeError, match="closed"):
        view.log(snapshot_at(0.01))
    assert rr.get_global_data_recording() is None


def test_a_view_that_saw_nothing_leaves_a_readable_file(tmp_path):
    path = tmp_path / "run.rrd"
    RerunView("test ropeway", {}, path=path, live=False).close()
    rerun_command("rrd", "verify", path)


def test_view_to_nowhere_and_unknown_unit_are_refused(tmp_path):
    with pytest.raises(ValueError, match="shows nothing"):
        RerunView("test ropeway", {}, path=None, live=False)
    with pytest.raises(ValueError, match="lbf"):
        RerunView("test ropeway", {}, path=tmp_path / "run.rrd", live=False, force_unit="lbf")


def test_live_view_listens_on_this_machine_only():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    view = RerunView("test ropeway", OUTLINES, path=None, live=True, live_port=port)
    try:
        view.log(snapshot_at(0.0))
        view.flush()
        assert view.url == f"rerun+http://127.0.0.1:{port}/proxy"
        listening = []
        deadline = time.monotonic() + 10.0
        while not listening and time.monotonic() < deadline:
            sockets = psutil.Process().net_connections(kind="tcp")
            listening = [s.laddr.ip for s in sockets if s.laddr.port == port and s.status == psutil.CONN_LISTEN]
        assert listening == ["127.0.0.1"]
    finally:
        view.close()


def test_file_or_port_that_cannot_be_had_is_an_error_at_once(tmp_path):
    with pytest.raises(OSError, match="No such file"):
        RerunView("test ropeway", {}, path=tmp_path / "no" / "run.rrd", live=False)
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(OSError, match=f"port {port}"):
            RerunView("test ropeway", {}, path=None, live=True, live_port=port)


FULL_DISK = """
import resource, signal, sys
from pathlib import Path
sys.path[:0] = {path!r}
import cable_twin.recording.rerun_view as drawing
from test_rerun_view import OUTLINES, snapshot_at
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
drawing.FLUSH_TIMEOUT = 0.5
view = drawing.RerunView("test ropeway", OUTLINES, path=Path({file!r}), live=False)
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
try:
    for index in range(500):
        view.log(snapshot_at(index / 100))
        if index % 50 == 49:
            view.flush()
except OSError as error:
    print("refused:", error)
view.close()
"""


@pytest.mark.parametrize("attempt", range(3))
def test_full_disk_is_an_error_and_no_hang(tmp_path, attempt):
    """rerun's own flush, disconnect and clean-up at exit wait for good when its writer gave up in between."""
    paths = [str(Path(__file__).parent), str(Path(__file__).parents[1]), str(RENDERER.parents[1])]
    script = FULL_DISK.format(path=paths, file=str(tmp_path / "run.rrd"))
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 0, run.stderr
    assert "refused: the rerun recording cannot be written" in run.stdout


def test_small_scenes_in_three_dimensions_are_drawn_in_newtons(tmp_path):
    """The plane is x and z whatever the dimension; a body without outline, a free end and no rope pull do no harm."""
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


def test_renderer_explains_itself(tmp_path):
    run = subprocess.run([sys.executable, RENDERER, "--help"], capture_output=True, text=True, timeout=300, check=True)
    assert "without a screen" in run.stdout
    missing = [sys.executable, RENDERER, tmp_path / "none.rrd"]
    run = subprocess.run(missing, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 1
    assert "no such recording" in run.stderr
    (tmp_path / "notes.rrd").write_text("no recording")
    other = [sys.executable, RENDERER, tmp_path / "notes.rrd"]
    run = subprocess.run(other, capture_output=True, text=True, timeout=300, check=False)
    assert run.returncode == 1
    assert "notes.rrd: not a rerun recording (.rrd)" in run.stderr
