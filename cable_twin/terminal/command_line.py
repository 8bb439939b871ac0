"""Command-line parts shared by all commands: options with errors in one line, signals, error reports."""

from __future__ import annotations

import argparse
import functools
import math
import os
import platform
import re
import shlex
import shutil
import signal
import sys
import tempfile
import textwrap
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import metadata
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

from cable_twin.basics.printable import printable

INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it
PROGRAM_FAULT = 70  # exit code, EX_SOFTWARE of sysexits.h
LONGEST_LINE = 4000  # characters of what is said of a file or a path

COMPILER = ("numba", "llvmlite")
NARROWEST = 24  # characters in which a text is still filled
DIGITS = 100  # of a whole number, fewer than Python converts
RETRY = 0.05  # s until Ctrl-C is tried again where it could be no exception


def split_ros_arguments(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split arguments into those of the command and those of ROS, from `--ros-args` up to `--` or the end."""
    arguments = list(argv)
    if "--ros-args" not in arguments:
        return arguments, []
    first = arguments.index("--ros-args")
    last = arguments.index("--", first) if "--" in arguments[first:] else len(arguments)
    return arguments[:first] + arguments[last + 1 :], arguments[first:last]


def ending_signals() -> tuple[signal.Signals, ...]:
    """Signals that end a command: SIGINT, SIGTERM, and SIGHUP unless ignored by `nohup`."""
    hung_up = () if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN else (signal.SIGHUP,)
    return signal.SIGINT, signal.SIGTERM, *hung_up


def leave_at_once(command: str, code: int) -> None:
    """End the process at once after a line on stderr; an exception would crash the compiler in its callbacks."""
    cursor = "\x1b[?25h" if sys.stderr.isatty() else ""  # a progress bar may have hidden it
    with suppress(OSError):  # a terminal that is gone
        os.write(sys.stderr.fileno(), f"{cursor}{command}: ended before it had started\n".encode())
    os._exit(code)


@contextmanager
def left_at_once(command: str) -> Iterator[None]:
    """Context in which Ctrl-C or the end of a terminal ends the process at once, as during imports and compilation."""
    with _answered(lambda *_: leave_at_once(command, INTERRUPTED)):
        yield


@contextmanager
def _answered(handler: Callable[[int, FrameType | None], None]) -> Iterator[None]:
    """Context manager that installs a handler for Ctrl-C and the end of the terminal."""
    try:
        before = {number: signal.signal(number, handler) for number in ending_signals() if number != signal.SIGTERM}
    except ValueError:  # not the main thread, which gets no signals
        yield
        return
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Context in which Ctrl-C raises KeyboardInterrupt, never lost in callbacks nor within the compiler.

    Closing the terminal acts as Ctrl-C.

    Kernels may be compiled or loaded at any first use, where an exception does harm (see `leave_at_once`), and Python
    drops what is raised in callbacks and finalizers with a traceback on the terminal. Both are tried again a moment
    later.
    """

    def on_interrupt(_number: int, frame: FrameType | None) -> None:
        if _compiles(frame):
            _interrupt_later()
        else:
            raise KeyboardInterrupt

    def on_dropped(dropped: sys.UnraisableHookArgs) -> None:
        if issubclass(dropped.exc_type, KeyboardInterrupt):
            _interrupt_later()
        else:
            hook(dropped)

    hook, sys.unraisablehook = sys.unraisablehook, on_dropped
    try:
        with _answered(on_interrupt):
            yield
    finally:
        sys.unraisablehook = hook


def _compiles(frame: FrameType | None) -> bool:
    """Whether `frame` or one of its callers belongs to the compiler."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in COMPILER:
            return True
        frame = frame.f_back
    return False


def _interrupt_later() -> None:
    main = threading.main_thread().ident or 0
    # a true signal, to that thread: it ends what waits there, which a note to the interpreter alone would not
    timer = threading.Timer(RETRY, signal.pthread_kill, (main, signal.SIGINT))
    timer.daemon = True
    timer.start()


Main = Callable[..., int]


def faults_reported(command: str) -> Callable[[Main], Main]:
    """Decorator of a command's `main`: an unhandled exception gives a line, a file of details and exit code 70.

    A warning is printed as one line.
    """

    def decorate(main: Main) -> Main:
        @functools.wraps(main)
        def answered(*arguments: Any, **options: Any) -> int:
            try:
                with warnings.catch_warnings():
                    warnings.showwarning = lambda message, *_, **__: tell(command, f"warning: {message}")
                    return main(*arguments, **options)
            except OSError:  # of the output, or of a disk, which `entry_points` tells
                raise
            except Exception as error:
                return report_fault(command, error)

        return answered

    return decorate


def report_fault(command: str, error: BaseException) -> int:
    """Report an internal error of the program in a line, with details in a new file; returns the exit code."""
    try:
        version = metadata.version("cable_twin")
    except metadata.PackageNotFoundError:
        version = "unknown"
    details = [f"cable_twin {version}, Python {sys.version}, {platform.platform()}", shlex.join(sys.argv)]
    details += traceback.format_exception(error)
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix=f"cable_twin_{command}_", suffix=".txt", delete=False, encoding="utf-8", errors="replace"
        ) as file:
            file.write("\n".join(details))
        where = f"please report it with {file.name}"
    except OSError as reason:
        where = f"please report it; its details cannot be written ({reason.strerror})"
    tell(command, f"a fault of the program ({type(error).__name__}: {printable(error, 200)}), {where}")
    return PROGRAM_FAULT


def print_line(line: object) -> None:
    """Print a line with foreign text, such as a file name, with control characters escaped."""
    print(printable(line, LONGEST_LINE))


def tell(command: str, text: object) -> None:
    """Print lines for the user on stderr, with control characters escaped."""
    with suppress(OSError):  # a terminal that is closed
        for line in str(text).split("\n"):
            print(f"{command}: {printable(line, LONGEST_LINE)}", file=sys.stderr, flush=True)


def fail(command: str, text: object, code: int) -> int:
    """Print the lines of an error on stderr; returns the given exit code of the command."""
    tell(command, text)
    return code


def typed(command: str) -> str:
    """Command to type for another program of this installation: its name if on the path, else its path."""
    beside = [directory / command for directory in (Path(sys.argv[0]).absolute().parent, Path(sys.executable).parent)]
    file = next((file for file in beside if os.access(file, os.X_OK)), None)
    found = shutil.which(command)
    if file is None or (found is not None and os.path.samefile(found, file)):
        return command
    short = os.path.relpath(file)
    return shlex.quote(str(file) if short.startswith("..") else short)


def number(low: float, high: float, unit: str = "", *, zero: bool = False) -> Callable[[str], float]:
    """Make a parser of option values: a finite number within bounds, in a unit, above 0 unless `zero` is allowed."""
    unit = f" {unit}" if unit else ""
    span = f"{low:g}{unit} or more" if zero else f"more than 0{unit}"
    if math.isinf(low):
        span = "a finite number"
    elif math.isfinite(high):
        span = f"{low:g} to {high:g}{unit}" if zero or low > 0.0 else f"more than 0, at most {high:g}{unit}"

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not (low <= value <= high and (zero or value > 0.0) and math.isfinite(value)):
            raise argparse.ArgumentTypeError(f"given {text!r}; allowed: {span}")
        return value

    return convert


def whole_number(low: int, high: int | None = None) -> Callable[[str], int]:
    """Make a parser of option values: a whole number within bounds, above without one where somebody else knows it."""
    allowed = f"a whole number from {low} " + ("on" if high is None else f"to {high}")

    def convert(text: str) -> int:
        if (
            not (text.isascii() and text.isdigit() and len(text) < DIGITS)
            or int(text) < low
            or (high is not None and int(text) > high)
        ):
            raise argparse.ArgumentTypeError(f"given {text!r}; allowed: {allowed}")
        return int(text)

    return convert


class OneLineParser(argparse.ArgumentParser):
    """Argument parser with errors in one line instead of a screen of usage."""

    def __init__(self, prog: str, description: str, epilog: str, *, failure: int = 1) -> None:
        """Set up a parser with the command's name, description and epilog.

        Args:
            prog: name of the command.
            description: description of the command.
            epilog: examples and exit codes; paragraphs are filled, lists with indented lines stay as they are.
            failure: exit code for a wrong option.
        """
        super().__init__(
            prog=prog,
            description=description,
            epilog=epilog,
            formatter_class=Filled,
            allow_abbrev=False,
        )
        self._failure = failure
        # argparse takes -2e5 and -10,4.5 for options
        size = r"(\d+\.?\d*|\.\d+)(e[+-]?\d+)?"
        self._negative_number_matcher = re.compile(rf"-{size}(,[+-]?{size})*$", re.IGNORECASE)

    def error(self, message: str) -> NoReturn:
        """Print the error of an option in one line and end the process."""
        print(f"{self.prog}: {message}; all options: {self.prog} --help", file=sys.stderr)
        sys.exit(self._failure)

    def add_scenario(self, text: str, listing: Callable[[], Sequence[str]]) -> None:
        """Add the scenario argument, `--scenario` and `--list`; `given_scenario` returns the given one.

        Args:
            text: description of the scenario in the help.
            listing: the lines that `--list` prints.
        """
        self.add_argument("plain_scenario", nargs="?", metavar="SCENARIO", help=text)
        self.add_argument("--scenario", metavar="SCENARIO", help="another way to give SCENARIO")
        self.add_argument("--list", action=_PrintLines, lines=listing, help="print the scenarios, a line each, and end")

    def given_scenario(self, options: argparse.Namespace) -> str | None:
        """Scenario given as argument or by `--scenario`; ends the process with an error line where both are given."""
        plain, named = options.plain_scenario, options.scenario
        if plain is not None and named is not None:
            self.error(f"SCENARIO: given '{plain}' and --scenario '{named}'; allowed: one of both")
        return plain if named is None else named


class Filled(argparse.HelpFormatter):
    """Help formatter: paragraphs and lists filled to the terminal width, examples unchanged for copying."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        return "\n\n".join(
            "\n".join(listed(line, width) for line in paragraph.splitlines())
            if re.search("^ ", paragraph, re.MULTILINE)
            else super(Filled, self)._fill_text(paragraph, width, indent)
            for paragraph in text.strip("\n").split("\n\n")
        )


def listed(line: str, width: int) -> str:
    """Format an entry of a list in a help text to a width: entry kept whole, its description beside or below."""
    gap = re.search(r"(?<=\S) {2,}(?=\S)", line)
    if len(line) <= width or gap is None:
        return line
    beside = width - gap.end() >= NARROWEST
    below = " " * (gap.end() if beside else len(line) - len(line.lstrip()) + 4)
    first = line[: gap.end()] if beside else f"{line[: gap.start()]}\n{below}"
    return first + f"\n{below}".join(textwrap.wrap(line[gap.end() :], max(width - len(below), NARROWEST)))


class _PrintLines(argparse.Action):
    """Option of a command line that prints lines and ends the process, like --help."""

    def __init__(self, *, lines: Callable[[], Sequence[str]], **options: Any) -> None:
        super().__init__(**options, nargs=0)
        self._lines = lines

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        """Print the lines of the option and end the process."""
        width = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
        print("\n".join(listed(line, width) for line in self._lines()))
        parser.exit()
