"""Discretisation check of key figures: their differences in a run of half the element length, step and saddle pitch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from cable_twin.key_figures import KeyFigure, KeyFigures
from cable_twin.offline.script import ScriptedCommand
from cable_twin.offline.scripted_run import simulate
from cable_twin.scenario import Grading, Scenario, load_scenario
from cable_twin.simulation import Simulation


def refined(scenario: Scenario) -> Scenario:
    """Refine a scenario: elements and steps of half the length, contact points of saddles half as far apart."""
    changes: dict[str, Any] = {}
    for rope, cable in scenario.cables.items():
        key, elements = f"{scenario.rope_key(rope)}.elements", cable.elements
        if isinstance(elements, Grading):
            changes |= {f"{key}.{part}": 0.5 * getattr(elements, part) for part in ("target", "at_towers")}
            # the growth per metre stays, so that elements are halved everywhere
            changes[f"{key}.growth"] = elements.growth**0.5
        else:
            changes[key] = 2 * elements
    for name, tower in scenario.towers.items():
        if tower.kind == "saddle" and tower.contacts > 1:  # of sheaves there are as many as there are
            changes |= {
                f"towers.{name}.contacts": 2 * tower.contacts - 1,
                f"towers.{name}.stiffness": 0.5 * tower.stiffness,
            }
    return load_scenario(scenario.resolved(), {**changes, "solver.step": 0.5 * scenario.solver.step})


def checked(
    figures: Sequence[KeyFigure],
    scenario: Scenario,
    script: Sequence[ScriptedCommand],
    *,
    duration: float,
    frame_steps: int,
) -> list[KeyFigure]:
    """Key figures of a run from its start, each with its difference from a run of the refined scenario.

    Args:
        figures: of the run.
        scenario: of the run.
        script: its commands.
        duration: s.
        frame_steps: solver steps in a frame of the run.
    """
    finer = refined(scenario)
    gathered = KeyFigures(finer)
    simulate(Simulation(finer), script, duration=duration, frame_steps=2 * frame_steps, epoch_ns=0, figures=gathered)
    return compared(figures, gathered.figures())


def compared(figures: Sequence[KeyFigure], finer: Sequence[KeyFigure]) -> list[KeyFigure]:
    """Key figures, each with its difference from the figure of equal id of a finer model."""
    values = {figure.id: figure.value for figure in finer}
    return [
        replace(figure, uncertainty=abs(values[figure.id] - figure.value)) if figure.id in values else figure
        for figure in figures
    ]
