"""Verdicts of rule profiles: document, clause, number, unit, verdict, and where several profiles differ."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from cable_twin.key_figures.rules import STATES, Profile, RuleVerdict, differences
from cable_twin.key_figures.rules.document import counts_of
from cable_twin.key_figures.rules.subjects import ROLES
from cable_twin.key_figures.rules.verdicts import NOT_DECIDED, OUTSIDE, limit_text, value_text
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.texts import Texts


class ProfilePart(NamedTuple):
    """Part of the section about one profile."""

    name: str
    document: str
    address: str
    rows: Sequence[RuleVerdict]
    reasons: Mapping[str, str]  # why checks are not decided, with the checks
    summary: str


class Difference(NamedTuple):
    """Row of the table of differences: a quantity, and the verdicts of each profile on it."""

    quantity: str
    role: str
    cells: Sequence[Sequence[RuleVerdict]]


class Rules:
    """Section with the verdicts of rule profiles."""

    title = "Rules"
    template = "rules.html"

    def content(self, results: Results, texts: Texts) -> Mapping[str, Any] | None:
        """Verdicts of each profile, and differences; None without a profile."""
        if not results.profiles:
            return None
        names = [one.name for one in results.profiles]
        rows, alone = _differences(results.verdicts, names, texts) if len(names) > 1 else ([], {})
        return {
            "parts": [_part(one, results.verdicts, texts) for one in results.profiles],
            "names": names,
            "differences": rows,
            "alone": alone,
            "value_text": value_text,
            "limit_text": lambda one: texts.limit(limit_text(one)),
        }


def _part(profile: Profile, verdicts: Sequence[RuleVerdict], texts: Texts) -> ProfilePart:
    document, own = profile.document, [one for one in verdicts if one.profile == profile.name]
    shown = [one for one in own if one.state != OUTSIDE and one.limits]
    reasons: dict[str, list[str]] = {}
    for one in own:
        if one.state == NOT_DECIDED and not one.limits:
            reasons.setdefault(one.reason, []).append(one.check)
    counts = Counter(one.state for one in own)
    told = ", ".join(f"{counts[state]} {texts(state)}" for state in STATES if counts[state])
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
    """Each profile with the number of its checks by verdict."""
    return [(one.name, _part(one, results.verdicts, texts).summary) for one in results.profiles]


def _differences(
    verdicts: Sequence[RuleVerdict], names: Sequence[str], texts: Texts
) -> tuple[list[Difference], dict[str, str]]:
    """Quantities on which profiles differ, and those on which one alone has a rule."""
    rows: list[Difference] = []
    alone: dict[str, list[str]] = {}
    for group in differences(verdicts, names):
        quantity, role, _ = group[0].quantity.split("/")
        name = texts.quantity(quantity)
        if len({one.profile for one in group}) == 1:
            rules = ", ".join(one.check for one in group)
            alone.setdefault(group[0].profile, []).append(f"{name} ({rules})")
            continue
        cells = [[one for one in group if one.profile == profile] for profile in names]
        rows.append(Difference(name, ROLES[role], cells))
    return rows, {profile: "; ".join(whats) for profile, whats in alone.items()}
