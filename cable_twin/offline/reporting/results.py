"""Results that a report shows, from a log or from an envelope of load cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from cable_twin.frame.records import FloatArray
from cable_twin.key_figures import FigureId, KeyFigure
from cable_twin.key_figures.rules import Profile, RuleVerdict
from cable_twin.offline.reporting.remarks import Inputs
from cable_twin.offline.reporting.rope_life import RopeLife
from cable_twin.offline.thinned_series import Signals
from cable_twin.scenario import Scenario


class ResultsError(ValueError):
    """Error of a file that is no results; one line."""


@dataclass(frozen=True, slots=True)
class RopeCourse:
    """Course of one rope over a run or over load cases.

    Attributes:
        name: of the rope.
        arc_lengths: (n,) m, unstrained, of the samples.
        shape: (n, 3) m, samples at the start, or at rest.
        x: (m,) m, places of `lowest`.
        lowest: (m,) m, lowest height at each x; NaN where the rope never was.
        clearance: (m,) m, least height over the terrain at each x; NaN without terrain.
        tension: (2, n) N, lowest and highest at each sample.
    """

    name: str
    arc_lengths: FloatArray
    shape: FloatArray
    x: FloatArray
    lowest: FloatArray
    clearance: FloatArray
    tension: FloatArray


@dataclass(frozen=True, slots=True)
class TowerLoad:
    """Force of a rope on a tower when it was highest.

    Attributes:
        subject: part of the ids of its figures, as towers.tower_1_up.
        tower: name of the support.
        place: (3,) m.
        force: (3,) N, of the rope on the tower; NaN where not known.
    """

    subject: str
    tower: str
    place: FloatArray
    force: FloatArray


@dataclass(frozen=True, slots=True)
class Case:
    """Load case with the changes that make it, or a command of a run.

    Attributes:
        id: of the case.
        name: what it stands for.
        changes: values by dotted key.
        fault: why it has no result; empty with one.
        moves: whether it is a run, and not a line at rest.
    """

    id: str
    name: str
    changes: Mapping[str, object] = field(default_factory=dict)
    fault: str = ""
    moves: bool = False


class StudyRange(NamedTuple):
    """Range of a key figure over the cases of a study.

    Attributes:
        extreme: the end that its statistic is about.
        case: id of the case with that.
        low: lowest value, in the unit of the figure, with the id of its case.
        high: highest value with the id of its case.
        having: number of cases that have the figure.
    """

    extreme: KeyFigure
    case: str
    low: tuple[float, str]
    high: tuple[float, str]
    having: int


class SobolIndex(NamedTuple):
    """First-order and total index of a key for a key figure, each with the ends of its interval of confidence."""

    figure: str  # id
    name: str  # printed, of the figure
    key: str
    first: float
    first_low: float
    first_high: float
    total: float
    total_low: float
    total_high: float


@dataclass(slots=True)
class Results:
    """All that the sections of a report show.

    Attributes:
        title: of the report.
        scenario: of the run, or the one that the load cases change.
        figures: key figures, or extremes of load cases.
        inputs: of the scenario, with remarks.
        governing: id of the load case that governs a figure; empty for a run.
        kind: what the report is of, in English.
        at: what the time of a figure is, and its unit.
        profiles: rule profiles, with their verdicts on the figures.
        ropes: courses of the ropes.
        towers: forces on towers, of a run.
        signals: signals over time, of a run.
        commands: time (s) and text of commands, of a run.
        lives: counts for the life of each rope, of a run.
        trips: trips in a year; None where not given.
        cases: load cases.
        factors: key and values of what a study varies.
        ranges: of key figures over the cases of a study.
        indices: of a study.
        sources: name and content of each input and of what made the results.
        notes: of what the reader has to know, as a log that is damaged.
    """

    title: str
    scenario: Scenario
    figures: Sequence[KeyFigure]
    inputs: Inputs
    governing: Mapping[FigureId, str] = field(default_factory=dict)
    kind: str = "a run"
    at: tuple[str, str] = ("at", "s")
    profiles: Sequence[Profile] = ()
    verdicts: Sequence[RuleVerdict] = ()
    ropes: Sequence[RopeCourse] = ()
    towers: Sequence[TowerLoad] = ()
    signals: Signals | None = None
    commands: Sequence[tuple[float, str]] = ()
    lives: Sequence[RopeLife] = ()
    trips: float | None = None
    cases: Sequence[Case] = ()
    factors: Sequence[tuple[str, str]] = ()
    ranges: Sequence[StudyRange] = ()
    indices: Sequence[SobolIndex] = ()
    sources: Sequence[tuple[str, str]] = ()
    notes: Sequence[str] = ()
