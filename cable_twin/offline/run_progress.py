"""Progress bar of `simulate` on a terminal."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn


@contextmanager
def run_progress(console: Console, start: float, duration: float) -> Iterator[Callable[[float], None]]:
    """Show a bar with simulated time, real-time factor and remaining time; yields its updating callback."""
    columns = (
        TextColumn("simulate"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.completed:.0f} of {task.total:.0f} s, {task.fields[factor]:.1f} times real time, remaining"),
        TimeRemainingColumn(),
    )
    # a file gets nothing of it, not even the empty line in the end
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as progress:
        task = progress.add_task("simulate", total=duration, factor=0.0)
        began = time.monotonic()

        def on_frame(simulated: float) -> None:
            elapsed = max(time.monotonic() - began, 1e-3)
            done = simulated - start
            progress.update(task, completed=min(done, duration), factor=done / elapsed)

        yield on_frame
