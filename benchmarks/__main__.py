"""Measure the solver and the twin and print tables; see `python -m benchmarks --help`."""

from __future__ import annotations

import sys

INTERRUPTED = 130  # exit code

if __name__ == "__main__":  # the bare timers' processes import this file too, and must not load the rest
    from benchmarks.command import main

    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)
