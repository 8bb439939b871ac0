"""Solver steps in parts, with what has to be done between them at times that no caller can shift."""

from __future__ import annotations

from collections.abc import Callable

from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.simulation.loading import load_on
from cable_twin.simulation.meeting import Meeting
from cable_twin.simulation.ropeway import Ropeway

PERIOD = 0.05  # s of simulated time from one look to the next; a person gets into a cabin in several of them


def in_parts(ropeway: Ropeway, meeting: Meeting, steps: int, advance: Callable[[int], tuple]) -> Outcome:
    """Take `steps` solver steps by calls of `advance`, in one where nothing is to be done meanwhile.

    Returns:
        What came of all of them, or until one failed or two vehicles have met.
    """
    step, clock = ropeway.system.solver.step, ropeway.state.clock
    period = max(round(PERIOD / step), 1)
    total = Outcome(True, 0, 0, 0, 0.0, 0.0, 0)
    while total.converged and total.steps < steps and not meeting.found(ropeway.state):
        rest = steps - total.steps
        until = period - int(clock[0]) % period if ropeway.loading or meeting.possible else rest
        part = Outcome(*advance(min(rest, until)))
        total = part._replace(
            steps=total.steps + part.steps,
            iterations=total.iterations + part.iterations,
            halvings=total.halvings + part.halvings,
            gap=max(total.gap, part.gap),
        )
        if total.converged and int(clock[0]) % period == 0:
            load_on(ropeway, period * step)
    return total


__all__ = ["in_parts"]
