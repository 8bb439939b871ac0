"""Sections of a report, each a function with a template of its own; a new section is a file and a row of `SECTIONS`."""

from __future__ import annotations

from collections.abc import Sequence

from cable_twin.offline.reporting.sections.assumptions import assumptions, origin
from cable_twin.offline.reporting.sections.figures import key_figure_table
from cable_twin.offline.reporting.sections.load_cases import load_cases
from cable_twin.offline.reporting.sections.profile import line_profile
from cable_twin.offline.reporting.sections.rope_life import rope_life_counts
from cable_twin.offline.reporting.sections.rules import rules
from cable_twin.offline.reporting.sections.section import Section
from cable_twin.offline.reporting.sections.study import study
from cable_twin.offline.reporting.sections.tension import tension_diagram
from cable_twin.offline.reporting.sections.time_plots import time_plots
from cable_twin.offline.reporting.sections.tower_loads import tower_loads

SECTIONS: Sequence[Section] = (  # in the order of the page
    Section("Study", "study.html", study),
    Section("Line profile", "profile.html", line_profile),
    Section("Rope tension", "tension.html", tension_diagram),
    Section("Tower loads", "tower_loads.html", tower_loads),
    Section("Key figures", "figures.html", key_figure_table),
    Section("Rules", "rules.html", rules),
    Section("Load cases", "load_cases.html", load_cases),
    Section("Over time", "time_plots.html", time_plots),
    Section("Rope life", "rope_life.html", rope_life_counts),
    Section("Assumptions", "assumptions.html", assumptions),
    Section("Inputs, versions and use", "origin.html", origin),
)
