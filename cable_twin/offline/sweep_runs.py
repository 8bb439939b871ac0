"""Definition of a sweep, a scenario key with values, and its parallel runs on all cores."""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.scenario import Scenario, full_key, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation

MOST = 1000  # runs
FORM = "KEY=START:STOP:STEP is needed, as in wind.y=0:30:2.5"


@dataclass(frozen=True, slots=True)
class Sweep:
    """Dotted key of a scenario and its swept values."""

    key: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class SweptRun:
    """Result of the run at one swept value."""

    value: float
    figures: Sequence[KeyFigure]
    fault: str = ""  # why it ended early, or could not start
    refused: Sequence[str] = ()  # commands, a line each


@dataclass(frozen=True, slots=True)
class Job:
    """Inputs of one run of a sweep."""

    value: float
    scenario: Scenario
    script: Sequence[ScriptedCommand]
    duration: float  # s
    frame_steps: int


def sweep_of(text: str) -> Sweep:
    """Parse KEY=START:STOP:STEP; the values are integers where all three numbers are.

    Raises:
        argparse.ArgumentTypeError: one line with what was given and what is allowed.
    """
    key, equals, span = text.partition("=")
    parts = span.split(":")
    if not equals or not key.strip() or len(parts) != 3:
        raise argparse.ArgumentTypeError(f"{text!r} given, {FORM}")
    try:
        start, stop, step = (_number(part) for part in parts)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{text!r} given, {error} is no finite number; {FORM}") from None
    if step == 0.0 or (stop - start) * step < 0.0:
        way = "0" if step == 0.0 else f"{step:g}, which leads away from {stop:g}"
        raise argparse.ArgumentTypeError(f"{text!r} given with a step of {way}; allowed: one from START towards STOP")
    count = math.floor((stop - start) / step + 1e-9) + 1
    if count > MOST:
        raise argparse.ArgumentTypeError(f"{text!r} given, {count} runs; allowed: at most {MOST}")
    values = (start + number * step for number in range(count))
    whole = all(isinstance(number, int) for number in (start, stop, step))
    return Sweep(full_key(key.strip()), tuple(value if whole else round(value, 12) for value in values))


def _number(text: str) -> float:
    try:
        value = int(text)
    except ValueError:
        try:
            value = float(text)  # type: ignore[assignment]
        except ValueError:
            raise ValueError(repr(text)) from None
    if not math.isfinite(value):
        raise ValueError(repr(text))
    return value


def swept_scenarios(sweep: Sweep, source: Any, changes: Mapping[str, Any]) -> list[Scenario]:
    """Scenarios at all swept values.

    Args:
        sweep: key and values; a part of the key may be an axis, or a number in a list.
        source: as `load_scenario` takes it.
        changes: of other values, by dotted key.

    Raises:
        ScenarioError: one line a fault, of the first value that has any.
    """
    return [load_scenario(source, {**changes, sweep.key: value}) for value in sweep.values]


def is_whole(scenario: Scenario, key: str) -> bool:
    """Whether a scenario key takes integers only."""
    node: Any = scenario.resolved()
    for part in key.split("."):
        node = node.get(part) if isinstance(node, Mapping) else None
    return isinstance(node, int)


@contextmanager
def side_by_side(count: int) -> Iterator[Callable[[Sequence[Job], Callable[[SweptRun], object]], list[SweptRun]]]:
    """Worker processes for up to `count` parallel runs; yields a function from jobs to runs in equal order."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    context = multiprocessing.get_context("spawn")  # a process that has threads must not be forked
    pool = ProcessPoolExecutor(min(cores, count), context, _leave_ctrl_c)

    def run_all(jobs: Sequence[Job], on_run: Callable[[SweptRun], object]) -> list[SweptRun]:
        done = []
        for run in pool.map(run_job, jobs):
            on_run(run)
            done.append(run)
        return done

    try:
        yield run_all
    finally:
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:  # after Ctrl-C nobody waits for a run
            process.terminate()


def _leave_ctrl_c() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def run_job(job: Job) -> SweptRun:
    """Carry out one run of a sweep."""
    try:
        simulation = Simulation(job.scenario)
    except EquilibriumError as error:
        return SweptRun(job.value, (), str(error))
    figures = KeyFigures(job.scenario)
    outcome = simulate(
        simulation, job.script, duration=job.duration, frame_steps=job.frame_steps, epoch_ns=0, figures=figures
    )
    return SweptRun(job.value, figures.figures(), outcome.fault, outcome.refused)


__all__ = ["Job", "Sweep", "SweptRun", "is_whole", "run_job", "side_by_side", "sweep_of", "swept_scenarios"]
