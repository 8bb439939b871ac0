"""Printed tables of the verdicts of rule profiles, and of the differences between profiles; verdicts as plain data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cable_twin.basics.units import counted
from cable_twin.key_figures import QUANTITIES, FigureId, KeyFigure
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
from cable_twin.key_figures.rules.document import UNITS, counts_of
from cable_twin.key_figures.rules.subjects import ROLES
from cable_twin.key_figures.rules.verdicts import (
    KEPT,
    NOT_DECIDED,
    NOT_KEPT,
    OUTSIDE,
    WAIVABLE,
    limit_text,
    sentence,
    value_text,
)
from cable_twin.scenario import Scenario

WIDE = 140  # characters that a table with clauses needs
STYLES = {NOT_KEPT: "bold red", WAIVABLE: "bold yellow"}
COLUMNS = (
    *("profile", "check", "document", "edition", "clause", "text", "verdict", "reason", "quantity", "figure", "value"),
    *("comparison", "limits", "unit", "place", "time [s]"),
)


def print_verdicts(
    console: Console, profiles: Sequence[Profile], verdicts: Sequence[RuleVerdict], scenario: Scenario | None = None
) -> None:
    """Print the verdicts of each profile, then the differences between profiles.

    Args:
        console: console of the output.
        profiles: rule profiles with their checks.
        verdicts: of all profiles.
        scenario: judged scenario, to print rules that contradict each other; None: without these.
    """
    for profile in profiles:
        own = [one for one in verdicts if one.profile == profile.name]
        _print_profile(console, profile, own)
    if len(profiles) > 1:
        _print_differences(console, profiles, verdicts)
        for one, two in clashes(asked_by(scenario, profiles)) if scenario is not None else ():
            say(console, f"nothing keeps both: {_demand(one)}, and {_demand(two)}", style="bold red")


def _demand(one: Asked) -> str:
    """Text of the demand of a rule check: quantity, limit, profile, check, clause."""
    name = QUANTITIES[one.quantity.partition("/")[0]].in_general
    why = f" ({one.why})" if one.why else ""
    case = f" in {one.load_case}" if one.load_case else ""
    return f"{name} {one.said}{why} of {one.profile} {one.check}, {one.clause}{case}"


def _print_profile(console: Console, profile: Profile, verdicts: Sequence[RuleVerdict]) -> None:
    wide = console.width >= WIDE
    document = profile.document
    edition = "" if document.edition in document.document else f", {document.edition}"
    say(console, f"{profile.name}: {document.jurisdiction}, {document.document}{edition}")
    shown = [one for one in verdicts if one.state != OUTSIDE and one.limits]
    if shown:
        table = Table("rule", "clause", "what", box=box.SIMPLE_HEAD, pad_edge=False)
        for title in ("value", "limit", "", "of"):
            table.add_column(title, justify="right" if title == "value" else "left", no_wrap=title in ("value", ""))
        if not wide:
            table = Table("rule", "value", "limit", "", box=box.SIMPLE_HEAD, pad_edge=False)
        for one in sorted(shown, key=lambda each: STATES.index(each.state)):
            verdict = f"[{STYLES[one.state]}]{one.state}[/]" if one.state in STYLES else one.state
            value, limit = value_text(one), limit_text(one)
            if wide:
                table.add_row(one.check, one.clause, escape(one.text), value, limit, verdict, escape(_subject(one)))
            else:
                below = f"\n  [dim]{escape(one.clause)}, {escape(one.text)}[/]"
                table.add_row(f"{one.check}{below}", value, limit, verdict)
        console.print(table)
    for one in verdicts:
        if one.state in (NOT_KEPT, WAIVABLE):
            say(console, f"  {sentence(one)}", style=STYLES[one.state])
    reasons: dict[str, list[str]] = {}
    for one in verdicts:
        if one.state == NOT_DECIDED:
            reasons.setdefault(one.reason, []).append(one.check)
    for reason, checks in reasons.items():
        say(console, f"  not decided, {', '.join(checks)}: {reason}")
    told = counts_text(one.state for one in verdicts)
    beyond = counts_of(document).not_decidable
    say(console, f"  {counted(len(verdicts), 'check')}: {told}; {beyond} more no figure decides (rules {profile.name})")
    console.print()


def _print_differences(console: Console, profiles: Sequence[Profile], verdicts: Sequence[RuleVerdict]) -> None:
    """Print a row for each quantity on which rule profiles differ, and a line of quantities of one profile only."""
    names = [profile.name for profile in profiles]
    table = Table("where the profiles differ", *names, box=box.SIMPLE_HEAD, pad_edge=False)
    alone: dict[str, list[str]] = {}
    roles = roles_of(verdicts)
    for group in differences(verdicts, names):
        quantity, role = topic_of(group[0].quantity)
        what = QUANTITIES[quantity].in_general
        if len({one.profile for one in group}) == 1:
            rules = ", ".join(one.check for one in group)
            of = f", {ROLES[role]}" if len(roles[quantity]) > 1 else ""
            alone.setdefault(group[0].profile, []).append(f"{what}{of} ({rules})")
            continue
        cells = ["\n".join(_cell(one) for one in group if one.profile == name) or "no rule" for name in names]
        table.add_row(f"{what}\n  [dim]{ROLES[role]}[/]", *cells)
    if table.row_count:
        console.print(table)
    elif not alone:
        say(console, "the profiles agree in all that they compare")
    for name, whats in alone.items():
        say(console, f"only {name} has a rule on {'; '.join(whats)}")
    console.print()


def _cell(one: RuleVerdict) -> str:
    state = f"[{STYLES[one.state]}]{one.state}[/]" if one.state in STYLES else one.state
    value = f"{value_text(one)}, " if one.state == KEPT or one.limits else ""
    return f"{value}{limit_text(one)}: {state} ({escape(one.check)}, {escape(one.clause)})".removeprefix(": ")


def _subject(one: RuleVerdict) -> str:
    if one.figure is None:
        return ""
    return one.figure.name.partition(": ")[0] if ": " in one.figure.name else ""


def say(console: Console, text: str, style: str | None = None) -> None:
    """Print a text, filled to the width of a console, with all lines but the first one indented."""
    console.print(fill(text, console.width, subsequent_indent="    "), markup=False, soft_wrap=True, style=style)


def verdict_columns(one: RuleVerdict) -> dict[str, Any]:
    """Rule verdict as a mapping by column name, of `COLUMNS`; numbers in the unit of the rule."""
    figure = one.figure
    id_, time, place = (str(figure.id), figure.time, figure.place) if figure is not None else (None, None, None)
    values = (one.profile, one.check, one.document, one.edition, one.clause, one.text, one.state, one.reason)
    return dict(
        zip(
            COLUMNS,
            (*values, one.quantity, id_, one.value, one.comparison, [*one.limits], one.unit, place, time),
            strict=True,
        )
    )


def verdict_of_columns(columns: Mapping[str, Any], names: Mapping[str, str]) -> RuleVerdict:
    """Rule verdict from a mapping by column name, inverse of `verdict_columns`; figures get printed names by id.

    Args:
        columns: by the names of `COLUMNS`.
        names: printed name by id of a figure.

    Raises:
        KeyError, TypeError, ValueError: the mapping is of no verdict.
    """
    scale, figure = UNITS.get(columns["unit"], ("", 1.0))[1], None
    if columns["figure"] is not None:
        id_, value = FigureId.of_text(columns["figure"]), scale * float(columns["value"])
        row = QUANTITIES[id_.quantity]
        name, place = names.get(columns["figure"], row.in_general), str(columns["place"] or "")
        figure = KeyFigure(id_, name, value, row.unit, float(columns["time [s]"] or 0.0), place)
    limits = tuple(map(float, columns["limits"]))
    same = ("profile", "check", "document", "edition", "clause", "text", "reason", "quantity", "comparison", "unit")
    said: dict[str, Any] = {key: str(columns[key]) for key in same}
    return RuleVerdict(**said, state=str(columns["verdict"]), figure=figure, limits=limits, scale=scale)


def verdict_rows(verdicts: Iterable[RuleVerdict]) -> list[list[Any]]:
    """Rows of rule verdicts for CSV, in the order of `COLUMNS`."""
    return [
        [" to ".join(map(repr, value)) if isinstance(value, list) else value for value in verdict_columns(one).values()]
        for one in verdicts
    ]
