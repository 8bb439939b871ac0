"""Start and end of `sim`: parameters, scenarios, signals, failing disks, kills, and the files left."""

from __future__ import annotations

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from urllib.request import urlopen

import psutil
import pytest
from bags import bag, rerun_command
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML
from twin_process import (
    COMPILING,
    environment,
    refused_starts,
    run_module,
    stamps,
    wait_until,
    write_quick_scenario,
)

from cable_twin.offline import replay
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import config_directory

pytest.importorskip("rclpy")
from std_srvs.srv import SetBool, Trigger

FRAME = 10_000_000  # ns


def check_logs(run: Path) -> int:
    """Open a finished run with other programs' readers; returns the number of joint states in it."""
    (bag,) = run.glob("*.mcap")
    (recording,) = run.glob("*.rrd")
    assert (bag.name, recording.name) == (f"{run.name}_0.mcap", f"{run.name}_0.rrd")
    with AnyReader([run]) as reader:
        connections = [item for item in reader.connections if item.topic == "/cable_twin/joint_states"]
        decoded = [reader.deserialize(data, item.msgtype) for item, _, data in reader.messages(connections)]
    taken = stamps(decoded)
    assert [after - before for before, after in pairwise(taken)] == [FRAME] * (len(taken) - 1)
    with bag.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    topics = {channel.topic: identifier for identifier, channel in summary.channels.items()}
    assert summary.statistics.channel_message_counts[topics["/cable_twin/joint_states"]] == len(decoded)
    assert summary.statistics.channel_message_counts[topics["/cable_twin/scenario"]] == 1
    metadata = YAML(typ="safe").load(run / "metadata.yaml")["rosbag2_bagfile_information"]
    assert metadata["message_count"] == summary.statistics.message_count
    rerun_command("mcap", "check", bag)
    rerun_command("rrd", "verify", recording)
    assert read_log(run).complete
    return len(decoded)


@pytest.mark.parametrize(
    "signals",
    [
        [signal.SIGTERM],
        pytest.param([signal.SIGHUP], marks=pytest.mark.long),
        [signal.SIGINT, signal.SIGTERM, signal.SIGINT],
    ],
    ids=lambda signals: "-".join(number.name for number in signals),
)
def test_signals_end_it_cleanly(quick_twin, signals):
    sim, participant = quick_twin()
    participant.until(lambda: len(participant.received["joint_states"]) > 50)
    for number in signals:
        sim.send(number)
        time.sleep(0.05)  # the next one comes while the logs are being closed
    assert sim.wait() == 0, sim.output
    assert "log closed" in sim.output
    assert "Traceback" not in sim.output
    frames = check_logs(sim.run_directory)
    assert frames >= len(participant.received["joint_states"])


def test_killed_run_is_readable_and_replays(quick_twin, capsys):
    sim, participant = quick_twin()
    with participant.stream(name=["cabin"], velocity=[3.0]):  # 20 a second, of which the last 1.5 s may be lost
        participant.until(lambda: participant.arc_length > 64.0 and len(participant.applied) > 45)
    sim.send(signal.SIGKILL)
    sim.wait()
    participant.spin(0.2)
    published = stamps(participant.received["joint_states"])[-1]
    log = read_log(sim.run_directory)
    assert not log.complete
    recorded = max(stamp for _, stamp, _ in log.messages(["joint_states"]))
    assert published - recorded < 1_500_000_000  # less than a second, and what a busy machine adds
    assert len(log.commands) > 10
    assert replay.main([str(sim.run_directory)]) == 0
    assert "cut short" in capsys.readouterr().out


def test_directory_that_cannot_be_written_is_told_and_the_twin_goes_on(quick_twin, tmp_path):
    (tmp_path / "occupied").write_text("not a directory")
    sim, participant = quick_twin("--record-directory", "occupied")
    assert "[ERROR]" in sim.output
    assert "nothing is recorded: record_directory 'occupied': File exists" in sim.output
    level, message, _ = participant.next_diagnostics()
    assert (level, message) == (2, "nothing is recorded: record_directory 'occupied': File exists")
    assert participant.call("pause", SetBool, data=True).success
    answer = participant.call("save_snapshot", Trigger)  # also while time stands still
    assert not answer.success
    assert answer.message.startswith(f"nothing saved: {tmp_path / 'occupied'}/snapshot_")
    assert answer.message.endswith(": File exists")
    assert participant.call("pause", SetBool, data=False).success
    with participant.stream(name=["cabin"], velocity=[1.0]):
        participant.until(lambda: participant.speed == pytest.approx(1.0, abs=1e-6))
    assert sim.end() == 0
    assert "Traceback" not in sim.output


def test_live_view_without_its_port_is_a_file(processes, tmp_path):
    with socket.socket() as occupied:
        with suppress(OSError):  # somebody else has it already
            occupied.bind(("127.0.0.1", 9876))
            occupied.listen()
        sim = processes("--scenario", str(write_quick_scenario(tmp_path)), "--rerun", "live")
        sim.wait_for("runs at 100 Hz")
        assert "[ERROR]" in sim.output
        assert "no live view, a file only: the live view cannot use port 9876 of 127.0.0.1" in sim.output
        wait_until(lambda: bag(sim.run_directory).stat().st_size > 50_000, what="a log of some frames")
        assert sim.end() == 0
        check_logs(sim.run_directory)


def test_view_for_a_browser_is_served_to_this_machine_alone_and_ends_with_the_twin(processes, tmp_path):
    sim = processes("--scenario", str(write_quick_scenario(tmp_path)), "--rerun", "web")
    sim.wait_for("live view, for a browser: http://127.0.0.1:")
    (link,) = re.findall(r"for a browser: (\S+)", sim.output)
    with urlopen(link, timeout=20.0) as page:
        assert page.status == 200
    twin = psutil.Process(sim.process.pid)
    servers = twin.children(recursive=True)
    sockets = [item for process in (twin, *servers) for item in process.net_connections("tcp")]
    assert {item.laddr.ip for item in sockets if item.status == psutil.CONN_LISTEN} == {"127.0.0.1"}
    assert sim.end() == 0
    assert servers
    assert not any(process.is_running() for process in servers)
    assert "recording: " not in sim.output
    check_logs(sim.run_directory)


@pytest.mark.long
def test_disk_that_fills_up_is_told_and_the_twin_goes_on(quick_twin):
    # a limit on the size of files is the full disk that needs no privileges
    code = (
        "import resource, signal, sys; signal.signal(signal.SIGXFSZ, signal.SIG_IGN); "
        "resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000)); "
        "from cable_twin.ros.sim import main; sys.exit(main(sys.argv[1:]))"
    )
    sim, participant = quick_twin(command=[sys.executable, "-c", code])
    participant.until(lambda: participant.received["/diagnostics"] and participant.diagnostics[0] == 2)
    participant.until(
        lambda: "recording: log stopped" in participant.diagnostics[1], what="the end of the log, for good"
    )
    sim.wait_for("recording: log stopped")
    count = len(participant.received["joint_states"])
    participant.until(lambda: len(participant.received["joint_states"]) > count + 50)
    assert sim.end() == 0
    assert "Traceback" not in sim.output
    assert sum(1 for _ in read_log(sim.run_directory).messages(["joint_states"])) > 10


def test_solver_that_fails_pauses_the_twin_until_a_reset(processes, participants):
    sim = processes("--scenario", "seed_example", "--rerun", "none")
    participant = participants(sim.domain)
    participant.subscribe_standard()
    participant.publish(name=["carriage"], effort=[1e9])
    participant.until(lambda: participant.received["/diagnostics"] and participant.diagnostics[0] == 2)
    assert "the last Newton increment was" in participant.diagnostics[1]
    assert "reset it to continue" in sim.output
    refusal = participant.call("pause", SetBool, data=False)
    assert not refusal.success
    assert "~/reset first" in refusal.message
    assert participant.call("reset", Trigger).success
    count = len(participant.received["joint_states"])
    participant.until(lambda: len(participant.received["joint_states"]) > count + 20, what="frames after the reset")
    assert sim.end() == 0
    assert replay.main([str(sim.run_directory)]) == 0


@pytest.mark.parametrize("stop", [pytest.param(False, marks=pytest.mark.long), True])
def test_a_twin_that_is_ended_before_its_time_ran_has_a_log(quick_twin, stop):
    """Log also with a first command from a service."""
    sim, participant = quick_twin("--start-paused", "true", paused=True)
    if stop:
        assert participant.call("emergency_stop", SetBool, data=True).success
        assert participant.call("step", Trigger).success
    assert sim.end() == 0
    assert "recording: " not in sim.output
    log = read_log(sim.run_directory)
    assert log.complete
    assert [applied.command.kind for applied in log.commands] == ["emergency_stop"] * stop
    taken = [stamp for _, stamp, _ in log.messages(["joint_states"])]
    assert [stamp - log.epoch_ns for stamp in taken] == [0, FRAME][: 1 + stop]
    assert replay.main([str(sim.run_directory)]) == 0


def test_as_fast_as_possible_from_a_paused_start_records_every_frame(quick_twin):
    arguments = ["--start-paused", "true", "--real-time-factor", "0", "--rerun", "none"]
    sim, participant = quick_twin(*arguments, paused=True)
    assert not participant.received["joint_states"]  # time has not begun to run
    assert "simulated time runs as fast as possible" in sim.output
    assert participant.call("step", Trigger).success
    participant.until(lambda: len(participant.received["joint_states"]) == 2, what="the start and one frame")
    assert participant.call("pause", SetBool, data=False).success
    started = time.monotonic()
    participant.until(lambda: len(participant.received["joint_states"]) > 1000)
    assert time.monotonic() - started < 10.0  # which they would take in real time
    assert sim.end() == 0
    taken = [stamp for _, stamp, _ in read_log(sim.run_directory).messages(["joint_states"])]
    assert [after - before for before, after in pairwise(taken)] == [FRAME] * (len(taken) - 1)


def compilers(directory):
    """Processes that compile kernels into a directory."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            command = (process / "cmdline").read_bytes()
            if b"first_compilation" in command and os.fsencode(directory) in (process / "environ").read_bytes():
                found.append(process.name)
    return found


@pytest.mark.long
def test_interrupt_ends_the_compilation(processes, domain, tmp_path):
    variables = {**environment(tmp_path, domain), "NUMBA_CACHE_DIR": str(tmp_path / "empty_cache")}
    sim = processes(domain=domain, variables=variables)
    sim.wait_for("compiling the solver's kernels, once on this machine")
    compiler = wait_until(lambda: compilers(tmp_path), what="a second process that compiles")
    assert len(os.sched_getaffinity(0)) < 2 or compiler
    sim.send(signal.SIGINT)
    sim.send(signal.SIGINT)
    assert sim.wait() == 0
    wait_until(lambda: not compilers(tmp_path), what="the end of the second process")
    assert sim.output.endswith("sim: ended before it had started\n")
    assert "Traceback" not in sim.output
    assert not (tmp_path / "cable_twin_logs").exists()


BAD_PARAMETERS = [
    (["--frame-rate", "-1"], "sim: parameter 'frame_rate': given -1.0; allowed: 1 to 1000 Hz"),
    (["--ros-args", "-p", "frame_rate:=fast"], "sim: parameter 'frame_rate': given 'fast'; allowed: a number: "),
    (["--ros-args", "-p", "frame_rate:=.nan"], "sim: parameter 'frame_rate': given nan; allowed: 1 to 1000 Hz"),
    (["--rerun", "sometimes"], "sim: parameter 'rerun': given 'sometimes'; allowed: none, file, live"),
    (["--scenario", "funicular"], "sim: scenario: given 'funicular', which is neither a scenario nor a file"),
    (["--scenario", "no.yaml"], "sim: no.yaml: no such file; allowed: "),
    (["--set", "cable.elements"], "sim: parameter 'set': given 'cable.elements'; allowed: KEY=VALUE"),
    (["--set", "carriages.cabbin.speed=1"], "sim: /"),  # and the file, where this key does not exist
    (["--set", "gravity=1", "--snapshot", "a.npz"], "sim: parameter 'set': given changes of gravity; allowed: none"),
    (["--frame-rate", "fast"], "sim: argument --frame-rate: invalid float value: 'fast'; all options: sim --help"),
    (["--split-duration", "0.5"], "sim: parameter 'split_duration': given 0.5 s; allowed: 0, or 1 s and more"),
    (
        ["--keep-age", "600"],
        "sim: parameter 'keep_age': given 600 s, less than a file; allowed: 0, or ",
    ),
    (["--frames", "10"], "sim: unrecognized arguments: --frames; all options: sim --help"),
    (["--ros-args", "--nonsense"], "sim: unknown ROS arguments ['--nonsense']"),
    (["--ros-args", "-p", "use_sim_time:=maybe"], "sim: parameter 'use_sim_time': given 'maybe'; allowed: a bool"),
    (["--readmit", "load_end"], "sim: parameter 'readmit': given 'load_end'; allowed: none at the start, as no "),
    (["--frame-id", "/map"], "sim: parameter 'frame_id': given '/map'; allowed: coordinate frame of all positions; "),
    (["--frame-prefix", "a b/"], "sim: parameter 'frame_prefix': given 'a b/'; allowed: prefix of the coordinate "),
    (
        ["--ros-args", "-p", "qos_overrides./cable_twin/cable.publisher.reliability:=sometimes"],
        "sim: qos_overrides./cable_twin/cable: Unexpected QoS override for policy `reliability`: `sometimes`",
    ),
    (
        ["--ros-args", "-p", "qos_overrides./cable_twin/cable.publisher.depth:=-1"],
        "sim: qos_overrides./cable_twin/cable: Failed to create publisher: failed to set history depth",
    ),
]


def test_bad_parameters_are_named_in_a_line_each(tmp_path):
    several = ["--frame-rate", "0", "--command-timeout", "0"]
    *said, said_of_several = refused_starts(tmp_path, *(arguments for arguments, _ in BAD_PARAMETERS), several)
    for (_, expected), lines in zip(BAD_PARAMETERS, said, strict=True):
        (line,) = lines
        assert line.startswith(expected)
    assert len(said_of_several) == 2


def test_bad_scenario_has_a_line_for_each_fault(tmp_path):
    path = write_quick_scenario(tmp_path)
    yaml = YAML()
    content = yaml.load(path)
    content["gravity"] = "strong"
    content["cable"]["elemnts"] = 3
    content["carriages"]["cabin"]["arc_length"] = 1e6
    yaml.dump(content, path)
    (lines,) = refused_starts(tmp_path, ["--scenario", str(path)])
    assert len(lines) == 3
    assert all(line.startswith(f"sim: {path}: ") for line in lines)
    for key in ("gravity", "cable.elemnts", "carriages.cabin.arc_length"):
        assert any(f": {key}: " in line for line in lines), key


def test_names_an_uneven_rate_and_an_unknown_ros_parameter_that_is_ignored(processes, participants, tmp_path):
    """Scenario in the working directory with a path that YAML would read as a number."""
    shutil.copy(config_directory() / "seed_example.yaml", tmp_path / "1e3")
    ros = ["-r", "__node:=tram", "-r", "__ns:=/site"]
    ros += ["-p", "frame_rat:=50", "-p", "use_sim_time:=false", "-p", "rerun:=off"]
    sim = processes("--scenario", "1e3", "--frame-rate", "30", "--ros-args", *ros)
    participant = participants(sim.domain, node="/site/tram")
    participant.subscribe_standard()
    assert "unknown parameter 'frame_rat' is ignored; known: scenario, set, scenario_directories, snapsh" in sim.output
    assert "use_sim_time" not in sim.output
    sim.wait_for("runs at")
    assert "frame_rate 30 Hz is no whole number of solver steps of 0.001 s: 30.303 Hz is used" in sim.output
    assert "'1e3' runs at 30.303 Hz; carriages: carriage" in sim.output
    participant.publish(name=["carriage"], effort=[1.0])
    participant.until(lambda: participant.received["applied_commands"])
    assert sim.end() == 0
    log = read_log(sim.run_directory)
    assert log.metadata["namespace"] == "/site/tram"
    assert log.scenario["name"] == "1e3"
    assert not list(sim.run_directory.glob("*.rrd"))  # off is YAML's false, and none of ours
    assert len(log.commands) >= 1
    assert os.listdir(tmp_path / "cable_twin_logs")


@pytest.mark.parametrize(("module", "command"), [("sim", "sim"), ("client.drive", "drive")])
def test_without_ros_it_says_what_to_install(tmp_path, module, command):
    code = f"import sys; sys.modules['rclpy'] = None; from cable_twin.ros.{module} import main; sys.exit(main())"
    arguments = ["cabin", "--speed", "1"] if command == "drive" else []
    result = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=tmp_path,
        env=environment(tmp_path),
        capture_output=True,
        text=True,
        timeout=COMPILING,
        check=False,
    )
    assert result.returncode == 1
    assert result.stderr.startswith(f"{command} needs ROS 2, which this Python does not have")
    assert "pip install '.[ros]'      (in the clone of cable_twin)" in result.stderr
    assert "source /opt/ros/" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize("command", ["ros.sim", "ros.client.drive", "offline.replay"])
def test_help_has_examples(tmp_path, command):
    result = run_module(command, "--help", directory=tmp_path)
    assert result.returncode == 0
    assert "examples:" in result.stdout
