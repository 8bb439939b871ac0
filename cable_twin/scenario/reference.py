"""Reference of scenario files generated from the schema: a page for readers, a JSON schema for editors.

python -m cable_twin.scenario.reference        writes both into docs/ anew
"""

from __future__ import annotations

import json
import math
import re
import sys
from collections.abc import Iterator
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cable_twin.mechanics.parameters import STRONGEST_WIND
from cable_twin.scenario.checks.fault import allowed, inner_model, locate
from cable_twin.scenario.overrides import ALIASES, full_key
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.couplings import Sheave
from cable_twin.scenario.sections.drives import BullwheelDrive
from cable_twin.scenario.sections.line import Tower

PAGE, JSON_SCHEMA = "scenario_reference.md", "scenario.schema.json"
NAME, NUMBER = "NAME", "N"  # in a key: a name that the file chooses, the place in a list
NEEDED = "needed"  # for a default
WIND = re.compile(r"air\.wind\.([xyz]|\d+)")  # components
STEPS: dict[type | None, str] = {None: "", dict: f".{NAME}", tuple: f".{NUMBER}"}  # to the sections in a container
MAPPING = "a mapping of names of "
NEAREST = 3  # keys that are proposed for one that does not exist

HEAD = f"""\
# Scenario reference

Every key of a scenario file, written from the schema by `python -m cable_twin.scenario.reference`. `{NAME}` is a name
that the file chooses, `{NUMBER}` the place in a list. `simulate --explain KEY` prints one entry, or those of a section.
[scenarios.md](scenarios.md) has examples.

Editors check a file while it is written where its first line names the JSON schema, as those in `config/` do:

    # yaml-language-server: $schema=../docs/{JSON_SCHEMA}
"""


class Entry(NamedTuple):
    """Reference entry of one key of a scenario file, in words."""

    key: str  # dotted, with placeholders
    unit: str
    default: str
    allowed: str
    meaning: str


class Range(NamedTuple):
    """Range of the numbers that one key of a scenario file can take, in its unit; infinite without limits."""

    low: float
    high: float
    without_low: bool  # whether the lower end is excluded
    without_high: bool


class Table(NamedTuple):
    """Reference table of the keys in one kind of scenario section."""

    places: tuple[str, ...]  # dotted keys of the sections of this kind, "" for the whole file
    meaning: str
    entries: tuple[Entry, ...]  # keys within the section


TOWER_OF_ROPES = Entry(
    f"ropes.{NAME}",
    "",
    "null",
    "null, or a mapping of keys of a tower",
    "keys that differ, by rope; each rope has a tower with the names of both",
)


def tables() -> list[Table]:
    """Reference tables of all kinds of scenario sections, in the order of the schema."""
    places: dict[type[BaseModel], list[str]] = {}
    for place, model in _sections("", Scenario):
        places.setdefault(model, []).append(place)
    return [Table(tuple(where), _summary(model), tuple(_entries(model))) for model, where in places.items()]


@cache
def entries() -> list[Entry]:
    """Reference entries of every key of a scenario file, in the order of the schema."""
    return [
        entry._replace(key=_join(place, entry.key))
        for place, model in _sections("", Scenario)
        for entry in _entries(model)
    ]


def explained(key: str) -> list[Entry]:
    """Reference entries of a scenario key and of all keys below, for a key with placeholders or with names.

    Raises:
        KeyError: there is no such key; its text is one line with the nearest ones.
    """
    every = entries()
    parts = full_key(key).split(".")
    found = [entry for entry in every if _fits(parts, entry.key.split("."))]
    if not found and parts[1:]:  # one of a mapping of numbers
        above = [entry for entry in every if _fits(parts[:-1], entry.key.split("."))]
        found = [
            entry for entry in above if entry.allowed.startswith(MAPPING) and entry.key.count(".") == len(parts) - 2
        ]
    if not found:
        keys = [entry.key for entry in every]
        near = [known for known in keys if known.endswith(f".{key}")]
        near += [known for known in get_close_matches(key, keys, n=NEAREST) if known not in near]
        hint = f"did you mean {', '.join(near[:NEAREST])}?" if near else f"sections: {', '.join(Scenario.model_fields)}"
        raise KeyError(f"{key}: this key does not exist; {hint}")
    return found


def unit_of(key: str) -> str:
    """Unit of a scenario key, of an item of a list that of the list; empty where there is none."""
    try:
        unit = explained(re.sub(r"\.([xyz]|\d+)$", "", key))[0].unit
    except KeyError:
        return ""
    return "" if unit == "-" else unit


def range_of(key: str) -> Range:
    """Range of a scenario key by its dotted name; of limits by several keys, only that of a component of the wind."""
    if WIND.fullmatch(full_key(key)):
        return Range(-STRONGEST_WIND, STRONGEST_WIND, without_low=False, without_high=False)
    field, _, _ = locate(tuple(full_key(key).split(".")))
    metadata = field.metadata if field is not None else []
    given = {name: [getattr(one, name, None) for one in metadata] for name in ("ge", "gt", "le", "lt")}
    ends = {name: [float(one) for one in values if one is not None] for name, values in given.items()}
    low = max(ends["ge"] + ends["gt"], default=-math.inf)
    high = min(ends["le"] + ends["lt"], default=math.inf)
    return Range(low, high, low in ends["gt"], high in ends["lt"])


def page() -> str:
    """Scenario reference as a page in Markdown."""
    parts = [HEAD]
    for table in tables():
        title = ", ".join(f"`{place}`" for place in table.places if place) or "The whole file"
        rows = "\n".join(f"| `{row.key}` | {' | '.join(map(_cell, row[1:]))} |" for row in table.entries)
        head = "| key | unit | default | allowed | meaning |\n| --- | --- | --- | --- | --- |"
        parts.append(f"## {title}\n\n{table.meaning}\n\n{head}\n{rows}\n")
    return "\n".join(parts)


def json_schema() -> dict[str, Any]:
    """JSON schema of a scenario file."""
    schema = Scenario.model_json_schema()
    definitions, drive = schema["$defs"], BullwheelDrive.model_json_schema(ref_template="#/$defs/{model}")
    definitions |= drive.pop("$defs", {}) | {"BullwheelDrive": drive}
    definitions["Sheave"]["properties"]["drive"] = _or_null("BullwheelDrive")
    definitions["Tower"]["properties"]["ropes"] = {"type": "object", "additionalProperties": _or_null("Tower")}
    definitions["Tower"].pop("required", None)  # its needed keys may be below `ropes`
    schema["properties"] |= {alias: schema["properties"][key] for alias, key in ALIASES.items()}
    schema.pop("required", None)
    schema["anyOf"] = [{"required": ["cable"]}, {"required": ["ropes"]}]
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}


def _or_null(definition: str) -> dict[str, Any]:
    return {"anyOf": [{"$ref": f"#/$defs/{definition}"}, {"type": "null"}]}


def write(directory: Path) -> list[Path]:
    """Write the reference page and the JSON schema into a directory; returns the files."""
    files = [directory / PAGE, directory / JSON_SCHEMA]
    files[0].write_text(page(), encoding="utf-8")
    files[1].write_text(json.dumps(json_schema(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return files


def _sections(place: str, model: type[BaseModel]) -> Iterator[tuple[str, type[BaseModel]]]:
    """Section models at a scenario key and at all keys below."""
    yield place, model
    if model is Sheave:  # a key of files only, as `TOWER_OF_ROPES`: `expand_bullwheels` rewrites both
        yield from _sections(_join(place, "drive"), BullwheelDrive)
    for name, field in model.model_fields.items():
        container, inner = inner_model(field)
        if inner is not None:
            yield from _sections(_join(place, name) + STEPS[container], inner)


def _entries(model: type[BaseModel]) -> Iterator[Entry]:
    """Reference entries of the keys of one section model."""
    for name, field in model.model_fields.items():
        extra = field.json_schema_extra if isinstance(field.json_schema_extra, dict) else {}
        unit, source = (
            str(extra.get("unit", "")),
            ", ".join(str(extra[key]) for key in ("source", "clause") if key in extra),
        )
        meaning = (field.description or "").removesuffix(f" ({unit})")
        sourced = f"{meaning}; {source}" if source else meaning
        yield Entry(name, unit, _default(field), allowed(field, unit=False), sourced)
    if model is Tower:
        yield TOWER_OF_ROPES


def _default(field: FieldInfo) -> str:
    """Default of a scenario key in YAML."""
    if field.is_required():
        return NEEDED
    value = field.get_default(call_default_factory=True)
    if isinstance(value, BaseModel):
        return "its own defaults"
    if isinstance(value, str):
        return value or '""'
    if isinstance(value, float):
        return f"{value:g}".replace("e+0", "e").replace("e-0", "e-")
    return json.dumps(value)


def _fits(given: list[str], key: list[str]) -> bool:
    """Return whether a scenario key is equal to the given one or below."""
    return len(given) <= len(key) and all(
        part in (word, NAME, NUMBER) for word, part in zip(given, key[: len(given)], strict=True)
    )


def _summary(model: type[BaseModel]) -> str:
    """Docstring of a section model on one line."""
    return " ".join((model.__doc__ or "").split())


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


def _join(place: str, name: str) -> str:
    return f"{place}.{name}" if place else name


if __name__ == "__main__":
    for written in write(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")):
        print(written)
