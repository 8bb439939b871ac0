"""Consistency checks of carriers that slide on track ropes beside the strands of their loop."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cable_twin.scenario.checks.fault import Fault, KeyPath, refuse, show
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.carriers import Carriers
from cable_twin.scenario.sections.quantities import in_space

FARTHEST = 5.0  # m, of the strand from the clamps of carriers at the ends of their track


def track_faults(scenario: Scenario, carriers: Carriers) -> Iterator[Fault]:
    """Faults of tracks: unknown ropes, missing for some strands, given twice, or away from their strand."""
    tracks, strands = carriers.tracks, scenario.strands
    if not tracks:
        if any(carriers.clamp_offset):
            yield Fault(("carriers", "clamp_offset"), "given without a track; allowed: beside `tracks`")
        if carriers.friction.rolling or carriers.friction.viscous:
            yield Fault(("carriers", "friction"), "given without a track; allowed: beside `tracks`")
        return
    beside: dict[str, str] = {}
    for strand, track in tracks.items():
        path: KeyPath = ("carriers", "tracks", strand)
        if strand not in strands:
            known = ", ".join(strands) or "none, there are no sheaves"
            yield Fault(path, f"given for {show(strand)}, which is no strand of a loop; allowed: {known}")
        elif track not in scenario.ropes or track in strands:
            known = ", ".join(name for name in scenario.ropes if name not in strands) or "none, all ropes are strands"
            yield refuse(path, track, f"a rope that is no strand, {known}")
        elif track in beside:
            yield refuse(path, track, "a track for each strand", detail=f", as for {beside[track]!r}")
        else:
            beside[track] = strand
            yield from _away(scenario, carriers, path, strand, track)
    bare = [name for name in strands if name not in tracks]
    if bare and tracks.keys() <= strands.keys():
        text = f"not given for {', '.join(bare)}; allowed: a track for each strand of the loop, or for none"
        yield Fault(("carriers", "tracks"), text)


def _away(scenario: Scenario, carriers: Carriers, path: KeyPath, strand: str, track: str) -> Iterator[Fault]:
    """Fault of a track that runs against its strand or too far beside it."""
    ropes = scenario.ropes
    start, end = (np.array(in_space(one.position)) for one in (ropes[strand].start, ropes[strand].end))
    ends = [np.array(in_space(one.position)) for one in (ropes[track].start, ropes[track].end)]
    if (ends[1] - ends[0]) @ (end - start) <= 0.0:
        yield refuse(path, track, "the same way", detail=f", which runs the other way than {strand!r}")
        return
    for which, place in zip(("start", "end"), ends, strict=True):
        clamp = place + np.array(in_space(carriers.clamp_offset))
        share = np.clip((clamp - start) @ (end - start) / ((end - start) @ (end - start)), 0.0, 1.0)
        apart = float(np.linalg.norm(start + share * (end - start) - clamp))
        if apart > FARTHEST:
            text = f"given {show(track)}, at whose {which} {strand!r} is {apart:.4g} m away from a clamp; allowed: "
            yield Fault(path, f"{text}up to {FARTHEST:g} m")
            return


__all__ = ["track_faults"]
