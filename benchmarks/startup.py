"""Start of a fresh process: import, cold start with empty kernel cache, warm start; and its memory."""

from __future__ import annotations

import importlib.util
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from rich.progress import Progress

from benchmarks.measure import BenchmarkError, Effort, environment_of_user
from benchmarks.report import Part, Table, Value

SCENARIO = "aerial_tramway"
SIMULATED = (SCENARIO, "windy_tramway", "chairlift", "jig_back")  # one rope and several, in a plane and in space
READY = (
    "from cable_twin.scenario import load_scenario; from cable_twin.simulation import Simulation; "
    f"Simulation(load_scenario('{SCENARIO}')).advance_to(0.01)"
)
READ_MEMORY = (
    "import json; status = dict(line.split(':', 1) for line in open('/proc/self/status')); "
    "print(json.dumps({'resident': int(status['VmRSS'].split()[0]) / 1024, "
    "'peak': int(status['VmHWM'].split()[0]) / 1024}))"
)
SIMULATE = f"import sys; from cable_twin.offline.simulate import main; code = main(); {READ_MEMORY}; sys.exit(code)"
TIME_CODE = "import time; start = time.perf_counter(); {code}; print(time.perf_counter() - start); "
RUNS = " runs at "  # in the line with which the node says that time runs
SIM_TIMEOUT = 300.0  # s

Result = dict[str, float]  # times in s, memory in MiB
Start = Callable[[dict[str, str]], Result]


def run(effort: Effort, progress: Progress) -> Part:
    """Start processes in turn; `quick` leaves out the cold starts, which compile all kernels."""
    starts: dict[str, Start] = {
        "Python alone": lambda environment: _start("pass", environment),
        "import cable_twin": lambda environment: _start("import cable_twin", environment),
        "import cable_twin.simulation": lambda environment: _start("import cable_twin.simulation", environment),
    }
    compiling: dict[str, Start] = {f"Simulation of {SCENARIO}, first frame": lambda where: _start(READY, where)}
    for name in SIMULATED:
        compiling[f"simulate {name}, 1 s, no logs"] = partial(_start_simulate, name)
    if importlib.util.find_spec("rclpy") is not None:
        compiling["sim, until time runs"] = _start_sim
    taken: dict[str, list[Result]] = {name: [] for name in starts}
    with tempfile.TemporaryDirectory(prefix="kernels-") as directory:
        cold: list[tuple[str, Start, str | None]] = []
        warm: list[tuple[str, Start, str | None]] = [(name, start, None) for name, start in starts.items()]
        for number, (name, start) in enumerate(compiling.items()):
            kernels = None if effort.quick else f"{directory}/{number}"
            if effort.quick:
                start(_environment(None))  # what is compiled already may be older
            else:
                cold.append((f"{name}, cold", start, kernels))
            warm.append((f"{name}, warm", start, kernels))
        turns = [*cold, *warm * effort.repetitions]
        for name, start, kernels in progress.track(turns, description="fresh processes, cold ones first"):
            taken.setdefault(name, []).append(start(_environment(kernels)))
    notes = [
        "Cold: nothing compiled (`NUMBA_CACHE_DIR` is an empty directory), once. Warm: with what a cold start kept.",
        "Process: from its start to its end; of `sim`, to the line that says that time runs. Inside: the code alone, "
        "without starting and ending the interpreter.",
    ]
    rows = [_row(name, taken[name]) for name in sorted(taken, key=lambda name: name.endswith(", cold"))]
    return Part("Start-up and memory", [Table("fresh processes", rows)], notes)


def _environment(kernels: str | None) -> dict[str, str]:
    """Environment of a user; `kernels` is the directory of compiled kernels, None for that of the user."""
    return environment_of_user() | ({} if kernels is None else {"NUMBA_CACHE_DIR": kernels})


def _start(code: str, environment: dict[str, str]) -> Result:
    """Run one line of Python in a fresh interpreter.

    Raises:
        BenchmarkError: the code failed.
    """
    command = [sys.executable, "-c", TIME_CODE.format(code=code) + READ_MEMORY]
    start = time.perf_counter()
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    process = time.perf_counter() - start
    if result.returncode:
        raise BenchmarkError(f"{code}: {result.stderr.strip()}")
    inside, memory = result.stdout.split(maxsplit=1)
    return {"process": process, "inside": float(inside), **json.loads(memory)}


def _start_simulate(name: str, environment: dict[str, str]) -> Result:
    """Run `simulate` for a second of simulated time.

    Raises:
        BenchmarkError: it could not.
    """
    command = [sys.executable, "-c", SIMULATE, name, "--duration", "1", "--record", "off"]
    start = time.perf_counter()
    result = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    process = time.perf_counter() - start
    if result.returncode:
        raise BenchmarkError(f"simulate {name}: {result.stderr.strip()}")
    return {"process": process, **json.loads(result.stdout.splitlines()[-1])}


def _start_sim(environment: dict[str, str]) -> Result:
    """Start `sim` with all logs and end it once simulated time runs.

    Raises:
        BenchmarkError: it ended before.
    """
    environment = {
        **environment,
        "PYTHONUNBUFFERED": "1",
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "ROS_DOMAIN_ID": os.environ.get("ROS_DOMAIN_ID") or str(20 + os.getpid() % 80),
    }
    with tempfile.TemporaryDirectory(prefix="cable_twin_start_") as directory:
        command = [sys.executable, "-m", "cable_twin.ros.sim", "--scenario", SCENARIO, "--record-directory", directory]
        start = time.perf_counter()
        with subprocess.Popen(
            command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as process:
            assert process.stdout is not None
            said = []
            for line in process.stdout:
                said.append(line)
                if RUNS in line:
                    break
            else:
                raise BenchmarkError(f"sim ended before time ran: {''.join(said).strip()}")
            taken = time.perf_counter() - start
            status = Path(f"/proc/{process.pid}/status").read_text(encoding="utf-8").splitlines()
            memory = dict(line.split(":", 1) for line in status)
            process.send_signal(signal.SIGINT)
            process.communicate(timeout=SIM_TIMEOUT)
    resident, peak = (int(memory[key].split()[0]) / 1024 for key in ("VmRSS", "VmHWM"))
    return {"process": taken, "resident": resident, "peak": peak}


def _row(name: str, results: list[Result]) -> dict[str, Value]:
    middle = {key: statistics.median(result[key] for result in results) for key in results[0]}
    inside = middle.get("inside")
    return {
        "start": name,
        "process [ms]": middle["process"] * 1e3,
        "inside [ms]": None if name == "Python alone" or inside is None else inside * 1e3,
        "resident [MiB]": middle["resident"],
        "peak [MiB]": middle["peak"],
    }
