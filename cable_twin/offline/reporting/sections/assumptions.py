"""Sections of a report on its inputs: assumptions, and origin with sources, versions and intended use."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any

from cable_twin.offline.reporting.remarks import NONE, Input
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections.section import row_of
from cable_twin.offline.reporting.texts import Texts


def assumptions(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Assumptions: assumed inputs, defaults, limits and ways of sampling."""
    inputs = results.inputs
    limits: dict[tuple[str, str, str], int] = {}  # number of figures by quantity, limit and its source
    for one in results.figures:
        if one.source.startswith("assumed"):
            row = row_of(one, results, texts)
            key = texts.quantity(one.id.quantity), row.limit, row.source
            limits[key] = limits.get(key, 0) + 1
    bands = list(dict.fromkeys(texts.phrase(one.band) for one in results.figures if "assumed" in one.band))
    return {
        "head": inputs.head,
        "groups": grouped([one for one in inputs.rows if one.assumed]),
        "defaults": inputs.defaults,
        "limits": limits,
        "bands": bands,
        "none": NONE,
        "count": sum(one.assumed for one in inputs.rows),
        "all": len(inputs.rows),
    }


def grouped(rows: list[Input]) -> list[list[Input]]:
    """Group successive inputs of one scenario section with an equal remark."""
    return [list(group) for _, group in groupby(rows, key=lambda one: (one.key.rpartition(".")[0], one.remark))]


def origin(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Inputs, versions and use: inputs that are not assumed, scenario file, sources, versions."""
    inputs = results.inputs
    return {
        "groups": grouped([one for one in inputs.rows if not one.assumed]),
        "file": inputs.file,
        "sources": [(texts(name), text) for name, text in results.sources],
    }
