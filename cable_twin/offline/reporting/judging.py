"""Verdicts of rule profiles on calculated results: extremes of load cases, and cases of a study."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from cable_twin.key_figures import FigureId, KeyFigure
from cable_twin.key_figures.rules import Profile, RuleVerdict, judge, profiles_of
from cable_twin.key_figures.rules.verdicts import BROKEN, NOT_DECIDED, with_place
from cable_twin.offline.envelope import in_case, worst_verdicts
from cable_twin.offline.reporting.results import Case, ResultsError
from cable_twin.scenario import Scenario, load_scenario

LOAD_CASES = "limits.load_cases"
# figures that follow from two, which may be of different load cases: bounds of those of any one, on the safe side
OF_TWO = ("load_ratio", "rope_deflection", "tension_over_load", "wheel_load_ratio")
APART = "its two figures are extremes that may be of different load cases; `envelope` with the profile judges each case"


def with_rules(
    scenario: Scenario, names: Sequence[str] | None, facts: Mapping[str, Any]
) -> tuple[Scenario, list[Profile]]:
    """Set facts of the installation in a scenario, and load rule profiles, named ones or those of the scenario.

    Raises:
        ScenarioError: a fact is invalid.
        RuleError: a profile is invalid, or contradicts another profile or the installation.
    """
    if facts:
        scenario = load_scenario(
            scenario.resolved(), {f"limits.installation.{key}": value for key, value in facts.items()}
        )
    return scenario, profiles_of(scenario, None if names is None else tuple(names))


def judge_extremes(
    scenario: Scenario,
    extremes: Sequence[KeyFigure],
    governing: Mapping[FigureId, str],
    cases: Iterable[Case],
    profiles: Sequence[Profile],
    at_rest: Sequence[tuple[str, KeyFigure]] = (),
) -> list[RuleVerdict]:
    """Rule verdicts on the extremes of load cases: a limit kept by the worst figure is kept in all cases.

    Args:
        scenario: scenario that the load cases change.
        extremes: key figures, the worst of all load cases.
        governing: id of the governing load case of each.
        cases: all load cases.
        profiles: rule profiles.
        at_rest: extremes of the load cases at rest with their cases, where others are in motion.

    Raises:
        ResultsError: a load case is that of a rule, so that its figures cannot be told from the others.
    """
    cases = list(cases)
    if own := [one.id for one in cases if LOAD_CASES in one.changes]:
        raise ResultsError(
            f"case {own[0]}: given a load case of a rule, whose figures are among the extremes; allowed: profiles that "
            "`envelope` has judged, as with --set 'limits.profile=[NAME]'"
        )
    found = [judge(scenario, _told(extremes, governing), profiles, at_rest=not any(one.moves for one in cases))]
    if at_rest:
        still = [one for _, one in at_rest]
        found.append(judge(scenario, _told(still, {one.id: case for case, one in at_rest}), profiles, at_rest=True))
    return [_bounded(one) for one in worst_verdicts(found)]


def _told(figures: Iterable[KeyFigure], governing: Mapping[FigureId, str]) -> list[KeyFigure]:
    """Key figures with their load case and the place of the vehicle in the text of their places."""
    return [
        replace(here, place=f"case {governing[one.id]}, {here.place}".rstrip(", "))
        for one in figures
        for here in (with_place(one),)
    ]


def _bounded(one: RuleVerdict) -> RuleVerdict:
    """Mark a rule violation as undecided if it combines two extremes that may be of different load cases."""
    if one.state in BROKEN and one.quantity.partition("/")[0] in OF_TWO:
        return replace(one, state=NOT_DECIDED, reason=APART)
    return one


def judge_cases(
    scenario: Scenario,
    cases: Iterable[tuple[str, Mapping[str, Any], Sequence[KeyFigure]]],
    profiles: Sequence[Profile],
    *,
    at_rest: bool,
) -> list[RuleVerdict]:
    """Worst verdict of each rule check over the cases of a study, each case judged with its own values.

    Args:
        scenario: scenario that the cases change.
        cases: id, values by key and key figures of each; cases without figures are left out.
        profiles: rule profiles.
        at_rest: whether the figures are of lines at rest.
    """
    if not profiles:
        return []
    resolved = scenario.resolved()
    found = []
    for name, values, figures in cases:
        if figures:
            changed = load_scenario(resolved, values)
            found.append(in_case(name, judge(changed, figures, profiles, at_rest=at_rest)))
    return worst_verdicts(found) if found else judge(scenario, [], profiles, at_rest=at_rest)
