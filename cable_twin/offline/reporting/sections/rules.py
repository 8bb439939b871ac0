"""Section of a report on rule verdicts: document, clause, value, unit, verdict, and differences of profiles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cable_twin.key_figures.rules import (
    STATES,
    Asked,
    Profile,
    RuleVerdict,
    asked_by,
    clashes,
    counts_text,
    differences,
)
from cable_twin.key_figures.rules.comparison import roles_of, topic_of
from cable_twin.key_figures.rules.document import counts_of
from cable_twin.key_figures.rules.subjects import ROLES
from cable_twin.key_figures.rules.verdicts import NOT_DECIDED, OUTSIDE, limit_text, value_text
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections.section import with_units_kept
from cable_twin.offline.reporting.texts import Texts


class ProfilePart(NamedTuple):
    """Part of the rules section about one rule profile: document, verdicts, undecided checks, summary."""

    name: str
    document: str
    address: str
    rows: Sequence[RuleVerdict]
    reasons: Mapping[str, str]  # why checks are not decided, with the checks
    summary: str


class Verdict(NamedTuple):
    """Rule verdict in the table of differences between profiles, with the demands of its check as text.

    Attributes:
        verdict: the verdict.
        limit: limit in words, also where the run does not decide the check.
        of: name of the quantity of the check, where it differs from that of the row.
        other: demands of the check on other quantities; empty without any.
    """

    verdict: RuleVerdict
    limit: str
    of: str
    other: str


class Difference(NamedTuple):
    """Row of the table of differences between rule profiles: a quantity, its role, the verdicts of each profile."""

    quantity: str
    role: str
    cells: Sequence[Sequence[Verdict]]


def rules(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Rules: verdicts of each profile, differences, contradictions; None without any."""
    if not results.profiles:
        return None
    names = [one.name for one in results.profiles]
    asked = asked_by(results.scenario, results.profiles) if len(names) > 1 else []
    rows, alone = _differences(results.verdicts, names, asked, texts) if len(names) > 1 else ([], {})
    return {
        "parts": [_part(one, results.verdicts, texts) for one in results.profiles],
        "names": names,
        "differences": rows,
        "alone": alone,
        "clashes": [(*pair, texts.quantity(pair[0].quantity.partition("/")[0])) for pair in clashes(asked)],
        "value_text": value_text,
        "limit_text": lambda one: with_units_kept(texts.limit(limit_text(one))),
        "place_text": lambda one: with_units_kept(texts.phrase(one.figure.place)),
    }


def _part(profile: Profile, verdicts: Sequence[RuleVerdict], texts: Texts) -> ProfilePart:
    document, own = profile.document, [one for one in verdicts if one.profile == profile.name]
    shown = [one for one in own if one.state != OUTSIDE and one.limits]
    reasons: dict[str, list[str]] = {}
    for one in own:
        if one.state == NOT_DECIDED and not one.limits:
            reasons.setdefault(one.reason, []).append(one.check)
    told = counts_text((one.state for one in own), texts)
    beyond, number = counts_of(document).not_decidable, texts("check" if len(own) == 1 else "checks")
    edition = "" if document.edition in document.document else f", {document.edition}"
    return ProfilePart(
        profile.name,
        f"{document.jurisdiction}: {document.document}{edition}",
        document.address,
        sorted(shown, key=lambda one: STATES.index(one.state)),
        {reason: ", ".join(checks) for reason, checks in reasons.items()},
        f"{len(own)} {number}: {told}; {beyond} {texts('more no figure decides')}",
    )


def rules_summary(results: Results, texts: Texts) -> list[tuple[str, str]]:
    """Name of each rule profile, with a text that counts its checks by verdict."""
    return [(one.name, _part(one, results.verdicts, texts).summary) for one in results.profiles]


def _differences(
    verdicts: Sequence[RuleVerdict], names: Sequence[str], asked: Sequence[Asked], texts: Texts
) -> tuple[list[Difference], dict[str, str]]:
    """Rows of quantities on which rule profiles differ, and quantities with a rule of one profile alone."""
    rows: list[Difference] = []
    alone: dict[str, list[str]] = {}
    roles, demands = roles_of(verdicts), dict[tuple[str, str], list[Asked]]()
    for one in asked:
        demands.setdefault((one.profile, one.check), []).append(one)
    for group in differences(verdicts, names):
        quantity, role = topic_of(group[0].quantity)
        name = texts.quantity(quantity)
        if len({one.profile for one in group}) == 1:
            rules = ", ".join(one.check for one in group)
            of = f", {ROLES[role]}" if len(roles[quantity]) > 1 else ""
            alone.setdefault(group[0].profile, []).append(f"{name}{of} ({rules})")
            continue
        cells = [[_cell(one, name, demands, texts) for one in group if one.profile == profile] for profile in names]
        rows.append(Difference(name, ROLES[role], cells))
    return rows, {profile: "; ".join(whats) for profile, whats in alone.items()}


def _cell(one: RuleVerdict, row: str, demands: Mapping[tuple[str, str], Sequence[Asked]], texts: Texts) -> Verdict:
    own, *others = demands.get((one.profile, one.check), ()) or (None,)
    limit = limit_text(one) or (own.said if own is not None and own.quantity == one.quantity else "")
    name = texts.quantity(one.quantity.partition("/")[0])
    told = [f"{texts.limit(each.said)}, {texts(each.why)}" for each in others if each.limits != one.limits]
    return Verdict(one, texts.limit(limit), "" if name == row else name, "; ".join(told))
