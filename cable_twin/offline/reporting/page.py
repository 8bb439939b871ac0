"""HTML page of a report: all sections in one self-contained file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timezone
from typing import TYPE_CHECKING

from cable_twin.basics.units import with_unit
from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections import SECTIONS
from cable_twin.offline.reporting.sections.figures import limits_summary
from cable_twin.offline.reporting.sections.rules import rules_summary
from cable_twin.offline.reporting.sections.section import Section
from cable_twin.offline.reporting.texts import Texts

if TYPE_CHECKING:
    from jinja2 import Environment


UNITS = {"m/s^2": "m/s²", "N/mm^2": "N/mm²", "kg/m^3": "kg/m³", "kg m^2": "kg m²"}  # as they are printed


def write_page(
    results: Results, texts: Texts, command: str, version: str, sections: Sequence[Section] = SECTIONS
) -> str:
    """HTML text of the page of a report, with all drawings and styles in it.

    Args:
        results: results to show.
        texts: texts in the language of the page.
        command: command that makes the report, with its options.
        version: of this package.
        sections: sections in their order.
    """
    environment = _environment(texts)
    parts = []
    for one in sections:
        content = one.content(results, texts)
        if content is not None:
            body = environment.get_template(one.template).render(**content, results=results)
            parts.append((anchor(one.title), texts(one.title), body))
    page = environment.get_template("page.html").render(
        results=results,
        parts=parts,
        language=texts.language,
        limits=limits_summary(results, texts),
        rules=rules_summary(results, texts),
        command=command,
        version=version,
        made=f"{datetime.now(timezone.utc):%Y-%m-%d %H:%M} UTC",
    )
    for plain, raised in UNITS.items():
        page = page.replace(plain, raised)
    return re.sub(r"\n\s*\n+", "\n", page)


def anchor(title: str) -> str:
    """HTML anchor of a section of a report from its English title."""
    return re.sub(r"[^a-z]+", "_", title.lower()).strip("_")


def _environment(texts: Texts) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined  # noqa: PLC0415 - an extra

    loader = PackageLoader("cable_twin.offline.reporting", "templates")
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.globals |= {"t": texts, "with_unit": with_unit}
    return environment
