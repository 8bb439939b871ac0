"""German texts of a report, by their English form, and German names of quantities."""

from __future__ import annotations

from collections.abc import Mapping

TEXTS: Mapping[str, str] = {}
QUANTITIES: Mapping[str, str] = {}
