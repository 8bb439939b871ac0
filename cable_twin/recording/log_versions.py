"""Versions of the bag: which one is written, which ones are read, and what older ones have otherwise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

FORMAT_VERSION = "3"
ABSOLUTE_FORMATS = ("1", "2")  # with the pitch of each body instead of its joint, and all forces in one frame
READABLE_FORMATS = (*ABSOLUTE_FORMATS, FORMAT_VERSION)


class LogError(ValueError):
    """A file that is no readable log of this package: one line with the file and what is wrong."""


def check_format(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a format that this version does not know; a newer one says what to do.

    Raises:
        LogError: with what the file is, and what is read.
    """
    given = metadata.get("format_version", "")
    if given in READABLE_FORMATS:
        return
    if given.isdecimal() and int(given) > int(FORMAT_VERSION):
        raise LogError(
            f"{file}: format version {given} is newer than this cable_twin reads ({FORMAT_VERSION}); "
            f"update cable_twin: the log was made by {metadata.get('package_version', 'an unknown version')}"
        )
    raise LogError(f"{file}: format version {given!r}, this package reads {', '.join(READABLE_FORMATS)}")
