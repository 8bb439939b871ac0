"""`simulate`: scripted runs with logs like the node's, replayed to the last bit and with changed scenarios."""

from __future__ import annotations

import re
import signal
import time
from collections import Counter
from contextlib import contextmanager

import pytest
from bags import NO_BAGS, bag
from named_figures import named
from small_tramway import TRAMWAY
from twin_process import COMPILING, TwinProcess, environment, run_module, wait_until, write_quick_scenario

from cable_twin.frame.records import Command, RefusedCommand
from cable_twin.offline import replay, review, what_if
from cable_twin.offline.scripted_run import Outcome
from cable_twin.offline.simulate import main, report
from cable_twin.recording.log_reader import read_log, read_snapshots
from cable_twin.scenario import load_scenario

SCRIPT = """\
- {time: 0, name: cabin, speed: 6.0}
- {time: 4.003, event: emergency_stop}
- {time: 7, event: release}
- {time: 7.5, name: cabin, force: 3.0e4}
- {time: 9, event: reset}
"""


@pytest.fixture(scope="module")
def scripted(tmp_path_factory):
    """Directory with a scenario, a script and their run."""
    directory = tmp_path_factory.mktemp("scripted")
    write_quick_scenario(directory)
    (directory / "trip.yaml").write_text(SCRIPT)
    result = run_module(
        *("offline.simulate", "quick.yaml", "--script", "trip.yaml", "--duration", "10"), directory=directory
    )
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    return directory, result.stdout


def the_run(directory):
    (run,) = directory.iterdir()
    return run


def test_it_says_how_fast_it_was_and_where_the_log_is(scripted):
    directory, output = scripted
    *table, first, log, hint = output.splitlines()
    assert any(re.match(r"cabin: speed +[\d.]+ +m/s +at most 10 ", line.strip()) for line in table)
    assert re.fullmatch(r"quick: 10\.00 s in [\d.]+ s, [\d.]+ times real time; 5 commands", first)
    run = the_run(directory / "cable_twin_logs")
    assert log == f"log: cable_twin_logs/{run.name}"
    assert re.fullmatch(rf"to view it: \S*review cable_twin_logs/{run.name}", hint)
    assert {file.name for file in run.iterdir()} == {f"{run.name}_0.mcap", f"{run.name}_0.rrd", "metadata.yaml"}


def test_log_holds_the_script_at_the_nearest_steps_and_replays_to_the_last_bit(scripted, replayed):
    run = the_run(scripted[0] / "cable_twin_logs")
    log = read_log(run)
    assert log.complete
    assert [(applied.time, applied.command) for applied in log.commands] == [
        (0.0, Command("speed", {"cabin": 6.0})),
        (4.005, Command("emergency_stop", {})),
        (7.0, Command("release", {})),
        (7.5, Command("force", {"cabin": 3e4})),
        (9.0, Command("reset", {})),
    ]
    counts = Counter(topic for topic, *_ in log.messages())
    assert (counts["joint_states"], counts["carriages/cabin/pose"], counts["supports/start/force"]) == (1001, 201, 201)
    assert (counts["cable"], counts["cable_path"], counts["key_figures"]) == (101, 11, 2)  # every 10 s and at the end
    replayed(run)


def test_commands_of_a_bag_give_the_same_run_again(scripted, tmp_path):
    run = the_run(scripted[0] / "cable_twin_logs")
    assert main(["--from-bag", str(run), "--output", str(tmp_path / "again"), "--record", "bag"]) == 0
    again = read_log(the_run(tmp_path / "again"))
    log = read_log(run)
    assert [applied.command for applied in again.commands] == [applied.command for applied in log.commands]
    for (topic, stamp, data), (other_topic, other_stamp, other) in zip(
        log.messages(["joint_states", "cable"]), again.messages(["joint_states", "cable"]), strict=True
    ):
        assert (topic, stamp - log.epoch_ns) == (other_topic, other_stamp - again.epoch_ns)
        assert data[12:] == other[12:]  # after the stamp


def test_commands_of_a_bag_drive_another_scenario(scripted, tmp_path, capsys):
    run = the_run(scripted[0] / "cable_twin_logs")
    softer = ["--set", "carriages.cabin.drive.limits.emergency_deceleration=0.6"]
    arguments = ["--from-bag", str(run), *softer, "--output", str(tmp_path), "--record", "bag", "--duration", "6"]
    assert main(arguments) == 0
    log = read_log(the_run(tmp_path))
    assert log.scenario["carriages"]["cabin"]["drive"]["limits"]["emergency_deceleration"] == 0.6
    assert log.end == 6.0
    assert (
        "simulate: not carried out, because their time is at or after the end of the run: 3 commands"
        in capsys.readouterr().err
    )
    assert replay.main([str(log.path)]) == 0
    assert "from 2 script" in capsys.readouterr().out


def test_what_the_other_scenario_refuses_is_told_and_the_rest_goes_on(scripted, tmp_path, capsys):
    run = the_run(scripted[0] / "cable_twin_logs")
    slower = ["--set", "carriages.cabin.drive.limits.speed=5.0"]
    assert main(["--from-bag", str(run), *slower, "--output", str(tmp_path), "--record", "bag"]) == 1
    said = capsys.readouterr()
    assert "command at 0.000 s: speed of 'cabin': given 6 m/s; allowed: -5 to 5 m/s" in said.err
    assert "4 commands, 1 refused" in said.out
    log = read_log(the_run(tmp_path))
    assert len(log.commands) == 4
    refused = [item for item in read_snapshots(log) if isinstance(item, RefusedCommand)]
    assert refused == [RefusedCommand(0.0, "script", "speed of 'cabin': given 6 m/s; allowed: -5 to 5 m/s", 1)]
    assert review.main([str(log.path), "--no-viewer"]) == 0
    told = "4 commands, 1 refused, the last at 0.00 s from script: speed of 'cabin': given 6 m/s; allowed: -5 to 5 m/s"
    assert told in capsys.readouterr().out


def test_frame_rate_and_duration_are_as_asked(scripted, tmp_path, capsys):
    quick = str(scripted[0] / "quick.yaml")
    arguments = ["--duration", "1", "--frame-rate", "30", "--output", str(tmp_path), "--record", "bag"]
    assert main([quick, *arguments]) == 0
    assert "--frame-rate 30 Hz is no whole number of solver steps of 0.005 s: 28.5714 Hz is used" in (
        capsys.readouterr().err
    )
    log = read_log(the_run(tmp_path))
    counts = Counter(topic for topic, *_ in log.messages(["joint_states", "carriages/cabin/pose", "cable"]))
    # of 28.57 Hz each second frame for at most 20 Hz, each third for at most 10 Hz
    assert counts == {"joint_states": 30, "carriages/cabin/pose": 15, "cable": 10}
    assert log.end == pytest.approx(29 * 0.035)


def test_nothing_is_written_where_nothing_is_to_be_recorded(scripted, tmp_path):
    assert main([str(scripted[0] / "quick.yaml"), "--duration", "1", "--record", "off", "--output", str(tmp_path)]) == 0
    assert list(tmp_path.iterdir()) == []


@contextmanager
def without_end(scripted, directory, *arguments, **options):
    """Run that continues until a signal, with its bag begun."""
    given = (str(scripted[0] / "quick.yaml"), "--duration", "100000", "--output", "logs", *arguments)
    process = TwinProcess(directory, *given, module="offline.simulate", **options)
    try:
        wait_until(lambda: [*directory.glob("logs/*/*.mcap")], COMPILING)
        yield process
    finally:
        process.kill()


def grown(directory):
    wait_until(lambda: bag(the_run(directory / "logs")).stat().st_size > 200_000)


@pytest.mark.parametrize(  # s; also of one who is impatient
    "pauses",
    [
        pytest.param((0.0,), marks=pytest.mark.long),
        (0.05, 0.1, 0.0),
        pytest.param((0.01,) * 100, marks=pytest.mark.long),
    ],
)
def test_a_signal_ends_it_with_a_log_that_is_complete(scripted, tmp_path, pauses):
    with without_end(scripted, tmp_path, "--record", "bag") as process:
        grown(tmp_path)
        for pause in pauses:
            process.send(signal.SIGINT)  # to one that has ended, too, which Popen leaves alone
            time.sleep(pause)
        assert process.wait() == 1
    assert process.output.count("simulate: ended by a signal\n") == 1
    assert "rope tension, highest" in process.output
    assert "Traceback" not in process.output
    log = read_log(the_run(tmp_path / "logs"))
    assert log.complete
    assert log.end > 0.5


def test_a_signal_while_the_logs_are_opened_ends_them_too(scripted, tmp_path):
    """Signal during the import of rerun, half a second between opening the bag and the first frame."""
    with without_end(scripted, tmp_path, variables=environment(tmp_path)) as process:
        process.send(signal.SIGINT)
        assert process.wait() == 1
    assert "simulate: ended by a signal" in process.output
    assert "Traceback" not in process.output
    assert read_log(the_run(tmp_path / "logs")).complete


def test_a_killed_run_is_reviewed_and_replayed_without_a_flag(scripted, tmp_path, replayed, capsys, no_display):
    with without_end(scripted, tmp_path):
        grown(tmp_path)
    run = the_run(tmp_path / "logs")
    assert review.main([str(run), "--plots", str(tmp_path / "plots")]) == 0
    output = capsys.readouterr().out
    assert "cut short, read as far as it goes" in output
    # the twin's own .rrd ends before the bag
    assert f"rerun recording: {run / f'{run.name}_review.rrd'}" in output
    assert len([*(tmp_path / "plots").glob("*.png")]) == 5  # its carriage rolls freely: no drive
    replayed(run)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["nowhere"], "given 'nowhere', which is neither a scenario nor a file"),
        (["--set", "cable.element=4"], "cable.element: this key does not exist; did you mean 'elements'?"),
        (["--set", "cable.elements"], "given 'cable.elements'; allowed: KEY=VALUE"),
        (["--set", "cable.elements=[1"], "given 'cable.elements=[1'; allowed: a value in YAML"),
        (["--duration", "0"], "given '0'; allowed: more than 0 s"),
        (["--frame-rate", "0.5"], "given '0.5'; allowed: 1 to 1000 Hz"),
        (["--log-pose-rate", "-1"], "--log-pose-rate: given '-1'; allowed: 0 to 1000 Hz"),
        (["--log-force-rate", "1001"], "--log-force-rate: given '1001'; allowed: 0 to 1000 Hz"),
        (["--log-joint-rate", "nan"], "--log-joint-rate: given 'nan'; allowed: 0 to 1000 Hz"),
        (["--log-path-rate", "often"], "--log-path-rate: given 'often'; allowed: 0 to 1000 Hz"),
        (["--log-poses-rate", "20"], "unrecognized arguments: --log-poses-rate;"),
        (["--log-rope-rate", "30"], "--log-rope-rate: given 30 Hz; allowed: whole fractions of the frame rate, as 1"),
        (["--log-joint-rate", "100", "--frame-rate", "50"], "--log-joint-rate: given 100 Hz; allowed: whole fractions"),
        (["--script", "none.yaml"], "none.yaml: No such file or directory"),
        (["--script", "a.yaml", "--from-bag", "b"], "not allowed with argument"),
        (["--script", "unknown.yaml"], "unknown.yaml:2: carriage or drive: given 'gondola'; allowed: cabin"),
        (["--script", "fast.yaml"], "fast.yaml:1: speed of 'cabin': given 60 m/s; allowed: -10 to 10 m/s"),
        (["--script", "stopped.yaml"], "stopped.yaml:2: the emergency stop is in force: release it"),
    ],
)
def test_wrong_input_is_named_in_a_line(tmp_path, monkeypatch, refusal, arguments, said):
    monkeypatch.chdir(tmp_path)
    first = "- {time: 0, name: cabin, speed: 1}\n"
    (tmp_path / "unknown.yaml").write_text(f"{first}- {{time: 1, name: gondola, speed: 1}}\n")
    (tmp_path / "fast.yaml").write_text("- {time: 0, name: cabin, speed: 60}\n")
    (tmp_path / "stopped.yaml").write_text(f"- {{time: 0, event: emergency_stop}}\n{first}")
    assert said in refusal(main, *arguments)
    assert not (tmp_path / "cable_twin_logs").exists()


@pytest.mark.parametrize(("make", "said"), NO_BAGS.values(), ids=NO_BAGS)
@pytest.mark.parametrize(
    ("command", "options"),
    [(main, ["--from-bag"]), (replay.main, []), (review.main, ["--no-viewer"]), (what_if.main, ["--at", 1])],
)
def test_what_is_no_bag_is_named_in_a_line(tmp_path, refusal, make, said, command, options):
    path = make(tmp_path / "thing.mcap")
    line = refusal(command, *options, path)
    assert f": {path}: " in line
    assert said in line


def test_directory_that_cannot_be_made_is_named(tmp_path, refusal):
    (tmp_path / "file").write_text("in the way")
    for path, said in (
        (tmp_path / "file", "File exists"),
        ("~nobody_here/logs", "Could not determine home directory."),
    ):
        line = refusal(main, "--duration", 1, "--set", "cable.elements=10", "--output", path, code=1)
        assert line == f"simulate: --output {path}: {said}"


def report_of(scenario, outcome, capsys, start=0.0):
    assert not report(scenario, start, outcome, [], None, [])
    printed = capsys.readouterr()
    return printed.out, printed.err


def test_a_run_in_which_nothing_was_driven_says_what_drives_it(capsys):
    hint = "no drive was commanded: give commands with --script FILE\n"
    scenario = load_scenario(TRAMWAY)
    said, _ = report_of(scenario, Outcome(time=5.0, wall_time=1.0), capsys)
    assert said.endswith(f" 5.0 times real time; 0 commands\n{hint}")
    said, _ = report_of(scenario, Outcome(time=5.0, wall_time=1.0, applied=1), capsys)
    assert said.endswith("; 1 command\n")
    said, _ = report_of(load_scenario("seed_example"), Outcome(time=5.0, wall_time=1.0), capsys)  # moves by itself
    assert said.endswith("; 0 commands\n")
    said, _ = report_of(scenario, Outcome(time=5.0, wall_time=1.0), capsys, start=1.0)  # which may be commanded before
    assert said.endswith("; 0 commands\n")


@pytest.mark.parametrize(
    ("name", "changes", "wall_time", "told"),
    [
        (TRAMWAY, {}, 9.0, True),
        (TRAMWAY, {}, 1.0, False),
        (TRAMWAY, {"solver.step": 0.005}, 9.0, False),
        ("seed_example", {"solver.integrator": "runge_kutta"}, 9.0, False),  # which a longer one makes unstable
        ("pantograph", {}, 9.0, False),  # whose contact force needs it
    ],
)
def test_a_slow_run_with_the_default_step_says_that_it_may_be_longer(name, changes, wall_time, told, capsys):
    scenario = load_scenario(name, {"solver.step": 0.001, **changes})
    _, said = report_of(scenario, Outcome(time=5.0, wall_time=wall_time), capsys)
    assert ("slower than real time with solver.step at its default of 0.001 s" in said) == told


def test_limits_of_a_run_that_failed_are_kept_only_up_to_there(capsys):
    fault, figures = "step 4 (to 20 s) failed", [named("sag", 4.0, "m", 1.0, limit=5.0)]
    assert report(load_scenario(TRAMWAY), 0.0, Outcome(time=15.0, wall_time=1.0, fault=fault), figures, None, [fault])
    assert "\nthe limit is kept up to 15.00 s, where the run ended early\n" in capsys.readouterr().out
