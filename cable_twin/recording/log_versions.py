"""Version of the bag format, and refusal of other versions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

FORMAT_VERSION = "4"


class LogError(ValueError):
    """File that is no readable log of this package: one line with the file and its fault."""


def check_format(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse an unknown log format, with advice where it is a newer one.

    Raises:
        LogError: with what the file is, and what is read.
    """
    given = metadata.get("format_version", "")
    if given == FORMAT_VERSION:
        return
    if given.isdecimal() and int(given) > int(FORMAT_VERSION):
        raise LogError(
            f"{file}: format version {given} is newer than this cable_twin reads ({FORMAT_VERSION}); "
            f"update cable_twin: the log was made by {metadata.get('package_version', 'an unknown version')}"
        )
    raise LogError(
        f"{file}: format version {given!r}, this cable_twin reads {FORMAT_VERSION}; "
        f"made by cable_twin {metadata.get('package_version', '(unknown)')}, which replays it"
    )
