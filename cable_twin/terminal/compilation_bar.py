"""Progress of a start: compilation by kernel, and settling of the rope; a bar on a terminal, else a few lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn

from cable_twin.simulation.compilation_watch import Moment, watching_compilation
from cable_twin.simulation.engine import RelaxationMoment, watching_relaxation

BEGIN = "compiling the solver's kernels, once on this machine"
LARGE = 5000  # elements, from which on a line says how long the rope takes to settle at most, where there is no bar
SOON = 1.0  # s, before which it says nothing
TOLD = (0.1, 0.4, 0.7)  # shares at which a line says how long it will take, where there is no bar


@contextmanager
def compilation_shown(console: Console, line: Callable[[str], object]) -> Iterator[None]:
    """Context that shows the progress of compilation and of settling.

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
        task = progress.add_task("starting", total=None, kernel="")

        def show(moment: Moment) -> None:
            nonlocal told
            left = "" if moment.remaining is None else f"about {moment.remaining:.0f} s left"
            if console.is_terminal:
                what = ", ".join(filter(None, (left, moment.kernel)))
                progress.update(task, description="compiling, once", total=1.0, completed=moment.share, kernel=what)
            elif told < 0:
                line(BEGIN)
            reached = sum(moment.share >= share for share in TOLD)
            if not console.is_terminal and reached > told >= 0:
                line(f"compiling: {100.0 * moment.share:.0f} %{f', {left}' if left else ''}")
            told = max(told, reached, 0)

        estimated = False

        def show_settling(moment: RelaxationMoment) -> None:
            nonlocal estimated
            what = f"{moment.elements} elements, {moment.iterations} iterations, at most {moment.remaining:.0f} s left"
            if console.is_terminal:
                progress.update(task, description="the rope settles", total=1.0, completed=moment.share, kernel=what)
            elif moment.elements >= LARGE and moment.elapsed > SOON and not estimated:
                estimated = True
                line(f"the rope settles: {what}")

        with watching_compilation(show), watching_relaxation(show_settling):
            yield
    if told >= 0:
        line(f"kernels compiled in {time.monotonic() - began:.1f} s and kept for next time")


__all__ = ["compilation_shown"]
