"""Equilibrium of the bare cable over its supports: an elastic catenary in each span (Irvine 1981).

Towers are taken as points without friction, so that the tension is the same on both sides of each, and as if they held
the cable down as well: a load that comes out negative is that of a tower which the cable does not touch.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import scipy  # loads `optimize` where it is used: a third of a second, not of each command

from cable_twin.basics.units import with_unit
from cable_twin.mechanics.parameters import Counterweights, FloatArray, System

ENDS = ("start", "end")
NEAR = 1e-4  # of its length, to which the rest in closed form is that of a cable over saddles and sheaves
CHANGES = np.geomspace(1e-4, 20.0, 18)  # of a length or a pull, which may let a rope touch a tower that it misses
UNKNOWN = 1e9  # N, load of a tower that is not found
ENOUGH = 1.02  # times the change with which it just does


class EquilibriumError(RuntimeError):
    """Failure to find a static equilibrium; the message states the last increment or the misfit."""


class Rest(NamedTuple):
    """Equilibrium of a bare cable, an elastic catenary in each span; span k is before tower k."""

    corner: FloatArray  # (spans + 1, dim) m: ends and towers
    basis: FloatArray  # (spans, 2, dim): unit vectors, level along each span and up
    pull: FloatArray  # (spans, 2) N at the start of each span: level, and upwards along the cable
    length: FloatArray  # (spans,) m, unstrained
    weight: float  # N/m
    stiffness: float  # EA, N
    free_stretch: float  # -, of the cable without tension

    def load(self) -> FloatArray:
        """Force (towers, dim) in N of each tower on the cable."""
        after = self.pull + np.stack([np.zeros_like(self.length), self.weight * self.length], axis=1)
        return _in_world(after[:-1], self.basis[:-1]) - _in_world(self.pull[1:], self.basis[1:])

    def place(self, arc_lengths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Positions (n, dim) in m and slopes r_x (n, dim) of the cable at arc lengths (n,) in m."""
        corner_at = np.concatenate([[0.0], np.cumsum(self.length)])
        span = np.clip(np.searchsorted(corner_at, arc_lengths, side="right") - 1, 0, self.length.size - 1)
        s = arc_lengths - corner_at[span]
        pull = self.pull[span]
        shape = elastic_catenary(pull, s, self.weight, self.stiffness, self.free_stretch)
        tension = pull + np.stack([np.zeros_like(s), self.weight * s], axis=-1)
        slopes = tension / self.stiffness
        slopes += self.free_stretch * tension / np.linalg.norm(tension, axis=-1, keepdims=True)
        basis = self.basis[span]
        return self.corner[span] + _in_world(shape, basis), _in_world(slopes, basis)


def _in_world(vectors: FloatArray, basis: FloatArray) -> FloatArray:
    """Convert vectors (n, 2), level and up, to axes of the world (n, dim), each from its own basis (n, 2, dim)."""
    return np.einsum("nb,nbd->nd", vectors, basis)


def elastic_catenary(
    pull: FloatArray, s: FloatArray, weight: float, stiffness: float, free_stretch: float
) -> FloatArray:
    """Position (n, 2), level and up in m, on elastic catenaries from the origin at arc lengths `s` (n,) in m.

    With tension (H, V + w s), r_x = (1/EA + f/T) (H, V + w s), integrated. `pull` (n, 2) is (H, V) in N, `weight` w in
    N/m, `stiffness` EA in N, `free_stretch` f the length without tension over the unstrained one.
    """
    level, rise = pull[..., 0], pull[..., 1]
    risen = rise + weight * s
    bent = level / weight * (np.arcsinh(risen / level) - np.arcsinh(rise / level))
    raised = (np.hypot(level, risen) - np.hypot(level, rise)) / weight
    along = level * s / stiffness + free_stretch * bent
    above = s * (rise + 0.5 * weight * s) / stiffness + free_stretch * raised
    return np.stack([along, above], axis=-1)


def _plane(whole: FloatArray, up: FloatArray) -> FloatArray:
    """Unit vectors (2, dim) along and up the plane of a cable whose end is `whole` (dim,) in m from its start."""
    level = whole - (whole @ up) * up
    width = float(np.linalg.norm(level))
    return np.stack([level / width if width > 0.0 else np.eye(up.size)[0], up])


def line_over(before: FloatArray, here: FloatArray, after: FloatArray) -> FloatArray:
    """Unit vector (dim,) of the line at a support: bisector of the directions from the previous and to the next one."""
    along = (here - before) / np.linalg.norm(here - before) + (after - here) / np.linalg.norm(after - here)
    return along / np.linalg.norm(along)


def _weighted_end(counterweights: Counterweights, basis: FloatArray) -> tuple[int, FloatArray, float]:
    """End (0, 1) with a counterweight, its direction (2,) and force (N); -1 and zeros without one."""
    weighted = np.flatnonzero(counterweights.mass > 0.0)
    if weighted.size == 0:
        return -1, np.zeros(2), 0.0
    end = int(weighted[0])
    return end, basis[-end] @ counterweights.direction[end], float(counterweights.force[end])


def _too_light(end: int, force: float, reach: str, weight: float) -> EquilibriumError:
    return EquilibriumError(
        f"cable.{ENDS[end]}.mass: given a counterweight of {with_unit(force, 'N', 6)}, with which no catenary {reach}: "
        f"it is too light to hold a cable of {with_unit(weight, 'N', 3)}; allowed: a heavier one"
    )


def rest_over_supports(system: System) -> Rest:
    """Solve for the equilibrium of the bare cable over its towers, with held ends or one counterweight.

    Unknown are pull and length of each span, and the travel of the counterweight; known are the corners, that the
    tension is the same on both sides of a tower, and the whole length.

    Raises:
        EquilibriumError: when there is none.
    """
    cable, counterweights = system.cable, system.counterweights
    gravity, strength = np.array(cable.gravity), float(np.linalg.norm(cable.gravity))
    corner = np.concatenate([cable.end_position[:1], system.towers.top, cable.end_position[1:]])
    up = -gravity / strength if strength > 0.0 else np.eye(gravity.size)[-1]
    basis = np.array([_plane(way, up) for way in np.diff(corner, axis=0)])
    stiffness, length, free = cable.axial_stiffness, cable.unstrained_length, cable.free_stretch
    # a cable without weight is taken as one of hardly any
    weight = max(cable.mass_per_length * strength, 1e-7 * stiffness / length if strength == 0.0 else 0.0)
    end, outwards, given = _weighted_end(counterweights, basis)

    def spans_at(travel: float) -> FloatArray:
        moved = corner.copy()
        if end >= 0:
            moved[-end] += travel * counterweights.direction[end]  # the first corner, or the last one
        return np.einsum("kd,kbd->kb", np.diff(moved, axis=0), basis)

    spans = spans_at(0.0)
    spans[:, 0] = np.maximum(spans[:, 0], 1e-3 * length / spans.shape[0])
    pulls, lengths = _first_guess(spans, weight / free, stiffness, length * free, given)
    scale, count = float(np.abs(pulls[0]).sum()), lengths.size

    def miss(unknown: FloatArray) -> FloatArray:
        pull, s = unknown[: 2 * count].reshape(count, 2) * scale, unknown[2 * count : 3 * count] * length
        travel = unknown[-1] * length if end >= 0 else 0.0
        goal = spans_at(travel)
        if end < 0:
            goal[:, 0] = spans[:, 0]
        after = pull + np.stack([np.zeros(count), weight * s], axis=1)
        gaps = (elastic_catenary(pull, s, weight, stiffness, free) - goal) / length
        tensions = (np.hypot(*after[:-1].T) - np.hypot(*pull[1:].T)) / scale
        result = [gaps.ravel(), tensions, [s.sum() / length - 1.0]]
        if end >= 0:
            held = after[-1] if end == 1 else -pull[0]
            result.append([(held @ outwards - given) / scale])
        return np.concatenate(result)

    first = np.concatenate([pulls.ravel() / scale, lengths / length, [0.0] if end >= 0 else []])
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        found = scipy.optimize.root(miss, first, method="hybr", tol=1e-12)
        missed = np.abs(miss(found.x)).max()
    pulls, lengths = found.x[: 2 * count].reshape(count, 2) * scale, found.x[2 * count : 3 * count] * length
    if not missed < 1e-6 or np.any(lengths <= 0.0) or np.any(pulls[:, 0] < 0.0):  # an arch in pressure is no rest
        across, height = _plane(corner[-1] - corner[0], up) @ (corner[-1] - corner[0])
        towers = {0: "", 1: " over a tower"}.get(count - 1, f" over {count - 1} towers")
        reach = f"of {length:g} m reaches over {across:g} m and up {height:g} m{towers}"
        if end < 0:
            misses = f"it misses by {with_unit(missed * length, 'm', 3)}"
            raise EquilibriumError(
                f"no catenary {reach}: {misses if not missed < 1e-6 else 'the one found would push, as an arch'}; "
                "allowed: another cable.unstrained_length, or other places of its supports"
            )
        raise _too_light(end, given, reach, weight * length)
    if end >= 0:
        corner[-end] += found.x[-1] * length * counterweights.direction[end]
    return Rest(corner, basis, pulls, lengths, weight, stiffness, free)


class Cure(NamedTuple):
    """Input quantity that sets the tension of a rope, to be changed until the rope touches a tower."""

    given: float
    text: str  # of what is allowed, with places for `bound` ("at most", "at least") and `value`
    unit: str
    at: Callable[[float], System]  # the same rope with another value, as its own ends and length then are

    def value(self, tower: int) -> str:
        """Text with the nearest value at which the rope touches a tower; empty if no value helps."""

        def load(change: float) -> float:
            try:
                system = self.at(changed(change))
                return float(rest_over_supports(system).load()[tower] @ _opening(system, tower))
            except EquilibriumError:
                return -UNKNOWN

        def changed(change: float) -> float:
            return self.given * (1.0 + change if change > 0.0 else 1.0 / (1.0 - change))

        before = 0.0
        for size in CHANGES:
            for change in (size, -size):
                if load(change) > 0.0:
                    just = float(scipy.optimize.brentq(load, np.copysign(before, change), change, rtol=1e-3))
                    bound = "at least" if change > 0.0 else "at most"
                    return self.text.format(bound=bound, value=with_unit(changed(ENOUGH * just), self.unit, 6))
            before = size
        return ""


def cure_of(system: System) -> Cure:
    """Quantity that sets the tension of a single rope: its counterweight, or else its length."""
    cable, counterweights = system.cable, system.counterweights
    for end in np.flatnonzero(counterweights.mass > 0.0):

        def pulled(force: float) -> System:
            return system._replace(counterweights=counterweights._replace(force=np.full(2, force)))

        return Cure(float(counterweights.force[end]), f"{{bound}} {{value}} of cable.{ENDS[end]}", "N", pulled)

    def cut(length: float) -> System:
        return system._replace(cable=cable._replace(unstrained_length=length))

    return Cure(cable.unstrained_length, "a cable.unstrained_length of {bound} {value}", "m", cut)


def check_rest(system: System, names: Sequence[str], *, loaded: bool, cure: Cure | None = None) -> None:
    """Refuse a bare cable at rest that misses a tower, or has a counterweight at a limit of its travel.

    Vehicles on a rope can only lift its counterweight: one at the upper limit of its travel may rest below it then.

    Args:
        system: parameters.
        names: of the towers.
        loaded: whether anything hangs on the cable when it is not bare.
        cure: quantity that sets its tension, where that is not its own end or length.

    Raises:
        EquilibriumError: naming the first one, how it misses and what is allowed.
    """
    towers, counterweights, cable = system.towers, system.counterweights, system.cable
    weighted = np.flatnonzero(counterweights.mass > 0.0)
    if towers.top.size == 0 and weighted.size == 0:
        return
    rest = rest_over_supports(system)
    for tower, (name, load) in enumerate(zip(names, rest.load(), strict=True)):
        side = _opening(system, tower)
        if load @ side <= 0.0:
            others = towers._replace(top=np.delete(towers.top, tower, axis=0))
            passing = rest_over_supports(system._replace(towers=others))
            places, _ = passing.place(np.linspace(0.0, cable.unstrained_length, 10_001))
            along, up = rest.basis[0]
            away = float(np.interp(towers.top[tower] @ along, places @ along, places @ up))
            away -= float(towers.top[tower] @ up)
            where, more = ("above", "higher") if away > 0.0 else ("below", "lower")
            helped = (cure or cure_of(system)).value(tower)
            raise EquilibriumError(
                f"towers.{name}.position: the bare cable at rest passes {with_unit(abs(away), 'm', 3)} {where} its "
                "top and would "
                f"have to be pulled there with {with_unit(abs(load @ side), 'N', 3)}; allowed: more than "
                f"{with_unit(abs(away), 'm', 3)} {more}, "
                f"hold_down the other way round{f', or {helped}' if helped else ''}"
            )
    for end in weighted:
        travel = float((rest.corner[-end] - cable.end_position[end]) @ counterweights.direction[end])
        low, high = counterweights.travel[end]
        if travel <= low - NEAR * cable.unstrained_length or (travel >= high and not loaded):
            raise EquilibriumError(beyond_travel(system, int(end), travel))


def beyond_travel(system: System, end: int, travel: float) -> str:
    """Error message for a counterweight at an end of the cable whose equilibrium `travel` (m) is beyond its limits."""
    low, high = system.counterweights.travel[end]
    short = travel <= low
    cause, way = (
        ("too light, or the cable too short", "longer") if short else ("too heavy, or the cable too long", "shorter")
    )
    return (
        f"cable.{ENDS[end]}.travel: the counterweight of {with_unit(system.counterweights.force[end], 'N', 6)} "
        "would rest at "
        f"{travel:.3f} m, it is {cause}; allowed: between {low:g} and {high:g} m, as with a cable that is about "
        f"{with_unit(max(low - travel, travel - high), 'm', 3)} {way}"
    )


def _opening(system: System, tower: int) -> FloatArray:
    """Mean of the contact normals (dim,) of a tower: the side on which the rope is."""
    first, end = system.towers.contact_offset[tower : tower + 2]
    mean: FloatArray = system.towers.normal[first:end].mean(axis=0)
    return mean


def _first_guess(
    spans: FloatArray, weight: float, stiffness: float, length: float, given: float
) -> tuple[FloatArray, FloatArray]:
    """Initial pulls (spans, 2) in N and lengths (spans,) in m for the solver; `given` is a counterweight force (N).

    One span that is slack: a parabola of the same sag (Jayaraman, Knudson 1981). Else a common tension T at which flat
    parabolas, stretched by T / EA, take up the whole length.
    """
    chords = np.hypot(spans[:, 0], spans[:, 1])
    cosines, sines = spans[:, 0] / chords, spans[:, 1] / chords
    if chords.size == 1 and given == 0.0:
        width, height = spans[0]
        slack = (length**2 - height**2) / width**2 - 1.0
        if slack > 0.0:
            sag = float(np.sqrt(3.0 * slack))
            pull = [0.5 * weight * width / sag, 0.5 * weight * (height / np.tanh(sag) - length)]
        else:
            tension = stiffness * (chords[0] / length - 1.0) + weight * length
            pull = [tension * cosines[0], tension * sines[0] - 0.5 * weight * length]
        return np.array([pull]), np.array([length])

    def taken(tension: float) -> FloatArray:
        return chords * (1.0 + (weight * chords * cosines / tension) ** 2 / 24.0) / (1.0 + tension / stiffness)

    tension = given
    if tension == 0.0:
        least, most = 1e-9 * stiffness, 10.0 * stiffness
        if taken(most).sum() > length:
            raise EquilibriumError(
                f"no tension up to {with_unit(most, 'N')}, ten times its axial stiffness, holds the rope of "
                f"{length:.6g} m on "
                f"its supports; its weight is {with_unit(weight * length, 'N')}; "
                "allowed: a longer, lighter or stiffer rope"
            )
        tension = scipy.optimize.brentq(lambda log: taken(np.exp(log)).sum() - length, np.log(least), np.log(most))
        tension = float(np.exp(tension))
    lengths = taken(tension)
    return np.stack([tension * cosines, tension * sines - 0.5 * weight * lengths], axis=1), lengths
