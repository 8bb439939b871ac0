"""Metadata record of a bag: checks before use, and a second copy of the scenario."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cable_twin.messages import SECOND
from cable_twin.recording.log_versions import LogError, check_format

LOST_FROM = "commands_lost_from"  # stamp (ns since 1970) after which commands are missing, of a file that was repaired
SCENARIO_TEXT, SCENARIO_CHECKSUM = "scenario_text", "scenario_crc32"
LATEST = 2**31 * SECOND  # ns since 1970, what the stamp of a message has room for
NUMBERS = {  # key: lowest and highest, what it is a number of, and whether it may be left out
    "epoch_ns": (0, LATEST - 1, "nanoseconds", False),
    "sample_count": (2, 100_000, "points", False),
    LOST_FROM: (0, LATEST - 1, "nanoseconds", True),
}
DIGITS = 19
SHOWN = 40  # characters of what is given


def check_metadata(file: Path, metadata: Mapping[str, str]) -> None:
    """Refuse a bag with metadata that do not belong to a run.

    Raises:
        LogError: with what is given, and what is allowed.
    """
    version = metadata.get("format_version", "")
    if len(version) > DIGITS:
        raise LogError(f"{file}: format version {_shown(version)}; allowed: a number of {DIGITS} digits at most")
    check_format(file, metadata)
    for key, (low, high, unit, optional) in NUMBERS.items():
        given = metadata.get(key, "")
        if not given and optional:
            continue
        sound = len(given) <= DIGITS and given.isascii() and given.isdecimal()
        if not (sound and low <= int(given) <= high):
            raise LogError(f"{file}: {key} is {_shown(given)}, a whole number of {unit} is expected, {low} to {high}")
    try:
        remapped = json.loads(metadata.get("remapped", "{}"))
    except (ValueError, RecursionError):
        remapped = None
    if not isinstance(remapped, dict) or not all(isinstance(name, str) for name in remapped.values()):
        raise LogError(f"{file}: remapped is {_shown(metadata['remapped'])}, names of topics by others are expected")


def scenario_metadata(scenario: Mapping[str, Any]) -> dict[str, str]:
    """Resolved scenario with checksum for the metadata of a file, in case the chunk with its message is damaged."""
    text = json.dumps(scenario, ensure_ascii=False)
    return {SCENARIO_TEXT: text, SCENARIO_CHECKSUM: str(zlib.crc32(text.encode()))}


def scenario_of_metadata(metadata: Mapping[str, str]) -> dict[str, Any] | None:
    """Scenario from the metadata of a file; None where missing or damaged, by a checksum of its own."""
    text = metadata.get(SCENARIO_TEXT, "")
    if metadata.get(SCENARIO_CHECKSUM) != str(zlib.crc32(text.encode())):
        return None
    try:
        scenario = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return scenario if isinstance(scenario, dict) else None


def _shown(given: str) -> str:
    return repr(given if len(given) <= SHOWN else f"{given[:SHOWN]}...")


__all__ = ["LATEST", "LOST_FROM", "check_metadata", "scenario_metadata", "scenario_of_metadata"]
