"""Tables of docs/topics.md as data."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

PAGE = Path(__file__).resolve().parents[1] / "docs" / "topics.md"


@dataclass(frozen=True, slots=True)
class Row:
    """Topic or service; VEHICLE, BODY or SUPPORT in its name stands for several."""

    direction: str  # in, out or service
    name: str
    type: str  # such as sensor_msgs/JointState
    rate: str
    text: str

    def expanded(
        self, vehicles: Mapping[str, Sequence[str]], supports: Sequence[str]
    ) -> Iterator[tuple[str, str, str]]:
        """Direction, name and type of all topics that a row stands for."""
        names = [self.name.replace("SUPPORT", support) for support in supports] if "SUPPORT" in self.name else []
        if "VEHICLE" in self.name:
            named = [(self.name.replace("VEHICLE", vehicle), bodies) for vehicle, bodies in vehicles.items()]
            names += [
                name.replace("BODY", body) for name, bodies in named for body in (bodies if "BODY" in name else "-")
            ]
        for name in names or [self.name]:
            yield self.direction, name, self.type


def table(section: str) -> list[list[str]]:
    """Cells of the first table of a section, without its head."""
    (text,) = re.findall(
        rf"^## {section}\n(.*?)(?=^## |\Z)", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL
    )
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def topics_of_page() -> list[Row]:
    """Topics of the page."""
    return [row for row in _rows() if row.direction != "service"]


def services_of_page() -> list[Row]:
    """Services of the page."""
    return [row for row in _rows() if row.direction == "service"]


def _rows() -> Iterator[Row]:
    for direction, names, text, rate in table("Topics"):
        found = re.match(r"\w+/\w+", text)
        assert found, f"{names}: its type stands first"
        for name in re.findall(r"`(.+?)`", names):
            general = name.replace("supports/NAME", "supports/SUPPORT").replace("/NAME", "/VEHICLE")
            yield Row(direction, general, found[0], rate, text)
