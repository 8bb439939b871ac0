"""Benchmarks of the solver beside the strongest other program: one part a file, all run by `python -m benchmarks`.

A part is a function `run(quick, repetitions, progress)` that gives a `report.Part`. Everything is measured on one
thread; the libraries below read their number of threads when they are loaded, so it is set here.
"""

from __future__ import annotations

import os

ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")

for variable in ONE_THREAD:
    os.environ[variable] = "1"
