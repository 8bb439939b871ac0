"""What a first start shows while it compiles: a bar by kernel on a terminal, else a few lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from cable_twin.simulation.compilation_watch import Moment, watching_compilation

BEGIN = "compiling the solver's kernels, once on this machine"
TOLD = (0.1, 0.4, 0.7)  # shares at which a line says how long it will take, where there is no bar


@contextmanager
def compilation_shown(console: Console, line: Callable[[str], object]) -> Iterator[None]:
    """Show what is compiled within this block.

    Args:
        console: Where the bar is, if that is a terminal.
        line: Takes a line about the begin, the time that is left at this machine's speed, and the end.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        TaskProgressColumn(),
        TextColumn("{task.fields[kernel]}"),
    )
    began, told = time.monotonic(), -1
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("the cable settles", total=None, kernel="")

        def show(moment: Moment) -> None:
            nonlocal told
            left = "" if moment.remaining is None else f"some {moment.remaining:.0f} s left"
            if console.is_terminal:
                what = f"{left}, {moment.kernel}" if left else moment.kernel
                progress.update(task, description="compiling, once", total=1.0, completed=moment.share, kernel=what)
            elif told < 0:
                line(BEGIN)
            reached = sum(moment.share >= share for share in TOLD)
            if not console.is_terminal and reached > told >= 0:
                line(f"compiling: {100.0 * moment.share:.0f} %{f', {left}' if left else ''}")
            told = max(told, reached, 0)

        with watching_compilation(show):
            yield
    if told >= 0:
        line(f"kernels compiled in {time.monotonic() - began:.1f} s and kept for next time")


__all__ = ["compilation_shown"]
