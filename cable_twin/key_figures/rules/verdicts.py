"""Verdicts of rule profiles on the key figures of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import hypot, inf
from typing import Any

from cable_twin.basics.units import rounded
from cable_twin.key_figures.figure import TOLERANCE, KeyFigure
from cable_twin.key_figures.rules.conditions import NUMBERS, brakes_of, facts_of, holds, subject_facts, system_of
from cable_twin.key_figures.rules.derived import derived_figures
from cable_twin.key_figures.rules.document import UNITS, Check, Compared, Profile, profiles_of
from cable_twin.key_figures.rules.expressions import FormulaError, MissingError, value_of
from cable_twin.key_figures.rules.subjects import Subjects
from cable_twin.scenario import Scenario

KEPT, NOT_KEPT, NOT_DECIDED = "kept", "not kept", "not decided"
WAIVABLE, OUTSIDE = "authority may allow", "does not apply"
BROKEN = (NOT_KEPT, WAIVABLE)
ALMOST = 0.99  # of the wind pressure of a load case, as speeds of wind are given in round numbers
LONG = 100.0  # m, chord above which a span is long
STATES = (NOT_KEPT, WAIVABLE, NOT_DECIDED, KEPT, OUTSIDE)  # the worst first
OF_SEVERAL = {OUTSIDE: "do not apply"}  # words that differ for several checks
# what a run needs for figures that not every one has
NEEDS = {
    "stopping_distance": "a stop in the run",
    "stopping_time": "a stop in the run",
    "mean_deceleration": "a stop in the run",
    "rope_safety_factor": "breaking_force of the rope",
    "tested_safety_factor": "breaking_force or tested_breaking_force of the rope",
    "calculated_safety_factor": "calculated_breaking_force of the rope",
    "vehicle_clearance": "terrain",
    "rope_clearance": "terrain",
    "moving_clearance": "terrain",
    "wind_pressure": "space: 3, and wind",
    "restart_delay": "a restart after a stop in the run",
    "tower_clearance": "space: 3, and towers with mast_offset and mast_width",
    "vehicle_separation": "space: 3, and vehicles on different ropes that come near each other",
    "lateral_swing_tangent": "space: 3",
    "lateral_ratio": "space: 3",
    "roller_pressure": "cable.metal_area",
    "wheel_pressure": "cable.metal_area and limits.installation.wheels",
    "wheel_load_ratio": "limits.installation.wheels",
    "radius_ratio": "cable.diameter, and radius of a saddle",
    "saddle_acceleration": "radius of a saddle, and a speed",
    "diameter_ratio": "cable.diameter",
    "wire_ratio": "cable.largest_wire",
    "brake_hold": "track_rope_brake",
    "grip_slip_safety": "clamps on a haul rope, and limits.installation.grip_force",
    "mass_per_person": "payload, and limits.installation.persons",
    "boarding_speed": "payload of a carriage",
}
# figures whose subjects all have one once the scenario has the data: what has none has not been judged
OF_DATA = (
    *("rope_safety_factor", "tested_safety_factor", "calculated_safety_factor", "diameter_ratio", "wire_ratio"),
    *("radius_ratio", "saddle_acceleration", "roller_pressure"),
)
# what the haul rope in the drive of a carriage lacks of subjects with a role
LACKS = {
    "bullwheels": "bullwheels",
    "drive_bullwheels": "bullwheels",
    "sheave_towers": "sheaves",
}


def counts_text(states: Iterable[str], say: Callable[[str], str] = str) -> str:
    """Text with the number of rule checks in each state, the worst first; `say` translates the states."""
    counts = Counter(states)
    order = [one for one in (*STATES, *counts) if counts[one]]
    return ", ".join(
        f"{counts[one]} {say(OF_SEVERAL.get(one, one) if counts[one] > 1 else one)}" for one in dict.fromkeys(order)
    )


@dataclass(frozen=True, slots=True)
class RuleVerdict:
    """Verdict of one check of a rule profile on a run.

    Attributes:
        profile: name of the profile.
        check: id of the check in it.
        document: title of the document, with edition.
        edition: edition of the document.
        clause: clause of the document.
        text: the rule in words.
        state: one of `STATES`.
        reason: why it is not decided or does not apply, what may be allowed, or doubts; may be empty.
        quantity: compared figure as quantity/role/statistic.
        figure: figure that is judged, the worst of several; None without one.
        comparison: side of the limits that is allowed; empty without limits.
        limits: limit, or least and most, in the unit of the rule; empty where not known.
        unit: unit of the rule.
        scale: SI units in a unit of the rule.
    """

    profile: str
    check: str
    document: str
    edition: str
    clause: str
    text: str
    state: str
    reason: str = ""
    quantity: str = ""
    figure: KeyFigure | None = None
    comparison: str = ""
    limits: tuple[float, ...] = ()
    unit: str = ""
    scale: float = 1.0

    @property
    def value(self) -> float | None:
        """Value of the figure in the unit of the rule; None without one."""
        return None if self.figure is None else self.figure.value / self.scale


def judge(
    scenario: Scenario,
    figures: Sequence[KeyFigure],
    profiles: Sequence[Profile] | None = None,
    *,
    at_rest: bool = False,
) -> list[RuleVerdict]:
    """Verdicts of rule profiles on the key figures of a run, one for each check that a figure can decide.

    Args:
        scenario: scenario of the run.
        figures: key figures of the run.
        profiles: profiles; None for those that the scenario names.
        at_rest: whether the figures are of a line at rest, without dynamic parts.

    Raises:
        RuleError: a profile is invalid; one line each.
    """
    return Judge(scenario, profiles_of(scenario) if profiles is None else profiles, at_rest=at_rest).verdicts(figures)


class Judge:
    """Evaluator of rule profiles on the key figures of a scenario; constants of a run are found once.

    Args:
        scenario: scenario of the run.
        profiles: rule profiles.
        at_rest: whether the figures are of a line at rest, without dynamic parts.
    """

    def __init__(self, scenario: Scenario, profiles: Sequence[Profile], *, at_rest: bool = False) -> None:
        self._scenario, self._profiles, self._at_rest = scenario, profiles, at_rest
        if profiles:
            self._subjects, self._system = Subjects(scenario), system_of(scenario)
            self._facts = facts_of(scenario, self._subjects)
            self._figures: list[KeyFigure] = []

    def verdicts(self, figures: Sequence[KeyFigure]) -> list[RuleVerdict]:
        """Verdicts on the key figures of a run up to the present time, one for each check that a figure decides."""
        if not self._profiles:
            return []
        self._figures = [*figures, *derived_figures(self._scenario, figures, self._subjects)]
        self._facts["sag"] = self._largest_sag(figures)
        return [
            self._verdict(profile, name, check)
            for profile in self._profiles
            for name, check in profile.document.checks.items()
            if check.quantity is not None
        ]

    def _largest_sag(self, figures: Sequence[KeyFigure]) -> float | None:
        """Largest sag (m) of long spans; 0 without one, None without any figure of a sag."""
        sags = {one.id.subject: one.value for one in figures if one.id.quantity == "sag"}
        long = [
            sags.get(f"ropes.{rope}.{'+'.join(ends)}", 0.0)
            for rope, supports in self._subjects.supports.items()
            for ends, chord in zip(pairwise(supports), self._subjects.chords[rope], strict=True)
            if hypot(*chord) > LONG
        ]
        return max(long, default=0.0) if sags else None

    def _verdict(self, profile: Profile, name: str, check: Check) -> RuleVerdict:
        """Verdict of one check of a rule profile that compares a key figure."""
        base = _Base(profile, name, check)
        if self._system not in profile.systems_of(check):
            return base.outside(f"it is for {' and '.join(profile.systems_of(check))}, this is {self._system}")
        try:
            if not holds(check.when, self._facts):
                return base.outside(f"it is for {words(check.when)}")
        except MissingError as missing:
            return base.open(_not_stated(str(missing)))
        case, stated = check.load_case, self._scenario.limits.load_cases
        if case is None and stated:
            return base.open(f"this run is {' and '.join(stated)} alone, a load case of certain rules")
        if case is not None and f"{profile.name}.{case}" not in self._scenario.limits.load_cases:
            return base.open(f"load case {profile.name}.{case} is not this run: {profile.document.load_cases[case]}")
        needed, blows = profile.document.wind_pressures.get(case or "", 0.0), self._wind_pressure()
        if ALMOST * needed > blows:
            return base.open(f"load case {profile.name}.{case} has a wind of {needed:g} Pa, this run of {blows:.3g} Pa")
        quantity, compared, found = check.quantity or "", check.compared, self._matching(check.quantity or "")
        at_rest = check.compared_at_rest if self._at_rest else None
        if not found and check.substitute is not None:
            quantity, compared, found = check.substitute, check.substitute_compared, self._matching(check.substitute)
            bounds = {compared, at_rest or "equal"}
        else:
            bounds = {at_rest or compared}
        if not found:
            return base.open(self._why_none(check.quantity or ""))
        if check.each_brake:
            return self._of_brakes(base, quantity, bounds, found)
        worst = min((self._of_figure(base, quantity, bounds, one) for one in found), key=severity)
        if worst.state == KEPT and (lacking := self._without(quantity, found)):
            name = quantity.partition("/")[0]
            return base.open(f"{' and '.join(lacking)} without figure {name}, which needs {NEEDS[name]}")
        return worst

    def _of_brakes(self, base: _Base, quantity: str, bounds: set[Compared], found: Iterable[KeyFigure]) -> RuleVerdict:
        """Verdict on the stops of a run by a rule for each brake alone: a run is made with one set of brakes."""
        verdicts = []
        for one in found:
            verdict, (brakes, acting) = self._of_figure(base, quantity, bounds, one), brakes_of(self._scenario, one)
            others = [brake for brake in brakes if brake not in acting]
            if len(acting) != 1 or acting[0] not in brakes:
                by = " and ".join(acting or ["the motor"])
                verdict = replace(verdict, state=NOT_DECIDED, reason=f"a stop by {by} tells nothing of a brake alone")
            elif others and verdict.state == KEPT:
                verdict = replace(verdict, state=NOT_DECIDED, reason=f"not tried alone: {', '.join(others)}")
            verdicts.append(verdict)
        return min(verdicts, key=severity)

    def _without(self, quantity: str, found: Iterable[KeyFigure]) -> list[str]:
        """Ropes, towers and bullwheels of a rule's role whose data do not give its figure, `found` of others."""
        name, role, _ = quantity.split("/")
        if name not in OF_DATA:
            return []
        having = {one.id.subject for one in found}
        subjects = (
            *(f"ropes.{rope}" for rope in self._scenario.cables),
            *(self._scenario.haul_rope_key(name) for name in self._scenario.haul_ropes),
            *(f"towers.{tower}" for tower in self._scenario.towers),
            *(f"sheaves.{wheel}" for wheel in self._scenario.sheaves),
        )
        return [one for one in subjects if self._subjects.has(role, one) and one not in having]

    def _wind_pressure(self) -> float:
        """Highest pressure (Pa) of the wind of a run, or of that of its scenario in a plane: ½ ρ v²."""
        air = self._scenario.air
        own = 0.5 * air.density * sum(one * one for one in air.wind)
        return max((one.value for one in self._figures if one.id.quantity == "wind_pressure"), default=own)

    def _why_none(self, quantity: str) -> str:
        """Reason why a run has no figure of a rule's quantity/role/statistic."""
        name, role, _ = quantity.split("/")
        hauled = self._scenario.haul_ropes
        there = any(self._subjects.has(role, one.id.subject) for one in self._figures)
        if not there and not (hauled and role in ("haul_ropes", "moving_ropes")):
            if hauled and role in LACKS:
                return f"the haul rope of {' and '.join(hauled)} is a part of the drive, without {LACKS[role]}"
            return f"the scenario has no {role.replace('_', ' ')}"
        needs = NEEDS.get(name, "")
        return f"the run has no figure {name}" + (f", which needs {needs}" if needs else "")

    def _matching(self, quantity: str) -> list[KeyFigure]:
        name, role, statistic = quantity.split("/")
        every = (
            ("mean", "highest", "lowest") if name == "mean_deceleration" else (statistic,)
        )  # of each of several stops
        wanted = [one for one in self._figures if one.id.quantity == name and one.id.statistic in every]
        if (name, role) == ("speed", "drives"):  # of a carriage on a haul rope that of the rope: the cabin bobs on it
            driven = [one for one in self._figures if one.id.quantity == "drive_speed"]
            hauled = {one.id.subject for one in driven}
            wanted = driven + [one for one in wanted if one.id.subject not in hauled]
        return [one for one in wanted if self._subjects.has(role, one.id.subject)]

    def _of_figure(self, base: _Base, quantity: str, bounds: set[Compared], figure: KeyFigure) -> RuleVerdict:
        check, facts = base.check, self._facts | subject_facts(self._scenario, figure.id.subject)
        if self._at_rest:
            figure = with_place(figure)
        numbers = {name: value for name, value in facts.items() if isinstance(value, int | float)}
        base = base.with_figure(quantity, figure)
        try:
            given = case_of(check.limit, facts)
            if given is None:
                return base.outside("none of its cases is this ropeway")
            both = given if isinstance(given, list) else [given]
            limits = tuple(value_of(one, numbers) for one in both)
            allowance = 0.0 if check.allowance is None else value_of(check.allowance, numbers)
        except MissingError as missing:
            return base.open(_not_stated(str(missing)))
        except FormulaError as error:
            return base.open(f"limit {error}")
        base = base.with_limits(limits)
        off = (figure.uncertainty or 0.0) / base.scale
        value = figure.value / base.scale
        least = -inf if "at least" in bounds else value - off
        most = inf if "at most" in bounds or figure.unfinished else value + off
        kept = {_keeps(check.comparison or "", limits, end, allowance) for end in (least, most)}
        if kept == {True}:
            return base.made(KEPT, check.doubt)
        if _never_kept(check.comparison or "", limits, least, most):
            state = WAIVABLE if check.waiver else NOT_KEPT
            return base.made(state, "; ".join(filter(None, (check.waiver, check.doubt))))
        if figure.unfinished:
            return base.open("the figure is that so far, of what is not over")
        if figure.uncertainty and least < value < most:
            return base.open(f"within the uncertainty of {off:.2g} {base.check.unit}")
        if check.allowance is not None:
            return base.open(f"within the allowance of {allowance:.3g} {check.unit}; {check.definition}".rstrip("; "))
        by_itself = _keeps(check.comparison or "", limits, value, allowance)
        ends: dict[Compared, float] = {"at least": least, "at most": most}
        sides = [one for one in ends if one in bounds]
        open_to = [one for one in sides if _keeps(check.comparison or "", limits, ends[one], allowance) != by_itself]
        side = (open_to or sides)[0]
        if self._at_rest and check.compared_at_rest == side:
            return base.open(f"at rest the figure is {side} what it is in motion, which the rule compares")
        return base.open(f"the figure is {side} what the rule compares: {check.definition or check.text}")


@dataclass(frozen=True, slots=True)
class _Base:
    """Rule verdict in preparation: check, compared figure and limits."""

    profile: Profile
    name: str
    check: Check
    quantity: str = ""
    figure: KeyFigure | None = None
    limits: tuple[float, ...] = ()

    @property
    def scale(self) -> float:
        """Factor that converts the unit of the rule to SI units."""
        return UNITS.get(self.check.unit or "", ("", 1.0))[1]

    def with_figure(self, quantity: str, figure: KeyFigure) -> _Base:
        """Copy of the verdict in preparation with the judged figure."""
        return _Base(self.profile, self.name, self.check, quantity, figure)

    def with_limits(self, limits: tuple[float, ...]) -> _Base:
        """Copy of the verdict in preparation with the limits in the unit of the rule."""
        return _Base(self.profile, self.name, self.check, self.quantity, self.figure, limits)

    def made(self, state: str, reason: str) -> RuleVerdict:
        """Rule verdict with a state and its reason."""
        document, check = self.profile.document, self.check
        return RuleVerdict(
            profile=self.profile.name,
            check=self.name,
            document=document.document,
            edition=document.edition,
            clause=check.clause,
            text=check.text,
            state=state,
            reason=reason,
            quantity=self.quantity or check.quantity or "",
            figure=self.figure,
            comparison=check.comparison or "",
            limits=self.limits,
            unit=check.unit or "",
            scale=self.scale,
        )

    def open(self, reason: str) -> RuleVerdict:
        """Rule verdict `not decided`, with its reason."""
        return self.made(NOT_DECIDED, reason)

    def outside(self, reason: str) -> RuleVerdict:
        """Rule verdict `does not apply`, with its reason."""
        return self.made(OUTSIDE, reason)


def words(when: Mapping[str, Any]) -> str:
    """Condition of a rule in words."""
    return " and ".join(f"{name} {_value_words(value)}" for name, value in when.items())


def _value_words(value: Any) -> str:
    if isinstance(value, list):
        return " or ".join(map(str, value))
    return ("yes" if value else "no") if isinstance(value, bool) else str(value)


def _not_stated(fact: str) -> str:
    if fact in ("rated_speed",):
        return "the drive has no limit of its speed, limits.speed"
    if fact == "sag" or (fact not in NUMBERS and fact in ("span", "friction", "wrap", "derailment_ratio")):
        return f"this run has no {fact}"
    return f"limits.installation.{fact} is not stated"


def case_of(limit: Any, facts: Mapping[str, Any]) -> Any:
    """Limit of a rule; of a rule with several cases, the limit of the first case that holds, None where none holds."""
    if not (isinstance(limit, list) and limit and isinstance(limit[0], Mapping)):
        return limit
    return next((one["limit"] for one in limit if holds(one["when"], facts)), None)


def _keeps(comparison: str, limits: tuple[float, ...], value: float, allowance: float) -> bool:
    """Whether a value complies with a rule's limits by at least the allowance, but for rounding."""
    low, high = limits[0], limits[-1]
    if comparison == "above":
        return value > low + allowance
    if comparison == "below":
        return value < high - allowance
    up = value <= high + TOLERANCE * abs(high) - allowance
    down = value >= low - TOLERANCE * abs(low) + allowance
    return {"at most": up, "at least": down, "within": up and down}[comparison]


def _never_kept(comparison: str, limits: tuple[float, ...], least: float, most: float) -> bool:
    """Whether no value from `least` to `most` complies with a rule's limits, without any allowance."""
    low, high = limits[0], limits[-1]
    if comparison in ("at least", "above"):
        return not _keeps(comparison, limits, most, 0.0)
    if comparison in ("at most", "below"):
        return not _keeps(comparison, limits, least, 0.0)
    return not (_keeps("at least", (low,), most, 0.0) and _keeps("at most", (high,), least, 0.0))


def severity(verdict: RuleVerdict) -> tuple[int, float]:
    """Key that sorts verdicts by severity: the worst state first, in it the value that is farthest beyond its limit."""
    return STATES.index(verdict.state), _margin(verdict)


def with_place(figure: KeyFigure) -> KeyFigure:
    """Key figure of a load case with the place of its vehicle, which it has for a time, in the text of the place.

    Args:
        figure: key figure of a line at rest or of a case of an envelope.
    """
    at = f"vehicle at {figure.time:.2f} m" if figure.time else ""
    return replace(figure, time=0.0, place=", ".join(filter(None, (at, figure.place))))


def _margin(verdict: RuleVerdict) -> float:
    """Relative distance of a verdict's value from its limit, negative on the side that is not allowed."""
    value = verdict.value
    if value is None or not verdict.limits:
        return inf
    least, most = verdict.limits[0], verdict.limits[-1]
    below, above = (value - least) / max(abs(least), 1e-9), (most - value) / max(abs(most), 1e-9)
    if verdict.comparison in ("at least", "above"):
        return below
    return above if verdict.comparison in ("at most", "below") else min(below, above)


def sentence(one: RuleVerdict) -> str:
    """Rule verdict in one line: check, state, value, limit, unit, place, document, edition and clause."""
    edition = "" if one.edition in one.document else f", {one.edition}"
    reason = f"; {one.reason}" if one.reason else ""
    figure = f"{one.figure.name}: " if one.figure is not None else ""
    said = f"{value_text(one)}, {limit_text(one)}".strip(", ")
    place = ", ".join(filter(None, (_when(one), one.figure.place if one.figure is not None else "")))
    return (
        f"{one.check} {one.state}: {figure}{said}, {place} ({one.document}{edition}, {one.clause}: {one.text}){reason}"
    )


def _when(one: RuleVerdict) -> str:
    return f"at {one.figure.time:.2f} s" if one.figure is not None and one.figure.time else ""


def value_text(one: RuleVerdict) -> str:
    """Value of a rule verdict's figure with the unit of the rule; empty without a figure."""
    return "" if one.value is None else f"{_tidy(one.value)}{_unit(one)}"


def limit_text(one: RuleVerdict) -> str:
    """Limit of a rule verdict with its unit, as `at most 2.5 m/s`; empty where not known."""
    if not one.limits:
        return ""
    numbers = " to ".join(rounded(limit) for limit in one.limits)
    return f"{one.comparison} {numbers}{_unit(one)}"


def _tidy(value: float) -> str:
    return "0" if abs(value) < 1e-9 else rounded(value)


def _unit(one: RuleVerdict) -> str:
    return "" if one.unit == "-" else f" {one.unit}"
