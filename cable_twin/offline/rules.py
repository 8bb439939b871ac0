"""Command `rules`: the rule profiles, their checks, and the checks that can be decided for a scenario."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

from rich import box
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from cable_twin.basics.units import counted
from cable_twin.key_figures import QUANTITIES, KeyFigures, compile_figures
from cable_twin.key_figures.rules import Profile, RuleError, counts_text, judge, load_profile, profiles_of
from cable_twin.key_figures.rules.conditions import CHOICES, OF_SCENARIO, SYSTEMS, VARIABLES
from cable_twin.key_figures.rules.document import UNITS, Check, Counts, counts_of
from cable_twin.key_figures.rules.subjects import ROLES
from cable_twin.key_figures.rules.verdicts import NOT_DECIDED, OUTSIDE, words
from cable_twin.offline.figure_table import table_console
from cable_twin.offline.simulate_options import add_changes
from cable_twin.offline.verdict_table import say
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.scenario.checks.limits import profile_names
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import compilation_shown
from cable_twin.terminal.command_line import OneLineParser, fail, left_at_once, tell

SHOWN, UNUSABLE = 0, 2  # exit codes
EPILOG = """\
A scenario names profiles in `limits: {profile: [france_1985]}`; simulate, line and review then judge its key figures
by them, and review --profile judges any log. A check is decided where the run has its figure, the installation is
stated in limits.installation, and the load case is that of the run.

exit codes: 0 all is shown, 2 wrong profile, scenario or option

examples:
  rules                                    the profiles, a line each
  rules france_1985                        the checks of one
  rules france_1985 --scenario jig_back    what can be decided, and what lacks
  rules --vocabulary                       what a profile of one's own can name
"""


def parser() -> OneLineParser:
    """Parser of the options of `rules`."""
    result = OneLineParser("rules", "List rule profiles and their checks.", EPILOG, failure=UNUSABLE)
    result.add_argument(
        "profiles",
        nargs="*",
        metavar="PROFILE",
        help="name of a profile, or path of a YAML file of the same form; default: all, a line each",
    )
    result.add_argument(
        "--scenario",
        metavar="SCENARIO",
        help="show which checks can be decided for this scenario, by name or path of a YAML file, at its start",
    )
    add_changes(result)
    result.add_argument(
        "--markdown", action="store_true", help="print the tables of all profiles as docs/rules.md has them, and end"
    )
    result.add_argument(
        "--vocabulary",
        action="store_true",
        help="list the figures, roles, facts and units that a check can name, and end",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """List rule profiles and their checks; returns the exit code that the help lists."""
    options = parser().parse_args(sys.argv[1:] if argv is None else list(argv))
    console = table_console()
    if options.vocabulary:
        _print_vocabulary(console)
        return SHOWN
    if options.markdown:
        print("\n".join((*markdown(), "", *reasons())))
        return SHOWN
    try:
        profiles = [load_profile(name) for name in options.profiles or profile_names()]
        if options.scenario is not None:
            scenario = load_scenario(options.scenario, dict(options.set))
            chosen = profiles_of(scenario, tuple(options.profiles)) if options.profiles else profiles_of(scenario)
            if not chosen:
                raise RuleError(f"{options.scenario}: limits.profile: given none; allowed: names of profiles")
            _print_decidable(console, scenario, chosen)
        elif options.profiles:
            for profile in profiles:
                _print_checks(console, profile)
        else:
            _print_profiles(console, profiles)
    except (ScenarioError, EquilibriumError) as error:
        return fail("rules", error, UNUSABLE)
    return SHOWN


def _print_profiles(console: Console, profiles: Sequence[Profile]) -> None:
    table = Table("profile", "document", "edition", box=box.SIMPLE_HEAD, pad_edge=False)
    for title in ("checks", "decided", "one way", "by load case", "not decidable"):
        table.add_column(title, justify="right")
    for name, document in profiles:
        counts = [str(number) for number in counts_of(document)]
        table.add_row(name, escape(f"{document.jurisdiction}: {document.document}"), document.edition, *counts)
    console.print(table)
    say(console, "one way: the figure is a bound of what the rule compares, so that it decides on one side alone")
    say(console, "by load case: in a load case of the document, which a scenario states in limits.load_cases")


def markdown() -> list[str]:
    """Lines of the Markdown table of all rule profiles with counts of their checks."""
    titles = "profile", "jurisdiction, document", "edition", *(name.replace("_", " ") for name in Counts._fields)
    rows = [
        (f"`{name}`", f"{one.jurisdiction}: {one.document}", one.edition, *map(str, counts_of(one)))
        for name, one in map(load_profile, profile_names())
    ]
    total = [sum(int(row[number]) for row in rows) for number in range(3, len(titles))]
    rows.append(("all", "", "", *map(str, total)))
    return _table(titles, rows)


def reasons() -> list[str]:
    """Lines of the Markdown table of rule checks that no key figure decides, with reasons."""
    rows = []
    for name, document in map(load_profile, profile_names()):
        found: dict[str, list[str]] = {}
        for check, one in document.checks.items():
            if one.not_decidable is not None:
                found.setdefault(one.not_decidable, []).append(check)
        rows += [(f"`{name}`", ", ".join(checks), reason) for reason, checks in found.items()]
    return _table(("profile", "rules", "not decidable, as"), rows)


def _table(titles: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    return [f"| {' | '.join(row)} |" for row in (titles, ["---"] * len(titles), *rows)]


def _print_checks(console: Console, profile: Profile) -> None:
    document = profile.document
    say(console, f"{profile.name}: {document.jurisdiction}, {document.document}; {document.edition}")
    for note in (document.status, document.address, f"for {document.carries}: {', '.join(document.systems)}"):
        if note:
            say(console, f"  {note}")
    table = Table("rule", "clause", "what", "limit", "of, or why not", box=box.SIMPLE_HEAD, pad_edge=False)
    for name, check in document.checks.items():
        doubt = f" [dim](doubt: {escape(check.doubt)})[/]" if check.doubt else ""
        table.add_row(name, escape(check.clause), escape(check.text) + doubt, _limit(check), escape(_of(check)))
    console.print(table)


def _limit(check: Check) -> str:
    """Text of the limit of a rule check, with its condition and load case."""
    if check.quantity is None:
        return ""
    cases = check.limit if isinstance(check.limit, list) and isinstance(check.limit[0], dict) else None
    text = (
        "; ".join(f"{_number(case['limit'])} for {words(case['when'])}" for case in cases)
        if cases
        else _number(check.limit)
    )
    unit = "" if check.unit == "-" else f" {check.unit}"
    when = f" [dim]for {escape(words(check.when))}[/]" if check.when else ""
    case = f" [dim]in load case {check.load_case}[/]" if check.load_case else ""
    waiver = f" [dim]({escape(check.waiver)})[/]" if check.waiver else ""
    return f"{check.comparison} {escape(text)}{unit}{when}{case}{waiver}"


def _number(limit: Any) -> str:
    return " to ".join(map(_number, limit)) if isinstance(limit, list) else str(limit)


def _of(check: Check) -> str:
    if check.judged_in:
        return f"judged in {check.judged_in}"
    return check.quantity or f"not decidable: {check.not_decidable}"


def _print_decidable(console: Console, scenario: Scenario, profiles: Sequence[Profile]) -> None:
    """Print which checks of rule profiles can be decided for a scenario at its start, and why others cannot."""
    with left_at_once("rules"), compilation_shown(Console(stderr=True), lambda text: tell("rules", text)):
        simulation = Simulation(scenario, meanwhile=compile_figures)
    figures = KeyFigures(scenario)
    figures.update(simulation.snapshot)
    verdicts = judge(scenario, figures.figures(), profiles)
    for profile in profiles:
        own = [one for one in verdicts if one.profile == profile.name]
        table = Table("rule", "clause", "what", "", box=box.SIMPLE_HEAD, pad_edge=False)
        for one in own:
            kind = _kind(one.state, bool(one.limits))
            why = kind if kind == "can be decided" else f"{kind}: {one.reason}"
            table.add_row(one.check, escape(one.clause), escape(one.text), escape(why))
        say(console, f"{profile.name} for {scenario.name} at its start")
        console.print(table)
        told = counts_text(_kind(one.state, bool(one.limits)) for one in own)
        say(console, f"  {counted(len(own), 'check')} with a figure: {told}")


def _kind(state: str, compared: bool) -> str:
    if state == OUTSIDE or (state == NOT_DECIDED and not compared):
        return state
    return "can be decided"


def _print_vocabulary(console: Console) -> None:
    sections: dict[str, dict[str, str]] = {
        "quantity/ROLE/STATISTIC": {
            f"{row.quantity} [{row.unit}]": f"{row.meaning}; {', '.join(row.statistics)}" for row in QUANTITIES.values()
        },
        "ROLE": ROLES,
        "systems": SYSTEMS,
        "facts of conditions": {
            name: ", ".join(str(one).lower() if isinstance(one, bool) else str(one) for one in choices) or "a number"
            for name, choices in CHOICES.items()
        },
        "variables of formulas": {
            f"{name} [{unit}]": OF_SCENARIO[name][0] if name in OF_SCENARIO else f"limits.installation.{name}"
            for name, unit in VARIABLES.items()
        },
        "units beside those of the figures": {unit: f"{size:.4g} {own}" for unit, (own, size) in UNITS.items()},
    }
    for title, rows in sections.items():
        table = Table(title, "", box=box.SIMPLE_HEAD, pad_edge=False)
        for name, text in rows.items():
            table.add_row(escape(name), escape(text))
        console.print(table)


if __name__ == "__main__":
    sys.exit(main())
