"""The commands `simulate`, `review` and `replay` as they are installed: what ends them from outside is a line."""

from __future__ import annotations

import os
import sys
from importlib import import_module

from cable_twin.command_line import INTERRUPTED, left_at_once

UNWRITTEN = {"simulate": 1, "review": 1, "replay": 2}  # exit code where the output has no place


def simulate() -> int:
    """Run a scenario."""
    return _run("simulate")


def review() -> int:
    """Show a log, or two."""
    return _run("review")


def replay() -> int:
    """Simulate a log again."""
    return _run("replay")


def _run(command: str) -> int:
    with left_at_once(command):
        module = import_module(f"cable_twin.offline.{command}")
    try:
        code: int = module.main()
        sys.stdout.flush()
    except KeyboardInterrupt:
        print(f"{command}: ended by Ctrl-C", file=sys.stderr)
        return INTERRUPTED
    except OSError as error:  # of the output: what else may fail on a disk is told where it does
        print(f"{command}: {error.filename or 'output'}: {error.strerror or error}", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python would try once more
        return UNWRITTEN[command]
    return code
