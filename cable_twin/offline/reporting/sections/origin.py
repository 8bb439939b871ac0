"""Section of a report on its origin: intended use, inputs with sources, versions, command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections.assumptions import grouped
from cable_twin.offline.reporting.texts import Texts


class Origin:
    """Section of a report with the origin of its results: inputs with sources, versions."""

    title = "Inputs, versions and use"
    template = "origin.html"

    def content(self, results: Results, texts: Texts) -> Mapping[str, Any] | None:
        """Template data of the section: inputs that are not assumed, scenario file, sources and versions."""
        inputs = results.inputs
        return {
            "groups": grouped([one for one in inputs.rows if not one.assumed]),
            "file": inputs.file,
            "sources": [(texts(name), text) for name, text in results.sources],
        }
