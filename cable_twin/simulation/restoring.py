"""Going to a full state."""

from __future__ import annotations

from cable_twin.mechanics.state import write_state
from cable_twin.simulation.ropeway import Ropeway
from cable_twin.simulation.snapshot_file import FullState


def restore_all(parts: list[Ropeway], full: FullState) -> None:
    """Go to what a full state has of each rope, and of what is commanded."""
    for part, state, start in zip(parts, full.states, full.starts, strict=True):
        write_state(state, part.state)
        write_state(start, part.start)
        part.note_stations()
        part.carry(part.state.payload)
        part.stopped = full.emergency_stopped
        own = (*part.rows, *part.scenario.drives)
        part.commands = {name: command for name, command in full.commands.items() if name in own}
        part.loading = {name: mass for name, mass in full.loading.items() if name in own}


__all__ = ["restore_all"]
