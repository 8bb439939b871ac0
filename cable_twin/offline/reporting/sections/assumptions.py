"""Sections of a report on its inputs: assumptions, and origin with sources, versions and intended use."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import groupby
from typing import Any, NamedTuple

from cable_twin.offline.reporting.remarks import CHANGED, NONE, Input
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
        "groups": grouped([one for one in inputs.rows if one.assumed], texts),
        "defaults": inputs.defaults,
        "limits": limits,
        "bands": bands,
        "none": NONE,
        "count": sum(one.assumed for one in inputs.rows),
        "all": len(inputs.rows),
    }


class InputRow(NamedTuple):
    """Row of the table of inputs: key of a section, or of one input, values by last part of their key, remark."""

    key: str
    values: list[tuple[str, str]]
    remark: str


def grouped(rows: list[Input], texts: Texts) -> list[InputRow]:
    """Rows of a table of inputs: those of one scenario section with an equal remark are one row.

    The points of a list have no numbers, and a remark is not repeated by the sections after it that stand beside it.
    """
    found: list[InputRow] = []
    above = "", ""
    for (section, remark), group in groupby(rows, key=lambda one: (one.key.rpartition(".")[0], one.remark)):
        own = list(group)
        names = [one.key.rpartition(".")[2] for one in own]
        if all(map(str.isdigit, names)):
            points = own[0]._replace(value=", ".join(one.value for one in own))
            key, values = section, [("", _with_unit(points))]
        elif len(own) == 1:
            key, values = own[0].key, [("", _with_unit(own[0]))]
        else:
            key, values = section, [(name, _with_unit(one)) for name, one in zip(names, own, strict=True)]
        whose = section.rpartition(".")[0], remark
        ours = remark in (NONE, CHANGED)
        told = texts(remark) if ours else texts("as above") if whose == above else remark
        found.append(InputRow(key, values, told))
        above = whose
    return found


def _with_unit(one: Input) -> str:
    """Value of an input with its unit, if it has one."""
    return f"{one.value} {one.unit}" if one.unit not in ("", "-") else one.value


def origin(results: Results, texts: Texts) -> Mapping[str, Any] | None:
    """Data of the section Inputs, versions and use: inputs that are not assumed, scenario file, sources, versions."""
    inputs = results.inputs
    return {
        "groups": grouped([one for one in inputs.rows if not one.assumed], texts),
        "file": inputs.file,
        "sources": [(texts(name), text) for name, text in results.sources],
    }
