"""Status line of `sim` in a real terminal (pty): contents, and no overlap with the log."""

from __future__ import annotations

import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import threading
from fcntl import ioctl
from types import SimpleNamespace

import pytest
from rich.text import Text
from small_tramway import TRAMWAY
from twin_process import COMPILING, PATIENCE, environment, wait_until, write_quick_scenario

from cable_twin.key_figures import KeyFigures
from cable_twin.messages import TopicNames
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.bars import StatusBar
from verification.ropes import clamped

pytest.importorskip("rclpy")
from std_srvs.srv import SetBool, Trigger

from cable_twin.ros.diagnostics import StatusLine, live_hint
from cable_twin.runtime.watches import FigureWatch

ROWS, COLUMNS = 24, 150
# the row, as it is drawn: the cursor is kept, and comes back to where the log goes on
DRAWN = re.compile(r"\x1b7\x1b\[(\d+);1H\x1b\[2K(.*?)\x1b8", re.DOTALL)
TAKEN = f"\n\x1b7\x1b[1;{ROWS - 1}r\x1b8\x1b[1A"
GIVEN_BACK = "\x1b7\x1b[r\x1b8\x1b[J"
BAR = re.compile(r"\x1b\[\?25[lh]|[^\n]*━[^\n]*\n?|\r|\x1b\[\d?[AK]")  # of compiling, gone when it is done
COLOUR = re.compile(r"\x1b\[[\d;]*m")
LOG_LINE = re.compile(r"\[(INFO|WARN|ERROR)\] \[[\d.]+\] \[cable_twin\]: \S.*")


class Terminal:
    """`sim` as the foreground process of its own terminal."""

    def __init__(self, directory, domain, *arguments, **streams):
        self.main, side = pty.openpty()
        self.resize(ROWS, COLUMNS)
        self.process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, *arguments],
            cwd=directory,
            env={**environment(directory, domain), "TERM": "xterm-256color"},
            **{"stdin": side, "stdout": side, "stderr": side, **streams},
            start_new_session=True,
        )
        os.close(side)
        self.output = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def resize(self, rows, columns):
        ioctl(self.main, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))

    def _read(self):
        while True:
            try:
                data = os.read(self.main, 65536)
            except OSError:  # nobody has the other side any more
                return
            self.output += data.decode().replace("\r\n", "\n")

    @property
    def rows(self):
        """Texts of the status line so far, without colours."""
        return [COLOUR.sub("", text) for _, text in DRAWN.findall(self.output)]

    def end(self):
        self.process.send_signal(signal.SIGINT)
        code = self.process.wait(PATIENCE)
        self._reader.join(PATIENCE)
        return code

    def close(self):
        self.process.kill()
        self.process.wait()
        os.close(self.main)


# a shell would have made the terminal its own
SCRIPT = """
import fcntl, os, sys, termios
fcntl.ioctl(next(fd for fd in (0, 1, 2) if os.isatty(fd)), termios.TIOCSCTTY, 0)
from cable_twin.ros.sim import main
sys.exit(main())
"""


@pytest.fixture
def terminals(tmp_path, domain):
    opened = []

    def start(*arguments, **streams):
        scenario = ["--scenario", str(write_quick_scenario(tmp_path))]
        opened.append(Terminal(tmp_path, domain, *scenario, *arguments, **streams))
        return opened[-1]

    yield start
    for terminal in opened:
        terminal.close()


def test_it_says_how_the_twin_is_and_events_are_lines_of_the_log(terminals, participants, domain):
    sim = terminals()
    wait_until(lambda: len(sim.rows) > 8 or sim.process.poll() is not None, COMPILING)
    first = sim.rows[8]
    assert re.match(r"(quick  )?[\d.]+ s  x[\d.]+(, [\d.]+ m?s late)?  ", first), first
    assert re.search(r"  cabin at 60\.0 m \+0\.00 m/s  ", first), first
    assert re.search(r"  from another terminal: \S+ cabin --speed", first), first
    if first.startswith("quick"):  # not so where the path of that command takes the room
        assert re.search(r"  tension [\d.]+ kN \(limit [\d.]+\)  recording  ", first), first
    assert all(len(row) < COLUMNS for row in sim.rows)

    participant = participants(domain)
    participant.subscribe_standard()
    with participant.stream(name=["cabin"], velocity=[2.0]):
        participant.until(lambda: "+2.00 m/s" in sim.rows[-1])
    assert "from another terminal" not in sim.rows[-1]
    participant.call("emergency_stop", SetBool, data=False)  # none is in force, and no news
    participant.call("emergency_stop", SetBool, data=True)
    participant.until(lambda: "EMERGENCY STOP" in sim.rows[-1])
    participant.call("emergency_stop", SetBool, data=False)
    participant.call("pause", SetBool, data=True)
    participant.until(lambda: "  paused  " in sim.rows[-1])
    participant.call("pause", SetBool, data=True)  # is paused already, and no news
    participant.call("reset", Trigger)
    participant.call("pause", SetBool, data=False)
    participant.until(lambda: re.search(r"  x[\d.]+", sim.rows[-1]))
    assert sim.end() == 0

    # without the row, what is left is the log, line by line
    assert sim.output.count(TAKEN) == sim.output.count(GIVEN_BACK) == 1
    rest = DRAWN.sub("", sim.output.replace(GIVEN_BACK, "")).replace(TAKEN, "", 1)
    lines = COLOUR.sub("", BAR.sub("", rest)).splitlines()
    assert all(LOG_LINE.fullmatch(line) for line in lines), lines
    for text in ("emergency stop at", "emergency stop released at", "paused at", "running at", "state put back"):
        assert sum(f"[cable_twin]: {text}" in line for line in lines) == 1, text
    assert "log closed" in lines[-1]
    assert sim.output.index(GIVEN_BACK) < sim.output.index("log closed")


def test_it_follows_the_size_of_the_terminal(terminals):
    sim = terminals("--record", "false")
    wait_until(lambda: sim.rows or sim.process.poll() is not None, COMPILING)
    sim.resize(10, 40)
    wait_until(lambda: DRAWN.findall(sim.output)[-1][0] == "10", what="the row of the new size")
    assert len(sim.rows[-1]) < 40
    assert "\x1b[1;9r" in sim.output
    sim.resize(3, 40)  # no room
    wait_until(lambda: sim.output.count(GIVEN_BACK) == 2, what="the row given back")
    assert sim.end() == 0
    assert sim.output.count(GIVEN_BACK) == 2


def test_it_is_there_where_both_streams_are_terminals_alone(monkeypatch, tmp_path):
    monkeypatch.setenv("TERM", "xterm")
    main, side = pty.openpty()
    with os.fdopen(side, "w") as terminal, (tmp_path / "stream.txt").open("w") as file:
        for streams, shown in (((terminal, terminal), True), ((file, terminal), False), ((terminal, file), False)):
            bar = StatusBar(lambda width: Text(""), *streams)
            bar.start()
            assert ("status bar" in {thread.name for thread in threading.enumerate()}) == shown
            bar.stop()
    os.close(main)


def status_of(scenario, **counts):
    simulation, figures = Simulation(scenario), FigureWatch(KeyFigures(scenario))
    figures.update(simulation.snapshot)
    loop = SimpleNamespace(simulated_time=12.5, behind=0.0, fault=None, paused=False)
    diagnostics = SimpleNamespace(
        counts={"commands_applied": 0, **counts}, recording=SimpleNamespace(problem=lambda: None)
    )
    return StatusLine(simulation, loop, SimpleNamespace(figures=figures, run=None), diagnostics, TopicNames())


def test_on_eighty_columns_it_says_how_to_drive_and_then_the_tension():
    scenario = load_scenario(TRAMWAY)
    status = status_of(scenario)
    told = status.text(79).plain
    assert status.hint in told
    assert told.startswith("12.5 s  ")
    assert len(told) <= 79
    whole = status.text(200).plain
    assert whole.startswith(f"{scenario.name}  12.5 s  ")
    assert whole.endswith(f"  not recorded  from another terminal: {status.hint}")
    assert status.hint not in status.text(len(status.hint)).plain  # half of it would be of no use
    driven = status_of(scenario, commands_applied=1).text(79).plain
    assert re.search(r"cabin at [\d.]+ m \+0\.00 m/s  tension [\d.]+ kN \(limit [\d.]+\)", driven), driven


def test_of_several_ropes_it_has_the_tension_of_the_one_nearest_to_its_limit():
    scenario = load_scenario(
        clamped(places=(100.0,), elements=16), {"ropes.track.breaking_force": 4e6, "ropes.haul.breaking_force": 4e5}
    )
    status = status_of(scenario, commands_applied=1)
    simulation, figures = status._simulation, status._output.figures
    highest = {name: simulation.snapshot.ropes[name].tensions.max() for name in scenario.ropes}
    limits = {
        name: rope.breaking_force / figures.limit("rope_safety_factor", f"ropes.{name}")
        for name, rope in scenario.ropes.items()
    }
    assert highest["haul"] / limits["haul"] > highest["track"] / limits["track"]
    shown = f"haul {highest['haul'] * 1e-3:.4g} kN (limit {limits['haul'] * 1e-3:.4g})"
    whole = status.text(150).plain
    assert whole.endswith(f"  {shown}  not recorded"), whole
    unnamed = status.text(len(whole) - 1).plain  # what has no room is left out whole, and the name first
    assert unnamed == whole.removeprefix(f"{scenario.name}  ")
    assert status.text(len(unnamed) - 1).plain.endswith(f"  {shown}")
    assert shown not in status.text(unnamed.index(shown) + len(shown) - 1).plain


def test_a_live_view_names_the_browser_where_no_window_can_open(monkeypatch):
    run = SimpleNamespace(web=None, live_url="rerun+http://127.0.0.1:9876/proxy")
    monkeypatch.setenv("DISPLAY", ":0")
    assert live_hint(run).endswith(f" --bind 127.0.0.1 --connect {run.live_url}")
    monkeypatch.delenv("DISPLAY")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert live_hint(run).endswith(f" --connect {run.live_url}; no display here: --rerun web")
