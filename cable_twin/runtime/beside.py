"""Processing of foreign input in a separate process within limits, unable to delay or end the twin."""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

NICE = 10
MEMORY = 4 * 2**30  # bytes of addresses
PACKAGE_PARENT = Path(__file__).resolve().parents[2]


class BesideError(RuntimeError):
    """Failed answer of the separate process: the reason, in a line."""


def ask_beside(module: str, request: Any, seconds: float) -> Any:
    """Have a module of this package process a request by `answer`; request and answer are JSON values.

    Args:
        module: as "runtime.scenario_reading".
        request: for it.
        seconds: s within which it answers.

    Raises:
        BesideError: It took too long, ended by itself or by a signal, as where it wanted too much memory.
    """
    paths = [str(PACKAGE_PARENT), *filter(os.path.isabs, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    process = subprocess.Popen(
        [sys.executable, "-m", f"cable_twin.{module}"],
        cwd="/",  # python -m would import from the directory where the twin was started
        env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "OPENBLAS_NUM_THREADS": "1"},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        start_new_session=True,  # Ctrl-C is for the twin
    )
    with suppress(OSError):
        os.setpriority(os.PRIO_PROCESS, process.pid, NICE)  # the twin goes before it
    try:
        output, _ = process.communicate(json.dumps(request).encode(), timeout=seconds)
    except subprocess.TimeoutExpired:
        raise BesideError(f"it takes more than {seconds:g} s") from None
    finally:
        process.kill()
        process.wait()
    if process.returncode != 0:
        raise BesideError("it takes too much memory, or is a fault of the program")
    return json.loads(output)


def answer(work: Callable[[Any], Any]) -> None:
    """Process the request on standard input within the memory limit, as the separate process."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    json.dump(work(json.load(sys.stdin)), sys.stdout)


__all__ = ["BesideError", "answer", "ask_beside"]
