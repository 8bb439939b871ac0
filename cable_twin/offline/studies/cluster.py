"""Run of a study's cases on workers of dask.distributed: a local cluster, or those of a running scheduler."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import islice
from typing import Any

from cable_twin.offline.studies.case import (
    Case,
    Finished,
    Inputs,
    Names,
    OtherProgramError,
    difference,
    program,
    run_case,
)

DEATHS = 30  # workers that may die with a case in a local cluster before the scheduler gives it back
LIVES = 4  # times that a case is given to the scheduler
AHEAD = 3  # cases on their way for each thread of a worker
PERIOD = 5.0  # s between two looks at the number of workers
PATIENCE = 10.0  # s for a scheduler to answer, and for its first worker
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


class ClusterError(RuntimeError):
    """Error of a study's cluster: missing, lost, or with another program version; the message is one line."""


@contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Any]:
    """Context with a Dask client of a scheduler, or of a local cluster of processes that ends with the context.

    Args:
        scheduler: address as tcp://HOST:PORT; None for a local cluster.
        workers: processes of a local cluster.

    Raises:
        ClusterError: there is no scheduler, or it has no worker, or a worker with another program.
    """
    import dask  # noqa: PLC0415 - a second
    from distributed import Client, LocalCluster  # noqa: PLC0415 - the same

    for name in ("distributed", "tornado", "bokeh", "asyncio"):
        logging.getLogger(name).setLevel(logging.CRITICAL)  # dead workers are expected, and told in a line
    settings = {"distributed.scheduler.allowed-failures": DEATHS,
                "distributed.logging": {"distributed": "critical"}}  # fmt: skip
    with dask.config.set(settings):
        if scheduler is None:
            cluster = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                host="127.0.0.1",
                dashboard_address="127.0.0.1:0",
                memory_limit=0,
                silence_logs=logging.CRITICAL,
                preload=["cable_twin.offline.studies.worker"],
                env={**dict.fromkeys(ONE_THREAD, "1"), **os.environ},
            )
            with cluster, Client(cluster) as client:
                yield client
            return
        try:
            client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError) as error:
            reason = " ".join(str(error).split())[:120] or type(error).__name__
            raise ClusterError(
                f"--scheduler {scheduler}: there is none ({reason}); allowed: the address of a running one, as "
                "tcp://HOST:8786"
            ) from None
        with client:
            _check(client, scheduler)
            yield client


def _check(client: Any, scheduler: str) -> None:
    """Refuse a Dask scheduler without workers, or with a worker of another program version or arithmetic."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise ClusterError(
            f"--scheduler {scheduler}: has no worker after {PATIENCE:g} s; allowed: at least one"
        ) from None
    try:
        programs = client.run(program)
    except Exception as error:  # what a worker without this package says
        raise ClusterError(f"--scheduler {scheduler}: a worker cannot load cable_twin ({error})") from None
    for worker, one in programs.items():
        if line := difference(program(), one):
            raise ClusterError(f"--scheduler {scheduler}: {worker}: {line}")


def run_on(
    client: Any, common: Inputs, cases: Sequence[Case], on_done: Callable[[Finished, Names], object]
) -> list[str]:
    """Run the cases of a study on the workers of a Dask client, in any order; again where a worker dies.

    Args:
        client: Dask client of the cluster.
        common: inputs of all cases.
        cases: the cases.
        on_done: called with each finished case and the names of its figures.

    Returns:
        A line for each case that could not be carried out.

    Raises:
        ClusterError: the scheduler has gone, or a worker has another program.
    """
    from distributed import KilledWorker, as_completed  # noqa: PLC0415 - a second
    from distributed.client import FutureCancelledError  # noqa: PLC0415 - the same

    running = as_completed([], loop=client.loop)
    deaths: dict[str, int] = {}
    under_way: dict[str, Case] = {}
    faults, waiting, looked = [], iter(cases), -PERIOD
    room = AHEAD

    def submit(case: Case) -> None:
        key = f"study-{case.inputs}-{deaths.get(case.id, 0)}"
        future = client.submit(run_case, common, case, program(), key=key, pure=False)
        under_way[future.key] = case
        running.add(future)

    def fill() -> None:
        nonlocal looked, room
        if time.monotonic() - looked > PERIOD:  # workers come and go
            looked, room = time.monotonic(), AHEAD * max(sum(client.nthreads().values()), 1)
        for case in islice(waiting, max(room - len(under_way), 0)):
            submit(case)

    fill()
    for future in running:
        case = under_way.pop(future.key)
        try:
            on_done(*future.result())
        except KilledWorker:
            deaths[case.id] = deaths.get(case.id, 0) + 1
            if deaths[case.id] < LIVES:
                submit(case)
            else:
                faults.append(f"{case.id}: every worker that runs it dies")
        except OtherProgramError as error:
            raise ClusterError(str(error)) from None
        except FutureCancelledError:
            raise ClusterError(
                "the connection to the scheduler is lost; finished cases are kept, and the same command continues"
            ) from None
        except Exception as error:  # a fault of the program, in one case of many
            faults.append(f"{case.id}: a fault of the program ({type(error).__name__}: {error})")
        future.release()
        fill()
    return faults
