"""Sections of a report, each a class with a template of its own; a new section is a file and a row of `SECTIONS`."""

from __future__ import annotations

from collections.abc import Sequence

from cable_twin.offline.reporting.sections.assumptions import Assumptions, Origin
from cable_twin.offline.reporting.sections.figures import KeyFigureTable
from cable_twin.offline.reporting.sections.load_cases import LoadCases
from cable_twin.offline.reporting.sections.profile import LineProfile
from cable_twin.offline.reporting.sections.rope_life import RopeLifeCounts
from cable_twin.offline.reporting.sections.rules import Rules
from cable_twin.offline.reporting.sections.section import Section
from cable_twin.offline.reporting.sections.study import Study
from cable_twin.offline.reporting.sections.tension import TensionDiagram
from cable_twin.offline.reporting.sections.time_plots import TimePlots
from cable_twin.offline.reporting.sections.tower_loads import TowerLoads

SECTIONS: Sequence[Section] = (  # in the order of the page
    Study(),
    LineProfile(),
    TensionDiagram(),
    TowerLoads(),
    KeyFigureTable(),
    Rules(),
    LoadCases(),
    TimePlots(),
    RopeLifeCounts(),
    Assumptions(),
    Origin(),
)
