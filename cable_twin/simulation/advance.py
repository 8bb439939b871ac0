"""Solver steps in batches, with loading, stations and vehicle contacts handled between, at fixed simulated times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from cable_twin.frame.records import SolverReport
from cable_twin.mechanics.parameters import Solver
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.simulation.loading import exchange, load_on
from cable_twin.simulation.meeting import Meeting
from cable_twin.simulation.ropeway import Ropeway

PART = 50_000  # steps times nodes that are taken at once
PERIOD = 0.05  # s of simulated time from one look to the next; a person gets into a cabin in several of them
SURE_RADIUS = 0.8  # -, of solver.spectral_radius; with more a light load on a stiff cable fails now and then


def in_parts(
    parts: Sequence[Ropeway],
    meetings: Sequence[Meeting],
    steps: int,
    advance: Callable[[int], tuple],
    on_part: Callable[[], object] = lambda: None,
) -> Outcome:
    """Take `steps` solver steps by calls of `advance`, each of some tenths of a second at most.

    Between them Ctrl-C is heard, and what is to be done meanwhile is done.

    Args:
        parts: one a rope, with what is on it.
        meetings: what watches each of them.
        steps: how many.
        advance: takes so many of them.
        on_part: called after each call; what it raises ends the steps there.

    Returns:
        What came of all of them, or until one failed or two vehicles are pressed through each other.
    """
    most = max(PART // sum([len(part.state.nodes.position) for part in parts]), 1)  # steps of a call
    if not _has_more_to_do(parts, meetings):
        total = Outcome(*advance(min(steps, most)))
        on_part()
        while total.converged and total.steps < steps:
            total = _joined(total, Outcome(*advance(min(steps - total.steps, most))))
            on_part()
        return total
    total = Outcome(True, 0, 0, 0, 0.0, 0.0, 0, 0.0, 0.0)
    step, clock = parts[0].system.solver.step, parts[0].state.clock
    period = max(round(PERIOD / step), 1)
    while total.converged and total.steps < steps and not meeting_found(parts, meetings):
        rest = steps - total.steps
        until = period - int(clock[0]) % period if _has_more_to_do(parts, meetings) else rest
        total = _joined(total, Outcome(*advance(min(rest, until, most))))
        on_part()
        if total.converged and int(clock[0]) % period == 0:
            for ropeway in parts:
                load_on(ropeway, period * step)
                if ropeway.rooms:
                    exchange(ropeway)
    return total


def _joined(before: Outcome, last: Outcome) -> Outcome:
    """Sum of the outcomes of two calls of the integrator."""
    return last._replace(
        steps=before.steps + last.steps,
        iterations=before.iterations + last.iterations,
        halvings=before.halvings + last.halvings,
        gap=max(before.gap, last.gap),
        lost=before.lost + last.lost,
        moved=before.moved + last.moved,
    )


def _has_more_to_do(parts: Sequence[Ropeway], meetings: Sequence[Meeting]) -> bool:
    """Whether steps have to be interrupted for loading, stations or vehicles that can meet."""
    return any(part.loading or part.rooms for part in parts) or any(meeting.possible for meeting in meetings)


def meeting_found(parts: Sequence[Ropeway], meetings: Sequence[Meeting]) -> str:
    """Message about two vehicles pressed through each other, empty without such a pair."""
    lines = (meeting.found(part.state) for part, meeting in zip(parts, meetings, strict=True))
    return next((line for line in lines if line), "")


def report_of(outcome: Outcome) -> SolverReport:
    """Solver report of a snapshot from the outcome of an integrator call."""
    return SolverReport(
        int(outcome.steps),
        int(outcome.iterations),
        int(outcome.halvings),
        float(outcome.gap),
        float(outcome.lost),
        float(outcome.moved),
    )


def undamped(solver: Solver) -> str:
    """Explanation of a failed step by too little numerical damping of joints and a stiff cable, empty where damped."""
    if solver.spectral_radius <= SURE_RADIUS:
        return ""
    return (
        f"solver.spectral_radius is {solver.spectral_radius:g}, which hardly damps the ringing of joints and cable: "
        f"up to {SURE_RADIUS:g} is sure; "
    )


__all__ = ["in_parts", "meeting_found", "report_of", "undamped"]
