"""Key figure: identity, value, unit, time and place of the extreme, and limit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from typing import Any, NamedTuple, cast, get_args

from cable_twin.key_figures.quantities import QUANTITIES, bound_of, limit_of
from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.limits import Bound, limit_row

TOLERANCE = 1e-6  # of a limit, for rounding alone
REST_UNKNOWN = "the run begins in motion, and its tension at rest is not known"


class FigureId(NamedTuple):
    """Identity of a key figure, by which runs are compared; as text quantity/subject/statistic.

    Attributes:
        quantity: a row of `QUANTITIES`, as rope_tension.
        subject: key in the scenario, as ropes.up, towers.t2, carriages.cabin; "solver"; a+b for a pair.
        statistic: highest, lowest, mean or standard deviation.
    """

    quantity: str
    subject: str
    statistic: str

    def __str__(self) -> str:
        """Identity of a key figure as text quantity/subject/statistic, read back by `of_text`."""
        return "/".join(self)

    @classmethod
    def of_text(cls, text: str) -> FigureId:
        """Identity of a key figure from its text quantity/subject/statistic.

        Raises:
            ValueError: the text has another form; one line.
        """
        quantity, _, rest = text.partition("/")
        subject, _, statistic = rest.rpartition("/")
        if not (quantity and subject and statistic):
            raise ValueError(f"id: given {text!r}; allowed: quantity/subject/statistic")
        return cls(quantity, subject, statistic)

    @classmethod
    def of_known(cls, text: str) -> FigureId:
        """Identity of a key figure from its text, with a quantity of `QUANTITIES` and one of its statistics.

        Raises:
            ValueError: another form, quantity or statistic; one line.
        """
        found = cls.of_text(text)
        row = QUANTITIES.get(found.quantity)
        if row is None:
            near = get_close_matches(found.quantity, QUANTITIES, n=1)
            hint = f"did you mean {near[0]}?" if near else "allowed: those of `rules --vocabulary`"
            raise ValueError(f"quantity: given {found.quantity!r}; {hint}")
        if found.statistic not in row.statistics:
            own = f"{found.quantity}/{found.subject}"
            raise ValueError(f"id: given {text!r}; allowed: {' or '.join(f'{own}/{one}' for one in row.statistics)}")
        return found


class Subject(NamedTuple):
    """Subject of key figures: part of the figure's id, and printed name, empty where no name is printed."""

    key: str
    name: str = ""


def haul_rope_of(scenario: Scenario, carriage: str) -> Subject:
    """Subject of the key figures of the haul rope in the drive of a carriage."""
    return Subject(scenario.haul_rope_key(carriage), f"haul rope of {carriage}")


@dataclass(frozen=True, slots=True)
class KeyFigure:
    """One key figure of a run with its limit."""

    id: FigureId
    name: str  # printed
    value: float
    unit: str
    time: float  # s, simulated
    place: str = ""  # of the extreme, with unit
    limit: float | None = None
    bound: Bound = "at most"
    source: str = ""  # of the limit
    uncertainty: float | None = None  # difference from a run with finer mesh and step; None without one
    band: str = ""  # samples of the extreme: means over a time, frames, or steps
    unfinished: bool = False  # still growing at the end of the run, as the distance of a stop that is not over

    @property
    def kept(self) -> bool | None:
        """Whether the value complies with its limit, but for rounding.

        None without a limit, within the uncertainty, and for an unfinished value that has not reached its limit.
        """
        if self.limit is None or (self.unfinished and self._keeps(self.value)):
            return None
        off = self.uncertainty or 0.0
        keeps = self._keeps(self.value - off)
        return keeps if self._keeps(self.value + off) == keeps else None

    @property
    def verdict(self) -> str:
        """Compliance with the limit in words, "not decided" within the uncertainty; empty without a limit."""
        if self.limit is None:
            return ""
        return {None: "not decided", True: "kept", False: "not kept"}[self.kept]

    def __reduce__(self) -> tuple[type[KeyFigure], tuple[Any, ...]]:
        """Class and constructor arguments for pickling; takes half the time of the default for a dataclass."""
        return KeyFigure, tuple([getattr(self, name) for name in self.__slots__])

    def _keeps(self, value: float) -> bool:
        assert self.limit is not None
        beyond = value - self.limit if self.bound == "at most" else self.limit - value
        return beyond <= TOLERANCE * abs(self.limit)

    def limited(self, limit: float | None, source: str) -> KeyFigure:
        """Copy with a limit and its source, as upper or lower bound according to the statistic; unchanged for None."""
        if limit is None:
            return self
        return replace(self, limit=limit, bound=bound_of(self.id.statistic), source=source)

    def limited_by(self, scenario: Scenario, *, clamped: bool = False, hauls: bool = False) -> KeyFigure:
        """Copy with the limit for its quantity from a scenario's `limits`, else the usual limit, if there is any."""
        if not QUANTITIES[self.id.quantity].limit:
            return self
        return self.limited(*limit_of(scenario, self.id.quantity, clamped=clamped, hauls=hauls))


def figure(
    quantity: str, subject: Subject, statistic: str, value: float, time: float, place: str = "", *, detail: str = ""
) -> KeyFigure:
    """Key figure of a quantity in the table `QUANTITIES`, with its printed name and without a limit.

    Args:
        quantity: row of `QUANTITIES`.
        subject: subject of the figure.
        statistic: highest, lowest, mean or standard deviation.
        value: in the unit of the quantity.
        time: s, when it was reached.
        place: where, with unit.
        detail: for the {} of the name.
    """
    row = QUANTITIES[quantity]
    told = len(row.statistics) > 1 and not row.name.startswith(statistic)
    name = row.name.format(detail) + (f", {statistic}" if told else "")
    name = f"{subject.name}: {name}" if subject.name else name
    return KeyFigure(FigureId(quantity, subject.key, statistic), name, value, row.unit, time, place)


def as_statistic(one: KeyFigure, statistic: str) -> KeyFigure:
    """Copy of a key figure as another statistic of its quantity, in id and name.

    Args:
        one: key figure of a quantity with several statistics, and without a detail in its name.
        statistic: highest, lowest, mean or standard deviation.
    """
    subject = Subject(one.id.subject, one.name.rpartition(": ")[0])
    other = figure(one.id.quantity, subject, statistic, one.value, one.time)
    return replace(one, id=other.id, name=other.name)


class NotJudged(NamedTuple):
    """Limit that judges no key figure of a run: its key in `limits`, the scenario key that is missing, else why."""

    limit: str
    missing: str = ""
    reason: str = "the run has no such key figure"

    def told(self, say: Callable[[str], str] = str) -> str:
        """Text of the limit and the reason why it judges nothing; `say` translates its words."""
        reason = f"{self.missing} {say('is not given')}" if self.missing else say(self.reason)
        return f"{say('not judged')}: limits.{self.limit}: {reason}"


def not_judged(scenario: Scenario, figures: Iterable[KeyFigure]) -> list[NotJudged]:
    """Limits by which no key figure of a run is judged: safety factors of ropes, and others unlike their default."""
    found, figures = [], list(figures)
    for name, cable in scenario.cables.items():
        if limit_of(scenario.of_rope(name), "rope_safety_factor")[0] and cable.breaking_force is None:
            found.append(NotJudged("rope_safety_factor", f"{scenario.rope_key(name)}.breaking_force"))
    for name, rope in scenario.haul_ropes.items():
        if rope.breaking_force is None:
            found.append(NotJudged("haul_rope_safety_factor", f"{scenario.haul_rope_key(name)}.breaking_force"))
    judged = {QUANTITIES[one.id.quantity].limit for one in figures if one.limit is not None}
    known = {row.limit for row in QUANTITIES.values() if row.limit} - {"rope_safety_factor"}
    # by value, as a recorded scenario has all keys
    given = {key for key in known if getattr(scenario.limits, key) not in (None, 0.0, limit_row(key).default)}
    started_later = {one.id.quantity for one in figures if one.limit is None} & {"dynamic_amplification"}
    return found + [
        NotJudged(key, reason=REST_UNKNOWN) if key in started_later else NotJudged(key)
        for key in sorted(given - judged)
    ]


def values_of(figure: KeyFigure) -> dict[str, str]:
    """Key figure as the text values of a diagnostic status; inverse of `figure_from_values`, exact to the last bit."""
    values = {"value": repr(float(figure.value)), "unit": figure.unit, "time_s": repr(float(figure.time))}
    values |= {"place": figure.place, "band": figure.band, "id": str(figure.id)}
    if figure.unfinished:
        values["unfinished"] = "true"
    if figure.limit is not None:
        values |= {"limit": repr(float(figure.limit)), "bound": figure.bound, "source": figure.source}
    return values


def figure_from_values(name: str, values: Mapping[str, str]) -> KeyFigure:
    """Key figure of a name from the text values written by `values_of`.

    Raises:
        ValueError: a value is missing or no number; one line.
    """
    try:
        id_ = FigureId.of_text(values["id"])
        figure = KeyFigure(id_, name, float(values["value"]), values["unit"], float(values["time_s"]))
        figure = replace(figure, place=values.get("place", ""), band=values.get("band", ""))
        figure = replace(figure, unfinished="unfinished" in values)
        if "limit" not in values:
            return figure
        bound, limit = values["bound"], float(values["limit"])
        if bound not in get_args(Bound):
            raise ValueError(f"bound: given {bound!r}; allowed: {', '.join(get_args(Bound))}")
        return replace(figure, limit=limit, bound=cast(Bound, bound), source=values.get("source", ""))
    except KeyError as error:
        raise ValueError(f"key figure {name!r}: {error.args[0]}: given nothing; allowed: a value") from None
    except ValueError as error:
        raise ValueError(f"key figure {name!r}: {error}") from None
