"""`review`: key figures, plots and recordings of real runs, finished or killed, and comparisons."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bags import alter, bag, cut_short, rerun_command
from matplotlib.image import imread
from named_figures import named
from recorded_run import snapshots_of
from rich.console import Console
from twin_process import environment, write_quick_scenario

from cable_twin.messages import SCENARIO
from cable_twin.offline import simulate
from cable_twin.offline.figure_table import print_figures
from cable_twin.offline.reading import Reading
from cable_twin.offline.review import main, print_differences
from cable_twin.offline.thinned_series import POINTS, Comparison, Series, compare
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import load_scenario

SCRIPT = "- {time: 0, name: cabin, speed: 6}\n- {time: 4, event: emergency_stop}\n"
PLOTS = {"rope.png", "tension.png", "speed.png", "swing.png", "drive.png", "contact_forces.png"}


def run(directory, *arguments):
    assert simulate.main([str(directory / "quick.yaml"), *arguments]) == 0
    return max((directory / "cable_twin_logs").iterdir())


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Two runs of 16 s: with the brake of the scenario, and with one of half its deceleration."""
    directory = tmp_path_factory.mktemp("runs")
    write_quick_scenario(directory)
    (directory / "stop.yaml").write_text(SCRIPT)
    arguments = ["--script", str(directory / "stop.yaml"), "--duration", "16"]
    arguments += ["--output", str(directory / "cable_twin_logs"), "--set", "cable.breaking_force=4e6"]
    hard = run(directory, *arguments)
    return hard, run(directory, *arguments, "--set", "carriages.cabin.drive.limits.emergency_deceleration=0.6")


def column(output: str, figure: str) -> list[str]:
    """Cells in a row of the printed table."""
    (line,) = re.findall(rf"^ {re.escape(figure)} +(\S.*?) *$", output, re.MULTILINE)
    return line.split()


def test_key_figures_are_those_of_the_run(runs, capsys):
    assert main([str(runs[0]), "--no-viewer"]) == 0
    output = capsys.readouterr().out
    assert "complete; scenario quick, 16.00 s, 1601 frames, 2 commands" in output
    snapshots = snapshots_of(runs[0])
    highest = max(snapshot.cable.tensions.max() for snapshot in snapshots) / 1e3
    assert column(output, "rope tension, highest")[:2] == [f"{highest:.4g}", "kN"]
    assert column(output, "rope safety factor")[:5] == [f"{4e3 / highest:.4g}", "-", "at", "least", "3.15"]
    distance = column(output, "cabin: stopping distance")
    assert float(distance[0]) == pytest.approx(6.0**2 / 2.4, abs=0.05)
    place = re.fullmatch(r"m 4.00 s emergency stop from 6.00 m/s at (.*) m", " ".join(distance[1:]))
    before = next(snapshot for snapshot in snapshots if snapshot.time >= 4.0)
    assert float(place[1]) == pytest.approx(before.carriages["cabin"].arc_length, abs=0.1)
    assert float(column(output, "cabin: stopping time")[0]) == pytest.approx(6.0 / 1.2, abs=0.1)
    swing = max(abs(snapshot.carriages["cabin"].bodies["cabin"].pitch) for snapshot in snapshots)
    assert column(output, "cabin: swing along the track")[0] == f"{np.degrees(swing):.4g}"
    assert "EN 12927" in output


def test_bag_cut_short_is_read_without_a_flag(runs, tmp_path, capsys):
    cut = cut_short(bag(runs[0]), tmp_path / "cut.mcap", 0.5)
    assert main([str(cut), "--no-viewer", "--plots", str(tmp_path / "plots")]) == 0
    output = capsys.readouterr().out
    assert "cut short, read as far as it goes; scenario quick, " in output
    assert int(re.search(r"(\d+) frames", output)[1]) > 300
    assert {path.name for path in (tmp_path / "plots").iterdir()} == PLOTS


@pytest.mark.parametrize("count", [pytest.param(1, marks=pytest.mark.long), 2])
def test_plots_show_something(runs, tmp_path, capsys, count):
    assert main([*map(str, runs[:count]), "--no-viewer", "--plots", str(tmp_path)]) == 0
    assert "plots: " in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == PLOTS
    for path in tmp_path.iterdir():
        picture = imread(path)
        assert picture.shape[0] > 300
        assert picture.shape[1] > 1000
        coloured = np.ptp(picture[..., :3], axis=2) > 0.3
        assert coloured.mean() > 1e-3, path.name


def test_recording_of_the_run_is_used_where_there_is_one(runs, no_display, capsys):
    before = sorted(runs[0].iterdir())
    assert main([str(runs[0])]) == 0
    output = capsys.readouterr().out
    assert f"rerun recording: {runs[0] / runs[0].name}_0.rrd\n" in output
    (command,) = re.findall(
        rf"^no display here; in a browser: (\S+) {re.escape(str(runs[0]))} --rerun web$", output, re.M
    )
    assert shutil.which(command)
    assert sorted(runs[0].iterdir()) == before


def test_recording_is_made_from_the_bag_where_there_is_none(runs, tmp_path, no_display, capsys):
    alone = shutil.copy(bag(runs[0]), tmp_path / "alone.mcap")
    assert main([str(alone)]) == 0
    assert f"rerun recording: {tmp_path / 'alone_review.rrd'}" in capsys.readouterr().out
    assert {path.name for path in tmp_path.iterdir()} == {"alone.mcap", "alone_review.rrd"}
    rerun_command("rrd", "verify", tmp_path / "alone_review.rrd")
    recordings = (tmp_path / "alone_review.rrd", runs[0] / f"{runs[0].name}_0.rrd")
    made, original = (rerun_command("rrd", "print", one) for one in recordings)
    paths = [set(re.findall(r"/?(?:track|plots|readout|commands)[\w/]*", text)) for text in (made, original)]
    assert paths[0] == paths[1]
    assert len(paths[0]) > 8


def test_without_rerun_it_shows_the_rest_and_says_so_in_a_line(runs, tmp_path, monkeypatch, capsys):
    directory = tmp_path / "alone"
    directory.mkdir()
    shutil.copy(bag(runs[0]), directory)
    monkeypatch.setitem(sys.modules, "cable_twin.offline.comparison_view", None)  # as if its import failed
    assert main([str(directory)]) == 1
    printed = capsys.readouterr()
    assert "cabin: stopping distance" in printed.out
    assert re.fullmatch(
        r"review: no rerun recording: rerun is not installed .* install rerun-sdk; --rerun off makes none\n",
        printed.err,
    )


def test_two_runs_are_one_table_and_one_recording(runs, tmp_path, no_display, capsys):
    copies = [shutil.copytree(run, tmp_path / f"run{index}") for index, run in enumerate(runs)]
    assert main([*map(str, copies)]) == 0
    output = capsys.readouterr().out
    a, b, unit = column(output, "cabin: stopping distance")
    assert unit == "m"
    assert float(b) == pytest.approx(2.0 * float(a), rel=0.02)
    assert "differences at 1601 common frames" in output
    largest, rms, unit, at, _, a_there, b_there = column(output, "speed/cabin")
    # the hard brake stands still after 5 s, the soft one then still has half the speed
    assert float(largest) == pytest.approx(3.0, abs=0.02)
    assert float(at) == pytest.approx(9.0, abs=0.1)
    assert (unit, float(rms) > 0.5) == ("m/s", True)
    assert float(b_there) - float(a_there) == pytest.approx(float(largest), rel=1e-4)
    recording = copies[0] / "run0_and_run1.rrd"
    assert f"rerun recording: {recording}" in output
    rerun_command("rrd", "verify", recording)
    text = rerun_command("rrd", "print", recording)
    for path in ("a/track/rope", "b/track/rope", "a/plots/speed/cabin", "b/plots/speed/cabin", "b/commands"):
        assert path in text


@pytest.mark.long
def test_three_runs_are_one_table_one_recording_and_plots(runs, tmp_path, no_display, capsys):
    """The first run given a second time as the third; each compared with the first."""
    copies = [shutil.copytree(run, tmp_path / name) for run, name in zip((*runs, runs[0]), "xyz", strict=True)]
    assert main([*map(str, copies), "--plots", str(tmp_path / "plots")]) == 0
    output = capsys.readouterr().out
    assert [line[:2] for line in output.splitlines() if "scenario quick, 16.00 s" in line] == ["a:", "b:", "c:"]
    a, b, c, unit = column(output, "cabin: stopping distance")
    assert (a, unit) == (c, "m")
    assert float(b) == pytest.approx(2.0 * float(a), rel=0.02)
    second, third = output.split("differences at 1601 common frames")[1:]
    assert float(column(second, "speed/cabin")[0]) == pytest.approx(3.0, abs=0.02)
    assert "of a and c" in third
    assert column(third, "speed/cabin")[:2] == ["0", "0"]
    text = rerun_command("rrd", "print", tmp_path / "x" / "x_and_y_and_z.rrd")
    assert all(f"{root}/plots/speed/cabin" in text for root in "abc")
    assert {path.name for path in (tmp_path / "plots").iterdir()} == PLOTS
    assert all(imread(path).shape[1] > 1000 for path in (tmp_path / "plots").iterdir())


def test_without_a_name_it_is_the_newest_run(runs, tmp_path, monkeypatch, capsys, refusal):
    monkeypatch.chdir(tmp_path)
    assert refusal(main, "--no-viewer").startswith("review: no run in cable_twin_logs: give the directory of one")
    for run in runs:
        shutil.copytree(run, Path("cable_twin_logs") / run.name)
    Path("cable_twin_logs", "not_a_run").mkdir()
    os.utime(bag(Path("cable_twin_logs") / runs[0].name))  # as one that is still being recorded
    os.utime(bag(Path("cable_twin_logs") / runs[1].name), (1e9, 1e9))
    assert main(["--no-viewer"]) == 0
    assert capsys.readouterr().out.startswith(f"cable_twin_logs/{runs[0].name}/")


def test_a_run_against_itself_has_no_difference(runs, capsys):
    assert main([str(runs[0]), str(runs[0]), "--no-viewer"]) == 0
    output = capsys.readouterr().out
    assert column(output, "speed/cabin")[:2] == ["0", "0"]
    assert column(output, "tension/highest")[:2] == ["0", "0"]


def test_on_a_narrow_terminal_names_are_whole_and_the_rest_is_below_them(runs, capsys):
    reading = Reading(read_log(runs[0]))
    for _ in reading.values():
        pass
    print_figures(Console(width=80), [reading.figures])
    lines = capsys.readouterr().out.splitlines()
    table = lines[: lines.index("  (1) EN 12927 and CEN practice: 3.15 to 3.5 track rope, 4.5 to 5 haul rope")]
    assert max(map(len, table)) <= 80
    for figure in reading.figures:
        (index,) = [index for index, line in enumerate(table) if line.startswith(f" {figure.name}"[:40])]
        assert any(f"{figure.time:.2f} s" in line for line in table[index + 1 : index + 3])
    assert "…" not in "".join(table)


def test_on_a_narrow_terminal_differing_signals_have_their_names(runs, capsys):
    a, b = (Reading(read_log(run)) for run in runs)
    (comparison,) = compare(a.values(), b.values())
    print_differences(Console(width=80), a, b, comparison)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    (row,) = [number for number, line in enumerate(lines) if line.startswith(" speed/cabin ")]
    assert float(lines[row].split()[1]) == pytest.approx(3.0, abs=0.02)
    assert re.fullmatch(r"   [\d.]+ s, a -?[\d.]+, b -?[\d.]+ *", lines[row + 1])


def test_what_is_below_the_resolution_of_its_unit_is_zero(capsys):
    noise = named("cabin: drive power", 1.442e-7, "W", 1.0, limit=9e5, uncertainty=1.1e-7)
    small = named("cabin: speed", 2.5e-6, "m/s", 1.0)
    print_figures(Console(width=160), [[noise, small]])
    told = capsys.readouterr().out
    assert re.search(r"drive power +0 +kW +at most 900 +kept, ± 0 ", told)
    assert re.search(r"speed +2.5e-06 +m/s", told)


def test_differences_that_neither_digits_nor_solver_resolve_are_zero(capsys):
    scenario = load_scenario("gondola", {"solver.tolerance": 1e-4})
    reading = SimpleNamespace(scenario=scenario, end=1.0)
    comparison = Comparison()
    slips, tensions, speeds, travels = (-4.1e-12, 2.9e-12), (3.1e5, 3.1e5 + 0.1), (2.0, 2.001), (0.1, 0.10005)
    names = "slip/drive", "tension/up_highest", "speed/haul_rope", "sheave_travel/return"
    pairs = dict(zip(names, (slips, tensions, speeds, travels), strict=True))
    comparison.take(0.5, *({name: pair[run] for name, pair in pairs.items()} for run in range(2)))
    print_differences(Console(width=160), reading, reading, comparison)
    told = capsys.readouterr().out
    assert re.search(r"slip/drive +0 +0 +m +0.50 s +0 +0", told)
    assert re.search(r"tension/up_highest +0 +0 +kN +0.50 s +310 +310", told)
    assert re.search(r"speed/haul_rope +0.001 +0.001 +m/s +0.50 s +2 +2.001", told)
    assert re.search(r"sheave_travel/return +0 +0 +m +0.50 s +0.1 +0.10005", told)


def test_notes_are_filled_below_their_text(capsys):
    noted = named("rope tension", 1.0, "N", 1.0, limit=2.0, source="many words " * 12)
    print_figures(Console(width=60), [[noted]])
    note = capsys.readouterr().out.partition("  (1) ")[2].partition("\n\n")[0].splitlines()
    assert len(note) > 2
    assert all(line.startswith("      many") or line.startswith("      words") for line in note[1:])


def test_series_keeps_every_extreme_in_a_memory_that_does_not_grow():
    series = Series()
    count = 37 * POINTS
    random = np.random.default_rng(3)
    values = np.sin(np.arange(count) * 1e-3) + 0.01 * random.standard_normal(count)
    values[12_345] = 9.0
    values[98_765] = -7.0
    values[[0, 12_344, 12_346, 98_764]] = np.nan  # of a carrier in a station
    for index, value in enumerate(values):
        series.append(index * 0.01, value)
    times, line = series.line()
    assert len(times) <= 2 * POINTS
    assert (np.nanmax(line), np.nanmin(line)) == (9.0, -7.0)
    assert np.all(np.diff(times) >= 0.0)
    assert abs(times[np.nanargmax(line)] - 123.45) < 64 * 0.01
    assert abs(times[np.nanargmin(line)] - 987.65) < 64 * 0.01


def test_frames_of_different_rates_are_compared_where_both_have_one():
    first = ((0.01 * index, {"speed/cabin": 0.1 * index, "swing/cabin/x": 0.0}) for index in range(101))
    second = ((0.04 * index, {"speed/cabin": 0.4 * index + 0.5}) for index in range(20))
    (found,) = compare(first, second)
    assert found.frames == 20
    difference = found.differences["speed/cabin"]
    assert (difference.count, difference.largest, difference.rms) == (20, pytest.approx(0.5), pytest.approx(0.5))
    assert found.only_in == ({"swing/cabin/x"}, set())


def test_places_on_a_loop_are_compared_round_it():
    """A chair that has passed the start of the loop in one run only is metres from itself, not the loop's length."""
    first, second = (iter([(0.0, {"arc_length/chair_1": place})]) for place in (3.0, 1640.0))
    (found,) = compare(first, second, loops={"arc_length/chair_1": 1650.0})
    difference = found.differences["arc_length/chair_1"]
    assert (difference.largest, difference.values) == (pytest.approx(13.0), (3.0, 1640.0))


MEASURE = """
import resource, sys
from cable_twin.offline.review import main
assert main(sys.argv[1:]) == 0
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, file=sys.stderr)
"""


def no_command(topic, _stamp_ns, data):
    """Every message but commands, whose stamp is also within the message."""
    return None if topic == "applied_commands" else data


@pytest.mark.long
def test_memory_does_not_grow_with_the_bag(runs, tmp_path):
    """Bag of five times the frames, by repetition with later stamps: at most some 10 MB more."""
    log = read_log(runs[0])
    shifts = [number * 16_010_000_000 for number in range(5)]
    long = alter(log.path, tmp_path / "long.mcap", no_command, shifts=shifts)
    peaks = []
    for path in (log.path, long):
        result = subprocess.run(
            [sys.executable, "-c", MEASURE, str(path), "--no-viewer"],
            env=environment(tmp_path),
            capture_output=True,
            text=True,
            check=True,
            timeout=300,
        )
        peaks.append(int(result.stderr.split()[-1]) / 1024)
    assert "8005 frames" in result.stdout
    assert peaks[1] - peaks[0] < 10.0, peaks


def test_bag_without_frames_is_named(runs, tmp_path, refusal):
    target = alter(bag(runs[0]), tmp_path / "none.mcap", lambda topic, _, data: data if topic == SCENARIO else None)
    for bags in ([target], [runs[0], target]):
        assert refusal(main, *bags, "--no-viewer") == f"review: {target}: it contains no frame of the twin"


def test_plots_that_cannot_be_written_are_named(runs, tmp_path, capsys):
    (tmp_path / "file").write_text("in the way")
    assert main([str(runs[0]), "--no-viewer", "--plots", str(tmp_path / "file")]) == 1
    assert capsys.readouterr().err == f"review: --plots {tmp_path / 'file'}: File exists\n"


def test_too_many_bags_and_unknown_options_are_refused_in_a_line(refusal):
    fact = "review: argument --fact: persons: given 'abc'; allowed: a whole number at least 1 and at most 500, or null"
    for arguments, said in (
        (["a"] * 27, "bags: given 27; allowed: at most 26"),
        (["--fast"], "--help"),
        (["--fact", "persons=abc"], fact),
    ):
        assert said in refusal(main, *arguments)


def test_viewer_is_opened_where_there_is_a_display(runs, monkeypatch, capsys):
    started = []
    monkeypatch.setenv("DISPLAY", ":99")
    monkeypatch.setattr(subprocess, "Popen", lambda arguments, **options: started.append((arguments, options)))
    assert main([str(runs[0])]) == 0
    ((arguments, options),) = started
    assert arguments[1:5] == ["-m", "rerun", "--bind", "127.0.0.1"]  # rerun has no access control
    assert os.path.samefile(arguments[-1], runs[0] / f"{runs[0].name}_0.rrd")
    assert options["start_new_session"]
    assert "opened in rerun" in capsys.readouterr().out
