"""Scenario files with a comment on the origin of each value, made anew or by changing values of an existing file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from io import StringIO
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from cable_twin.offline.survey.profile import SurveyError
from cable_twin.scenario import full_key

COLUMN = 52  # of comments behind values
OF_MANY = ("towers", "ropes", "carriages")  # sections of things by name, which are often alike


@dataclass(frozen=True, slots=True)
class Marked:
    """Value of a scenario with its origin as text.

    Attributes:
        value: plain, or a mapping or list.
        why: origin, or what decided it.
        assumed: whether it is only a customary value.
        misses: whether it is the best there is, and yet misses what `why` says.
    """

    value: Any
    why: str
    assumed: bool = True
    misses: bool = False

    @property
    def comment(self) -> str:
        """Comment behind the value in a scenario file: its origin."""
        return f"assumed: {self.why}" if self.assumed else self.why


def assumed(value: Any, why: str) -> Marked:
    """Mark a value of a scenario as assumed, for a reason."""
    return Marked(value, why)


def derived(value: Any, why: str) -> Marked:
    """Mark a value of a scenario as derived or given, with its origin."""
    return Marked(value, why, assumed=False)


def plain(tree: Any) -> Any:
    """Copy nested scenario values without the notes on their origin, as for `load_scenario`."""
    if isinstance(tree, Marked):
        return plain(tree.value)
    if isinstance(tree, Mapping):
        return {key: plain(value) for key, value in tree.items()}
    return [plain(one) for one in tree] if isinstance(tree, list | tuple) else tree


def assumptions(tree: Mapping[str, Any]) -> list[str]:
    """Lines about the assumed values of a scenario tree, one for each reason: section, values by key, reason."""
    found: dict[tuple[str, str], dict[str, list[str]]] = {}
    for path, mark in _marks(tree, ()):
        if mark.assumed:
            section = ".".join(path[:1] if path[0] in OF_MANY else path[:-1])
            last = ".".join(path[2:] if path[0] in OF_MANY else path[-1:])
            owners = found.setdefault((section, mark.why), {}).setdefault(f"{last} {shown(mark.value)}", [])
            owners += path[1:2] if path[0] in OF_MANY else []
    lines = []
    for (section, why), values in found.items():
        owners = list(dict.fromkeys(name for names in values.values() for name in names))
        place = f"{section}.{owners[0] if len(owners) == 1 else '{' + ','.join(owners) + '}'}" if owners else section
        lines.append(f"{place or 'scenario'}: {', '.join(values)}: {why}")
    return lines


def missed(tree: Mapping[str, Any]) -> list[str]:
    """Lines about the values of a scenario tree that miss what they are chosen for: key, value, reason."""
    return [f"{'.'.join(path)}: given {shown(mark.value)} {mark.why}" for path, mark in _marks(tree, ()) if mark.misses]


def _marks(tree: Any, path: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], Marked]]:
    if isinstance(tree, Marked):
        yield path, tree
        tree = tree.value
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            yield from _marks(value, (*path, str(key)))


def shown(value: Any) -> str:
    """Text of a value of a scenario in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {shown(plain(one))}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(shown(one) for one in value)}]"
    return f"{value:.7g}" if isinstance(value, float) else str(value)


def as_file(tree: Mapping[str, Any], heading: Sequence[str]) -> str:
    """Text of a scenario file with a comment behind each marked value.

    Args:
        tree: tree of plain and marked values.
        heading: lines of the comment at the top of the file.
    """
    content = _commented(tree)
    content.yaml_set_start_comment("\n".join(heading))
    return dumped(content)


def dumped(content: CommentedMap) -> str:
    """YAML text of data with comments."""
    yaml, text = YAML(), StringIO()
    yaml.width = 4000  # type: ignore[assignment]  # a comment stands behind its line
    yaml.indent(mapping=2, sequence=4, offset=2)
    yaml.dump(content, text)
    return text.getvalue()


def given_number(changes: Mapping[str, Any], key: str, usual: float) -> float:
    """Number given for a dotted key, from which other values of a scenario are derived; the usual one if none is.

    Raises:
        SurveyError: what is given is no number above 0; one line.
    """
    value = changes.get(key, usual)
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < np.inf:
        raise SurveyError(f"--set {key}: given {value!r}; allowed: a number above 0")
    return float(value)


def with_changes(tree: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Copy of a scenario tree with given values by dotted key; keys may end in an axis or an index of a list."""
    found = dict(tree)
    for key, value in changes.items():
        found = _given(found, full_key(key).split("."), value)
    return found


def _given(tree: Any, parts: Sequence[str], value: Any) -> Any:
    """Copy of a part of a scenario tree with a value set at a path below it and marked as given by the user."""
    inner = tree.value if isinstance(tree, Marked) else tree
    if not parts:
        return derived(value, "given")
    if isinstance(inner, list | tuple):
        number = int(parts[0]) if parts[0].isdecimal() else (0 if parts[0] == "x" else len(inner) - 1)
        whole = [*inner]
        whole[number] = plain(_given(whole[number], parts[1:], value))
        return derived(whole, "given in part")
    inner = dict(inner or {})
    inner[parts[0]] = _given(inner.get(parts[0]), parts[1:], value)
    return inner


def _commented(tree: Mapping[str, Any], indent: int = 0) -> CommentedMap:
    content = CommentedMap()
    for key, given in tree.items():
        value = given.value if isinstance(given, Marked) else given
        content[key] = _commented(value, indent + 2) if isinstance(value, Mapping) else _flow(value)
        if isinstance(given, Marked) and isinstance(value, Mapping):
            content.yaml_set_comment_before_after_key(key, before=given.comment, indent=indent)
        elif isinstance(given, Marked):
            content.yaml_add_eol_comment(given.comment, key, column=COLUMN)
    if not content or (len(content) < 4 and not any(isinstance(one, Marked | Mapping) for one in tree.values())):
        content.fa.set_flow_style()
    return content


def _flow(value: Any) -> Any:
    if not isinstance(value, list | tuple):
        return value.item() if isinstance(value, np.generic) else value
    inner = CommentedSeq([_flow(one) for one in value])
    if not (inner and isinstance(inner[0], CommentedSeq)):  # points stand in a line each
        inner.fa.set_flow_style()
    return inner


class Change(NamedTuple):
    """Changed value of a scenario, with the reason as text of a comment."""

    value: Any
    why: str


def rewritten(text: str, changes: Mapping[str, Change], heading: str) -> str:
    """Change values in the text of a scenario file, each with a comment; returns the new text.

    Args:
        text: of a valid scenario.
        changes: by dotted key in the file; missing sections are made. Parts that share a value by an anchor change too,
            unless their own path is given.
        heading: comment line at the top.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    content = yaml.load(text)
    places = dict(_nodes(content, ()))
    lines: dict[tuple[int, str], tuple[CommentedMap, dict[str, str]]] = {}  # by owner and key, with texts by key
    for key, change in changes.items():
        owner, depth = _set(content, key.split("."), change.value, places)
        parts = key.split(".")
        _, texts = lines.setdefault((id(owner), parts[depth]), (owner, {}))
        texts[".".join(parts[depth + 1 :])] = change.why
    for (_, last), (owner, texts) in lines.items():
        several = [f"{key}: {why}" if key else why for key, why in texts.items()]
        _remark(owner, last, "; ".join(several if len(several) > 1 else texts.values()))
    return f"# {heading}\n{dumped(content)}"


def _nodes(node: Any, path: tuple[str, ...]) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Identity of each mapping and list of YAML data, with the path of its first place: others are aliases of it."""
    if isinstance(node, CommentedMap | CommentedSeq):
        for key, value in reversed(list(node.items() if isinstance(node, CommentedMap) else enumerate(node))):
            yield from _nodes(value, (*path, str(key)))
        yield id(node), path


def _set(
    content: CommentedMap, parts: Sequence[str], value: Any, places: dict[int, tuple[str, ...]]
) -> tuple[CommentedMap, int]:
    """Set a value of YAML data at a path; what is an alias of another part there is made a copy of its own before.

    Returns:
        The innermost mapping with a line for each key, and the depth in the path at which its key is.
    """
    here: Any = content
    owner, line, flow = content, 0, False
    for depth, part in enumerate(parts):
        flow = flow or not isinstance(here, CommentedMap) or bool(here.fa.flow_style())
        owner, line = (owner, line) if flow else (here, depth)
        if depth == len(parts) - 1:
            break
        if isinstance(here, CommentedMap) and here.get(part) is None:
            here[part] = CommentedMap()
        row = int(part) if isinstance(here, CommentedSeq) else part
        if places.setdefault(id(here[row]), (*parts[: depth + 1],)) != (*parts[: depth + 1],):
            here[row] = _copied(here[row])
            places.update(_nodes(here[row], (*parts[: depth + 1],)))
        here = here[row]
    if isinstance(here, CommentedSeq):
        axes = ("x", "y", "z") if len(here) == 3 else ("x", "z")
        here[axes.index(parts[-1]) if parts[-1] in axes else int(parts[-1])] = value
    else:
        here[parts[-1]] = _flow(value)
    return owner, line


def _copied(node: Any) -> Any:
    """Copy of YAML data without anchors."""
    copied = deepcopy(node)
    for one in (copied, *(copied.values() if isinstance(copied, CommentedMap) else copied)):
        if isinstance(one, CommentedMap | CommentedSeq):
            one.yaml_set_anchor(None)
    return copied


def _remark(owner: CommentedMap, key: str, text: str) -> None:
    """Put a comment behind a key of YAML data, in place of an old one; comments in lines below it stay."""
    tokens = owner.ca.items.get(key)
    there = tokens[2] if tokens is not None and len(tokens) > 2 else None
    if there is None:
        owner.yaml_add_eol_comment(text, key, column=COLUMN)
        return
    _, _, below = there.value.partition("\n")
    there.value = f"# {text}\n{below}"


def write_scenario(file: Path, text: str) -> Path | None:
    """Write a scenario file; one of that name with another content is kept under a name of its own, FILE.bak.

    Returns:
        Where the former file is kept; None without one.

    Raises:
        OSError: it cannot be written.
    """
    kept = None
    if file.is_file() and file.read_bytes() != text.encode():
        names = (file.with_name(f"{file.name}.bak{number or ''}") for number in count())
        kept = next(name for name in names if not name.exists())
        file.replace(kept)
    file.write_text(text, encoding="utf-8")
    return kept
