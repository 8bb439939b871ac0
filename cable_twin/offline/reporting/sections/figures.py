"""Section of a report with the table of key figures: value, limit, its source with clause, verdict."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cable_twin.key_figures import not_judged
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections.section import row_of
from cable_twin.offline.reporting.texts import Texts


def key_figure_table(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Key figures: rows of the table, notes, sources of limits; None without key figures.

    None for a study, too, whose ranges have them all.
    """
    if results.ranges:
        return None
    rows = [row_of(one, results, texts) for one in results.figures]
    notes = list(dict.fromkeys(row.note for row in rows if row.note))
    sources = list(dict.fromkeys(row.source for row in rows if row.source))
    content = {"rows": rows, "notes": notes, "sources": sources, "several": bool(results.governing)}
    return content if rows else None


def limits_summary(results: Results, texts: Texts) -> tuple[str, list[str]]:
    """Text with the count of kept limits, and lines with the key figures that do not keep theirs.

    For a study, whose table of results has no limits, text with the count of cases that do not keep one.
    """
    if results.ranges:
        broken = sum(one.not_kept > 0 for one in results.cases)
        told = f"{broken} {texts('of')} {len(results.cases)} {texts('cases miss a limit')}"
        return f"{texts('not judged here')}: {told}", []
    limited = [one for one in results.figures if one.limit is not None]
    passed = [one for one in limited if one.verdict != "kept"]
    unjudged = [one.told(texts) for one in not_judged(results.scenario, results.figures)]
    if not limited:
        return texts("no key figure has a limit"), unjudged
    told = f"{len(limited) - len(passed)} {texts('of')} {len(limited)} {texts('limits are kept')}"
    return told, [f"{texts.figure(one)}: {texts(one.verdict)}" for one in passed] + unjudged
