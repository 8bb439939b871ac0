"""Entry points of the commands without ROS, such as `simulate`; an interrupt or closed pipe ends them in one line."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from importlib.util import find_spec

from cable_twin.basics.cpu import hold_numpy_to_the_class
from cable_twin.terminal.command_line import INTERRUPTED, faults_reported, interrupts_kept, left_at_once, tell

PIPE_CLOSED = 128 + signal.SIGPIPE  # exit code, as of any command whose reader has gone
UNWRITTEN = {"replay": 2}  # exit code where the output has no place, 1 for all others


def __getattr__(command: str) -> Callable[[], int]:
    """Entry point of a command by its module name in `setup.cfg`: a callable that runs the `main` of the module."""
    if find_spec(f"cable_twin.offline.{command}") is None:
        raise AttributeError(f"no command {command!r}")
    return partial(_run, command)


def _run(command: str) -> int:
    with left_at_once(command):
        hold_numpy_to_the_class()
        module = import_module(f"cable_twin.offline.{command}")
    try:
        with interrupts_kept():
            code: int = faults_reported(command)(module.main)()
        sys.stdout.flush()
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # it is done: while Python ends, Ctrl-C would kill it
    except KeyboardInterrupt:
        tell(command, "ended by Ctrl-C")
        return INTERRUPTED
    except BrokenPipeError:  # who reads the output has enough, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return PIPE_CLOSED
    except OSError as error:  # of the output: what else may fail on a disk is told where it does
        tell(command, f"{error.filename or 'output'}: {error.strerror or error}")
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python would try once more
        return UNWRITTEN.get(command, 1)
    return code
