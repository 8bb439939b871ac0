"""Origin: intended use, inputs with sources, versions, and the command that made the report."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cable_twin.offline.reporting.results import Results
from cable_twin.offline.reporting.sections.assumptions import grouped
from cable_twin.offline.reporting.texts import Texts


class Origin:
    """Section with what the results come from."""

    title = "Inputs, versions and use"
    template = "origin.html"

    def content(self, results: Results, texts: Texts) -> Mapping[str, Any] | None:
        """Inputs that are not assumed, sources and versions."""
        inputs = results.inputs
        return {
            "groups": grouped([one for one in inputs.rows if not one.assumed]),
            "file": inputs.file.name if inputs.file is not None else "",
            "sources": [(texts(name), text) for name, text in results.sources],
        }
