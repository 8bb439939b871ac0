"""Installed commands: no traceback from Ctrl-C at any moment, closed pipes and full disks."""

from __future__ import annotations

import os
import pty
import signal
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from bags import bag
from twin_process import COMPILING, environment, wait_until, write_quick_scenario

from cable_twin.recording.log_reader import read_log


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Directory of a run of half a minute, logged by a process of its own with the arithmetic that `replay` has."""
    directory = tmp_path_factory.mktemp("commands")
    options = ("--duration", "30", "--record", "bag", "--output", str(directory / "logs"))
    command = "import sys; from cable_twin.offline.entry_points import simulate; sys.exit(simulate())"
    subprocess.run(
        [sys.executable, "-c", command, str(write_quick_scenario(directory)), *options],
        env=environment(directory),
        stdout=subprocess.DEVNULL,
        check=True,
    )
    (log,) = (directory / "logs").iterdir()
    return log


# as the installed script, which takes Ctrl-C also where whoever started the tests ignores it; it says when it begins
SCRIPT = """
import signal, sys
from pathlib import Path
signal.signal(signal.SIGINT, signal.default_int_handler)
from cable_twin.offline.entry_points import {0}
Path("{0}.begun").touch()
sys.exit({0}())
"""


@pytest.fixture
def start(tmp_path):
    """Start commands that are ended after the test in every case."""
    started = []

    def begin(command, *arguments, **options):
        process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT.format(command), *arguments],
            cwd=tmp_path,
            env=environment(tmp_path),
            stderr=subprocess.PIPE,
            **{"stdout": subprocess.PIPE, **options},
            text=True,
        )
        started.append(process)
        return process

    yield begin
    for process in started:
        process.kill()
        process.wait()


# s: in the imports, at the start, under way
@pytest.mark.parametrize("pause", [0.3, *(pytest.param(pause, marks=pytest.mark.long) for pause in (1.0, 3.0))])
def test_an_interrupt_is_one_line_at_any_moment(run, start, tmp_path, pause):
    write_quick_scenario(tmp_path)
    started = {
        "simulate": start("simulate", "quick.yaml", "--duration", "1e6", "--record", "off"),
        "review": start("review", str(run), "--no-viewer"),
        "replay": start("replay", str(run)),
    }
    wait_until(lambda: all((tmp_path / f"{command}.begun").exists() for command in started))
    time.sleep(pause)
    for command, process in started.items():
        process.send_signal(signal.SIGINT)
        _, error = process.communicate(timeout=COMPILING)
        assert "Traceback" not in error
        if process.returncode == 0:
            continue  # it was faster
        if "simulate: ended by a signal" in error:  # under way, with its figures
            assert process.returncode == 1
            continue
        assert process.returncode == 130
        assert error.strip() in (f"{command}: ended before it had started", f"{command}: ended by Ctrl-C")


@pytest.mark.parametrize(
    ("command", "code"),
    [
        pytest.param("simulate", 1, marks=pytest.mark.long),
        pytest.param("review", 1, marks=pytest.mark.long),
        ("replay", 2),
    ],
)
def test_an_output_without_room_is_one_line(run, start, tmp_path, command, code):
    arguments = ["quick.yaml", "--duration", "1", "--record", "off"] if command == "simulate" else [str(run)]
    write_quick_scenario(tmp_path)
    with open("/dev/full", "w") as full:
        process = start(command, *arguments, *(["--no-viewer"] if command == "review" else []), stdout=full)
        _, error = process.communicate(timeout=COMPILING)
    assert error == f"{command}: output: No space left on device\n"
    assert process.returncode == code


def test_simulate_into_a_pipe_that_is_closed_has_its_log(start, tmp_path):
    write_quick_scenario(tmp_path)
    process = start("simulate", "quick.yaml", "--duration", "1", "--record", "bag")
    process.stdout.close()
    process.stdout = None
    _, error = process.communicate(timeout=COMPILING)
    assert error == ""
    assert process.returncode == -signal.SIGPIPE
    (log,) = (tmp_path / "cable_twin_logs").iterdir()
    assert os.path.getsize(bag(log)) > 50_000


def test_a_terminal_that_is_closed_ends_a_run_with_a_log_that_is_complete(tmp_path):
    scenario = str(write_quick_scenario(tmp_path))
    child, terminal = pty.fork()
    if child == 0:  # with that terminal as its own, which its end hangs up
        os.chdir(tmp_path)
        command = [sys.executable, "-c", SCRIPT.format("simulate"), scenario, "--duration", "1e6", "--record", "bag"]
        os.execve(sys.executable, command, environment(tmp_path))
    os.set_blocking(terminal, False)

    def recorded() -> bool:
        with suppress(BlockingIOError):  # what it prints is taken, or it would wait
            os.read(terminal, 1 << 16)
        return any(file.stat().st_size > 200_000 for file in tmp_path.glob("*/*/*.mcap"))

    try:
        wait_until(recorded, COMPILING)
        os.close(terminal)
        wait_until(lambda: os.waitpid(child, os.WNOHANG)[0] == child)
    except BaseException:
        os.kill(child, signal.SIGKILL)
        raise
    (log,) = (tmp_path / "cable_twin_logs").iterdir()
    assert read_log(log).complete


def test_a_table_into_a_pipe_that_is_closed_ends_without_a_word(start, tmp_path):
    """`line --csv - | head`, with the exit code of a closed pipe."""
    write_quick_scenario(tmp_path)
    process = start("line", "quick.yaml", "--places", "2", "--csv", "-")
    process.stdout.close()
    process.stdout = None
    _, error = process.communicate(timeout=COMPILING)
    assert "Broken pipe" not in error
    assert "Traceback" not in error
    assert process.returncode == 128 + signal.SIGPIPE
