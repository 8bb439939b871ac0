"""Final report of `simulate`."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from cable_twin.key_figures import KeyFigure
from cable_twin.messages.figure_messages import describe
from cable_twin.offline.figure_table import print_figures, table_console
from cable_twin.offline.scripted_run import Outcome
from cable_twin.recording.run import Run
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Solver
from cable_twin.terminal.command_line import tell, typed

DEFAULT_STEP: float = Solver().step  # s


def report(
    scenario: Scenario,
    start: float,
    outcome: Outcome,
    figures: Sequence[KeyFigure],
    run: Run | None,
    faults: Sequence[str],
) -> bool:
    """Print the results of a run; returns whether something failed.

    Args:
        scenario: what ran.
        start: simulated time (s) at which it began.
        outcome: of the run.
        figures: that it showed.
        run: its log, where there is one.
        faults: what failed, a line each.
    """
    print_figures(table_console(), [figures])
    warned = [one for one in figures if one.kept is False and one.id.quantity in ("energy_lost", "derailed")]
    met = [one for one in figures if one.id.quantity == "buffer_force"]
    told = [f"warning: {figure.name}: {describe(figure)}" for figure in (*met, *warned)]
    told += [f"refused: {line}" for line in outcome.refused[:5]]
    told += [f"{len(outcome.refused) - 5} more refused"] if len(outcome.refused) > 5 else []
    told += [*faults]
    told += (
        [f"not carried out, because their time is at or after the end of the run: {_count(outcome.left)}"]
        if outcome.left
        else []
    )
    told += [f"not carried out: {line}" for line in outcome.not_reached]
    told += (
        [f"not carried out, because their time is before that of the snapshot: {_count(outcome.past)}"]
        if outcome.past
        else []
    )
    simulated, since = outcome.time - start, f" from {start:.2f} s on" if start else ""
    factor = simulated / max(outcome.wall_time, 1e-9)
    told += [_shorter_than_needed(scenario)] if factor < 1.0 and scenario.solver.step == DEFAULT_STEP else []
    for line in told:
        tell("simulate", line)
    print(
        f"{scenario.name}: {simulated:.2f} s{since} in {outcome.wall_time:.2f} s, {factor:.1f} times real time; "
        + _count(outcome.applied)
        + (f", {len(outcome.refused)} refused" if outcome.refused else "")
    )
    if _idle(scenario, outcome):
        print("no drive was commanded: give commands with --script FILE")
    if run is not None:
        print(f"log: {run.directory}\nto view it: {typed('review')} {shlex.quote(str(run.directory))}")
    return bool(faults or outcome.refused)


def _count(commands: int) -> str:
    return f"{commands} command{'' if commands == 1 else 's'}"


def _idle(scenario: Scenario, outcome: Outcome) -> bool:
    """Whether all drives stood still for lack of a command."""
    carriages = scenario.carriages.values()
    drives = [one.speed for one in scenario.drives.values()]
    drives += [one.speed for one in carriages if one.drive.mode == "speed"]
    given = outcome.applied or outcome.refused or outcome.past or outcome.left or outcome.not_reached
    return bool(drives) and not any(drives) and not given


def _shorter_than_needed(scenario: Scenario) -> str:
    return (
        f"slower than real time with solver.step at its default of {DEFAULT_STEP:g} s; ropeways usually do with 0.005 "
        "to 0.01 s: --set solver.step=0.005, and --check says what that changes"
    )


__all__ = ["report"]
