"""Companion process of the outlook: states of a running twin from a pipe, and messages about its futures back.

It stands beside the twin at a lower priority, and ends with it: as soon as the pipe is closed.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import IO

import numpy as np

from cable_twin.ensemble.outlook import Forecaster, standard_gust
from cable_twin.frame.records import Command, TensionAhead
from cable_twin.key_figures.outlook import AS_COMMANDED, Outlook
from cable_twin.messages import diagnostics_message
from cable_twin.messages.figure_messages import outlook_statuses
from cable_twin.runtime.companion import inbox, send, serve_twin
from cable_twin.runtime.outlook import Answer, Question
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import FullState


def restore(twin: Simulation, like: FullState, question: Question) -> None:
    """Set a simulation to the state in an outlook request; `like`, a state of equal layout, is overwritten."""
    for kept, block in zip((like.now, like.before, *like.couplings), question.blocks, strict=True):
        kept.memory[:] = np.frombuffer(block, np.uint8)
    commands = {name: Command(kind, {name: value}) for name, (kind, value) in question.commands.items()}
    state = (commands, question.loading, False, like.couplings)
    twin.restore(FullState(twin.scenario, question.time, like.now, like.before, question.stopped, *state))


def answer_of(outlook: Outlook, question: Question) -> Answer:
    """Answer of the process with an outlook: message, warnings and ranges of tension."""
    age = time.monotonic() - question.taken
    message = diagnostics_message(question.stamp_ns, *outlook_statuses(outlook, age))
    ahead = outlook[AS_COMMANDED]
    warnings = {
        str(one.id): (ahead.passed[one.id], ahead.warning(one)) for one in ahead.figures if one.id in ahead.passed
    }
    run = [one for one in outlook.futures if one.last is not None]
    lowest = np.min([one.lowest.min(axis=0) for one in run], axis=0)
    highest = np.max([one.highest.max(axis=0) for one in run], axis=0)
    return Answer(outlook.time, message, warnings, TensionAhead(outlook.time, lowest, highest))


def serve(source: IO[bytes], sink: IO[bytes], leave: Callable[[], None]) -> None:
    """Answer requests for outlooks from a pipe, one at a time, until the pipe is closed.

    Args:
        source: pipe with the scenario and options, then requests.
        sink: pipe for the answers.
        leave: called as soon as the source is closed.
    """
    waiting = inbox(source, leave)
    options = waiting.get()
    twin = Simulation(load_scenario(options["scenario"]), on_demand=True)
    forecaster = Forecaster(twin.scenario, horizon=options["horizon"], threads=1)
    gust, like = standard_gust(twin.scenario, options["gust"]), twin.capture()
    while True:
        question = waiting.get()
        restore(twin, like, question)
        send(sink, answer_of(forecaster.outlook(twin, gust), question))


if __name__ == "__main__":
    serve_twin(serve)
