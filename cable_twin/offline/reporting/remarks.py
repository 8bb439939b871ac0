"""Inputs of a scenario with the remarks of its file on sources and assumptions; without a remark they are assumed."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode

from cable_twin.basics.limited_yaml import limited_text, read_yaml
from cable_twin.basics.units import rounded
from cable_twin.scenario import Scenario, load_scenario, parse_scenario, scenario_file, scenario_names
from cable_twin.scenario.reference import explained, unit_of

DIGITS = 6  # of an input
REMARK = re.compile(r"^[\s}\],]*#\s*(.*)$")  # behind a value
NONE, CHANGED, DEFAULT = "no source stated", "set for this run", "default"


class Input(NamedTuple):
    """Input of a scenario: dotted key, value, unit, remark, and whether it is an assumption."""

    key: str
    value: str
    unit: str
    remark: str
    assumed: bool


class Inputs(NamedTuple):
    """All inputs of a run with their remarks, for a report.

    Attributes:
        file: name of the scenario file; empty where it is not at hand.
        head: remark at the top of the file.
        rows: inputs in the file or set for the run.
        defaults: assumed defaults of keys that are not given.
    """

    file: str
    head: str
    rows: list[Input]
    defaults: list[Input]


class ScenarioText(NamedTuple):
    """Name and text of a scenario file, which results carry along for its remarks."""

    name: str
    text: str


def scenario_text(source: str | Path) -> ScenarioText:
    """Name and text of a scenario file, by name or path of the scenario.

    Raises:
        ScenarioError: there is no such scenario.
    """
    file = scenario_file(source)
    return ScenarioText(file.name, limited_text(file.expanduser()))


def inputs_of(scenario: Scenario, file: Path | None, kept: ScenarioText | None = None) -> Inputs:
    """Gather the inputs of a run: values of its scenario, with the remarks of the scenario file.

    Args:
        scenario: of the run.
        file: scenario file; None for that in the results, else the shipped file of its name, if any.
        kept: scenario file in the results; None without.

    Raises:
        ScenarioError: a given file cannot be read; a line each.
    """
    if file is not None:
        load_scenario(file)  # its faults, with its path
        kept = scenario_text(file)
    elif kept is None and scenario.name in scenario_names():
        kept = scenario_text(scenario.name)
    used = _flat(scenario.resolved())
    defaults = list(_assumed_defaults(used))
    if kept is None:
        rows = [_input(key, value, NONE) for key, value in used.items() if not _is_default(key, value)]
        return Inputs("", "", [one for one in rows if _is_number(one.value)], defaults)
    before = _flat(parse_scenario(kept.text).resolved())
    remarks = dict(_remarks(kept.text))
    rows = []
    for key, (value, remark, assumed) in remarks.items():
        own = used.get(key, value)
        changed = key in used and before.get(key) != own
        rows.append(_input(key, own, CHANGED if changed else remark, assumed=assumed and not changed))
    rows += [
        _input(key, value, CHANGED)
        for key, value in used.items()
        if before.get(key) != value and key not in remarks and key != "name"
    ]
    head = " ".join(line.lstrip("# ") for line in _head(kept.text.splitlines()))
    return Inputs(kept.name, head, [one for one in rows if _is_number(one.value)], defaults)


def _input(key: str, value: Any, remark: str, *, assumed: bool = False) -> Input:
    """Make an input of a scenario with its unit and remark."""
    remark = remark or NONE
    return Input(key, _shown(value), unit_of(key), remark, assumed or "assumed" in remark or remark == NONE)


def change_text(key: str, value: Any) -> str:
    """Text of a change of a scenario: dotted key, and value with unit; `none` for null."""
    unit = f" {unit_of(key)}" if unit_of(key) and _has_number(value) else ""
    return f"{key}: {'none' if value is None else _shown(value)}{unit}"


def _has_number(value: Any) -> bool:
    """Whether a value of a scenario is a number, or has one in it."""
    if isinstance(value, Mapping | list | tuple):
        return any(map(_has_number, value.values() if isinstance(value, Mapping) else value))
    return isinstance(value, int | float) and not isinstance(value, bool)


def _shown(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_shown(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_shown, value)) + "]"
    if isinstance(value, float):
        return rounded(value, DIGITS)
    return json.dumps(value) if value is None or isinstance(value, bool) else str(value)


def _is_number(text: str) -> bool:
    return re.fullmatch(r"[-\[\]\d., e+]*\d[-\[\]\d., e+]*", text) is not None


def _is_default(key: str, value: Any) -> bool:
    try:
        return explained(key)[0].default == _shown(value)
    except KeyError:
        return False


def _assumed_defaults(used: Mapping[str, Any]) -> Iterator[Input]:
    """Defaults in use that the scenario reference calls assumed, one for each kind of section."""
    seen = set()
    for key, value in used.items():
        try:
            entry = explained(key)[0]
        except KeyError:
            continue
        if "assumed" in entry.meaning and entry.key not in seen and entry.default == _shown(value):
            seen.add(entry.key)
            yield Input(entry.key, entry.default, entry.unit, entry.meaning, True)


def _flat(content: Mapping[str, Any], above: str = "") -> dict[str, Any]:
    """Values of a resolved scenario by dotted key; a list of numbers is one value, and null is left out."""
    found: dict[str, Any] = {}
    for key, value in content.items():
        path = f"{above}{key}"
        if isinstance(value, Mapping):
            found |= _flat(value, f"{path}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping | list):
            found |= _flat({str(number): one for number, one in enumerate(value)}, f"{path}.")
        elif value is not None and value not in ([], {}):
            found[path] = value
    return found


def _remarks(text: str) -> Iterator[tuple[str, tuple[Any, str, bool]]]:
    """Each key of a YAML text with value, remark, and whether the remark of a block around it says "all assumed"."""
    document, lines = read_yaml(text), text.splitlines()
    for path, node in _leaves(document.node, ()):
        value: Any = document.content
        try:
            for part in path:
                value = value[part]
        except KeyError:  # of a merged mapping, in place of which there is another one
            continue
        key, heads = ".".join(map(str, path)), list(_heads(lines, node.start_mark.line))
        said = (*_own_remarks(lines, node), *heads[:1])
        remark = next((one for one in said if one.strip(",:; ") not in ("", "-", unit_of(key))), "")
        yield key, (value, remark, any("all assumed" in head for head in heads))


def _leaves(node: Node | None, path: tuple[Any, ...]) -> Iterator[tuple[tuple[Any, ...], Node]]:
    """Leaf nodes of a YAML document with their paths; a list of scalars is one leaf."""
    if isinstance(node, MappingNode):
        for key, value in node.value:
            if isinstance(key, ScalarNode) and key.value != "<<":
                yield from _leaves(value, (*path, key.value))
    elif isinstance(node, SequenceNode) and not all(isinstance(one, ScalarNode) for one in node.value):
        for number, value in enumerate(node.value):
            yield from _leaves(value, (*path, number))
    elif node is not None:
        yield path, node


def _own_remarks(lines: Sequence[str], node: Node) -> Iterator[str]:
    """Remarks on a value in a YAML text, behind it or above its line; some are empty, or a unit alone."""
    end, row = node.end_mark, node.start_mark.line
    behind = lines[end.line][end.column :] if end.line < len(lines) else ""
    if found := REMARK.match(behind) or re.search(r"[}\]]\s*#\s*(.*)$", lines[row]):
        yield found[1]
    yield _group(lines, row, -1)


def _heads(lines: Sequence[str], row: int) -> Iterator[str]:
    """Remarks at the heads of the YAML blocks around a line, from the innermost block on."""
    while row > 0:
        indent = _indent(lines[row])
        while row > 0 and (not lines[row - 1].strip() or _indent(lines[row - 1]) >= indent):
            row -= 1
        if row == 0:
            return  # the head of the file is for itself
        if above := _group(lines, row, 1):
            yield above
        row -= 1  # the line that opens the block
        if found := re.search(r":\s*(?:&\w+\s*)?#\s*(.*)$", lines[row]):
            yield found[1]
        elif above := _group(lines, row, -1):
            yield above


def _indent(line: str) -> int:
    """Indentation of a YAML line; list items count as within their key also where both begin in one column."""
    plain = line.lstrip()
    return len(line) - len(plain) + (2 if plain.startswith("- ") else 0)


def _group(lines: Sequence[str], row: int, step: int) -> str:
    """Join the comment lines at a YAML line: above it (`step` -1) or from it on (1); empty for the file's header."""
    rows = []
    row += min(step, 0)
    while 0 <= row < len(lines) and lines[row].lstrip().startswith("#"):
        rows.append(row)
        row += step
    return " ".join(lines[one].strip().lstrip("# ") for one in sorted(rows)) if 0 not in rows else ""


def _head(lines: Sequence[str]) -> Iterator[str]:
    """Comment lines at the top of a scenario file, without the schema line of the YAML language server."""
    for line in lines:
        if not line.startswith("#"):
            return
        if "yaml-language-server" not in line:
            yield line
