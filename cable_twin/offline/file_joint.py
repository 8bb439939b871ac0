"""Transition of a replay from one file of a log to the next."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from enum import Enum, auto
from io import BytesIO

import numpy as np

from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.language.declared import arrays_of
from cable_twin.offline.replay_result import Comparison, Difference
from cable_twin.recording.log_file import LogFile
from cable_twin.recording.mcap_file import SNAPSHOT_NAME
from cable_twin.simulation import Simulation, SnapshotError
from cable_twin.simulation.snapshot_file import FullState, read_full_state


class Joint(Enum):
    """Kinds of transition of a replay to the next file."""

    GOES_ON = auto()
    FROM_ITS_STATE = auto()
    LEFT_OUT = auto()


def join(
    before: LogFile,
    file: LogFile,
    simulation: Simulation,
    advance: Callable[[float], Snapshot],
    result: Comparison,
    *,
    exactly: bool,
) -> Joint:
    """Go from one file of a log to the next, by comparing or taking over the attached state.

    A state that is damaged is said; where it is needed, the file is left out.

    Args:
        before: What has been read.
        file: What comes next.
        simulation: Where the file before has ended.
        advance: Brings the simulation to a time (s), with the commands until then.
        result: Gets what differs, that the state was taken over, or that it is damaged.
        exactly: The states have to be equal to the last bit; else they are not compared.

    Returns:
        Whether the simulation goes on without a break, or from the state of the file, or cannot go on with it.
    """
    whole, name = file.follows(before), f"{file.path.name}: {SNAPSHOT_NAME}"
    try:
        full = read_full_state(BytesIO(file.snapshot() or b""), name)
        if not whole:
            simulation.restore(full)
    except SnapshotError as error:
        if not whole:
            result.restarts.append(
                f"{file.path.name}: left out, because the data before it is lost and "
                f"its own state cannot be used: {error}"
            )
            return Joint.LEFT_OUT
        if exactly:
            result.restarts.append(f"{error}; its state is not compared")
        return Joint.GOES_ON  # of another version, or damaged, and not needed
    if not whole:
        result.end = full.time
        result.restarts.append(
            f"{file.path.name}: data before {full.time:.2f} s is lost; the replay continues from the state "
            "at the start of this file"
        )
        return Joint.FROM_ITS_STATE
    if exactly:
        advance(full.time)
        result.samples[SNAPSHOT_NAME] += 1
        difference = next(_state_differences(full, simulation.capture()), None)
        if difference is not None:
            result.first = result.first or difference
            result.differing[SNAPSHOT_NAME] += 1
    return Joint.GOES_ON


def _state_differences(logged: FullState, replayed: FullState) -> Iterator[Difference]:
    """Bitwise differences of two full states."""
    for part in ("state", "start"):
        others = arrays_of(getattr(replayed, part))
        for name, array in arrays_of(getattr(logged, part)).items():
            other = others[name]
            if array.tobytes() != other.tobytes():
                same = np.array([a.tobytes() == b.tobytes() for a, b in zip(array.flat, other.flat, strict=True)])
                place = int(np.argmin(same))
                values = array.flat[place].item(), other.flat[place].item()
                yield Difference(logged.time, SNAPSHOT_NAME, f"{part}/{name}[{place}]", *values)
    if (logged.emergency_stopped, logged.commands) != (replayed.emergency_stopped, replayed.commands):
        yield Difference(logged.time, SNAPSHOT_NAME, "commands in force", logged.commands, replayed.commands)
