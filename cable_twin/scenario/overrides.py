"""Keys of a scenario file: overrides by dotted key, and forms of keys that exist in a file only."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cable_twin.basics.limited_yaml import UnreadableYamlError, read_yaml
from cable_twin.scenario.checks.fault import Fault, KeyPath, Phrase, inner_model, listed, refuse, unknown_key
from cable_twin.scenario.schema import Scenario

AXES = ("x", "y", "z")
OF_AIR = "wind"  # begins a short key
ALIASES = {"bullwheels": "sheaves"}  # other names of sections, read silently


class UnknownKeyError(ValueError):
    """Error of a dotted key that does not exist in a scenario.

    Attributes:
        fault: fault with the key and the allowed ones.
    """

    def __init__(self, fault: Fault) -> None:
        super().__init__(fault.text)
        self.fault = fault


def assignment(text: str) -> tuple[str, Any]:
    """Parse KEY=VALUE into key and value, the value in YAML.

    Raises:
        ValueError: one line with the given text and the allowed form.
    """
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise ValueError(f"given {text!r}; allowed: KEY=VALUE")
    try:
        return key.strip(), read_yaml(value).content
    except (UnreadableYamlError, ValueError):
        raise ValueError(f"given {text!r}; allowed: a value in YAML") from None


def full_key(key: str) -> str:
    """Full form of an abbreviated or alternative key: `air.wind.y` of `wind.y`, `sheaves.NAME` of `bullwheels.NAME`."""
    first, dot, rest = key.partition(".")
    if first != OF_AIR:
        return f"{ALIASES.get(first, first)}{dot}{rest}"
    last = rest.partition(".")[0]
    return f"air.{key}" if not rest or last in AXES or last.isdecimal() else f"air.{rest}"


def without_aliases(data: dict[str, Any]) -> tuple[dict[str, Any], dict[str, str], list[Fault]]:
    """Replace alternative names of scenario sections, such as `bullwheels`, by their names in the schema.

    Returns:
        The content of the file, its other names by those of the schema, and a fault of each section that is given
        under both.
    """
    used = {key: alias for alias, key in ALIASES.items() if alias in data}
    both = {key: alias for key, alias in used.items() if key in data}
    faults = [refuse((key,), data[alias], "one of the two", f"also given as `{key}`") for key, alias in both.items()]
    return {ALIASES.get(key, key): value for key, value in data.items()}, used, faults


def override(data: dict[str, Any], key: str, value: Any) -> KeyPath:
    """Set one value of a scenario by its dotted key; in a list, the key ends with an axis or an index from 0 on.

    Carriages, bodies and other named sections have to exist, or are given whole; other sections are made.

    Args:
        data: a scenario as plain data; changed parts of it are copies.
        key: full dotted key.
        value: plain data.

    Returns:
        Key path of the changed value, or of the list in which the key ends.

    Raises:
        UnknownKeyError: the key does not exist.
    """
    parts = key.split(".")
    data.update(_in_model(data, Scenario, parts, value, ()))
    node: Any = data
    for depth, part in enumerate(parts):
        if isinstance(node, list):
            return tuple(parts[:depth])
        node = node.get(part) if isinstance(node, dict) else None
    return tuple(parts)


def put_into_list(items: Sequence[Any], parts: Sequence[str], value: Any, path: KeyPath) -> list[Any]:
    """Copy of a list with one value set; setting y turns a vector of two numbers into one of three.

    Args:
        items: numbers, or lists of them; not changed.
        parts: parts of the key below the list.
        value: plain data.
        path: key path of the list.

    Raises:
        UnknownKeyError: the list has no such index or axis.
    """
    part, *rest = parts
    items = list(items)
    vector = 2 <= len(items) <= 3 and not any(isinstance(item, list | tuple | dict) for item in items)
    if vector and part in AXES:
        items = [items[0], 0.0, items[1]] if part == "y" and len(items) == 2 else items
        row = min(AXES.index(part), len(items) - 1)
    elif part.isdecimal() and int(part) < len(items):
        row = int(part)
    else:
        axes = f"{', '.join(AXES)} or " if vector else ""
        known = [f"{axes}a number from 0 to {len(items) - 1}"] if items else []
        raise UnknownKeyError(unknown_key((*path, part), known))
    if rest and not isinstance(items[row], list | tuple):
        raise UnknownKeyError(unknown_key((*path, part, rest[0]), ()))
    items[row] = put_into_list(items[row], rest, value, (*path, part)) if rest else value
    return items


def _in_model(node: Any, model: type[BaseModel], parts: Sequence[str], value: Any, path: KeyPath) -> Any:
    """Copy of a scenario section with one value set."""
    part, *rest = parts
    if part not in model.model_fields:
        raise UnknownKeyError(unknown_key((*path, part), model.model_fields))
    if node is None or isinstance(node, int | float):  # left out, or a number where a mapping may stand too
        node = {}
    if not isinstance(node, dict):
        return node  # a fault of its own
    if not rest:
        return {**node, part: value}
    return {**node, part: _in_field(node.get(part), model.model_fields[part], rest, value, (*path, part))}


def _in_field(node: Any, field: FieldInfo, parts: Sequence[str], value: Any, path: KeyPath) -> Any:
    """Copy of the content of a scenario key with one value set."""
    container, model = inner_model(field)
    if container is None and model is not None:
        return _in_model(node, model, parts, value, path)
    if container is dict:
        return _in_names({} if node is None else node, model, parts, value, path)
    if node is None and not field.is_required():
        node = field.get_default(call_default_factory=True)
    if not isinstance(node, list | tuple):
        raise UnknownKeyError(unknown_key((*path, parts[0]), ()))
    if model is None or not parts[1:] or not parts[0].isdecimal() or int(parts[0]) >= len(node):
        return put_into_list(node, parts, value, path)
    items, row = list(node), int(parts[0])
    items[row] = _in_model(items[row], model, parts[1:], value, (*path, parts[0]))
    return items


def _in_names(node: Any, model: type[BaseModel] | None, parts: Sequence[str], value: Any, path: KeyPath) -> Any:
    """Copy of a mapping of named sections with one value set, or with a new entry given whole."""
    if not isinstance(node, dict):
        return node  # a fault of its own
    part, *rest = parts
    whole = not rest and model is not None and isinstance(value, dict)
    if part not in node and not whole:
        fault = unknown_key((*path, part), node)
        if model is not None and not node:
            key = ".".join(map(str, (*path, part)))
            fault = refuse(
                fault.path, Phrase("only a part"), f"a whole mapping, as in {key}={{...}}", "it does not exist yet"
            )
        raise UnknownKeyError(fault)
    if not rest:
        return {**node, part: value}
    if model is None:
        raise UnknownKeyError(unknown_key((*path, part, rest[0]), ()))
    return {**node, part: _in_model(node[part], model, rest, value, (*path, part))}


OWN = {"sheaves": "drive", "towers": "ropes"}  # by section, the key that exists in a file only


class _Place(NamedTuple):
    """Key paths at which a scenario file defines one drive, or one tower for one of its several ropes."""

    own: KeyPath
    keys: frozenset[str]  # given in the file
    common: KeyPath  # key path of all other keys


class Written:
    """Keys of a scenario file as written, before `expand_bullwheels` rewrites drives and towers of several ropes.

    Args:
        data: content of the file as plain dicts; overrides of such keys are put into it.
        aliases: other names of sections in the file, by those of the schema.
    """

    def __init__(self, data: dict[str, Any], aliases: Mapping[str, str]) -> None:
        self._data, self._aliases = data, aliases
        self._given: set[str] = set()  # keys of overrides, as they are given and as the file has them

    def put(self, key: str, value: Any) -> bool:
        """Set a key that exists in the file only; returns whether the key is of this kind.

        Such keys are those below `sheaves.NAME.drive` and `towers.NAME.ropes`, a whole sheave or tower, or all.

        Raises:
            UnknownKeyError: the key ends in a list without such an index or axis.
        """
        self._given.add(key)
        section, *below = key.split(".")
        if section not in OWN:
            return False
        if not below:
            self._data[section] = value
            return True
        name, *inner = below
        places = self._places()
        if (section, name) in places:
            whole = not inner and isinstance(value, dict)
            return whole and self.put(".".join(map(str, places[section, name].own)), value)
        if not inner and isinstance(value, dict):
            self._data.setdefault(section, {})
        things = self._data.get(section)
        if not isinstance(things, dict):
            return False
        if not inner:
            if name not in things and not isinstance(value, dict):
                return False
            things[name] = value
            return True
        node = things.get(name)
        if inner[0] != OWN[section] or not isinstance(node, dict):
            return False
        if inner[1:] and not isinstance(node.get(inner[0]), dict):
            return False
        *sections, last = inner
        for depth, part in enumerate(sections):
            if isinstance(items := node.get(part), list):
                path = (section, name, *sections[: depth + 1])
                node[part] = put_into_list(items, inner[depth + 1 :], value, path)
                self.give(path)
                return True
            if not isinstance(node.get(part), dict):
                node[part] = {}  # not there yet, or null
            node = node[part]
        node[last] = value
        return True

    def give(self, path: KeyPath) -> None:
        """Record a key path as changed by an override."""
        self._given.add(".".join(map(str, path)))

    def depth(self, key: str) -> int:
        """Number of dotted parts that a scenario key has in the file."""
        return len(self.path(tuple(key.split("."))))

    def expanded(self, key: str) -> list[str]:
        """Keys of the scenario that one key of its file stands for: for a tower of several ropes, one key per rope."""
        parts = tuple(key.split("."))
        ropes = [place for place, where in self._places().items() if where.common == parts[:2]]
        keys = [".".join((*map(str, place), *parts[2:])) for place in ropes]
        self._given |= {".".join(map(str, self.path(tuple(one.split("."))))) for one in keys}
        return keys or [key]

    def path(self, path: KeyPath) -> KeyPath:
        """Convert a key path of the scenario into the key path by which the file or an override gives the value."""
        if not {*path[:1]} & {"drives", *OWN}:
            return path
        place, rest = self._places().get(path[:2]), path[2:]
        if place is None or self.is_given(path, by_name=True):
            return path
        return (*(place.own if not rest or rest[0] in place.keys else place.common), *rest)

    def shown(self, path: KeyPath) -> str:
        """Key path as dotted text, with the names of sections that the file uses."""
        words = [self._aliases.get(str(path[0]), path[0]), *path[1:]] if path else []
        return ".".join(part if isinstance(part, str) and part.isprintable() else repr(part) for part in words)

    def is_given(self, path: KeyPath, *, by_name: bool = False) -> bool:
        """Return whether an override names a key path or a parent; `by_name`: not just a whole section."""
        key = ".".join(map(str, path))
        given = (one for one in self._given if "." in one or not by_name)
        return any(key == one or key.startswith(f"{one}.") for one in given)

    def _places(self) -> dict[KeyPath, _Place]:
        """Key paths of drives and towers in the scenario file, by their section and name in the scenario."""
        found: dict[KeyPath, _Place] = {}
        for section, own in OWN.items():
            things = self._data.get(section)
            for name, thing in things.items() if isinstance(things, dict) else ():
                written = thing.get(own) if isinstance(thing, dict) else None
                if not isinstance(written, dict):
                    continue
                if section == "sheaves":
                    drive = (section, name, own)
                    called = written.get("name")
                    found["drives", called if isinstance(called, str) else name] = _Place(drive, frozenset(), drive)
                    continue
                for rope, differs in written.items():
                    keys = frozenset(differs if isinstance(differs, dict) else ())
                    found[section, f"{name}_{rope}"] = _Place((section, name, own, rope), keys, (section, name))
        return found


FILE_SECTIONS = "sheaves", "towers", "ropes"
ROPES_EXAMPLE = "{up: {}, down: {}}"


def faults_in_file(data: dict[str, Any]) -> Iterator[Fault]:
    """Errors in drives below bullwheels and in towers of several ropes, which only scenario files have."""
    sheaves, towers, ropes = (given if isinstance(given := data.get(key), dict) else {} for key in FILE_SECTIONS)
    drives = data.get("drives")
    called = set(drives if isinstance(drives, dict) else ())
    for name, sheave in sheaves.items():
        if not isinstance(sheave, dict) or "drive" not in sheave:
            continue
        drive, path = sheave["drive"], ("sheaves", name, "drive")
        if not isinstance(drive, dict):
            yield refuse(path, drive, "a mapping with the keys of a drive")
        elif not isinstance(drive.get("name"), str | None) or drive.get("name") == "":
            yield refuse((*path, "name"), drive["name"], "a text, not empty")
        elif (own := drive.get("name") or name) in called:
            yield refuse((*path, "name"), own, "another name", "another drive has this name")
        else:
            called.add(own)
    for name, tower in towers.items():
        if isinstance(tower, dict) and "ropes" in tower:
            yield from _faults_of_tower(name, tower["ropes"], towers, ropes)


def _faults_of_tower(name: str, own: Any, towers: dict[str, Any], ropes: dict[str, Any]) -> Iterator[Fault]:
    """Errors in the keys that a tower of several ropes gives for each of its ropes."""
    path: KeyPath = ("towers", name, "ropes")
    if not isinstance(own, dict):
        yield refuse(path, own, f"a mapping of ropes to the keys that differ there: {ROPES_EXAMPLE}")
        return
    for rope, differs in own.items():
        if rope not in ropes:
            yield refuse((*path, rope), rope, listed(ropes, "none, there is one cable"), "no such rope")
        elif differs is not None and not isinstance(differs, dict):
            yield refuse((*path, rope), differs, "a mapping of keys of a tower, or null")
        elif f"{name}_{rope}" in towers:
            given = Phrase(f"a tower with the name '{name}_{rope}'")
            yield refuse((*path, rope), given, "another name", "another tower has this name")
        else:
            for key in {"rope", "ropes"} & (differs := differs or {}).keys():
                yield refuse((*path, rope, key), differs[key], f"no such key here, as the rope is {rope!r}")


def expand_bullwheels(data: dict[str, Any]) -> dict[str, Any]:
    """Move drives of bullwheels to `drives`, and split towers of several ropes into one tower per rope."""
    sheaves, drives = data.get("sheaves"), data.get("drives", {})
    if isinstance(sheaves, dict) and isinstance(drives, dict):
        plain, drives = {}, dict(drives)
        for name, sheave in sheaves.items():
            plain[name] = sheave
            if isinstance(sheave, dict) and isinstance(sheave.get("drive"), dict):
                plain[name] = {key: value for key, value in sheave.items() if key != "drive"}
                given = dict(sheave["drive"])
                called = given.pop("name", None) or name
                drives[called] = {"kind": "moving_cable", "sheave": name, **given}
        data = {**data, "sheaves": plain} | ({"drives": drives} if drives else {})
    towers = data.get("towers")
    if isinstance(towers, dict):
        plain = {}
        for name, tower in towers.items():
            ropes = tower.get("ropes") if isinstance(tower, dict) else None
            if not isinstance(ropes, dict):
                plain[name] = tower
                continue
            common = {key: value for key, value in tower.items() if key != "ropes"}
            for rope, own in ropes.items():
                plain[f"{name}_{rope}"] = {**common, **(own or {}), "rope": rope}
        data = {**data, "towers": plain}
    return data
