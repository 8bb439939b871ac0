"""Compile the solver's kernels ahead of time, into the package's wheel: `python -m cable_twin.kernels build`.

The wheel holds the kernels that Python calls, in the types of the shipped scenarios, but not the modules they are
linked from: a scenario of other types compiles its own kernels at its first start, as without these files.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from cable_twin.basics.cpu import CLASSES, VARIABLE, class_of, machine, this_cpu
from cable_twin.mechanics.language.kernel_cache import FROM_PYTHON, SHIPPED
from cable_twin.scenario import ScenarioError, load_scenario, scenario_names
from cable_twin.terminal.bars import count_shown
from cable_twin.terminal.command_line import OneLineParser, print_line, tell

COMMAND = "python -m cable_twin.kernels"
DURATION = 0.1  # s of simulated time, in which a run has called all its kernels
EPILOG = f"""\
A wheel of the package that is made afterwards holds them, for this version of Python, numba and the class of this CPU;
with another one, and with changed sources, they are not used. It takes two or three minutes.

examples:
  {COMMAND} build                  all shipped scenarios
  {COMMAND} build single_span      one of them
"""


class BuildError(RuntimeError):
    """Failure to compile kernels ahead of time; the message is one line."""


def parser() -> OneLineParser:
    """Command-line parser of `python -m cable_twin.kernels`."""
    result = OneLineParser(COMMAND, "Compile the solver for the shipped scenarios, into the package.", EPILOG)
    result.add_argument("action", choices=["build"], help="replace what is there")
    result.add_argument("scenarios", nargs="*", metavar="SCENARIO", help="name or path; default: all shipped ones")
    return result


def build(scenarios: Sequence[str], target: Path = SHIPPED) -> None:
    """Compile the kernels that Python calls in runs of scenarios into a directory, whose earlier kernels are deleted.

    Raises:
        ScenarioError: a scenario is invalid.
        BuildError: a scenario does not run, or the CPU is of no known class, so that no other could use its kernels.
        OSError: the directory cannot be written.
    """
    if class_of(machine(), this_cpu()) is None:
        known = CLASSES.get(machine())
        allowed = "x86_64 or aarch64" if known is None else f"with all instructions of {known.target.name}"
        raise BuildError(f"CPU: given {this_cpu().name}; allowed: {allowed}, as others could not run its kernels")
    for scenario in scenarios:
        load_scenario(scenario)
    shutil.rmtree(target, ignore_errors=True)  # and nothing is taken from there
    with tempfile.TemporaryDirectory(prefix="cable_twin_kernels_") as directory:
        with count_shown(Console(stderr=True), "scenarios", len(scenarios)) as done:
            for scenario in scenarios:
                _run(scenario, directory)
                done()
        for kernels in (Path(directory) / "cable_twin").iterdir():
            shutil.copytree(kernels / FROM_PYTHON, target / kernels.name / FROM_PYTHON)


def _run(scenario: str, directory: str) -> None:
    """Run a scenario shortly with `simulate`, with numba's cache of compiled kernels in a directory."""
    variables = {name: value for name, value in os.environ.items() if name != VARIABLE}
    command = [sys.executable, "-m", "cable_twin.offline.simulate", "--scenario", scenario, "--record", "off"]
    result = subprocess.run(
        [*command, "--duration", str(DURATION)],
        env=variables | {"NUMBA_CACHE_DIR": directory, "NUMBA_DISABLE_JIT": "0"},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    if result.returncode:
        raise BuildError(result.stderr.strip().rpartition("\n")[2].removeprefix("simulate: "))


def main(argv: Sequence[str] | None = None) -> int:
    """Compile kernels ahead of time and report number and size; returns exit code 0, or 1 after a failure."""
    options = parser().parse_args(sys.argv[1:] if argv is None else list(argv))
    scenarios, began = options.scenarios or scenario_names(), time.monotonic()
    try:
        build(scenarios)
    except (BuildError, ScenarioError, OSError) as error:
        tell(COMMAND, error)
        return 1
    files = list(SHIPPED.rglob("*.nbc"))
    size = sum(file.stat().st_size for file in SHIPPED.rglob("*.nb?"))
    print_line(
        f"{SHIPPED}: {len(files)} kernels of {len(scenarios)} scenarios, {1e-6 * size:.1f} MB, "
        f"in {time.monotonic() - began:.0f} s"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
