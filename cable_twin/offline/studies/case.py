"""Run of one case of a study in any process: from scenario text and values to key figures, bit for bit everywhere."""

from __future__ import annotations

import hashlib
import json
import platform
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, lru_cache
from typing import Any, NamedTuple

from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.offline.studies.design import SCRIPT, Value
from cable_twin.recording.log_writer import program_metadata, program_sources
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.simulation import EquilibriumError, Simulation

ALONE = threading.Lock()  # cases of one process run one after the other


class Inputs(NamedTuple):
    """Common inputs of all cases of a study: scenario, scripts, duration, frame rate.

    Attributes:
        scenario: resolved scenario, as JSON.
        scripts: commands by name of the script; "" for the script of cases that do not vary it.
        duration: s; None for the time `after` the last command of the script.
        after: s.
        frame_rate: Hz.
    """

    scenario: str
    scripts: Mapping[str, Sequence[ScriptedCommand]]
    duration: float | None
    after: float
    frame_rate: float


class Case(NamedTuple):
    """Case of a study: id, values by key, and hash of all its inputs."""

    id: str
    values: Mapping[str, Value]
    inputs: str


class Finished(NamedTuple):
    """Result of a finished case of a study: key figures, error, refused commands, host and times.

    Attributes:
        case: id of the case.
        inputs: hash of all inputs of the case.
        host: name of the machine.
        seconds: wall time of the case.
        processor: s, processor time of the case.
        fault: reason of missing figures or of an early end; empty without a fault.
        refused: refused commands, a line each.
        figures: value, time (s) and place of each key figure, by id.
        exceeded: ids of figures that do not keep their limits.
    """

    case: str
    inputs: str
    host: str
    seconds: float
    processor: float
    fault: str
    refused: Sequence[str]
    figures: Mapping[str, tuple[float, float, str]]
    exceeded: Sequence[str]


Names = Mapping[str, tuple[str, str]]  # name and unit of key figures, by id


@cache
def program() -> str:
    """JSON text of the versions, sources and arithmetic of this process, on which the bits of results depend."""
    return json.dumps({**program_metadata(), "sources": program_sources()}, sort_keys=True)


def digest(content: Any) -> str:
    """Hash of plain data, by its JSON text."""
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]


def hash_of_case(common: Inputs) -> Callable[[Mapping[str, Value]], str]:
    """Make a function that hashes all inputs of a study's case, and the program version, from the case's values."""
    kept = [json.loads(common.scenario), common.duration, common.after, common.frame_rate, program()]
    of_study = digest(kept)
    scripts = {name: digest([[one.time, repr(one.command), one.at] for one in script])
               for name, script in common.scripts.items()}  # fmt: skip

    def of(values: Mapping[str, Value]) -> str:
        script = scripts.get(str(values.get(SCRIPT, "")), "")
        return digest([of_study, {key: value for key, value in values.items() if key != SCRIPT}, script])

    return of


@lru_cache(maxsize=4)
def _scenario(text: str) -> Mapping[str, Any]:
    found: Mapping[str, Any] = json.loads(text)
    return found


def scenario_of(common: Inputs, values: Mapping[str, Value]) -> Scenario:
    """Scenario of a study's case: the common scenario with the values of the case.

    Raises:
        ScenarioError: the scenario refuses the values.
    """
    return load_scenario(_scenario(common.scenario), {key: one for key, one in values.items() if key != SCRIPT})


def run_case(common: Inputs, case: Case, wanted: str) -> tuple[Finished, Names]:
    """Run a case of a study on one thread; returns its result, and names and units of its key figures.

    Args:
        common: inputs of all cases of the study.
        case: the case.
        wanted: result of `program` that this process must have.

    Raises:
        OtherProgramError: this process has another program.
    """
    if program() != wanted:
        raise OtherProgramError(difference(wanted, program()))
    with ALONE:
        began, processor = time.perf_counter(), time.thread_time()
        figures, fault, refused = _run(common, case)
        seconds, processor = time.perf_counter() - began, time.thread_time() - processor
    by_id = {str(one.id): one for one in figures}
    finished = Finished(
        case.id,
        case.inputs,
        platform.node(),
        seconds,
        processor,
        " ".join(fault.split()),
        refused,
        {name: (float(one.value), float(one.time), one.place) for name, one in by_id.items()},
        [name for name, one in by_id.items() if one.kept is False],
    )
    return finished, {name: (one.name, one.unit) for name, one in by_id.items()}


def _run(common: Inputs, case: Case) -> tuple[Sequence[KeyFigure], str, Sequence[str]]:
    """Simulate a case of a study: returns key figures, the reason of an early end, and refused commands."""
    try:
        scenario = scenario_of(common, case.values)
        simulation = Simulation(scenario, on_demand=True)
    except ScenarioError as error:
        return (), str(error.faults[0]).partition(": ")[2], ()
    except EquilibriumError as error:
        return (), str(error), ()
    script = common.scripts.get(str(case.values.get(SCRIPT, "")), ())
    duration = common.duration
    if duration is None:
        duration = (script[-1].time if script else 0.0) + common.after
    figures = KeyFigures(scenario)
    frame_steps = max(round(1.0 / (common.frame_rate * simulation.step)), 1)
    outcome = simulate(simulation, script, duration=duration, frame_steps=frame_steps, epoch_ns=0, figures=figures)
    return figures.figures(), outcome.fault, outcome.refused


class OtherProgramError(RuntimeError):
    """Error of a study's worker with another version of the program or another arithmetic; the message is one line."""


def difference(wanted: str, found: str) -> str:
    """Line about the first difference between the versions, sources and arithmetic of two processes; empty if equal."""
    here, there = json.loads(wanted), json.loads(found)
    for key in here | there:
        if here.get(key) != there.get(key):
            return f"a worker has {key.replace('_', ' ')} {there.get(key)}; allowed: {here.get(key)}, as here"
    return ""
