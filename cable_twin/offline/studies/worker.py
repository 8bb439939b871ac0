"""Worker of a study on dask.distributed: `python -m cable_twin.offline.studies.worker tcp://HOST:8786`.

The worker holds numpy to the class of the CPU, as commands do, and has one thread. Local clusters load this module.
"""

from __future__ import annotations

import signal
import sys
from typing import Any


def dask_setup(_worker: Any) -> None:
    """Set up a worker of a local cluster: it ignores Ctrl-C, which the command handles."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def main() -> None:
    """Run a worker of a study, with the options of `dask worker`."""
    from cable_twin.basics.cpu import hold_numpy_to_the_class  # noqa: PLC0415 - before numpy is loaded

    hold_numpy_to_the_class()
    from distributed.cli.dask_worker import main as run  # noqa: PLC0415 - after that

    sys.argv[1:] = ["--nthreads", "1", *sys.argv[1:]]
    run()


if __name__ == "__main__":
    main()
