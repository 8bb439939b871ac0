"""Start of a fresh process: import, cold start with nothing compiled, warm start; and what it holds in memory."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.progress import Progress

from benchmarks.report import Part, Table, Value

ROOT = Path(__file__).resolve().parents[1]
PROBES = {
    "Python alone": "pass",
    "import cable_twin": "import cable_twin",
    "import cable_twin.simulation": "import cable_twin.simulation",
    "seed example, first second simulated": (
        "from cable_twin.scenario import load_scenario; from cable_twin.simulation import Simulation; "
        "Simulation(load_scenario('seed_example')).advance_to(1.0)"
    ),
}
BARE, *_, LAST = PROBES
READ_MEMORY = (
    "import json; status = dict(line.split(':', 1) for line in open('/proc/self/status')); "
    "print(json.dumps({'resident': int(status['VmRSS'].split()[0]) / 1024, "
    "'peak': int(status['VmHWM'].split()[0]) / 1024}))"
)
TIME_CODE = "import time; start = time.perf_counter(); {code}; print(time.perf_counter() - start); "


def run(quick: bool, repetitions: int, progress: Progress) -> Part:
    """Start processes in turn; `quick` leaves out the cold start, which compiles everything."""
    rows: list[dict[str, Value]] = []
    with tempfile.TemporaryDirectory(prefix="kernels-") as empty:
        cold = [] if quick else [_start(PROBES[LAST], empty)]
        taken: dict[str, list[dict[str, float]]] = {name: [] for name in PROBES}
        turns = [name for _ in range(repetitions) for name in PROBES]
        if quick:
            _start(PROBES[LAST], None)  # what is compiled already may be older
        for name in progress.track(turns, description="fresh processes"):
            taken[name].append(_start(PROBES[name], None if quick else empty))
    for name, results in taken.items():
        label = f"{name}, warm" if name == LAST else name
        rows.append(_row(label, results))
    if cold:
        rows.append(_row(f"{LAST}, cold", cold))
    notes = [
        "Cold: nothing compiled (`NUMBA_CACHE_DIR` is an empty directory), once. Warm: with what the cold start kept.",
        "Process: from its start to its end. Inside: the code alone, without starting and ending the interpreter.",
    ]
    return Part("Start-up and memory", [Table("fresh processes", rows)], notes)


def _start(code: str, kernels: str | None) -> dict[str, float]:
    """Run `code` in a fresh interpreter; returns its times (s) and memory (MiB).

    Args:
        code: statements on one line.
        kernels: directory of compiled kernels, None for the user's own.

    Raises:
        subprocess.CalledProcessError: the code failed.
    """
    environment = dict(os.environ, PYTHONPATH=os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    environment |= {"NUMBA_CACHE_DIR": kernels} if kernels is not None else {}
    command = [sys.executable, "-c", TIME_CODE.format(code=code) + READ_MEMORY]
    start = time.perf_counter()
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    process = time.perf_counter() - start
    inside, memory = result.stdout.split(maxsplit=1)
    return {"process": process, "inside": float(inside), **json.loads(memory)}


def _row(name: str, results: list[dict[str, float]]) -> dict[str, Value]:
    middle = {key: statistics.median(result[key] for result in results) for key in results[0]}
    return {
        "start": name,
        "process [ms]": middle["process"] * 1e3,
        "inside [ms]": None if name == BARE else middle["inside"] * 1e3,
        "resident [MiB]": middle["resident"],
        "peak [MiB]": middle["peak"],
    }
