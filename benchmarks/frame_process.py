"""Process that runs one scenario piece by piece and reports the processor time of each in all threads.

It is started with the sources of any version of the package on its path; `solver` needs nothing of it that is new.

    python frame_process.py KIND SCENARIO DRIVE SPEED KEY=VALUE...

KIND is `solver` (all frames in one call), `off` (what `simulate --record off` does) or `all` (what `simulate` does).
For each line of standard input, a number of simulated seconds, it prints the processor time in s.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

FRAME = 0.01  # s
Runner = Callable[[Any, float], float]


def run_solver(simulation: Any, duration: float) -> float:
    """Processor time (s) of the solver alone."""
    started = time.process_time()
    simulation.advance_to(simulation.time + duration)
    return time.process_time() - started


def run_without_logs(simulation: Any, duration: float) -> float:
    """Processor time (s) with key figures."""
    return _run(simulation, duration, None)


def run_with_logs(simulation: Any, duration: float) -> float:
    """Processor time (s) with key figures, bag and rerun recording, closing included and opening not."""
    from cable_twin.messages import topics  # noqa: PLC0415 - not of every version
    from cable_twin.recording.run import start_run  # noqa: PLC0415

    with tempfile.TemporaryDirectory(prefix="frame_") as directory:
        table = topics(simulation.layout)
        return _run(
            simulation, duration, start_run(simulation, table, record_directory=Path(directory), frame_period=FRAME)
        )


def _run(simulation: Any, duration: float, run: Any) -> float:
    from cable_twin.key_figures import KeyFigures  # noqa: PLC0415
    from cable_twin.offline.scripted_run import simulate  # noqa: PLC0415

    figures = KeyFigures(simulation.scenario)
    figures.update(simulation.snapshot)
    epoch_ns = time.time_ns()
    if run is not None:
        run.begin(epoch_ns)
        while not run.recorder.idle:
            time.sleep(0.01)
    started = time.process_time()
    frame_steps = round(FRAME / simulation.step)
    simulate(simulation, [], duration=duration, frame_steps=frame_steps, epoch_ns=epoch_ns, run=run, figures=figures)
    if run is not None:
        run.recorder.close()
        assert not run.recorder.faults, run.recorder.faults
    figures.figures()
    return time.process_time() - started


KINDS: dict[str, Runner] = {"solver": run_solver, "off": run_without_logs, "all": run_with_logs}


def main() -> None:
    """Serve until the end of the input."""
    from cable_twin.scenario import load_scenario  # noqa: PLC0415
    from cable_twin.simulation import Simulation  # noqa: PLC0415

    kind, scenario, drive, speed, *changes = sys.argv[1:]
    pairs = (change.partition("=") for change in changes)
    simulation = Simulation(load_scenario(scenario, {key: json.loads(value) for key, _, value in pairs}))
    simulation.command(drive, speed=float(speed))
    simulation.advance_to(10.0)
    KINDS[kind](simulation, 1.0)  # what is made or compiled at its first use
    print("ready", flush=True)
    for line in sys.stdin:
        print(KINDS[kind](simulation, float(line)), flush=True)


if __name__ == "__main__":
    main()
