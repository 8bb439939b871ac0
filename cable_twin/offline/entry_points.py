"""The commands without ROS, such as `simulate`, as they are installed: what ends them from outside is a line."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from importlib import import_module
from importlib.util import find_spec

from cable_twin.command_line import INTERRUPTED, interrupts_kept, left_at_once

UNWRITTEN = {"replay": 2}  # exit code where the output has no place, 1 for all others


def __getattr__(command: str) -> Callable[[], int]:
    """The command of a module beside this one, as `setup.cfg` names it: what runs its `main`."""
    if find_spec(f"cable_twin.offline.{command}") is None:
        raise AttributeError(f"no command {command!r}")
    return partial(_run, command)


def _run(command: str) -> int:
    with left_at_once(command):
        module = import_module(f"cable_twin.offline.{command}")
    try:
        with interrupts_kept():
            code: int = module.main()
        sys.stdout.flush()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is done: while Python ends, Ctrl-C would kill it
    except KeyboardInterrupt:
        _say(f"{command}: ended by Ctrl-C")
        return INTERRUPTED
    except OSError as error:  # of the output: what else may fail on a disk is told where it does
        _say(f"{command}: {error.filename or 'output'}: {error.strerror or error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python would try once more
        return UNWRITTEN.get(command, 1)
    return code


def _say(line: str) -> None:
    with suppress(OSError):  # a terminal that is closed
        print(line, file=sys.stderr, flush=True)
