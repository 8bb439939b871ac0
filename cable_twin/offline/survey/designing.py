"""Design of a line in closed form: tension, unstrained length, rope, tower heights, each with its deciding reason."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import ceil, log10, sqrt
from typing import NamedTuple

import numpy as np
import scipy  # loads `optimize` where it is used

from cable_twin.basics.units import rounded, with_unit
from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey.lift import LEAST_BARE, MARGIN, choose_tension, tower_margin, tower_margins
from cable_twin.offline.survey.line_model import DesignError, LineModel
from cable_twin.offline.survey.marked import Change
from cable_twin.offline.survey.tramway import TRANSVERSE
from cable_twin.scenario.spans import SpanError

LARGEST = 3.0  # times the diameter of the rope, up to which a stronger one is looked for
SLACKEST, TAUTEST = 0.02, 0.95  # of the breaking force, tension between which that of a sag is looked for
STRONGEST = 0.01  # of EA, strength of a rope whose breaking force is not known
SAME = 1e-3  # relative change of a tension that is none
ALONG = np.radians(5.0)  # from the rope, up to which a counterweight is taken to pull along it
SURE = 0.02  # m and kN, by which conditions are kept, as heights are rounded to centimetres


class Designed(NamedTuple):
    """Result of the design of a line: changes of the scenario, with reasons.

    Attributes:
        changes: values by dotted key.
        lines: lines with values and deciding conditions.
    """

    changes: dict[str, Change]
    lines: list[str]


def design_tension(model: LineModel, factor: float | None = None) -> Designed:
    """Design the counterweight for the highest tension that rope and towers allow, and the unstrained length.

    Args:
        model: line with a counterweight.
        factor: safety factor of the rope; None: that of the scenario and 10 % more.

    Raises:
        DesignError: there is no counterweight, or no allowed tension.
    """
    if not model.mass_keys:
        raise DesignError("tension: given a rope without a counterweight; allowed: --for length --tension or --sag")
    factor = factor or model.factor * MARGIN
    strength = model.strength
    if not model.cabin:
        chosen = choose_tension(model.corner, model.rope, model.weights, model.towers, factor)
        return for_tension(model, chosen.tension, chosen.why)

    tension = most = strength / factor
    try:
        for _ in range(4):  # along the rope the tension changes by nearly the same, whatever it is
            tension += most - model.highest_tension(tension)
    except SpanError:
        raise DesignError(
            f"tension: given a safety factor of {factor:.3g}, which no tension keeps; allowed: a stronger rope"
        ) from None
    if tension < TRANSVERSE * model.cabin:
        raise DesignError(
            f"tension: given {with_unit(tension, 'N')} by a safety factor of {factor:.3g}, less than "
            f"{TRANSVERSE:g} times the full cabin, {with_unit(model.cabin, 'N')}; allowed: a stronger rope, or a "
            "lighter cabin"
        )
    return for_tension(model, tension, f"safety factor {factor:.3g} of {strength / 1e3:.0f} kN")


def design_length(model: LineModel, tension: float, why: str) -> Designed:
    """Design the length for a tension (N), with its reason `why`, as `for_tension` does.

    Raises:
        DesignError: the rope of a lift would lift off a tower.
    """
    if not model.cabin:
        loads = tower_margin(model.corner, tension, model.rope["axial_stiffness"], model.weights, model.towers)
        if loads.touches < -LEAST_BARE:
            raise DesignError(
                f"length: given {with_unit(tension, 'N')} in the rope by {why}, with which it lifts off {loads.name} "
                f"with {with_unit(-loads.touches - LEAST_BARE, 'N')}; allowed: less tension, or other heights "
                "(--for towers)"
            )
    return for_tension(model, tension, why)


def for_tension(model: LineModel, tension: float, why: str) -> Designed:
    """Design counterweight and unstrained lengths for a tension (N) at the tensioned end, with its reason `why`."""
    scenario, changes, lines = model.scenario, {}, []
    if model.mass_keys:
        mass = model.pull(tension) / scenario.gravity
        mass = _rounded_within(mass, SAME * mass, -1)
        tension = model.tension_of(mass * scenario.gravity)
        if abs(tension / model.tension() - 1.0) > SAME:
            decided = Change(mass, f"kg, design: {with_unit(tension, 'N')} in the rope: {why}")
            changes.update(dict.fromkeys(model.mass_keys, decided))
        lines.append(
            f"{', '.join(model.mass_keys)}: {rounded(mass, 7)} kg, {with_unit(tension, 'N')} in the rope: {why}"
        )
    length = model.lengths(tension)
    shorter = length if model.mass_keys else length - model.lengths((1.0 + SAME) * tension)
    length = _rounded_within(length, shorter, 2)
    middle = "the counterweight is then near the middle of its travel"
    rope = "bare rope" if model.cabin else "rope"
    reason = middle if model.mass_keys else f"for {with_unit(tension, 'N')} in the {rope}: {why}"
    for key in model.rope_keys:
        changes[f"{key}.unstrained_length"] = Change(length, f"m, design: {reason}")
    lines.append(f"{', '.join(model.rope_keys)}: unstrained_length {length} m: {reason}")
    if model.cabin and not model.mass_keys:
        highest = model.highest_tension(tension)
        has = f", a safety factor of {model.strength / highest:.3f}" if "breaking_force" in model.rope else ""
        lines.append(f"{', '.join(model.rope_keys)}: up to {with_unit(highest, 'N')} with the full vehicle{has}")
    return Designed(changes, lines)


def _rounded_within(value: float, change: float, decimals: int) -> float:
    """Round a value to a number of decimals, or to as many more as alter it by at most half of `change`, above 0."""
    return float(round(value, max(decimals, ceil(-log10(change)))))


def design_sag(model: LineModel, span: int, sag: float) -> Designed:
    """Design counterweight and unstrained lengths for a sag of the rope below the chord of a span.

    The sag is that with full vehicles on a lift, and that of the bare rope on a track rope.

    Args:
        model: the line.
        span: number of the span, from 1 at the start of the first rope in the file.
        sag: m.

    Raises:
        DesignError: there is no such span, or no tension with this sag.
    """
    count = model.corner.shape[0] - 1
    if not 1 <= span <= count:
        raise DesignError(f"--sag: given span {span}; allowed: 1 to {count}")
    row = span - 1 if model.forward else count - span
    which = 2 if model.cabin else 0
    strength = model.rope.get("breaking_force", STRONGEST * model.rope["axial_stiffness"])

    def miss(tension: float) -> float:
        return float(model.spans(tension, which).sags()[row]) - sag

    try:
        tension = float(scipy.optimize.brentq(miss, _carrying(model, strength), TAUTEST * strength, rtol=1e-9))
    except (ValueError, SpanError):
        taut = with_unit(float(model.spans(TAUTEST * strength, which).sags()[row]), "m", 3)
        raise DesignError(
            f"--sag: given {sag:g} m in span {span}; allowed: above {taut}, which the rope has near its breaking "
            "force, and below that of a slack rope"
        ) from None
    return design_length(model, tension, f"a sag of {sag:g} m in span {span}")


def _carrying(model: LineModel, strength: float) -> float:
    """Lowest tension (N) at which a rope of given strength (N) can hang in all spans of a line, in closed form."""
    for share in np.geomspace(SLACKEST, TAUTEST, 40):
        try:
            model.spans(share * strength, 0)
        except SpanError:
            continue
        return float(share * strength)
    raise DesignError(
        f"rope: given a breaking force of {with_unit(strength, 'N', 3)}, at which it cannot hang in its spans; "
        "allowed: a rope that is stronger for its weight"
    )


def design_rope(model: LineModel, factor: float | None = None) -> Designed:
    """Design the thinnest rope of equal construction, in whole millimetres, that keeps the required safety factor.

    The counterweight stays, or without one the tension of the bare rope; steel, weight, stiffness and strength go with
    the square of the diameter, the bending stiffness with its fourth power.

    Args:
        model: the line.
        factor: safety factor; None: that of the scenario.

    Raises:
        DesignError: the diameter is not given, or no diameter is enough.
    """
    diameter = model.rope.get("diameter")
    if diameter is None:
        raise DesignError("diameter: given none; allowed: that of the rope, in m, from which others are scaled")
    factor, tension = factor or model.factor, model.tension()
    least = 1e3 * diameter * max(1.0 / LARGEST, sqrt(factor * tension / model.strength))  # of the tensioned end alone
    millimetres, most = max(8, ceil(least)), ceil(1e3 * diameter * LARGEST)
    while millimetres <= most:
        other = model.with_rope(_scaled(model.rope, 1e-3 * millimetres / diameter))
        pulled = other.tension() if model.mass_keys else tension
        try:
            has = other.strength / other.highest_tension(pulled)
        except SpanError:
            millimetres += 1
            continue
        if has >= factor:
            break
        # strength goes with the square of the diameter, and a thicker rope is not less taut
        millimetres = max(millimetres + 1, ceil(millimetres * sqrt(factor / has)))
    else:
        raise DesignError(
            f"rope: given a safety factor of {factor:g}, which no diameter up to {LARGEST * diameter * 1e3:.0f} mm "
            "keeps; allowed: a smaller factor"
        )
    construction = f"assumed: construction of the rope of {1e3 * diameter:.3g} mm, scaled"
    why = f"{millimetres} mm, design: smallest in mm with a safety factor of {factor:g}, it has {has:.3f}"
    if abs(1e-3 * millimetres - diameter) < 1e-6:
        return Designed({}, [f"{', '.join(model.rope_keys)}: {why}: as it is"])
    changes = {
        f"{key}.{name}": Change(float(f"{value:.6g}"), why if name == "diameter" else construction)
        for key in model.rope_keys
        for name, value in other.rope.items()
    }
    found = for_tension(other, pulled, "as before")
    lines = [f"{', '.join(model.rope_keys)}: {why}; {construction}", *found.lines]
    for name, wheel in model.scenario.sheaves.items():
        if any(f"ropes.{rope}" in model.rope_keys for rope in wheel.ropes):
            now, before = (rounded(2.0 * wheel.radius / one, 3) for one in (1e-3 * millimetres, diameter))
            lines.append(f"sheaves.{name}: diameter over that of the rope {now}, {before} before; radius as it is")
    return Designed(changes | found.changes, lines)


def _scaled(rope: dict[str, float], ratio: float) -> dict[str, float]:
    powers = {"diameter": 1, "bending_stiffness": 4}
    return {key: value * ratio ** powers.get(key, 2) for key, value in rope.items()}


class Conditions(NamedTuple):
    """Conditions on tower heights in a design: names and units, and a function from heights to margins, at least 0."""

    names: list[str]
    units: list[str]
    margins: Callable[[FloatArray], FloatArray]


def design_towers(model: LineModel, lower: float, raise_: float) -> Designed:
    """Design the heights of the rope on the towers: the smallest changes that keep minimum tower loads and clearance.

    The sum of squares of the changes is minimised (SLSQP), the tension stays.

    Args:
        model: the line.
        lower: m, by which a tower may become lower at most.
        raise_: m, by which a tower may become higher at most.

    Raises:
        DesignError: there are no towers, or no such heights within these bounds.
    """
    if not model.towers.names:
        raise DesignError("towers: given none; allowed: a line with towers")
    tension = model.tension()
    before = model.corner[1:-1, 1]
    conditions = _conditions(model, tension)

    def margins(moved: FloatArray) -> FloatArray:
        return conditions.margins(before + moved) - SURE

    bounds = [(-lower, raise_)] * before.size
    constraint = {"type": "ineq", "fun": margins}
    found = scipy.optimize.minimize(
        lambda moved: float(moved @ moved),
        np.zeros(before.size),
        jac=lambda moved: 2.0 * moved,
        bounds=bounds,
        constraints=[constraint],
        method="SLSQP",
        options={"maxiter": 200, "ftol": 1e-9},
    )
    moved = np.round(found.x, 2)
    kept = conditions.margins(before + moved)
    if kept.min() < -1e-6:
        worst = int(kept.argmin())
        raise DesignError(
            f"towers: found no heights from {-lower:g} to {raise_:g} m that keep all conditions, "
            f"{conditions.names[worst]} is missed by {-kept[worst]:.3g} {conditions.units[worst]}; "
            "allowed: wider bounds (--lower, --raise), another tension, or more towers"
        )
    designed = _heights(model, tension, before, moved, conditions)
    if not found.success:
        designed.lines.append(f"towers: changes may not be the least, the search ended with: {found.message}")
    return designed


def _conditions(model: LineModel, tension: float) -> Conditions:
    """Conditions on tower heights of a line: margins of tower loads (kN), and of clearance in each span (m)."""
    ends = ["the tensioned end", *model.towers.names, "the other end"]
    names = [f"rope on {name}" for name in model.towers.names]
    if not model.cabin:
        names += [f"least load of the sheaves of {name}" for name in model.towers.names]
    units = ["kN"] * len(names)
    asked = np.zeros(len(ends) - 1, dtype=bool)
    if model.terrain.size > 0:  # not of a span within a station
        asked[:] = np.isfinite(model.heights(tension)).any(axis=1)
    names += [f"clearance from {low} to {high}" for (low, high), one in zip(pairwise(ends), asked, strict=True) if one]
    units += ["m"] * int(asked.sum())

    def margins(heights: FloatArray) -> FloatArray:
        there = model.with_heights(heights)
        if model.cabin:
            bare = -there.spans(tension, 2).loads()[:, 1]
            parts = [1e-3 * (bare - LEAST_BARE)]
        else:
            loads = tower_margins(there.corner, tension, model.rope["axial_stiffness"], model.weights, model.towers)
            parts = [1e-3 * one for one in loads]
        if asked.any():
            parts.append(there.heights(tension)[asked].min(axis=1) - model.clearance)
        return np.concatenate(parts)

    return Conditions(names, units, margins)


def _heights(
    model: LineModel, tension: float, before: FloatArray, moved: FloatArray, conditions: Conditions
) -> Designed:
    """Design with changed tower heights, each with the condition that fails first without the change."""
    changes: dict[str, Change] = {}
    lines = []
    kept = conditions.margins(before + moved)
    for row, (name, way) in enumerate(zip(model.towers.names, moved, strict=True)):
        if way == 0.0:
            continue
        without = moved.copy()
        without[row] = 0.0
        lost = conditions.margins(before + without)
        worst = int(np.where(kept < 10.0, lost, np.inf).argmin())
        why = f"{'raised' if way > 0.0 else 'lowered'} by {abs(way):.2f} m for {conditions.names[worst]}"
        height = round(float(before[row] + way), 2)
        for own, above in model.supports[row] if model.supports else ((name, 0.0),):
            changes[f"towers.{own}.position.z"] = Change(round(height + above, 2), f"design: {why}")
        lines.append(f"towers.{name}.position: z = {height:g} m, {why}")
    if not changes:
        return Designed({}, ["towers: all conditions are kept as they are"])
    after = model.with_heights(before + moved)
    if moved[0] != 0.0 and model.mass_keys:
        after, turned = _turned(model, after, tension)
        changes |= turned.changes
        lines += turned.lines
    found = for_tension(after, tension, "as before")
    return Designed(changes | found.changes, lines + found.lines)


def _turned(before: LineModel, after: LineModel, tension: float) -> tuple[LineModel, Designed]:
    """Line with other heights of towers, whose counterweight pulls along the rope if it did before, and the changes.

    A counterweight that did not, as of a wheel on level rails, keeps its direction.

    Args:
        before: the line as it was.
        after: with other heights.
        tension: N, at the tensioned end.
    """
    keys = ", ".join(before.directions())
    if not before.follows(tension, ALONG):
        return after, Designed({}, [f"{keys}: stays, as it was not along the rope before"])
    after = after.along_rope(tension)
    found = after.directions()
    why = f"along the rope to {after.towers.names[0]}"
    values = ", ".join(f"{one:g}" for one in next(iter(found.values())))
    changes = {key: Change(value, f"-, design: {why}") for key, value in found.items()}
    return after, Designed(changes, [f"{keys}: [{values}], {why}"])
