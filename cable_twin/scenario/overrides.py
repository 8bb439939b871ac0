"""Keys of a scenario file: overrides by dotted key, and forms of keys that exist in a file only."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeVar

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from cable_twin.basics.limited_yaml import UnreadableYamlError, read_yaml
from cable_twin.scenario.checks.fault import Fault, KeyPath, Phrase, inner_model, listed, refuse, unknown_key
from cable_twin.scenario.schema import Scenario

AXES = ("x", "y", "z")
OF_AIR = "wind"  # begins a short key
ALIASES = {"bullwheels": "sheaves"}  # other names of sections, read silently


Value = TypeVar("Value")


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


def scenario_keys(scenario: Mapping[str, Any], key: str) -> list[str]:
    """Full keys of a resolved scenario that one key, also one as written in a file, stands for.

    A tower of several ropes, `towers.NAME`, stands for the tower of each of its ropes, `towers.NAME.ropes.ROPE` for one
    of them, and `sheaves.NAME.drive` for the drive of that bullwheel. Any other key stands for itself.

    Args:
        scenario: resolved scenario as plain data.
        key: dotted key; of a short one the full form is returned.
    """
    key = full_key(key)
    section, *below = key.split(".")
    things = scenario.get(section)
    if not below or not isinstance(things, Mapping):
        return [key]
    name, *rest = below
    if section == "sheaves" and rest[:1] == ["drive"]:
        drives = _named(scenario.get("drives"), "sheave")
        return [".".join(("drives", one, *rest[1:])) for one, sheave in drives.items() if sheave == name] or [key]
    if section != "towers" or name in things:
        return [key]
    ropes = {rope: one for one, rope in _named(things, "rope").items() if one == f"{name}_{rope}"}
    if rest[:1] == ["ropes"]:
        return [".".join((section, ropes[rest[1]], *rest[2:]))] if rest[1:] and rest[1] in ropes else [key]
    return [".".join((section, one, *rest)) for one in ropes.values()] or [key]


def _named(things: Any, key: str) -> dict[str, Any]:
    """Value of one key in each of the named mappings of a scenario section."""
    found = things.items() if isinstance(things, Mapping) else ()
    return {name: thing.get(key) for name, thing in found if isinstance(thing, Mapping)}


def value_at(scenario: Mapping[str, Any], key: str) -> Any:
    """Value of a resolved scenario by its dotted key; None for a key without value."""
    node: Any = scenario
    for part in key.split("."):
        if isinstance(node, Mapping):
            node = node.get(part)
        elif isinstance(node, list | tuple):
            row = len(node) - 1 if part == "z" else "xy".find(part) if part in ("x", "y") else -1
            row = int(part) if part.isdecimal() else row
            node = node[row] if 0 <= row < len(node) else None
        else:
            return None
    return node


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
        content: content of the file as plain dicts.

    Attributes:
        data: content with sections by their names in the schema; overrides of keys of a file are put into it.
        faults: faults of sections that are given under two names.
    """

    def __init__(self, content: dict[str, Any]) -> None:
        self.data, self._aliases, self.faults = without_aliases(content)
        self._given: set[str] = set()  # keys of overrides, as they are given and as the file has them

    def put(self, key: str, value: Any) -> bool:
        """Set a key that exists in the file only; returns whether the key is of this kind.

        Such keys are those below `sheaves.NAME.drive`, `towers.NAME.ropes`, `towers.NAME.ropes.ROPE`, a whole sheave or
        tower, or all. What is below a rope of a tower is set later, as `expanded` says, after what its ropes share.

        Raises:
            UnknownKeyError: the key ends in a list without such an index or axis.
        """
        self._given.add(key)
        section, *below = key.split(".")
        if section not in OWN:
            return False
        if not below:
            self.data[section] = value
            return True
        name, *inner = below
        places = self._places()
        if (section, name) in places:
            whole = not inner and isinstance(value, dict)
            return whole and self.put(".".join(map(str, places[section, name].own)), value)
        if not inner and isinstance(value, dict):
            self.data.setdefault(section, {})
        things = self.data.get(section)
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
        if inner[2:] and (section, f"{name}_{inner[1]}") in places:
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

    def by_file(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """Sort values of a scenario by the keys with which the file gives them.

        A key of the tower of one rope becomes that of its rope, `towers.NAME.ropes.ROPE`, and one that all ropes of the
        tower have alike that of the tower, unless the file has it for a rope; such ropes get a value of the tower, too.

        Args:
            values: by full key of the scenario or of a file, later ones before earlier ones.
        """
        found: dict[str, Value] = {}
        places = self._places()
        for key, value in values.items():
            path: KeyPath = tuple(key.split("."))
            place, rest = places.get(path[:2]), path[2:]
            of_tower = place.common if place else path[:2]
            others = {one: where for one, where in places.items() if where.common == of_tower}
            own = [(*where.own, *rest) for where in others.values() if rest and rest[0] in where.keys]
            if place is not None:
                alike = (
                    rest and not own and all(values.get(".".join(map(str, (*one, *rest)))) == value for one in others)
                )
                paths = [(*(place.common if alike else place.own), *rest)]
            else:
                paths = [path, *own]
            found |= {
                ".".join((self._aliases.get(str(one[0]), str(one[0])), *map(str, one[1:]))): value for one in paths
            }
        return found

    def give(self, path: KeyPath) -> None:
        """Record a key path as changed by an override."""
        self._given.add(".".join(map(str, path)))

    def depth(self, key: str) -> int:
        """Number of dotted parts that a scenario key has in the file."""
        return len(self.path(tuple(key.split("."))))

    def expanded(self, keys: Iterable[str], scenario: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
        """Pair keys of overrides with the keys of the scenario they stand for, those of single ropes after all others.

        Args:
            keys: full keys, whole sections before keys in them.
            scenario: after `expand_bullwheels`.
        """
        found = [(key, scenario_keys(scenario, key)) for key in keys]
        for key, own in sorted(found, key=lambda one: (self.depth(one[0]), len(one[1]) == 1)):
            self._given |= {".".join(map(str, self.path(tuple(one.split("."))))) for one in own}
            yield from ((key, one) for one in own)

    def path(self, path: KeyPath) -> KeyPath:
        """Convert a key path of the scenario into the key path by which the file or an override gives the value."""
        if not {*path[:1]} & {"drives", *OWN}:
            return path
        place, rest = self._places().get(path[:2]), path[2:]
        if place is None or self.is_given(path, by_name=True):
            return path
        if ".".join(map(str, own := (*place.own, *rest))) in self._given:
            return own
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
            things = self.data.get(section)
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
