"""Demands of several rule profiles on one quantity, side by side, and demands that contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import Any, NamedTuple

from cable_twin.basics.units import rounded
from cable_twin.key_figures.rules.conditions import facts_of, holds, system_of
from cable_twin.key_figures.rules.document import UNITS, Check, Profile, SameAs
from cable_twin.key_figures.rules.expressions import FormulaError, MissingError, value_of
from cable_twin.key_figures.rules.subjects import Subjects
from cable_twin.key_figures.rules.verdicts import OUTSIDE, RuleVerdict, case_of
from cable_twin.scenario import Scenario

# quantities that rules compare in place of each other, by the one that stands for all
TOPICS = {
    "tested_safety_factor": "rope_safety_factor",
    "calculated_safety_factor": "rope_safety_factor",
    "tension_over_load": "tension_per_transverse_load",
    "stopping_distance": "mean_deceleration",
    "drive_deceleration": "mean_deceleration",
}
UPPER, LOWER = ("at most", "below", "within"), ("at least", "above", "within")


class Asked(NamedTuple):
    """Demand of a rule profile's check on a quantity, whether or not a run decides it.

    Attributes:
        profile: name of the profile.
        check: id of the check.
        clause: clause of the document.
        quantity: quantity/role/statistic of the figure.
        comparison: side of the limits that is allowed.
        limits: limits in the unit of the rule.
        unit: unit of the rule.
        load_case: load case in which the demand is judged, in words; empty for any run.
        why: how the demand follows from the check, where the check compares another quantity.
    """

    profile: str
    check: str
    clause: str
    quantity: str
    comparison: str
    limits: tuple[float, ...]
    unit: str
    load_case: str = ""
    why: str = ""

    @property
    def scale(self) -> float:
        """Factor that converts the unit of the rule to SI units."""
        return UNITS.get(self.unit, ("", 1.0))[1]

    @property
    def said(self) -> str:
        """Demand in words, as `at most 2.5 m/s^2`."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        return f"{self.comparison} {' to '.join(rounded(limit) for limit in self.limits)}{unit}"


def asked_by(scenario: Scenario, profiles: Iterable[Profile]) -> list[Asked]:
    """Demands of the rule profiles' checks that apply to a scenario and whose limits do not depend on a run.

    A check that other documents compare in another quantity gives a demand in both quantities.
    """
    profiles = list(profiles)
    if not profiles:
        return []
    facts, system = facts_of(scenario, Subjects(scenario)), system_of(scenario)
    found = []
    for profile in profiles:
        for name, check in profile.document.checks.items():
            if check.quantity is None or system not in profile.systems_of(check) or not _applies(check, facts):
                continue
            case = profile.document.load_cases[check.load_case] if check.load_case is not None else ""
            for one in (check, check.same_as):
                if one is None or (limits := _limits(one, facts)) is None:
                    continue
                own = (profile.name, name, check.clause, str(one.quantity), str(one.comparison), limits)
                found.append(Asked(*own, str(one.unit), case, one.why if isinstance(one, SameAs) else ""))
    return found


def _applies(check: Check, facts: Mapping[str, Any]) -> bool:
    try:
        return holds(check.when, facts)
    except MissingError:
        return False


def _limits(one: Check | SameAs, facts: Mapping[str, Any]) -> tuple[float, ...] | None:
    """Limits of a rule's check; None where they depend on results of a run."""
    numbers = {name: value for name, value in facts.items() if isinstance(value, int | float)}
    try:
        given = case_of(one.limit, facts)
        if given is None:
            return None
        return tuple(value_of(each, numbers) for each in (given if isinstance(given, list) else [given]))
    except (MissingError, FormulaError):
        return None


def clashes(asked: Sequence[Asked]) -> list[tuple[Asked, Asked]]:
    """Pairs of demands of different rule profiles on one quantity that contradict each other."""
    found = []
    for one, two in combinations(asked, 2):
        if one.profile == two.profile or one.quantity != two.quantity:
            continue
        for high, low in ((one, two), (two, one)):
            apart = low.scale * low.limits[0] > high.scale * high.limits[-1] * (1.0 + 1e-9)
            if high.comparison in UPPER and low.comparison in LOWER and apart:
                found.append((one, two))
                break
    return found


def topic_of(quantity: str) -> tuple[str, str]:
    """Quantity and role under which equivalent quantities of rules are compared.

    Args:
        quantity: as quantity/role/statistic.
    """
    name, role, _ = quantity.split("/")
    return TOPICS.get(name, name), role


def roles_of(verdicts: Iterable[RuleVerdict]) -> dict[str, set[str]]:
    """Roles of each quantity in the rules of a run, by quantity.

    Args:
        verdicts: of all profiles.
    """
    found: dict[str, set[str]] = {}
    for one in verdicts:
        if one.state != OUTSIDE:
            quantity, role = topic_of(one.quantity)
            found.setdefault(quantity, set()).add(role)
    return found


def differences(verdicts: Sequence[RuleVerdict], profiles: Sequence[str]) -> Iterator[list[RuleVerdict]]:
    """Groups of rule verdicts on one quantity in which profiles differ in limit or verdict, or one gives no verdict.

    Args:
        verdicts: of all profiles.
        profiles: names of the profiles.
    """
    by_topic: dict[tuple[str, str], list[RuleVerdict]] = {}
    for one in verdicts:
        if one.state != OUTSIDE:
            by_topic.setdefault(topic_of(one.quantity), []).append(one)
    for found in by_topic.values():
        seen = [
            {
                (one.quantity, one.comparison, tuple(limit * one.scale for limit in one.limits), one.state)
                for one in found
                if one.profile == name
            }
            for name in profiles
        ]
        if any(one != seen[0] for one in seen):
            yield found
