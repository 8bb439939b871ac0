"""Version of the bag that is written and read, and the refusal of others."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

FORMAT_VERSION = "4"


class LogError(ValueError):
    """A file that is no readable log of this package: one line with the file and what is wrong."""


def check_format(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a format that this version does not know; a newer one says what to do.

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
