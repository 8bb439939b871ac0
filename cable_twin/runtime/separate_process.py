"""Processing of foreign input in a separate process within limits, which can neither delay nor end the twin.

A regular expression from another node is such an input, as matching one may take hours.
"""

from __future__ import annotations

import json
import os
import re
import resource
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from threading import Thread
from typing import Any

from cable_twin.basics.printable import printable

NICE = 10  # levels below the twin: a ninth of its share of a processor where both want one
MEMORY = 4 * 2**30  # bytes of address space
PACKAGE_PARENT = Path(__file__).resolve().parents[2]
LONGEST_FILTER = 1000  # characters
MATCHING_TIME = 2.0  # s for all names
ALLOWED = f"allowed: a regular expression of names, of up to {LONGEST_FILTER} characters and {MATCHING_TIME:g} s"


class SeparateProcessError(RuntimeError):
    """Failed answer of the separate process: the reason, in a line."""


def start_process(module: str) -> subprocess.Popen[bytes]:
    """Start a module as a process of less priority than the twin's, which talks over its standard input and output.

    Args:
        module: name within the package, such as "runtime.outlook_process".
    """
    paths = [str(PACKAGE_PARENT), *filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    threads = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    process = subprocess.Popen(
        [sys.executable, "-m", f"cable_twin.{module}"],
        cwd="/",  # python -m would import from the directory where the twin was started
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), **threads},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the twin
    )
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, min(os.getpriority(os.PRIO_PROCESS, os.getpid()) + NICE, 19))
    return process


def ask_process(module: str, request: Any, seconds: float) -> Any:
    """Send a request to a module's function `answer` in the separate process; request and answer are JSON values.

    Args:
        module: name within the package, such as "runtime.scenario_reading".
        request: passed to the module.
        seconds: time (s) within which it has to answer.

    Raises:
        SeparateProcessError: the process took too long, or has ended, by itself or by a signal, as without memory.
    """
    process = start_process(module)
    try:
        output, _ = process.communicate(json.dumps(request).encode(), timeout=seconds)
    except subprocess.TimeoutExpired:
        raise SeparateProcessError(f"it takes more than {seconds:g} s") from None
    finally:
        process.kill()
        process.wait()
    if process.returncode != 0:
        raise SeparateProcessError("it takes too much memory, or is a fault of the program")
    return json.loads(output)


def answer(work: Callable[[Any], Any]) -> None:
    """Read a JSON request from standard input and write the answer of `work` to standard output, in limited memory."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    json.dump(work(json.load(sys.stdin)), sys.stdout)


class FilterError(ValueError):
    """Error of a regular expression that cannot be applied; the message is one line."""


def matching_names(expression: str, names: Sequence[str]) -> Future[list[str]]:
    """Return a future of the names that match a regular expression, which fails with FilterError if it is invalid."""
    future: Future[list[str]] = Future()
    if len(expression) > LONGEST_FILTER:
        future.set_exception(FilterError(f"filter: given {len(expression)} characters; {ALLOWED}"))
    elif re.fullmatch(r"[\w/ -]*", expression):
        future.set_result([name for name in names if expression in name])
    else:
        Thread(target=_match, args=(future, expression, list(names)), name="name matching", daemon=True).start()
    return future


def _match(future: Future[list[str]], expression: str, names: list[str]) -> None:
    try:
        found = ask_process("runtime.separate_process", [expression, names], MATCHING_TIME)
    except SeparateProcessError as error:
        found = str(error)
    if isinstance(found, str):
        future.set_exception(FilterError(f"filter: given '{printable(expression)}': {printable(found)}; {ALLOWED}"))
    else:
        future.set_result(found)


def _matching(request: Any) -> list[str] | str:
    expression, names = request
    try:
        wanted = re.compile(expression)
    except (re.error, OverflowError, RecursionError) as error:
        return str(error)
    return [name for name in names if wanted.search(name)]


if __name__ == "__main__":
    answer(_matching)
