"""Snapshot files with changed numbers, shapes, headers and bytes, to a simulation that continues from them."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from fuzzing import DONE, REFUSED, Case
from fuzzing.mutations import EXTREMES, NOT_FINITE, changed, changed_bytes

NAMES = "seed_example", "chairlift", "windy_tramway", "bicable"  # one rope and several, in a plane and in space
STEPS = 5
WHOLE = (-(2**63), -(2**31), -1000, -2, -1, 0, 1, 2, 3, 5, 100, 1000, 2**31, 2**62, 2**63 - 1)


@cache
def originals() -> list[dict[str, Any]]:
    """Arrays of valid snapshot files, some steps after the start."""
    from cable_twin.scenario import load_scenario  # noqa: PLC0415 - only where cases are made
    from cable_twin.simulation import Simulation  # noqa: PLC0415

    found = []
    for name in NAMES:
        simulation = Simulation(load_scenario(name))
        simulation.advance_to(0.05)
        stream = BytesIO()
        simulation.capture().write(stream)
        stream.seek(0)
        found.append(dict(np.load(stream)))
    return found


def first() -> list[Case]:
    """First cases: a valid file, and a file from the start."""
    stream = BytesIO()
    np.savez(stream, **originals()[0])
    return [Case(stream.getvalue(), ".npz"), Case(stream.getvalue()[:100], ".npz")]


@st.composite
def cases(draw: Callable[..., Any]) -> Case:
    """Valid file with some changes."""
    arrays = dict(draw(st.sampled_from(originals())))
    way = draw(st.sampled_from(("numbers", "numbers", "numbers", "numbers", "shapes", "header", "bytes")))
    names = sorted(set(arrays) - {"header"})
    if way == "numbers":
        for _ in range(draw(st.integers(1, 3))):
            given = [name for name in names if arrays[name].size]
            whole = [name for name in given if arrays[name].dtype.kind != "f"]  # few, and memory is found by them
            name = draw(st.sampled_from(whole if whole and draw(st.booleans()) else given))
            arrays[name] = draw(_changed_numbers(arrays[name]))
    elif way == "shapes":
        name = draw(st.sampled_from(names))
        arrays |= draw(_changed_shape(name, arrays[name]))
    elif way == "header":
        header = draw(changed(json.loads(arrays["header"].tobytes()), most=2))
        arrays["header"] = np.frombuffer(json.dumps(header, default=str).encode(), np.uint8)
    stream = BytesIO()
    np.savez(stream, **arrays)
    content = stream.getvalue()
    return Case(draw(changed_bytes(content, (b"PK\x03\x04", b"\x00" * 64))) if way == "bytes" else content, ".npz")


@st.composite
def _changed_numbers(draw: Callable[..., Any], array: Any) -> Any:
    array = array.copy()
    place = draw(st.integers(0, array.size - 1)) if draw(st.booleans()) else slice(None)
    if array.dtype.kind == "b":
        array.flat[place] = draw(st.booleans())
    elif array.dtype.kind == "i":
        array.flat[place] = draw(st.one_of(st.sampled_from(WHOLE), st.integers(-(2**63), 2**63 - 1)))
    else:
        array.flat[place] = draw(
            st.one_of(st.sampled_from((*EXTREMES, *NOT_FINITE)), st.floats(), st.floats(-1e3, 1e3))
        )
    return array


@st.composite
def _changed_shape(draw: Callable[..., Any], name: str, array: Any) -> dict[str, Any]:
    way = draw(st.sampled_from(("longer", "shorter", "flat", "type", "other name", "texts", "empty")))
    if way == "longer":
        return {name: np.concatenate([array, array]) if array.ndim else array}
    if way == "shorter":
        return {name: array[:-1]}
    if way == "flat":
        return {name: array.reshape(-1)}
    if way == "texts":
        return {name: np.array(["what"] * max(len(array), 1))}
    if way == "empty":
        return {name: np.zeros(0)}
    if way == "other name":
        return {f"{name}{draw(st.sampled_from(('x', '/y', '2')))}": array}
    with np.errstate(all="ignore"):
        return {name: array.astype(draw(st.sampled_from(("f4", "i4", "i8", "f8", "c16", "u1", "b"))))}


@cache
def simulations() -> list[Any]:
    """Simulation by scenario, for the files of that scenario."""
    from cable_twin.scenario import load_scenario  # noqa: PLC0415
    from cable_twin.simulation import Simulation  # noqa: PLC0415

    return [Simulation(load_scenario(name)) for name in NAMES]


def prepare() -> None:
    """Start the simulations, and take some steps."""
    for simulation in simulations():
        simulation.advance_to(0.02)


def run(file: Path) -> str:
    """Continue from a file like `simulate --snapshot`, and check the published numbers."""
    from cable_twin.key_figures import KeyFigures  # noqa: PLC0415
    from cable_twin.scenario import ScenarioError  # noqa: PLC0415
    from cable_twin.simulation import EquilibriumError, Simulation, SnapshotError, SolverError  # noqa: PLC0415
    from cable_twin.simulation.snapshot_file import read_full_state  # noqa: PLC0415

    try:
        full = read_full_state(file, "snapshot")
        known = [one for one in simulations() if one.scenario.resolved() == full.scenario.resolved()]
        simulation = known[0] if known else Simulation(full.scenario)
        simulation.restore(full)
    except (SnapshotError, ScenarioError, EquilibriumError):
        return REFUSED
    figures = KeyFigures(simulation.scenario)
    figures.update(simulation.snapshot)
    try:
        for _ in range(STEPS):
            figures.update(simulation.advance_to(simulation.time + simulation.step))
        for _ in range(2):
            simulation.reset()
            figures.update(simulation.advance_to(simulation.time + simulation.step))
    except SolverError:
        pass
    figures.figures()
    return DONE
