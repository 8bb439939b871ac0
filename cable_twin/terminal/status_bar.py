"""Status bar in the bottom row of a terminal, redrawn a few times a second by its own thread, below all other output.

The row is taken out of what the terminal scrolls, as apt does, so that nobody who writes a line can tear it: rcl logs
from C, rerun from Rust. Knows nothing of a twin.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from io import StringIO
from typing import TextIO

from rich.console import Console
from rich.text import Text

PERIOD = 0.25  # s
FEWEST_ROWS, FEWEST_COLUMNS = 4, 20  # of a terminal that has room for it
HERE, BACK = "\x1b7", "\x1b8"  # keep the place of the cursor, and go back to it
ALL, ROW, BELOW = "\x1b[r", "\x1b[2K", "\x1b[J"  # scroll all rows; erase the row, what is below


class BottomRow:
    """Status bar with a text in the bottom row, inactive where a stream is not a terminal.

    Args:
        text: What to show in so many characters; called by the thread.
        streams: All have to be terminals; the last one is written to.
    """

    def __init__(self, text: Callable[[int], Text], *streams: TextIO) -> None:
        self._text = text
        self._usable = all(stream.isatty() for stream in streams) and os.environ.get("TERM", "dumb") != "dumb"
        self._terminal = streams[-1].fileno() if self._usable else -1
        self._size: os.terminal_size | None = None  # that the row was taken from
        self._stopping = threading.Event()
        # a terminal may take nothing for as long as somebody likes (Ctrl-S), which must not keep the process
        self._thread = threading.Thread(target=self._run, name="bottom row", daemon=True)

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
            self._write(self._given_back())
        except OSError:
            return  # the terminal is gone

    def _in_foreground(self) -> bool:
        """Whether this process is in the terminal's foreground; after `sim &` the shell and its editors are."""
        try:
            return os.tcgetpgrp(self._terminal) == os.getpgrp()
        except OSError:
            return False

    def _draw(self) -> None:
        size = os.get_terminal_size(self._terminal)
        before = ""
        if size != self._size:
            before = self._given_back() + self._taken(size)
        if self._size is not None:
            place = f"\x1b[{size.lines};1H"
            self._write(f"{before}{HERE}{place}{ROW}{self._rendered(size.columns - 1)}{BACK}")
        else:
            self._write(before)

    def _taken(self, size: os.terminal_size) -> str:
        """Escape sequence that reserves the bottom row, with the cursor above; empty in a too small terminal."""
        if size.lines < FEWEST_ROWS or size.columns < FEWEST_COLUMNS:
            return ""
        self._size = size
        return f"\n{HERE}\x1b[1;{size.lines - 1}r{BACK}\x1b[1A"

    def _given_back(self) -> str:
        """Escape sequence that lets the terminal scroll all rows again and clears all below the cursor."""
        if self._size is None:
            return ""
        self._size = None
        return f"{HERE}{ALL}{BACK}{BELOW}"

    def _rendered(self, width: int) -> str:
        """Text of the status bar in the terminal's colours, cropped to a width in characters."""
        console = Console(file=StringIO(), force_terminal=True, width=width, legacy_windows=False)
        with console.capture() as capture:
            console.print(self._text(width), end="", no_wrap=True, overflow="crop", crop=True, highlight=False)
        return capture.get()

    def _write(self, text: str) -> None:
        os.write(self._terminal, text.encode())  # at once, or another writer would come between
