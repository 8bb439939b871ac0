"""Section of a report on load cases with the figures that each governs, or on the commands of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any

from cable_twin.offline.reporting.remarks import change_text
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections.section import row_of
from cable_twin.offline.reporting.texts import Texts

MOST = 200  # commands or cases in the table


def load_cases(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Load cases: tables of cases, governing figures and commands."""
    governed = Counter(results.governing.values())
    return {
        "cases": [
            (one, "; ".join(change_text(*change) for change in one.changes.items()), governed[one.id])
            for one in results.cases[:MOST]
        ],
        "more_cases": max(len(results.cases) - MOST, 0),
        "governing": [row_of(one, results, texts) for one in results.figures] if results.governing else [],
        "commands": results.commands[:MOST],
        "more_commands": max(len(results.commands) - MOST, 0),
        "stated": results.scenario.limits.load_cases,
        "is_run": not results.cases,
    }
