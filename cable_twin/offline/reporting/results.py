"""Results that a report shows: of a run, of an envelope of load cases, or of a study."""

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
    """Error of a file without usable results for a report; the message is one line."""


@dataclass(frozen=True, slots=True)
class RopeCourse:
    """Course of one rope over a run or over load cases: lowest heights, clearances, range of tension.

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
    """Highest and least force of a rope on a tower over a run or over load cases.

    Attributes:
        subject: part of the ids of the tower's figures, as towers.tower_1_up.
        tower: name of the support.
        place: (3,) m.
        force: (3,) N, of the rope on the tower, with the highest load; NaN where not known.
        least: (3,) N, with the least load; NaN where not known.
    """

    subject: str
    tower: str
    place: FloatArray
    force: FloatArray
    least: FloatArray


@dataclass(frozen=True, slots=True)
class Case:
    """Load case or case of a study, with its changes of the scenario.

    Attributes:
        id: of the case.
        name: name for people.
        changes: values by dotted key.
        fault: reason why the case has no result; empty with a result.
        moves: whether the case is a run, and not a line at rest.
        not_kept: number of limits that a case of a study does not keep; 0 for a load case.
    """

    id: str
    name: str
    changes: Mapping[str, object] = field(default_factory=dict)
    fault: str = ""
    moves: bool = False
    not_kept: int = 0


class StudyRange(NamedTuple):
    """Range of a key figure over the cases of a study.

    Attributes:
        extreme: end of the range by the statistic of the figure.
        case: id of the case with this extreme.
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
    """First-order and total Sobol index of a key for a key figure, each with the ends of its confidence interval."""

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
    """Results of a run, of load cases or of a study: data of all sections of a report.

    Attributes:
        title: of the report.
        scenario: of the run, or the base scenario of the cases.
        figures: key figures, or extremes of load cases.
        inputs: of the scenario, with remarks.
        governing: id of the load case that governs a figure; empty for a run.
        kind: subject of the report, in English.
        at: meaning of the time of a figure, and its unit.
        profiles: rule profiles, with their verdicts on the figures.
        ropes: courses of the ropes.
        towers: forces on towers, of a run.
        signals: signals over time, of a run.
        commands: time (s) and text of commands, of a run.
        lives: counts for the life of each rope, of a run.
        trips: trips in a year; None where not given.
        cases: load cases.
        factors: keys that a study varies, with their values.
        ranges: ranges of key figures over the cases of a study.
        indices: Sobol indices of a study.
        sources: name and text of each source of the results: inputs, program, versions.
        notes: warnings for the reader, as of a missing rule profile.
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
