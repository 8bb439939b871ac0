"""Keys of a scenario file mapped to keys of the scenario: drives at bullwheels, towers of several ropes."""

from __future__ import annotations

from typing import Any, NamedTuple

from cable_twin.scenario.checks.fault import KeyPath
from cable_twin.scenario.overrides import put_into_list

OWN = {"sheaves": "drive", "towers": "ropes"}  # by section, what only a file has below its things


class _Place(NamedTuple):
    """Key path in the file of a drive, or of a tower of one rope."""

    own: KeyPath
    keys: frozenset[str]  # that are there
    common: KeyPath  # where all others are


class Written:
    """Keys of a file before `expand_bullwheels` rewrites drives at bullwheels and towers of several ropes.

    Args:
        data: what the file has, as plain dicts; overrides of such keys are put into it.
    """

    def __init__(self, data: dict[str, Any]) -> None:
        self._data = data
        self._given: set[str] = set()  # keys of overrides, as they are given and as the file has them

    def put(self, key: str, value: Any) -> bool:
        """Set a key that exists in the file only; returns whether the key is of this kind.

        That is what is below `sheaves.NAME.drive` or `towers.NAME.ropes`, a whole sheave or tower, and all of them.

        Raises:
            UnknownKeyError: the key ends in a list that has no such place.
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
        """Record a key path changed by an override."""
        self._given.add(".".join(map(str, path)))

    def depth(self, key: str) -> int:
        """Depth in the file of a key of the scenario."""
        return len(self.path(tuple(key.split("."))))

    def expanded(self, key: str) -> list[str]:
        """Scenario keys of one key of the file: for a tower of several ropes, the key of each of its towers."""
        parts = tuple(key.split("."))
        ropes = [place for place, where in self._places().items() if where.common == parts[:2]]
        keys = [".".join((*map(str, place), *parts[2:])) for place in ropes]
        self._given |= {".".join(map(str, self.path(tuple(one.split("."))))) for one in keys}
        return keys or [key]

    def path(self, path: KeyPath) -> KeyPath:
        """Key path in the file, or in an override, of a key path of the scenario."""
        place, rest = self._places().get(path[:2]), path[2:]
        if place is None or self.is_given(path, by_name=True):
            return path
        return (*(place.own if not rest or rest[0] in place.keys else place.common), *rest)

    def is_given(self, path: KeyPath, *, by_name: bool = False) -> bool:
        """Return whether an override names a key path or a parent; `by_name`: not just a whole section."""
        key = ".".join(map(str, path))
        given = (one for one in self._given if "." in one or not by_name)
        return any(key == one or key.startswith(f"{one}.") for one in given)

    def _places(self) -> dict[KeyPath, _Place]:
        """Key paths in the file by section and name in the scenario."""
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


__all__ = ["Written"]
