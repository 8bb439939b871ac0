"""Solver cost a step of the shipped ropeways under way, on their own meshes and on those that they had before.

With `--beside PATH` another checkout runs the same in turn, by its own Python (`PATH/.venv`) where it has one, and the
ratios to it are what counts.
"""

from __future__ import annotations

import json
import statistics
import subprocess
import sys
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.progress import Progress

from benchmarks.measure import ROOT, BenchmarkError, Effort, environment_of_user
from benchmarks.report import Part, Table, Value
from benchmarks.yardstick import Case, Contestant

ROPEWAYS = {
    "single_span": Case("single_span", "cabin", 7.0),
    "aerial_tramway": Case("aerial_tramway", "cabin", 7.0),
    "windy_tramway": Case("windy_tramway", "cabin", 7.0),
    "chairlift": Case("chairlift", "haul_rope", 2.5),
    "gondola": Case("gondola", "haul_rope", 6.0),
    "jig_back": Case("jig_back", "haul_rope", 10.0),
    "bicable": Case("bicable", "haul_rope", 7.0),
}


def graded(target: float, at_towers: float, growth: float) -> dict[str, float]:
    """Value of `elements`, in m."""
    return {"target": target, "at_towers": at_towers, "growth": growth}


# `elements` of each rope before there was a node under each load
EARLIER: dict[str, dict[str, Any]] = {
    "single_span": {"cable": 100},
    "aerial_tramway": {"cable": graded(11.3, 3.5, 1.7)},
    "windy_tramway": {"cable": graded(11.3, 3.5, 1.7)},
    "chairlift": dict.fromkeys(("ropes.up", "ropes.down"), graded(4.0, 1.4, 1.5)),
    "gondola": dict.fromkeys(("ropes.up", "ropes.down"), graded(7.0, 1.25, 1.25)),
    "jig_back": {
        **dict.fromkeys(("ropes.track_1", "ropes.track_2"), graded(6.0, 4.0, 1.3)),
        **dict.fromkeys(("ropes.haul_1", "ropes.haul_2"), graded(10.0, 2.0, 1.5)),
    },
    "bicable": {
        **dict.fromkeys(("ropes.track_up", "ropes.track_down"), graded(6.0, 2.0, 1.4)),
        **dict.fromkeys(("ropes.haul_up", "ropes.haul_down"), graded(8.0, 2.0, 1.5)),
    },
}
PIECE, TURNS = 10.0, 5  # s of simulated time in a turn; turns
MOST_SHIPPED, MOST_EQUAL, MOST_ELEMENTS = 0.75, 1.1, 0.6  # of the other checkout: cost, cost on equal meshes, elements
SIZE = """\
import json, sys
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
name, *changes = sys.argv[1:]
pairs = (change.partition("=") for change in changes)
simulation = Simulation(load_scenario(name, {key: json.loads(value) for key, _, value in pairs}))
print(sum(part.system.cable.element_count for part in simulation.parts.values()), simulation.step)
"""


def mesh_changes(elements: Mapping[str, Any]) -> tuple[str, ...]:
    """Changes KEY=VALUE of a scenario that give its ropes a mesh, from `elements` by the key of each rope."""
    return tuple(f"{rope}.elements={json.dumps(value)}" for rope, value in elements.items())


def run(effort: Effort, progress: Progress) -> Part:
    """Cost of each ropeway on both meshes, beside that of another checkout if there is one."""
    turns = 1 if effort.quick else max(TURNS, effort.repetitions)
    piece = 1.0 if effort.quick else PIECE
    names = ["single_span", "chairlift"] if effort.quick else list(ROPEWAYS)
    trees = {"here": ROOT} | ({} if effort.beside is None else {"beside": effort.beside})
    task = progress.add_task("loads", total=len(names) * 2 * turns)
    rows: list[dict[str, Value]] = []
    faults = []
    for name in names:
        for mesh in ("shipped", "before"):
            changes = mesh_changes(EARLIER[name]) if mesh == "before" else ()
            case = replace(ROPEWAYS[name], changes=changes)
            sizes = {tree: _size(case, path) for tree, path in trees.items()}
            times: dict[str, list[float]] = {tree: [] for tree in trees}
            with ExitStack() as stack:
                running = {}
                for tree, path in trees.items():
                    running[tree] = Contestant("solver", case, path, python_of(path))
                    stack.callback(running[tree].close)
                    running[tree].wait()
                for turn in range(turns):
                    for tree in sorted(running, reverse=turn % 2 == 1):  # neither is always the first
                        times[tree].append(running[tree].run(piece))
                    progress.advance(task)
            rows.append(_row(name, mesh, sizes, times, piece))
            faults += [] if effort.quick else _faults(rows[-1])
    notes = [
        f"Under way at the speed of the drive: processor time of the solver, medians of {turns} turns of {piece:g} s.",
        "Meshes: `shipped` is that of the scenario in each checkout, `before` the one that it had before there was a "
        "node under each load.",
        f"Allowed beside another checkout: {MOST_SHIPPED:g} of its cost and {MOST_ELEMENTS:g} of its elements on "
        f"shipped meshes, {MOST_EQUAL:g} of its cost on equal ones.",
    ]
    return Part("Loads", [Table("solver cost of shipped ropeways", rows)], notes, faults)


def python_of(tree: Path) -> str:
    """Interpreter of a checkout: its own, or this one."""
    own = tree / ".venv" / "bin" / "python"
    return str(own) if own.is_file() else sys.executable


def _size(case: Case, tree: Path) -> tuple[int, float]:
    """Elements of all ropes, and the step (s), of a case in a checkout.

    Raises:
        BenchmarkError: it cannot be loaded there.
    """
    command = [python_of(tree), "-c", SIZE, case.scenario, *case.changes]
    environment = {**environment_of_user(), "PYTHONPATH": str(tree)}
    done = subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True, check=False)
    if done.returncode:
        last = done.stderr.strip().splitlines() or ["no message"]
        raise BenchmarkError(f"{case.scenario} in {tree}: {last[-1]}")
    count, step = done.stdout.split()
    return int(count), float(step)


def _row(
    name: str, mesh: str, sizes: Mapping[str, tuple[int, float]], times: Mapping[str, list[float]], piece: float
) -> dict[str, Value]:
    """Row of the table; ratios are medians over turns."""
    row: dict[str, Value] = {"scenario": name, "mesh": mesh}
    for tree, (count, step) in sizes.items():
        row[f"elements {tree}"] = count
        row[f"a step {tree} [µs]"] = statistics.median(times[tree]) / piece * step * 1e6
    if "beside" in sizes:
        pairs = zip(times["here"], times["beside"], strict=True)
        row["elements, ratio"] = sizes["here"][0] / sizes["beside"][0]
        row["cost, ratio"] = statistics.median(here / beside for here, beside in pairs)
    return row


def _faults(row: Mapping[str, Value]) -> list[str]:
    """Limits that are missed, a line each."""
    if "cost, ratio" not in row:
        return []
    limits = {"shipped": {"cost, ratio": MOST_SHIPPED, "elements, ratio": MOST_ELEMENTS}}
    limits["before"] = {"cost, ratio": MOST_EQUAL}
    return [
        f"loads: {row['scenario']}, mesh {row['mesh']}: {key} is {row[key]:.3f}, allowed: {most:g}"
        for key, most in limits[str(row["mesh"])].items()
        if float(row[key] or 0.0) > most
    ]
