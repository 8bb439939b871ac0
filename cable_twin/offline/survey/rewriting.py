"""Rewriting of scenario files with changed values; all else, comments included, stays unchanged."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from cable_twin.offline.survey.marked import COLUMN, dumped


class Change(NamedTuple):
    """Changed value of a scenario, with the reason as text of a comment."""

    value: Any
    why: str


def rewritten(text: str, changes: Mapping[str, Change], heading: str) -> str:
    """Change values in the text of a scenario file, each with a comment; returns the new text.

    Args:
        text: of a valid scenario.
        changes: by dotted key in the file; missing sections are made.
        heading: comment line at the top.
    """
    yaml = YAML()
    yaml.preserve_quotes = True
    content = yaml.load(text)
    for key, change in changes.items():
        _set(content, key.split("."), change)
    return f"# {heading}\n{dumped(content)}"


def _set(content: CommentedMap, parts: list[str], change: Change) -> None:
    """Set a value of YAML data at a path, with a comment behind the innermost key that has a line of its own."""
    here: Any = content
    owner, last = content, parts[0]
    for part in parts:
        if isinstance(here, CommentedMap) and not here.fa.flow_style():
            owner, last = here, part
        if part is parts[-1]:
            break
        if isinstance(here, CommentedMap) and here.get(part) is None:
            here[part] = CommentedMap()
        here = here[int(part) if isinstance(here, CommentedSeq) else part]
    if isinstance(here, CommentedSeq):
        axes = ("x", "y", "z") if len(here) == 3 else ("x", "z")
        here[axes.index(parts[-1]) if parts[-1] in axes else int(parts[-1])] = change.value
    else:
        here[parts[-1]] = change.value
    _remark(owner, last, change.why)


def _remark(owner: CommentedMap, key: str, text: str) -> None:
    """Put a comment behind a key of YAML data, in place of an old one; comments in lines below it stay."""
    tokens = owner.ca.items.get(key)
    there = tokens[2] if tokens is not None and len(tokens) > 2 else None
    if there is None:
        owner.yaml_add_eol_comment(text, key, column=COLUMN)
        return
    _, _, below = there.value.partition("\n")
    there.value = f"# {text}\n{below}"
