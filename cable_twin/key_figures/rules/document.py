"""Rule profile: a YAML file with the checks of one document, its schema, and its validation, a line per error."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from math import pi
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import BaseModel, Field, ValidationError

from cable_twin.basics.limited_yaml import read_mapping
from cable_twin.key_figures.quantities import QUANTITIES
from cable_twin.key_figures.rules.conditions import SYSTEMS, VARIABLES, condition_fault
from cable_twin.key_figures.rules.expressions import FormulaError, variables_of
from cable_twin.key_figures.rules.subjects import ROLES
from cable_twin.scenario import Scenario, ScenarioError
from cable_twin.scenario.checks.fault import NOTHING, Fault, KeyPath, allowed, refuse, unknown_key
from cable_twin.scenario.checks.limits import RULES, is_file, profile_names
from cable_twin.scenario.sections.quantities import FromList, OneLine, Section

Kind = Literal["limit", "assumption", "parameter", "operation"]
Comparison = Literal["at most", "at least", "below", "above", "within"]
Compared = Literal["equal", "at most", "at least"]
Read = Literal["full", "excerpt", "secondary"]
Texts = Annotated[tuple[str, ...], FromList]
# units of rules beside those of the figures: the figure's unit, and how many of it
UNITS = {
    "%": ("-", 0.01),
    "mm": ("m", 1e-3),
    "deg": ("rad", pi / 180.0),
    "kN": ("N", 1e3),
    "N/mm^2": ("Pa", 1e6),
}
OUTCOMES = ("quantity", "judged_in", "not_decidable")  # of which each check has one
JUDGED = ("comparison", "unit")  # needed by a check with a quantity
A_CHECK = "a figure as quantity/role/statistic, or judged_in, or not_decidable"


class Strict(BaseModel):
    """Base class of parts of a rule profile: no unknown keys, no type conversion, finite numbers only."""

    model_config = Section.model_config


class SameAs(Strict):
    """Equivalent limit in another quantity, only to compare a rule with other documents, not to judge."""

    quantity: str = Field(description="that quantity as quantity/role/statistic")
    comparison: Comparison = Field(description="side of the limit that is allowed")
    limit: Any = Field(description="number or formula")
    unit: OneLine = Field(description="unit of the limit")
    why: OneLine = Field(default="", description="how it follows")


class Check(Strict):
    """Rule of a document: a figure compared with a limit, or the reason why the twin cannot decide it."""

    clause: OneLine = Field(description="article, section or paragraph", min_length=1)
    text: OneLine = Field(description="the rule in own words, without its number", min_length=1)
    kind: Kind = Field(default="limit", description="limit, assumption of a calculation, parameter, operating rule")
    quantity: str | None = Field(default=None, description="compared figure as quantity/role/statistic")
    comparison: Comparison | None = Field(default=None, description="side of the limit that is allowed")
    limit: Any = Field(default=None, description="number, formula, or list of cases; two of them for `within`")
    unit: OneLine | None = Field(default=None, description="unit of the limit")
    allowance: Any = Field(default=None, description="number or formula by which the rule may be stricter")
    compared: Compared = Field(
        default="equal", description="figure beside what the rule compares: equal, at most that, or at least that"
    )
    compared_at_rest: Compared | None = Field(
        default=None, description="the same of a line at rest, where it differs, also of a substitute"
    )
    substitute: str | None = Field(default=None, description="figure that is taken where a run does not have the first")
    substitute_compared: Compared = Field(default="equal", description="that figure beside what the rule compares")
    when: dict[str, Any] = Field(default_factory=dict, description="condition by installation")
    systems: Texts | None = Field(default=None, description="kinds of ropeway, where not those of the document")
    definition: OneLine = Field(default="", description="what the figure stands for, where words differ")
    load_case: str | None = Field(default=None, description="load case of the document in which it is to be judged")
    each_brake: bool = Field(
        default=False, description="true: kept where each brake of the drive keeps it alone, in an emergency stop"
    )
    waiver: OneLine = Field(default="", description="what the authority may allow")
    same_as: SameAs | None = Field(default=None, description="the rule in a quantity that other documents compare")
    doubt: OneLine = Field(default="", description="doubt about the text that was read")
    read: Read | None = Field(default=None, description="how it was read, where not as the document")
    judged_in: str | None = Field(default=None, description="check that applies it")
    not_decidable: OneLine | None = Field(default=None, description="reason why no figure decides it", min_length=1)


class Document(Strict):
    """Rule profile: the checks of one document."""

    document: OneLine = Field(description="title", min_length=1)
    jurisdiction: OneLine = Field(description="where it applies", min_length=1)
    edition: OneLine = Field(description="edition that was read", min_length=1)
    status: OneLine = Field(default="", description="what is known of its being in force")
    address: OneLine = Field(default="", description="where the text was read")
    read: Read = Field(default="full", description="how it was read")
    systems: Texts = Field(description="kinds of ropeway", min_length=1)
    carries: Literal["persons", "goods", "both"] = Field(description="load of the ropeways it is for")
    load_cases: dict[str, OneLine] = Field(default_factory=dict, description="load cases by name, in words")
    wind_pressures: dict[str, float] = Field(
        default_factory=dict, description="least wind of a load case by its name, in Pa: half the density times speed^2"
    )
    checks: dict[str, Check] = Field(description="checks by id", min_length=1)


class Profile(NamedTuple):
    """Rule profile with its name: that of its file without the suffix."""

    name: str
    document: Document

    def systems_of(self, check: Check) -> tuple[str, ...]:
        """Kinds of ropeway that a check of the profile is for."""
        return check.systems or self.document.systems


class Counts(NamedTuple):
    """Numbers of checks of a rule document: all, decided by a figure, by a bound, by a load case, not decidable."""

    checks: int
    decided: int  # by a figure, each alone or within another check
    one_way: int  # of those: where the figure is only a bound of what the rule compares
    by_load_case: int  # of those: in a load case of their own
    not_decidable: int


def counts_of(document: Document) -> Counts:
    """Count the checks of a rule document by kind of decision; ids that differ only by a last letter are one rule."""
    checks = document.checks
    rules = [one for name, one in checks.items() if not name[-1].islower()]
    judged = [checks[one.judged_in] if one.judged_in else one for one in rules]
    figures = [one for one in judged if one.quantity is not None]
    return Counts(
        checks=len(rules),
        decided=len(figures),
        one_way=sum(one.compared != "equal" for one in figures),
        by_load_case=sum(one.load_case is not None for one in figures),
        not_decidable=len(rules) - len(figures),
    )


class RuleError(ScenarioError):
    """Error of an invalid rule profile; its text has one line for each invalid entry."""


@cache
def load_profile(source: str) -> Profile:
    """Load a rule profile by the name of a shipped one, or from a YAML file.

    Args:
        source: name, or path that ends in .yaml.

    Raises:
        RuleError: the profile is invalid; one line for each fault.
    """
    if not is_file(source) and source not in profile_names():
        names = ", ".join(profile_names())
        raise RuleError(f"given {source!r}: no such profile; allowed: {names}, or the path of a YAML file")
    file = Path(source).expanduser() if is_file(source) else RULES / f"{source}.yaml"
    if not file.is_file():  # a pipe would hold up a running twin
        raise RuleError(f"{file}: no such file; allowed: a YAML file with a rule profile")
    content = read_mapping(file, lambda text: RuleError(*text.splitlines()), "a rule profile", Document.model_fields)
    document, faults = read_document(content)
    if document is None or faults:
        raise RuleError(*(f"{file}: {'.'.join(map(str, path))}: {text}" for path, text in faults))
    return Profile(file.stem, document)


def read_document(data: Mapping[Any, Any]) -> tuple[Document | None, list[Fault]]:
    """Validate plain data as a rule document; returns it (None if the schema is violated) and all errors in it."""
    try:
        document = Document.model_validate(data)
    except ValidationError as error:
        return None, [_schema_fault(tuple(item["loc"]), item["type"], data) for item in error.errors()]
    return document, list(_faults(document))


def _schema_fault(location: KeyPath, kind: str, data: Any) -> Fault:
    """Error for an entry that violates the schema of a rule profile, worded as errors in scenarios."""
    model: type[Strict] = Check if location[0] == "checks" and len(location) > 2 else Document
    key = str(location[2] if model is Check else location[0])
    if kind == "extra_forbidden":
        return unknown_key(location, model.model_fields)
    path = location[:3] if model is Check else location[:2] if key == "checks" else location[:1]
    given: Any = data
    for part in path:
        if not isinstance(given, Mapping) or part not in given:
            given = NOTHING
            break
        given = given[part]
    field = model.model_fields[key]
    lists = "a list of texts" if key in ("systems",) else "a check: a mapping" if key == "checks" else allowed(field)
    return refuse(path, given, lists, "it is needed" if given is NOTHING else "")


def _faults(document: Document) -> Iterator[Fault]:
    """Errors in a rule document that follows the schema: outcomes, conditions, units, contradictions."""
    yield from _system_faults(("systems",), document.systems)
    for name, check in document.checks.items():
        path: KeyPath = ("checks", name)
        yield from _system_faults((*path, "systems"), check.systems or ())
        given = [key for key in OUTCOMES if getattr(check, key) is not None]
        if len(given) != 1:
            yield refuse(path, " and ".join(given) or NOTHING, f"one of {', '.join(OUTCOMES)}")
        elif given == ["quantity"]:
            yield from _judged_faults(path, check, document)
        elif given == ["judged_in"]:
            other = document.checks.get(str(check.judged_in))
            if other is None or other.quantity is None:
                yield refuse((*path, "judged_in"), check.judged_in, "the id of a check with a quantity")
        for key, value in check.when.items():
            if fault := condition_fault(key, value):
                yield Fault((*path, "when", key), fault)
    yield from _contradictions(document)


def _system_faults(path: KeyPath, systems: tuple[str, ...]) -> Iterator[Fault]:
    for name in systems:
        if name not in SYSTEMS:
            yield refuse(path, name, f"a list of some of {', '.join(SYSTEMS)}")


def _judged_faults(path: KeyPath, check: Check, document: Document) -> Iterator[Fault]:
    """Errors in a rule's check that compares a key figure: missing keys, figures, load case and limits."""
    for key in JUDGED:
        if getattr(check, key) is None:
            yield refuse((*path, key), NOTHING, allowed(Check.model_fields[key]), "it is needed")
    yield from _quantity_faults(path, "quantity", str(check.quantity), check.unit)
    if check.substitute is not None:
        yield from _quantity_faults(path, "substitute", check.substitute, check.unit)
    if check.load_case is not None and check.load_case not in document.load_cases:
        names = ", ".join(document.load_cases) or "none, as the document has no load_cases"
        yield refuse((*path, "load_case"), check.load_case, names)
    yield from _limit_faults((*path, "limit"), check.limit, within=check.comparison == "within")
    if check.allowance is not None:
        yield from _limit_faults((*path, "allowance"), check.allowance, within=False)
    if (other := check.same_as) is not None:
        yield from _quantity_faults((*path, "same_as"), "quantity", other.quantity, other.unit)
        yield from _limit_faults((*path, "same_as", "limit"), other.limit, within=other.comparison == "within")


def _quantity_faults(path: KeyPath, key: str, given: str, unit: str | None) -> Iterator[Fault]:
    """Errors in a rule's figure, given as quantity/role/statistic, and in its unit (None: not given)."""
    quantity, role, statistic = (*given.split("/"), "", "")[:3]
    row = QUANTITIES.get(quantity)
    if row is None:
        near = get_close_matches(quantity, QUANTITIES, n=1)
        hint = f"did you mean {near[0]}?" if near else f"{', '.join(list(QUANTITIES)[:4])}, ... (`rules --vocabulary`)"
        yield refuse((*path, key), given, hint, "unknown quantity")
        return
    if role not in ROLES or statistic not in row.statistics or given.count("/") != 2:
        ids = f"{quantity}/ROLE/{' or '.join(row.statistics)}, with ROLE one of {', '.join(ROLES)}"
        yield refuse((*path, key), given, ids)
    if unit is not None and UNITS.get(unit, (unit,))[0] != row.unit:
        others = [other for other, (own, _) in UNITS.items() if own == row.unit]
        yield refuse((*path, "unit"), unit, ", ".join([row.unit, *others]), f"{quantity} is in {row.unit}")


def _limit_faults(path: KeyPath, limit: Any, *, within: bool) -> Iterator[Fault]:
    """Errors in a rule's limit: a number, a formula, a band, or a list of cases."""
    if isinstance(limit, list) and limit and all(isinstance(one, Mapping) for one in limit):
        for number, one in enumerate(limit):
            if set(one) != {"when", "limit"} or not isinstance(one["when"], Mapping):
                yield refuse((*path, number), ", ".join(map(str, one)), "when and limit")
                continue
            yield from (
                Fault((*path, number, "when", key), fault)
                for key, value in one["when"].items()
                if (fault := condition_fault(str(key), value))
            )
            yield from _limit_faults((*path, number, "limit"), one["limit"], within=within)
        return
    if within:
        if not isinstance(limit, list) or len(limit) != 2:
            yield refuse(path, limit, "a list of two, the least and the most")
            return
        if all(isinstance(one, int | float) for one in limit) and limit[0] > limit[1]:
            yield refuse(path, limit, "the least, then the most", "nothing can be within it")
    for one in limit if within else [limit]:
        if isinstance(one, str):
            try:
                unknown = sorted(variables_of(one) - set(VARIABLES))
            except FormulaError as error:
                yield Fault(path, f"given {one!r}: {error}")
                continue
            if unknown:
                yield refuse(path, one, ", ".join(VARIABLES), f"unknown variable {unknown[0]}")
        elif not isinstance(one, int | float) or isinstance(one, bool):
            yield refuse(path, NOTHING if one is None else one, "a number, a formula, or a list of cases")


def _contradictions(document: Document) -> Iterator[Fault]:
    """Errors for pairs of checks whose limits on one figure under one condition contradict each other."""
    least: dict[tuple[Any, ...], tuple[str, float]] = {}
    judged = [(name, one) for name, one in document.checks.items() if isinstance(one.limit, int | float)]
    for bound in ("at least", "at most"):
        for name, check in judged:
            key = (check.quantity, check.unit, str(sorted(check.when.items())), check.systems, check.load_case)
            if check.comparison != bound or check.quantity is None:
                continue
            if bound == "at least":
                least[key] = name, max(float(check.limit), least.get(key, ("", check.limit))[1])
            elif key in least and least[key][1] > check.limit:
                other, value = least[key]
                why = f"contradicts {other}, at least {value:g} {check.unit}"
                yield refuse(("checks", name, "limit"), check.limit, f"at least {value:g}", why)


def profiles_of(scenario: Scenario, names: tuple[str, ...] | None = None) -> list[Profile]:
    """Rule profiles of a scenario, or those of given names.

    Args:
        scenario: scenario, whose `limits` name profiles and load cases.
        names: names or paths instead of those in the scenario.

    Raises:
        RuleError: a profile is invalid, or contradicts another one or the installation; one line each.
    """
    found = [load_profile(name) for name in (scenario.limits.profile if names is None else names)]
    key = "limits.profile"
    for number, one in enumerate(found):
        if one.name in [other.name for other in found[:number]]:
            raise RuleError(f"{key}: given {one.name!r}: given twice; allowed: each profile once")
    carried = scenario.limits.installation.carries
    kinds = {one.name: one.document.carries for one in found if one.document.carries != "both"}
    if carried is not None and (wrong := [name for name, kind in kinds.items() if kind != carried]):
        why = f"it is for {kinds[wrong[0]]} alone, and limits.installation.carries is {carried}"
        raise RuleError(f"{key}: given {wrong[0]!r}: {why}; allowed: profiles for {carried}")
    if len(set(kinds.values())) > 1:
        words = " and ".join(f"{name} is for {kind} alone" for name, kind in kinds.items())
        raise RuleError(f"{key}: given {', '.join(kinds)}: {words}; allowed: all for persons, or all for goods")
    cases = {f"{one.name}.{case}" for one in found for case in one.document.load_cases}
    for case in scenario.limits.load_cases if names is None else ():
        if case not in cases:
            allowed_cases = ", ".join(sorted(cases)) or "none, as the profiles have no load cases"
            raise RuleError(f"limits.load_cases: given {case!r}; allowed: {allowed_cases}")
    return found
