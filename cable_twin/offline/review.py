"""Command `review`: key figures, plots and rerun view of a recorded run, or of several runs side by side."""

from __future__ import annotations

import argparse
import re
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

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

from cable_twin.basics.units import shown_unit
from cable_twin.key_figures.shown import shown
from cable_twin.offline.export import Export, add_export, export_fault
from cable_twin.offline.figure_table import LABELS, print_figures, table_console
from cable_twin.offline.reading import Reading
from cable_twin.offline.repair import repair
from cable_twin.offline.responses import print_responses
from cable_twin.offline.review_picture import MadeRecording, existing_recordings, serve, show
from cable_twin.offline.simulate_options import add_rule_options, plots_fault, profile_fault
from cable_twin.offline.thinned_series import Comparison, Difference, compare, unit_of
from cable_twin.offline.verdict_table import print_verdicts
from cable_twin.recording.log_file import LogError
from cable_twin.recording.log_reader import Log, read_log
from cable_twin.scenario.sections.vehicles import Carriers
from cable_twin.terminal.command_line import OneLineParser, fail, print_line, tell
from cable_twin.view.web_view import why_not

LONGEST_TITLE = 24  # letters of what --output called a run, in a legend
DIGITS = 6  # of both values beside their difference
WIDE = 110  # characters that the whole table of differences needs
RUNS = Path("cable_twin_logs")  # where runs are that nobody names
SHOWN, NOT_WRITTEN, CANNOT = 0, 1, 2  # exit codes
EPILOG = """\
exit codes: 0 all is shown, 1 plots or recording cannot be written or a rule profile of the log is not there, 2 a bag
cannot be read, 130 ended by Ctrl-C

examples:
  review                                 the newest run in cable_twin_logs
  review cable_twin_logs/2026-01-31_09-30-00 --rerun web
  review run.mcap --no-viewer --plots pictures
  review --no-viewer --profile france_2009 --fact persons=4 --fact grip=fixed
  review cable_twin_logs/2026-01-31_09-30-00 \\
         cable_twin_logs/2026-01-31_09-45-00 --plots pictures
"""


def parser() -> OneLineParser:
    """Parser of the options of `review`."""
    result = OneLineParser(
        "review", "Show a recorded run in rerun with its key figures, or compare several.", EPILOG, failure=CANNOT
    )
    result.add_argument(
        "bags",
        type=Path,
        nargs="*",
        metavar="BAG",
        help=f"directory of a run, or its .mcap; of several all are compared with the first; "
        f"default: the newest run in {RUNS}",
    )
    result.add_argument("--plots", type=Path, metavar="DIR", help="write plots as PNG files into this directory")
    result.add_argument(
        "--rerun",
        choices=("window", "web", "off"),
        default="window",
        help="window: show the rerun recording in rerun's viewer; web: serve it to a browser on "
        "this machine until Ctrl-C; "
        "off: make no recording; "
        "default: window",
    )
    add_rule_options(result)
    add_export(result)
    result.add_argument("--no-viewer", action="store_const", dest="rerun", const="off", help="short for --rerun off")
    result.add_argument(
        "--repair",
        action="store_true",
        help="copy the readable part of a damaged or unfinished bag to BAG_repaired, and do nothing else",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Review one or more recorded runs; returns the exit code that the help lists."""
    if argv is None:
        signal.signal(signal.SIGPIPE, signal.SIG_DFL)  # `review BAG | head` ends without a word
    arguments = parser()
    options = arguments.parse_args(sys.argv[1:] if argv is None else list(argv))
    if not options.bags:
        options.bags = newest_run(RUNS)
        if not options.bags:
            arguments.error(f"no run in {RUNS}: give the directory of one")
    if len(options.bags) > len(LABELS):
        arguments.error(f"bags: given {len(options.bags)}; allowed: at most {len(LABELS)}")
    if fault := profile_fault(options.profile):
        arguments.error(fault)
    if fault := export_fault(options) or (plots_fault("--plots") if options.plots is not None else ""):
        arguments.error(fault)
    console = Console(stderr=True)
    try:
        logs = [read_log(bag) for bag in options.bags]
        if options.repair:
            return _repair(logs, console)
        try:
            export = Export(options)
        except OSError as error:
            tell("review", f"{error.filename}: {error.strerror}")
            return NOT_WRITTEN
        return _review(logs, options, export, console)
    except LogError as error:
        return fail("review", error, CANNOT)


def newest_run(directory: Path) -> list[Path]:
    """List with the directory of the run whose bag was written last below a directory; empty without a bag."""
    written: dict[Path, float] = {}
    for bag in directory.glob("*/*.mcap"):
        with suppress(OSError):  # removed in between
            written[bag.parent] = max(bag.stat().st_mtime, written.get(bag.parent, 0.0))
    return [max(written, key=lambda run: (written[run], run.name))] if written else []


def _repair(logs: Sequence[Log], console: Console) -> int:
    """Repair damaged bags and bags without an index; returns the exit code."""
    for log in logs:
        try:
            with _progress(console) as progress:
                task = progress.add_task(f"reading {log.path.name}", total=log.size)
                for _ in log.messages(on_position=_mover(progress, task)):
                    pass  # what is lost is known in the end
                if log.complete and not log.damage:
                    print_line(f"{log.path}: complete, nothing to repair")
                    continue
                task = progress.add_task(f"repairing {log.path.name}", total=log.size)
                directory, count = repair(log, _mover(progress, task))
        except OSError as error:
            tell("review", f"--repair {log.path}: {error.strerror or error}: {error.filename}")
            return NOT_WRITTEN
        print_line(f"{directory}: {count} messages, all that could be read of {log.path}")
        for line in log.damage:
            print_line(f"  {line}")
    return SHOWN


def _progress(console: Console) -> Progress:
    """Progress bar over the bytes of files, without any output where the console is no terminal."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    return Progress(*columns, console=console, transient=True, disable=not console.is_terminal)


def _review(logs: Sequence[Log], options: argparse.Namespace, export: Export, console: Console) -> int:
    """Read the logs of runs, print the review, write plots and open the viewer; returns the exit code."""
    code, rerun = SHOWN, options.rerun
    comparisons: list[Comparison] = []
    recordings: list[Path] = []
    with _progress(console) as progress:
        readings = []
        for log in logs:
            task = progress.add_task(f"reading {log.path.name}", total=log.size)
            readings.append(Reading(log, _mover(progress, task), options.profile, dict(options.fact)))
            readings[-1].table = export.add(str(log.source), readings[-1].scenario.name)
        made: MadeRecording | None = None
        if rerun != "off":
            recordings = existing_recordings(logs[0]) if len(logs) == 1 else []
            if not recordings:
                try:
                    made = MadeRecording(readings)
                except (OSError, ImportError) as error:  # rerun may be left out of an installation
                    tell("review", f"no rerun recording: {why_not(error)}; --rerun off makes none")
                    code = NOT_WRITTEN
        try:
            comparisons = compare(*(reading.values() for reading in readings), loops=readings[0].loops)
            if made is not None:
                recordings = [made.finish()]
        except OSError as error:
            tell("review", f"the rerun recording cannot be written: {error}")
            code = NOT_WRITTEN
        finally:
            if made is not None:
                made.discard()
    for reading in readings:
        for fault in reading.rule_faults:
            tell("review", f"{reading.log.path}: {fault}; --profile gives another one")
            code = NOT_WRITTEN
        if reading.table is not None:
            reading.table.figures, reading.table.verdicts = reading.figures, reading.verdicts
            reading.table.responses = reading.responses.rows()
    with export.words():
        print_review(readings, comparisons)
        if options.plots is not None and not write_review_plots(readings, options.plots, console):
            code = NOT_WRITTEN
    if not export.write("review"):
        code = NOT_WRITTEN
    with export.words():
        return _open(recordings, options.bags, rerun) or code


def _open(recordings: Sequence[Path], bags: Sequence[Path], rerun: str) -> int:
    """Show the rerun recordings of the reviewed runs, if any; returns the exit code."""
    if recordings and rerun == "web":
        try:
            serve(recordings)
        except (OSError, ImportError) as error:
            tell("review", f"--rerun web: {why_not(error)}")
            return NOT_WRITTEN
    elif recordings:
        show(recordings, bags)
    return SHOWN


def _mover(progress: Progress, task: TaskID) -> Callable[[int], None]:
    """Callback that moves a progress bar to a position (bytes), at most once in each hundred kilobytes."""
    shown = 0

    def move(position: int) -> None:
        nonlocal shown
        if position - shown > 100_000:
            shown = position
            progress.update(task, completed=position)

    return move


def print_review(readings: Sequence[Reading], comparisons: Sequence[Comparison]) -> None:
    """Print summaries, key figures, verdicts and responses of runs, and differences of each run from the first."""
    console = table_console()
    for label, reading in zip(LABELS, readings, strict=False):
        print_line(f"{label}: {reading.summary()}" if len(readings) > 1 else reading.summary())
    print_figures(console, [reading.figures for reading in readings])
    for label, reading in zip(LABELS, readings, strict=False):
        if reading.profiles and len(readings) > 1:
            print_line(f"rules, {label}:")
        print_verdicts(console, reading.profiles, reading.verdicts, reading.scenario)
    for label, reading in zip(LABELS if len(readings) > 1 else ("",), readings, strict=False):
        print_responses(console, reading.responses.finish(), reading.responses.efforts.values(), label)
    for label, reading, comparison in zip(LABELS[1:], readings[1:], comparisons, strict=False):
        print_differences(console, readings[0], reading, comparison, label)


def print_differences(console: Console, a: Reading, b: Reading, comparison: Comparison, label: str = "b") -> None:
    """Print the differences of the signals of two runs as a table; `label` names the second run.

    Differences below the digits of both values, and of places below the tolerance of the solver, are 0. On a narrow
    terminal, time and values of the largest difference of each signal go to a line below.
    """
    wide = console.width >= WIDE
    table = Table("signal", box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("largest difference", "rms", "unit", *(("at", "a there", f"{label} there") if wide else ())):
        table.add_column(title, justify="left" if title == "unit" else "right", no_wrap=True)
    carriers = a.scenario.carriers
    for name, difference in _worst_of_each(comparison.differences, carriers).items():
        if difference.count:
            unit, scale = shown_unit(unit_of(name), max(map(abs, difference.values)))
            least = 0.5 * 10.0**-DIGITS * max(map(abs, difference.values))  # what the values beside it do not show
            if unit_of(name) == "m":
                least = max(least, a.scenario.solver.tolerance)
            numbers = [shown(value if value > least else 0.0, scale) for value in (difference.largest, difference.rms)]
            there = [shown(value, scale, DIGITS) for value in difference.values]
            when = f"{difference.time:.2f} s"
            if wide:
                table.add_row(name, *numbers, unit, when, *there)
            else:
                below = f"{when}, a {there[0]}, {label} {there[1]}"
                table.add_row(f"{name}\n  [dim]{below}[/]", *numbers, unit)
    print(f"differences at {comparison.frames} common frames" + (f" of a and {label}" if label != "b" else ""))
    if comparison.frames:
        console.print(table)
        if carriers is not None:
            name = carriers.name
            print(f"of {name}_1 to {name}_{carriers.count}, only the one with the largest difference is shown\n")
    for run, names in zip(("a", label), comparison.only_in, strict=True):
        if names:
            print(f"only in {run}: {', '.join(sorted(names))}")
    if abs(a.end - b.end) > 1e-3:
        print(f"a ends at {a.end:.2f} s, {label} at {b.end:.2f} s")


def _worst_of_each(differences: Mapping[str, Difference], carriers: Carriers | None) -> dict[str, Difference]:
    """Differences by signal; for carriers only the largest difference over all carriers of each kind of signal."""
    if carriers is None:
        return dict(differences)
    worst: dict[str, str] = {}
    for name, difference in differences.items():
        kind = re.sub(f"/{carriers.name}_[0-9]+(?=/|$)", "/*", name)
        if kind not in worst or difference.largest > differences[worst[kind]].largest:
            worst[kind] = name
    return {name: differences[name] for name in worst.values()}


def write_review_plots(readings: Sequence[Reading], directory: Path, console: Console) -> bool:
    """Write the plots of reviewed runs; prints their paths, or an error and returns False."""
    from cable_twin.offline import plots  # noqa: PLC0415 - a second, and not always installed

    labels: Sequence[str] = LABELS[: len(readings)] if len(readings) > 1 else ("",)
    titles = [reading.title for reading in readings]
    if (
        len(readings) > 1
        and len(set(titles)) == len(titles)
        and all(0 < len(title) <= LONGEST_TITLE for title in titles)
    ):
        labels = titles
    runs = [
        plots.PlottedRun(label, reading.scenario.name, reading.name, reading.signals)
        for label, reading in zip(labels, readings, strict=True)
    ]
    try:
        with console.status("drawing") as status:
            files = [*plots.write_plots(runs, directory, lambda file: status.update(f"drawing {file}"))]
            for label, reading in zip(LABELS, readings, strict=False):
                file = directory / (f"rules_{label}.png" if len(readings) > 1 else "rules.png")
                title = f"{reading.scenario.name}, {reading.name}: rules"
                files += [file] if plots.write_verdict_plot(title, reading.verdicts, file) else []
    except OSError as error:
        tell("review", f"--plots {directory}: {error.strerror or error}")
        return False
    print_line(f"plots: {', '.join(str(file) for file in files)}")
    return True


if __name__ == "__main__":
    sys.exit(main())
