"""Scripts of commands, as YAML and as CSV, to simulations in a plane and in space."""

from __future__ import annotations

import csv
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from fuzzing import DONE, REFUSED, Case
from fuzzing.mutations import changed, changed_bytes, scalars
from fuzzing.scenarios import LARGEST, WORDS, bombs, written

RUN_BY = "seed_example", "windy_tramway"
DURATION, FRAME_STEPS = 0.05, 1  # s
EXAMPLE = [
    {"time": 0.0, "name": "cabin", "speed": 3.0},
    {"time": 0.01, "name": "carriage", "force": 100.0},
    {"time": 0.01, "wind": 15.0, "wind_z": 1.0},
    {"time": 0.02, "wind": -5.0, "wind_y": 2.0},
    {"time": 0.02, "gust": 12.0, "gust_z": 0.0, "gust_duration": 1.0},
    {"time": 0.02, "name": "cabin", "payload": 500.0},
    {"time": 0.03, "event": "emergency_stop"},
    {"time": 0.03, "event": "release"},
    {"time": 0.04, "event": "reset"},
    {"at": {"name": "carriage", "position": 12.0}, "name": "carriage", "speed": 1.0},
    {"at": {"name": "cabin", "position": 100.0}, "time": 0.01, "event": "emergency_stop"},
]
HEADER = ("time", "name", "speed", "force", "payload", "wind", "wind_z", "wind_y", "gust", "gust_duration", "event")


@st.composite
def cases(draw: Callable[..., Any]) -> Case:
    """Rows of the example script with changes, as data or as text."""
    rows = draw(st.lists(st.sampled_from(EXAMPLE), min_size=1, max_size=5))
    way = draw(st.sampled_from(("data", "data", "data", "text", "cells", "cells text", "bomb")))
    if way == "data":
        return Case(written(draw(changed(rows))), ".yaml")
    if way == "text":
        return Case(draw(changed_bytes(written(rows), WORDS))[:LARGEST], ".yaml")
    if way == "bomb":
        return Case(draw(bombs()), ".yaml")
    header = draw(st.lists(st.sampled_from((*HEADER, "at_name", "at_position", "", "what")), max_size=8))
    lines = [{key: draw(scalars) for key in header} for _ in rows] if draw(st.booleans()) else rows
    text = StringIO()
    writer = csv.DictWriter(text, ["time", *header], extrasaction="ignore")
    writer.writeheader()
    for line in lines:
        writer.writerow({key: _cell(value) for key, value in line.items()})
    content = text.getvalue().encode("utf-8", "replace")
    return Case(draw(changed_bytes(content, WORDS))[:LARGEST] if way == "cells text" else content, ".csv")


def _cell(value: Any) -> str:
    return str(value) if not isinstance(value, int) or abs(value) < 10**400 else "9" * 401


@cache
def simulations() -> list[tuple[Any, Any]]:
    """Simulations for scripts, each with its initial state."""
    from cable_twin.scenario import load_scenario  # noqa: PLC0415 - the parent needs no program
    from cable_twin.simulation import Simulation  # noqa: PLC0415

    started = [Simulation(load_scenario(name)) for name in RUN_BY]
    return [(simulation, simulation.capture()) for simulation in started]


def prepare() -> None:
    """Start the simulations, and take some steps."""
    for simulation, start in simulations():
        simulation.advance_to(0.02)
        simulation.restore(start)


def run(file: Path) -> str:
    """Read and check a script like `simulate --script`, and run an accepted one."""
    from cable_twin.offline.script import ScriptError, check_script, commands_ahead, read_script  # noqa: PLC0415
    from cable_twin.offline.scripted_run import simulate  # noqa: PLC0415

    try:
        script = read_script(file)
        with suppress(ScriptError):  # what a scenario refuses is found in the same pass
            read_script(file, simulations()[0][0].scenario)
    except ScriptError:
        return REFUSED
    done = REFUSED
    for simulation, start in simulations():
        simulation.restore(start)
        ahead = commands_ahead(script, simulation.time, simulation.step)
        if check_script(simulation.scenario, ahead):
            continue
        simulate(simulation, script, duration=DURATION, frame_steps=FRAME_STEPS, epoch_ns=0)
        done = DONE
    return done
