"""The command `review`: what a recorded run, or two beside each other, showed: key figures, plots and rerun."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from importlib.util import find_spec
from itertools import chain
from pathlib import Path
from typing import Any, Protocol

from rich import box
from rich.console import Console
from rich.progress import (
    BarColumn,
    DownloadColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from cable_twin.command_line import OneLineParser
from cable_twin.figure_messages import figures_of_statuses
from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.figure_table import print_figures, shown_unit, table_console
from cable_twin.offline.repair import repair
from cable_twin.offline.signal_series import Comparison, Difference, Signals, compare, signal_values, unit_of
from cable_twin.recording.log_reader import Log, LogError, read_log
from cable_twin.recording.snapshot_reader import Item, RecordedFigures, read_snapshots
from cable_twin.records import AppliedCommand
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.scenario.schema import Carriers
from cable_twin.snapshot import Snapshot

SHOWN, NOT_WRITTEN, CANNOT = 0, 1, 2  # exit codes
FIGURES_AGE = 1.5  # s before the end at which the last key figures may have been recorded without a word
BATCH = 500  # frames; the index of a recording is kept in memory, an entry a batch
EPILOG = """\
exit codes: 0 all is shown, 1 plots or recording cannot be written, 2 a bag cannot be read, 130 ended by Ctrl-C

examples:
  review cable_twin_logs/2026-01-31_09-30-00
  review run.mcap --no-viewer --plots pictures
  review cable_twin_logs/2026-01-31_09-30-00 cable_twin_logs/2026-01-31_09-45-00 --plots pictures
"""


class _View(Protocol):
    def log(self, snapshot: Snapshot) -> None: ...

    def log_command(self, applied: AppliedCommand) -> None: ...


class Reading:
    """One bag being read: everything that is gathered from it in one pass.

    Args:
        log: The bag.
        on_position: Called with the bytes read so far.

    Raises:
        LogError: The log holds no frame, or its scenario cannot be understood.
    """

    def __init__(self, log: Log, on_position: Callable[[int], None] | None = None) -> None:
        self.log = log
        try:
            self.scenario = load_scenario(log.scenario)
        except ScenarioError as error:
            raise LogError("\n".join(f"{log.path}: {fault}" for fault in error.faults)) from error
        self._gathered = KeyFigures(self.scenario)
        self._recorded: list[KeyFigure] | None = None  # the last ones
        self._figures_time = 0.0  # s, of those
        self.signals = Signals()
        self.view: _View | None = None
        self.frames, self.commands, self.end = 0, 0, 0.0
        self._items = read_snapshots(log, on_position=on_position)
        self._early: list[AppliedCommand | RecordedFigures] = []
        self.first = self._find_first()

    @property
    def name(self) -> str:
        """What names the run: its directory, or its file where that is alone."""
        return self.log.source.name

    def _find_first(self) -> Snapshot:
        for item in self._items:
            if isinstance(item, Snapshot):
                return item
            self._early.append(item)
        raise LogError(f"{self.log.path}: no frame of the twin in it")

    def values(self) -> Iterator[tuple[float, Mapping[str, float]]]:
        """Read the bag; yields time (s) and signals of each frame after taking it in."""
        for item in chain(self._early, [self.first], self._items):
            yield from self._take(item)

    @property
    def figures(self) -> list[KeyFigure]:
        """Key figures as the run had them from all its frames; where none were recorded, those of the frames here."""
        return self._gathered.figures() if self._recorded is None else self._recorded

    def _take(self, item: Item) -> Iterator[tuple[float, Mapping[str, float]]]:
        if isinstance(item, AppliedCommand):
            self.commands += 1
            self._gathered.command(item)
            if self.view is not None:
                self.view.log_command(item)
            return
        if isinstance(item, RecordedFigures):
            self._recorded, self._figures_time = self._understand(item), item.time
            return
        values = signal_values(item)
        self._gathered.update(item)
        self.signals.update(item, values)
        if self.view is not None:
            self.view.log(item)
        self.frames += 1
        self.end = item.time
        yield item.time, values

    def _understand(self, recorded: RecordedFigures) -> list[KeyFigure]:
        try:
            return figures_of_statuses(recorded.statuses)
        except ValueError as error:
            raise LogError(f"{self.log.path}: key figures at {recorded.time:.6f} s are unreadable: {error}") from error

    def summary(self) -> str:
        """One line about the run."""
        whole = self._recorded is None or self.end - self._figures_time < FIGURES_AGE
        return (
            f"{self.log.path}: {self.log.condition}; scenario {self.scenario.name}, {self.end:.2f} s, "
            f"{self.frames} frames, {self.commands} commands"
            + ("" if whole else f"; key figures as of {self._figures_time:.2f} s, their last record")
        )


def parser() -> OneLineParser:
    """Options of `review`."""
    result = OneLineParser(
        "review", "Show a recorded run in rerun with its key figures, or compare two.", EPILOG, failure=CANNOT
    )
    result.add_argument(
        "bags", type=Path, nargs="+", metavar="BAG", help="directory of a run, or its .mcap; one or two"
    )
    result.add_argument("--plots", type=Path, metavar="DIR", help="write plots as PNG")
    result.add_argument("--no-viewer", action="store_true", help="neither make nor open a rerun recording")
    result.add_argument(
        "--repair", action="store_true", help="only copy what is readable of a bag cut short or damaged to BAG_repaired"
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Review one or two bags; see the exit codes above."""
    if argv is None:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `review BAG | head` ends without a word
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    if len(options.bags) > 2:
        arguments.error(f"{len(options.bags)} bags given; one or two are allowed")
    if options.plots is not None and find_spec("matplotlib") is None:
        arguments.error("--plots needs matplotlib, which this Python does not have: pip install matplotlib")
    console = Console(stderr=True)
    try:
        logs = [read_log(bag) for bag in options.bags]
        if options.repair:
            return _repair(logs, console)
        return _review(logs, options.plots, options.no_viewer, console)
    except LogError as error:
        for line in str(error).splitlines():
            print(f"review: {line}", file=sys.stderr)
        return CANNOT


def _repair(logs: Sequence[Log], console: Console) -> int:
    """Make bags with an index of those that have none, and of those that are damaged."""
    for log in logs:
        try:
            with _progress(console) as progress:
                if log.complete:
                    task = progress.add_task(f"reading {log.path.name}", total=log.size)
                    for _ in log.messages(on_position=_mover(progress, task)):
                        pass  # whether it is damaged is known in the end
                    if not log.damage:
                        print(f"{log.path}: complete, nothing to repair")
                        continue
                task = progress.add_task(f"repairing {log.path.name}", total=log.size)
                directory, count = repair(log, _mover(progress, task))
        except OSError as error:
            print(f"review: --repair {log.path}: {error.strerror or error}: {error.filename}", file=sys.stderr)
            return NOT_WRITTEN
        print(f"{directory}: {count} messages, all that could be read of {log.path}")
    return SHOWN


def _progress(console: Console) -> Progress:
    """A bar over the bytes of files; a file as output gets nothing of it, not even the empty line in the end."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _review(logs: Sequence[Log], plots: Path | None, no_viewer: bool, console: Console) -> int:
    """Read, print, draw and open."""
    code = SHOWN
    comparison: Comparison | None = None
    recordings: list[Path] = []
    with _progress(console) as progress:
        readings = []
        for log in logs:
            task = progress.add_task(f"reading {log.path.name}", total=log.size)
            readings.append(Reading(log, _mover(progress, task)))
        made: _Recording | None = None
        if not no_viewer:
            recordings = _existing_recordings(logs[0]) if len(logs) == 1 else []
            if not recordings:
                try:
                    made = _Recording(readings)
                except OSError as error:
                    print(f"review: no rerun recording: {error}", file=sys.stderr)
                    code = NOT_WRITTEN
        try:
            if len(readings) == 2:
                comparison = compare(readings[0].values(), readings[1].values())
            else:
                for _ in readings[0].values():
                    pass
            if made is not None:
                recordings = [made.finish()]
        except OSError as error:
            print(f"review: the rerun recording cannot be written: {error}", file=sys.stderr)
            code = NOT_WRITTEN
        finally:
            if made is not None:
                made.discard()
    _print(readings, comparison)
    if plots is not None and not _write_plots(readings, plots, console):
        code = NOT_WRITTEN
    if recordings:
        _show(recordings)
    return code


def _mover(progress: Progress, task: TaskID) -> Callable[[int], None]:
    """What moves a bar to a position, at most once in each hundred kilobytes."""
    shown = 0

    def move(position: int) -> None:
        nonlocal shown
        if position - shown > 100_000:
            shown = position
            progress.update(task, completed=position)

    return move


def _existing_recordings(log: Log) -> list[Path]:
    """The .rrd beside each file: the twin's own, which after a kill lacks its end, else the one made from the bag."""
    directory = log.files[0].path.resolve().parent
    choices = [[directory / _made_name([log])]]
    if log.complete:
        own = [directory / file.path.with_suffix(".rrd").name for file in log.files]
        choices = [own, [directory / f"{directory.name}.rrd"], *choices]  # the second of format 1, one for the run
    for files in choices:
        with suppress(OSError):
            if all(file.stat().st_size > 0 for file in files):
                return files
    return []


def _made_name(logs: Sequence[Log]) -> str:
    """Name of a recording made from bags: never that of one of the twin's own."""
    return f"{'_and_'.join(log.source.name for log in logs)}{'_review' if len(logs) == 1 else ''}.rrd"


class _Recording:
    """A rerun recording being made from bags; it gets its name when it is complete.

    Raises:
        OSError: Neither the directory of the bag nor the one for temporary files can be written.
    """

    def __init__(self, readings: Sequence[Reading]) -> None:
        from cable_twin.offline.comparison_view import ComparisonView  # noqa: PLC0415 - half a second
        from cable_twin.recording.run import open_view  # noqa: PLC0415

        names = [reading.name for reading in readings]
        name = _made_name([reading.log for reading in readings])
        directory = readings[0].log.files[0].path.parent
        if not os.access(directory, os.W_OK):
            directory = Path(tempfile.mkdtemp(prefix="review_"))
        self._target = directory / name
        self._partial = directory / f"{name}.part"
        self._view: Any
        if len(readings) == 2:
            scenarios = [reading.scenario for reading in readings]
            self._view = ComparisonView(scenarios, names, self._partial, readings[0].first)
            readings[0].view, readings[1].view = self._view.views
        else:
            self._view = open_view(readings[0].scenario, self._partial, batch_frames=BATCH)
            readings[0].view = self._view

    def finish(self) -> Path:
        """Close it and give it its name."""
        self._view.close()
        return self._partial.replace(self._target)

    def discard(self) -> None:
        """Remove what was not finished."""
        with suppress(OSError):
            self._partial.unlink(missing_ok=True)


def _print(readings: Sequence[Reading], comparison: Comparison | None) -> None:
    """Summaries, key figures, and the differences of two runs."""
    console = table_console()
    for label, reading in zip("ab", readings, strict=False):
        print(f"{label}: {reading.summary()}" if comparison is not None else reading.summary())
    print_figures(console, [reading.figures for reading in readings])
    if comparison is not None:
        _print_differences(console, readings, comparison)


def _print_differences(console: Console, readings: Sequence[Reading], comparison: Comparison) -> None:
    table = Table("signal", box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("largest difference", "rms", "unit", "at", "a there", "b there"):
        table.add_column(title, justify="left" if title == "unit" else "right", no_wrap=True)
    carriers = readings[0].scenario.carriers
    for name, difference in _worst_of_each(comparison.differences, carriers).items():
        if difference.count:
            unit, scale = shown_unit(unit_of(name), max(map(abs, difference.values)))
            numbers = [f"{value * scale:.4g}" for value in (difference.largest, difference.rms)]
            there = [f"{value * scale:.6g}" for value in difference.values]
            table.add_row(name, *numbers, unit, f"{difference.time:.2f} s", *there)
    print(f"differences at {comparison.frames} common frames")
    if comparison.frames:
        console.print(table)
        if carriers is not None:
            name = carriers.name
            print(f"of {name}_1 to {name}_{carriers.count} the one that differs most is shown\n")
    for label, names in zip("ab", comparison.only_in, strict=True):
        if names:
            print(f"only in {label}: {', '.join(sorted(names))}")
    if abs(readings[0].end - readings[1].end) > 1e-3:
        print(f"a ends at {readings[0].end:.2f} s, b at {readings[1].end:.2f} s")


def _worst_of_each(differences: Mapping[str, Difference], carriers: Carriers | None) -> dict[str, Difference]:
    """Signals to show: of each signal of the carriers only that of the one that differs most."""
    if carriers is None:
        return dict(differences)
    worst: dict[str, str] = {}
    for name, difference in differences.items():
        kind = re.sub(f"/{carriers.name}_[0-9]+(?=/|$)", "/*", name)
        if kind not in worst or difference.largest > differences[worst[kind]].largest:
            worst[kind] = name
    return {name: differences[name] for name in worst.values()}


def _write_plots(readings: Sequence[Reading], directory: Path, console: Console) -> bool:
    """Write the plots; says where they are, or what prevents it."""
    from cable_twin.offline.plots import PlottedRun, write_plots  # noqa: PLC0415 - a second, and not always installed

    labels = "ab" if len(readings) == 2 else ("",)
    runs = [
        PlottedRun(label, reading.scenario.name, reading.name, reading.signals)
        for label, reading in zip(labels, readings, strict=True)
    ]
    try:
        with console.status("drawing") as status:
            files = write_plots(runs, directory, lambda file: status.update(f"drawing {file}"))
    except OSError as error:
        print(f"review: --plots {directory}: {error.strerror or error}", file=sys.stderr)
        return False
    print(f"plots: {', '.join(str(file) for file in files)}")
    return True


def _show(recordings: Sequence[Path]) -> None:
    """Open the viewer where there is a screen, on the local interface only; else say how."""
    files = [str(recording) for recording in recordings]
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        print(f"no display here; look at it with: rerun {' '.join(files)}")
        return
    subprocess.Popen(
        [sys.executable, "-m", "rerun", "--bind", "127.0.0.1", *files],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    print(f"opened in rerun: {' '.join(files)}")


if __name__ == "__main__":
    sys.exit(main())
