"""Worker processes that run jobs in parallel, with results in the order of the jobs."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from typing import TypeVar

Job = TypeVar("Job")
Done = TypeVar("Done")


@contextmanager
def side_by_side(
    count: int, work: Callable[[Job], Done]
) -> Iterator[Callable[[Sequence[Job], Callable[[Done], object]], list[Done]]]:
    """Worker processes for up to `count` parallel jobs; yields a function from jobs to results in equal order.

    Args:
        count: number of jobs.
        work: function of a module that does a job.
    """
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    context = multiprocessing.get_context("spawn")  # a process that has threads must not be forked
    pool = ProcessPoolExecutor(max(min(cores, count), 1), context, _leave_ctrl_c)

    def run_all(jobs: Sequence[Job], on_done: Callable[[Done], object]) -> list[Done]:
        done = []
        for one in pool.map(work, jobs):
            on_done(one)
            done.append(one)
        return done

    try:
        yield run_all
    finally:
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:  # jobs are not awaited after Ctrl-C
            process.terminate()


def _leave_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
