"""Bars in a terminal: progress of a start, and a status bar in the bottom row below all other output.

The status bar takes its row out of the scrolled region, as apt does, so that no line of another writer can tear it: rcl
logs from C, rerun from Rust.
"""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from io import StringIO
from typing import TextIO

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from cable_twin.simulation.engine import RelaxationMoment, watching_relaxation
from cable_twin.simulation.first_compilation import Moment, watching_compilation
from cable_twin.terminal.command_line import left_at_once

BEGIN = "compiling the solver's kernels, once on this machine"
LARGE = 5000  # elements, from which on a line reports the settling of the rope where there is no bar
SETTLING_TIME = 1.0  # s, before which it does not
REPORTED = (0.1, 0.4, 0.7)  # shares of compilation at which a line reports the remaining time where there is no bar
PERIOD = 0.25  # s
PATIENCE = 2.0  # s that a count takes at least where it has a bar
FEWEST_ROWS, FEWEST_COLUMNS = 4, 20  # of a terminal that has room for it
SAVE, RESTORE = "\x1b7", "\x1b8"  # the place of the cursor
SCROLL_ALL, ERASE_ROW, ERASE_BELOW = "\x1b[r", "\x1b[2K", "\x1b[J"


@contextmanager
def count_shown(console: Console, things: str, count: int) -> Iterator[Callable[[], None]]:
    """Show a progress bar over a long series of items; yields a function to call after each finished item."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task, began, done = progress.add_task(things, total=count, visible=False), time.monotonic(), 0

        def show() -> None:
            nonlocal done
            done += 1
            duration = (time.monotonic() - began) / done * count
            if done > count:  # some that were added
                progress.update(task, description=f"more {things}", total=None)
            progress.update(task, completed=done, visible=duration > PATIENCE)

        yield show


@contextmanager
def share_shown(console: Console, what: str) -> Iterator[Callable[[float], None]]:
    """Show a progress bar over one long call; yields a function that takes the finished fraction, 0 to 1."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task, began = progress.add_task(what, total=1.0, visible=False), time.monotonic()

        def show(share: float) -> None:
            visible = time.monotonic() - began > PATIENCE * share and share < 1.0
            progress.update(task, completed=share, visible=visible)

        yield show


@contextmanager
def compilation_shown(console: Console, line: Callable[[str], object]) -> Iterator[None]:
    """Context that shows the progress of kernel compilation and of the relaxation of the rope to its equilibrium.

    Args:
        console: console with the bar, if it is a terminal.
        line: called without a terminal, with a line at the begin, for the remaining time, and at the end.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TaskProgressColumn(),
        TextColumn("{task.fields[kernel]}"),
    )
    began, reported = time.monotonic(), -1
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("starting", total=None, kernel="")

        def show(moment: Moment) -> None:
            nonlocal reported
            left = "" if moment.remaining is None else f"about {moment.remaining:.0f} s left"
            if console.is_terminal:
                what = ", ".join(filter(None, (left, moment.kernel)))
                progress.update(task, description="compiling, once", total=1.0, completed=moment.share, kernel=what)
            elif reported < 0:
                line(BEGIN)
            reached = sum(moment.share >= share for share in REPORTED)
            if not console.is_terminal and reached > reported >= 0:
                line(f"compiling: {100.0 * moment.share:.0f} %{f', {left}' if left else ''}")
            reported = max(reported, reached, 0)

        estimated = False

        def show_settling(moment: RelaxationMoment) -> None:
            nonlocal estimated
            what = f"{moment.elements} elements, {moment.iterations} iterations, at most {moment.remaining:.0f} s left"
            if console.is_terminal:
                progress.update(task, description="the rope settles", total=1.0, completed=moment.share, kernel=what)
            elif moment.elements >= LARGE and moment.elapsed > SETTLING_TIME and not estimated:
                estimated = True
                line(f"the rope settles: {what}")

        with watching_compilation(show), watching_relaxation(show_settling):
            yield
    if reported >= 0:
        line(f"kernels compiled in {time.monotonic() - began:.1f} s and kept for next time")


@contextmanager
def start_shown(command: str, console: Console) -> Iterator[None]:
    """Context for the start of a command: progress as of `compilation_shown`, and Ctrl-C ends the process at once."""
    with left_at_once(command), compilation_shown(console, partial(print, file=sys.stderr, flush=True)):
        yield


class StatusBar:
    """Status bar in the bottom row, redrawn four times a second by its own thread; inactive without a terminal.

    Args:
        text: returns the text for a width in characters; called by the thread.
        streams: streams that all have to be terminals; the bar is written to the last one.
    """

    def __init__(self, text: Callable[[int], Text], *streams: TextIO) -> None:
        self._text = text
        self._usable = all(stream.isatty() for stream in streams) and os.environ.get("TERM", "dumb") != "dumb"
        self._terminal = streams[-1].fileno() if self._usable else -1
        self._size: os.terminal_size | None = None  # of the terminal whose row is reserved
        self._stopping = threading.Event()
        # a daemon, as a terminal stopped by Ctrl-S may take nothing for as long as somebody likes
        self._thread = threading.Thread(target=self._run, name="status bar", daemon=True)

    def start(self) -> None:
        """Begin to show the status bar."""
        if self._usable:
            self._thread.start()

    def stop(self) -> None:
        """Give the bottom row back to the terminal, within a second at most."""
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join(1.0)

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                if self._in_foreground():
                    self._draw()
                self._stopping.wait(PERIOD)
            self._write(self._released())
        except OSError:
            return  # the terminal is gone

    def _in_foreground(self) -> bool:
        """Whether this process is in the terminal's foreground, and not in the background as after `sim &`."""
        try:
            return os.tcgetpgrp(self._terminal) == os.getpgrp()
        except OSError:
            return False

    def _draw(self) -> None:
        size = os.get_terminal_size(self._terminal)
        before = ""
        if size != self._size:
            before = self._released() + self._reserved(size)
        if self._size is not None:
            place = f"\x1b[{size.lines};1H"
            self._write(f"{before}{SAVE}{place}{ERASE_ROW}{self._rendered(size.columns - 1)}{RESTORE}")
        else:
            self._write(before)

    def _reserved(self, size: os.terminal_size) -> str:
        """Escape sequence that reserves the bottom row, with the cursor above; empty in a too small terminal."""
        if size.lines < FEWEST_ROWS or size.columns < FEWEST_COLUMNS:
            return ""
        self._size = size
        return f"\n{SAVE}\x1b[1;{size.lines - 1}r{RESTORE}\x1b[1A"

    def _released(self) -> str:
        """Escape sequence that lets the terminal scroll all rows again and clears all below the cursor."""
        if self._size is None:
            return ""
        self._size = None
        return f"{SAVE}{SCROLL_ALL}{RESTORE}{ERASE_BELOW}"

    def _rendered(self, width: int) -> str:
        """Text of the status bar in the terminal's colours, cropped to a width in characters."""
        console = Console(file=StringIO(), force_terminal=True, width=width, legacy_windows=False)
        with console.capture() as capture:
            console.print(self._text(width), end="", no_wrap=True, overflow="crop", crop=True, highlight=False)
        return capture.get()

    def _write(self, text: str) -> None:
        os.write(self._terminal, text.encode())  # at once, or another writer would come between
