"""Logs with most topics at some frames only, as by default: reviewed, drawn and compared like complete ones."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from bags import bag, cut_short
from rerun.chunk import RrdReader
from twin_process import LOG_EVERY_FRAME, write_quick_scenario

from cable_twin.key_figures import KeyFigures
from cable_twin.messages import KEY_FIGURES
from cable_twin.offline import review, scripted_run, simulate
from cable_twin.offline.reading import Reading
from cable_twin.offline.script import script_of_log
from cable_twin.offline.scripted_run import start_of
from cable_twin.offline.thinned_series import compare
from cable_twin.recording.log_reader import read_log

SCRIPT = "- {time: 0, name: cabin, speed: 6}\n- {time: 4, event: emergency_stop}\n- {time: 12, event: release}\n"
DURATION = 15.0  # s
FRAMES = 1501


def printed(main, *arguments) -> str:
    with redirect_stdout(StringIO()) as output:
        assert main(list(map(str, arguments))) == 0
    return output.getvalue()


def table(output: str) -> list[str]:
    """Printed key figures with the sources of their limits."""
    lines = output.splitlines()
    (first,) = [number for number, line in enumerate(lines) if line.startswith(" key figure")]
    last = max(number for number, line in enumerate(lines) if line.startswith("  ("))
    assert last - first > 20
    return lines[first : last + 1]


def read(path: Path) -> Reading:
    reading = Reading(read_log(path))
    for _ in reading.values():
        pass
    return reading


def figures_again(path: Path, duration: float, frame_steps: int = 2) -> list:
    """Key figures of a log's run, simulated again and taken at every frame."""
    log = read_log(path)
    simulation = start_of(log)
    figures = KeyFigures(simulation.scenario)
    script = script_of_log(log)
    scripted_run.simulate(
        simulation, script, duration=duration, frame_steps=frame_steps, epoch_ns=log.epoch_ns, figures=figures
    )
    return figures.figures()


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    directory = tmp_path_factory.mktemp("sparse")
    write_quick_scenario(directory)
    (directory / "trip.yaml").write_text(SCRIPT)
    return directory


def run(directory: Path, name: str, *options: str) -> tuple[Path, str]:
    """Directory and printed output of a scripted run."""
    arguments = ["--script", directory / "trip.yaml", "--duration", DURATION, "--record", "bag", *options]
    output = printed(simulate.main, directory / "quick.yaml", *arguments, "--output", directory / name)
    (log,) = (directory / name).iterdir()
    return log, output


@pytest.fixture(scope="module")
def sparse(directory):
    return run(directory, "sparse")


@pytest.fixture(scope="module")
def dense(directory):
    return run(directory, "dense", *LOG_EVERY_FRAME)[0]


def test_review_prints_what_simulate_printed(sparse):
    log, output = sparse
    assert table(printed(review.main, log, "--no-viewer")) == table(output)
    reading = read(log)
    assert reading.frames == FRAMES
    assert reading.figures == figures_again(log, DURATION)  # to the last bit


def test_log_cut_short_has_the_figures_of_its_last_record(sparse, tmp_path):
    log, _ = sparse
    cut = cut_short(bag(log), tmp_path / "cut.mcap", 0.85)
    reading = read(cut)
    assert 10.5 < reading.end < 14.5  # the records of 10 s are in it, those of the end are not
    assert reading.figures == figures_again(log, 10.0)
    shorter = printed(simulate.main, "--from-bag", log, "--duration", 10, "--record", "off")
    shown = printed(review.main, cut, "--no-viewer")
    assert table(shown) == table(shorter)
    assert "key figures as of 10.00 s, their last record" in shown


def test_log_cut_before_its_first_record_has_the_figures_of_its_frames(sparse, tmp_path):
    cut = cut_short(bag(sparse[0]), tmp_path / "cut.mcap", 0.5)
    reading = read(cut)
    assert 5.0 < reading.end < 9.5
    assert KEY_FIGURES not in {topic for topic, *_ in read_log(cut).messages()}
    found = {figure.name: figure.value for figure in reading.figures}
    expected = {figure.name: figure.value for figure in figures_again(sparse[0], round(reading.end, 2))}
    assert found.keys() == expected.keys()
    for name in ("speed", "drive force", "drive power, highest", "swing along the track"):  # known at every frame
        assert found[f"cabin: {name}"] == expected[f"cabin: {name}"]
    assert found["energy lost or gained by the solver"] == pytest.approx(
        expected["energy lost or gained by the solver"], rel=0.02
    )
    tensions = "rope tension, highest", "rope tension, lowest", "end: support load, highest"
    for name in (*tensions, "cabin: passenger's stopping distance"):
        assert found[name] == pytest.approx(expected[name], rel=0.02)
    assert 0.1 < found["cabin: vehicle acceleration"] <= expected["cabin: vehicle acceleration"]


def test_signals_to_draw_are_of_the_frames_that_hold_them(sparse):
    series = {name: one.line() for name, one in read(sparse[0]).signals.series.items()}
    counts = {name: len(times) for name, (times, _) in series.items()}
    for name, count in {"speed/cabin": FRAMES, "contact_force/cabin": 301, "tension/highest": 151}.items():
        assert counts[name] == count
    assert counts["support_force/start"] == 301
    for name, (times, values) in series.items():
        # in an emergency stop by the drive there is no limit of its force
        assert np.isfinite(values).all() or name == "force_limit_used/cabin", name
        assert (times[0], times[-1]) == (0.0, DURATION), name
        np.testing.assert_allclose(np.diff(times), DURATION / (counts[name] - 1), rtol=1e-6)


def test_recording_made_of_it_has_no_gap(sparse, tmp_path, no_display):
    alone = tmp_path / "alone.mcap"
    alone.write_bytes(bag(sparse[0]).read_bytes())
    printed(review.main, alone)
    drawn = numbers_of(tmp_path / "alone_review.rrd")
    for name in ("speed/cabin", "tension", "swing/cabin", "drive_force/cabin"):
        times, values = drawn[f"/plots/{name}"]
        assert len(times) == FRAMES
        known = values[:, :1] if name.startswith("speed") else values  # beside it the speed that is commanded, if any
        assert np.isfinite(known).all(), name
    _, tensions = drawn["/plots/tension"]
    changes = np.flatnonzero(np.any(np.diff(tensions, axis=0), axis=1)) + 1
    assert len(changes) > 120
    assert not np.any(changes % 10)  # from one frame that holds it to the next it stays as it was


def numbers_of(recording: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times (s) and numbers (frames, lines) of all plots of a recording."""
    rows: dict[str, list[tuple[int, list[float]]]] = {}
    for chunk in RrdReader(recording).stream():
        batch = chunk.to_record_batch()
        if chunk.entity_path.startswith("/plots/") and "Scalars:scalars" in batch.schema.names:
            times = batch.column("sim_time").cast(pa.int64()).to_pylist()
            values = batch.column("Scalars:scalars").to_pylist()
            rows.setdefault(chunk.entity_path, []).extend(zip(times, values, strict=True))
    return {
        path: (np.array([time for time, _ in sorted(found)]) / 1e9, np.array([values for _, values in sorted(found)]))
        for path, found in rows.items()
    }


def test_logs_of_different_rates_are_compared_where_both_hold_a_signal(sparse, dense):
    logs = sparse[0], dense
    output = printed(review.main, *logs, "--no-viewer")
    assert f"differences at {FRAMES} common frames" in output
    assert "only in" not in output
    (found,) = compare(*(Reading(read_log(log)).values() for log in logs))
    assert found.only_in == (set(), set())
    counts = {"speed/cabin": FRAMES, "swing/cabin/cabin": FRAMES, "contact_force/cabin": 301, "tension/highest": 151}
    assert {name: found.differences[name].count for name in counts} == counts
    differing = {name: one.largest for name, one in found.differences.items() if one.largest}
    assert differing.keys() <= {"tension/start", "tension/end"}  # of the topic `cable`, in single precision
    assert max(differing.values()) < 0.1  # N, of 1 MN


def test_logs_of_different_frame_rates_are_compared_where_both_have_a_frame(sparse, directory):
    slower, _ = run(directory, "slower", "--frame-rate", "40", "--log-rope-rate", "4", "--log-force-rate", "40")
    (found,) = compare(*(Reading(read_log(log)).values() for log in (sparse[0], slower)))
    assert (found.frames, found.only_in) == (301, (set(), set()))  # 20 Hz are common to 100 Hz and 40 Hz
    counts = {"speed/cabin": 301, "contact_force/cabin": 301, "tension/highest": 31}  # 2 Hz to 10 Hz and 4 Hz
    assert {name: found.differences[name].count for name in counts} == counts
    assert found.differences["arc_length/cabin"].largest < 1e-9


def test_signals_that_one_log_never_holds_are_named():
    first = ((0.1 * index, {"speed/cabin": 0.0, **({"travel/end": 0.1} if index == 3 else {})}) for index in range(9))
    second = ((0.2 * index, {"speed/cabin": 0.0, "tension/end": 1.0}) for index in range(4))
    assert compare(first, second)[0].only_in == ({"travel/end"}, {"tension/end"})
