"""Shared command line parts of all commands."""

from __future__ import annotations

import ctypes
import re
import signal
import sys
import threading

import numba
import pytest
from numba.extending import overload

from cable_twin.offline import (
    calibrate,
    design,
    envelope,
    follow,
    import_profile,
    line,
    plant,
    replay,
    report,
    review,
    rules,
    simulate_options,
    study,
    what_if,
)
from cable_twin.ros import sim
from cable_twin.ros.client import drive
from cable_twin.terminal.command_line import OneLineParser, ending_signals, interrupts_kept, listed


def test_help_fills_paragraphs_and_leaves_examples_as_they_are(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    short = "  drive cabin --speed 5    5 m/s"
    long = f"  drive --ros-args {'-r a:=b ' * 6}".rstrip()
    parser = OneLineParser("drive", "Tell a twin.", f"{'many words ' * 20}\nand more\n\nexamples:\n{short}\n{long}\n")
    with pytest.raises(SystemExit, match="0"):
        parser.parse_args(["--help"])
    paragraph, examples = capsys.readouterr().out.rpartition("\n\nexamples:\n")[::2]
    assert max(map(len, paragraph.splitlines())) < 60
    assert " ".join(paragraph.split()).endswith("many words and more")
    assert examples == f"{short}\n{long}\n"


@pytest.mark.parametrize("width", [58, 40])
def test_what_is_said_of_an_example_has_the_width_that_there_is(width):
    command, said = "  drive cabin --speed 5", "what it does " * 6
    lines = listed(f"{command}   {said}".rstrip(), width).splitlines()
    assert lines[0].startswith(command)
    assert max(map(len, lines)) <= width
    assert " ".join(" ".join(lines).split()) == f"{command.strip()} {said.strip()}"


HELPS = {
    "sim": sim.parser,
    "drive": drive.parser,
    "simulate": simulate_options.parser,
    "line": line.parser,
    "review": review.parser,
    "replay": replay.parser,
    "rules": rules.parser,
    "envelope": envelope.parser,
    "report": report.parser,
    "import_profile": import_profile.parser,
    "design": design.parser,
    "what_if": what_if.parser,
    "study": study.parser,
    "plant": plant.parser,
    "follow": follow.parser,
    "calibrate": calibrate.parser,
}


@pytest.mark.parametrize("name", HELPS)
def test_every_help_fits_eighty_columns(name, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    text = HELPS[name]().format_help()
    assert max(map(len, text.splitlines())) < 80
    usage = text.partition("\n\n")[0]
    options = {option for action in HELPS[name]()._actions for option in action.option_strings}
    said = set(re.findall(r"--?[a-z][a-z-]*", usage))
    assert options - said == {"--help"}


WITHIN = 60.0  # s in which an interrupt that is put off comes


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_an_interrupt_is_at_once_where_it_may_be(number):
    before = signal.getsignal(number), sys.unraisablehook
    with pytest.raises(KeyboardInterrupt), interrupts_kept():
        signal.raise_signal(number)
    assert (signal.getsignal(number), sys.unraisablehook) == before


def test_nohup_keeps_a_command_from_ending_with_its_terminal():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        assert signal.SIGHUP not in ending_signals()
        with interrupts_kept():
            signal.raise_signal(signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


def test_an_interrupt_in_a_callback_is_neither_lost_nor_printed(capfd):
    callback = ctypes.CFUNCTYPE(None)(lambda: signal.raise_signal(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt), interrupts_kept():  # noqa: PT012 - it comes after the callback
        callback()
        threading.Event().wait(WITHIN)
    assert capfd.readouterr().err == ""


def test_an_interrupt_of_the_compiler_waits_until_it_is_done():
    done = []

    def measure(value):
        raise NotImplementedError

    @overload(measure)
    def _measure(value):
        signal.raise_signal(signal.SIGINT)  # while its caller is compiled
        return lambda value: 2.0 * value

    @numba.njit
    def kernel(value):
        return measure(value)

    with pytest.raises(KeyboardInterrupt), interrupts_kept():  # noqa: PT012 - it comes after the compiler
        done.append(kernel(3.0))
        threading.Event().wait(WITHIN)
    assert done == [6.0]
