"""Scenario files: search, reading, overrides, and report of all errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache
from os.path import isfile
from pathlib import Path
from typing import Any

import numpy as np

from cable_twin.basics.limited_yaml import Document, UnreadableYamlError, limited_text, read_yaml
from cable_twin.basics.printable import printable
from cable_twin.scenario.checks.fault import Fault, Phrase, listed, refuse, show
from cable_twin.scenario.checks.find_faults import find_faults
from cable_twin.scenario.overrides import (
    UnknownKeyError,
    Written,
    expand_bullwheels,
    faults_in_file,
    full_key,
    override,
)
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import KINKS, warn_of_kinks

LONGEST_DESCRIPTION = 400  # characters in a list
LONGEST_NAME = 200  # characters of the name of a file that becomes that of a scenario
SUFFIXES = (".yaml", ".yml")
SCALARS = (float, int, str, bool, type(None))


class ScenarioError(ValueError):
    """Exception for an invalid scenario; its text has one line for each error found.

    Attributes:
        faults: lines with file, key path, given and allowed value, and unit.
    """

    def __init__(self, *faults: str) -> None:
        super().__init__(*faults)
        self.faults = faults

    def __str__(self) -> str:
        return "\n".join(self.faults)


def load_scenario(
    source: str | Path | Mapping[str, Any], overrides: Mapping[str, Any] | None = None, *, label: str = "mapping"
) -> Scenario:
    """Read a scenario by name, from a file or from a mapping.

    Args:
        source: name of a scenario in the config directory, path of a YAML file, or the content of one.
        overrides: values by dotted key, as in `{"cable.elements": 48, "wind.x": 12.0}`; a key may end in a list, with
            an axis or a number from 0 on, and a whole named section may be new.
        label: what a mapping is called in errors.

    Returns:
        The scenario, with defaults for keys that are not given.

    Raises:
        ScenarioError: the scenario is invalid; one line for each fault.
    """
    if isinstance(source, Mapping):
        return _build(label, "custom", source, [], overrides or {})
    file = scenario_file(source)
    return _build(str(file), file.stem, *_read(file), overrides or {})


def parse_scenario(text: str) -> Scenario:
    """Read a scenario from a YAML text.

    Raises:
        ScenarioError: the text is invalid; one line for each fault.
    """
    return _build("text", "custom", *_parse(text, "text"), {})


def _without_kinks(given: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield all scenario overrides but those of the obsolete key `kinks` of ropes, with a warning for these."""
    for key, value in given.items():
        parts = key.split(".")
        if parts[-1] == "kinks" and value in KINKS and (parts[0], len(parts)) in (("cable", 2), ("ropes", 3)):
            warn_of_kinks()
        else:
            yield key, value


def _build(label: str, name: str, content: Any, faults: list[Fault], overrides: Mapping[str, Any]) -> Scenario:
    """Build a scenario from parsed content, or raise ScenarioError with all errors, a line each, after `label`."""
    try:
        data = _plain(content, (), faults)
        if not isinstance(data, dict):
            raise ScenarioError(f"{label}: {refuse((), data, 'a mapping with the keys of a scenario').text}")
        if not isinstance(overrides, Mapping):
            fault = refuse((), overrides, "a mapping of dotted keys to values")
            raise ScenarioError(f"{label}: overrides: {fault.text}")
        written = Written(data)
        data = written.data
        faults += written.faults
        given = dict(_without_kinks({full_key(str(key)): value for key, value in overrides.items()}))
        values = {key: _plain(value, tuple(key.split(".")), faults) for key, value in given.items()}
        # whole sections before keys in them
        values = dict(sorted(values.items(), key=lambda one: written.depth(one[0])))
        unknown: list[Fault] = []  # of overrides whose keys do not exist
        others = []
        for key, value in values.items():
            with _kept(unknown):
                others += [] if written.put(key, value) else [key]
        if in_file := list(faults_in_file(data)):
            raise ScenarioError(*_lines(label, [*faults, *in_file], written))
        data = expand_bullwheels(data)
        for given_key, key in written.expanded(others, data):
            value = values[given_key]
            if other := _of_other_ropes(data, key, value):
                faults.append(other)
                continue
            with _kept(unknown):
                if (changed := override(data, key, value)) != tuple(key.split(".")):  # the list that it is in
                    written.give(written.path(changed))
    except RecursionError:
        raise ScenarioError(f"{label}: nested too deeply; allowed: the keys of a scenario") from None
    data.setdefault("name", printable(name, LONGEST_NAME))
    scenario, found = find_faults(data)
    faults += unknown
    faults += [fault for fault in found if fault not in faults]
    if scenario is None or faults:
        raise ScenarioError(*_lines(label, faults, written, unknown))
    return scenario


def _of_other_ropes(data: dict[str, Any], key: str, value: Any) -> Fault | None:
    """Fault of an override of the one cable in a scenario with several ropes, or of a rope in one with a cable."""
    section, *below = key.split(".")
    ropes = data.get("ropes")
    if section == "cable" and ropes and isinstance(ropes, dict):
        known = listed([f"ropes.{name}" for name in ropes], "")
        return refuse((section, *below), value, known, "with several ropes")
    if section == "ropes" and len(below) > 1 and not ropes and "cable" in data:
        return refuse((section, *below), value, ".".join(("cable", *below[1:])), "with one cable")
    return None


@contextmanager
def _kept(faults: list[Fault]) -> Iterator[None]:
    """Context manager that catches UnknownKeyError and appends its error message to `faults`."""
    try:
        yield
    except UnknownKeyError as error:
        faults.append(error.fault)


def scenario_names() -> list[str]:
    """Names of the scenarios in the config directory, sorted; files of node parameters are not scenarios."""
    files = (file for suffix in SUFFIXES for file in config_directory().glob(f"*{suffix}"))
    return sorted(file.stem for file in files if b"ros__parameters" not in file.read_bytes())


def scenario_lines() -> list[str]:
    """Name and description of each scenario in the config directory, a line each."""
    names = scenario_names()
    width = max(map(len, names), default=0)
    return [
        f"{printable(name):<{width}}  {printable(_description(scenario_file(name)), LONGEST_DESCRIPTION)}".rstrip()
        for name in names
    ]


def _description(file: Path) -> str:
    """Description in a scenario file; empty for an unreadable file, which is reported on loading."""
    try:
        content = _read(file)[0]
    except ScenarioError:
        return ""
    return str(content.get("description", "")) if isinstance(content, Mapping) else ""


def config_directory() -> Path:
    """Directory of the scenario files: beside the package in a checkout, else in the share directory of its prefix.

    Raises:
        ScenarioError: there is no such directory.
    """
    for module in (Path(__file__).absolute(), Path(__file__).resolve()):
        checkout = module.parents[2]
        if (checkout / "resource" / "cable_twin").is_file() and (checkout / "config").is_dir():
            return checkout / "config"
        for prefix in module.parents:
            shared = prefix / "share" / "cable_twin" / "config"
            if shared.is_dir():
                return shared
    raise ScenarioError(f"{__file__}: no share/cable_twin/config in any directory above; install cable_twin again")


def scenario_file(source: Any) -> Path:
    """Path of a scenario file by name or path; the name of a shipped scenario takes precedence over a file.

    Raises:
        ScenarioError: the source is neither.
    """
    if not isinstance(source, str | Path) or not str(source):
        fault = refuse(("scenario",), source, "a name, the path of a YAML file, or a mapping")
        raise ScenarioError(f"scenario: {fault.text}")
    path = Path(source)
    if not (isinstance(source, str) and path.name == source and path.suffix not in SUFFIXES):
        return path
    names = scenario_names()
    if source in names:
        return next(file for suffix in SUFFIXES if (file := config_directory() / f"{source}{suffix}").is_file())
    if isfile(path):
        return path
    raise ScenarioError(
        f"scenario: given {source!r}, which is neither a scenario nor a file; "
        f"allowed: {', '.join(names) or '(none installed)'}, or the path of a YAML file"
    )


def _read(file: Path) -> tuple[Any, list[Fault]]:
    """Read a scenario file in YAML 1.2 (1e6 is a number); returns its content, and errors of duplicate keys."""
    try:
        text = limited_text(file.expanduser())
    except FileNotFoundError:
        names = ", ".join(scenario_names())
        raise ScenarioError(f"{file}: no such file; allowed: a YAML file, or one of {names}") from None
    except UnreadableYamlError as error:
        raise ScenarioError(f"{file}: {error}") from None
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{file}: not a text in UTF-8 (byte {error.start}); allowed: a YAML file") from None
    except (OSError, RuntimeError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise ScenarioError(f"{file}: cannot be read ({reason}); allowed: a YAML file") from None
    return _parse(text, str(file))


def _parse(text: str, label: str) -> tuple[Any, list[Fault]]:
    """Parse a YAML text, named `label` in error messages; returns its content, and errors of duplicate keys."""
    try:
        document = _document(text)
    except UnreadableYamlError as error:
        raise ScenarioError(f"{label}{error.where}: {error}") from None
    twice = [(one.path, Phrase(f"twice, on lines {one.first} and {one.second}")) for one in document.doubles]
    return document.content, [refuse(path, given, "once") for path, given in twice]


@lru_cache(maxsize=4)  # the cases of a study are one text with other values
def _document(text: str) -> Document:
    """Parse a YAML text with a cache; the returned document is shared and must not be changed."""
    return read_yaml(text)


def _plain(value: Any, path: tuple[str | int, ...], faults: list[Fault]) -> Any:
    """Copy dicts, lists and scalars without numpy types; errors of keys that are no texts go into `faults`."""
    if type(value) in SCALARS:
        return value
    if isinstance(value, Mapping):
        strange = [key for key in value if not isinstance(key, str)]
        faults += [refuse(path, Phrase(f"the key {show(key)}"), "keys that are texts") for key in strange]
        return {key: _plain(item, (*path, key), faults) for key, item in value.items() if isinstance(key, str)}
    if isinstance(value, list | tuple):
        return [_plain(item, (*path, number), faults) for number, item in enumerate(value)]
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return value


def _lines(label: str, faults: Iterable[Fault], written: Written, unknown: Sequence[Fault] = ()) -> list[str]:
    """Lines of text for the errors in a scenario; errors repeated for each rope of one tower are given once.

    Args:
        label: name of the source.
        faults: all faults.
        written: keys of the file and of overrides.
        unknown: faults of overrides whose keys do not exist.
    """
    lines = []
    for fault in faults:
        path = written.path(fault.path)
        source = f"{label} (override)" if fault in unknown or written.is_given(path) else label
        lines.append(": ".join(part for part in (source, written.shown(path), fault.text) if part))
    return list(dict.fromkeys(lines))
