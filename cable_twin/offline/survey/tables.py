"""Reader of surveys in CSV: terrain as x and z, towers as x and the height of the rope, in metres or feet."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from cable_twin.basics.limited_yaml import UnreadableYamlError, limited_text
from cable_twin.basics.separated import separator_of, with_point
from cable_twin.offline.survey.profile import (
    FEET,
    Survey,
    SurveyedTower,
    SurveyError,
    check_terrain,
    surveyed,
)
from cable_twin.scenario.sections.line import MOST_CONTACTS

LARGEST = 2**25  # bytes of a file
MOST_ROWS = 20_000  # of a file
MOST_FAULTS = 20  # that are told
NAMES: Mapping[str, tuple[str, ...]] = {
    "x": ("x", "distance", "chainage", "station", "s"),
    "z": ("z", "height", "elevation", "altitude"),
    "name": ("name", "tower", "nr", "no", "id"),
    "z_rope": ("z_rope", "rope_z", "rope_elevation"),
    "rope_above_ground": ("rope_above_ground", "rope_height"),
    "contacts": ("contacts", "sheaves", "rollers"),
    "length": ("length",),
    "radius": ("radius",),
    "hold_down": ("hold_down", "holddown", "compression"),
}
LENGTHS = ("x", "z", "z_rope", "rope_above_ground", "length", "radius")  # columns in a unit of length
UNITS = {"m": "m", "metre": "m", "meter": "m", "metres": "m", "meters": "m", "": "m"} | dict.fromkeys(
    ("ft", "feet", "foot", "international feet"), "ft"
)
UNITS |= dict.fromkeys(("us-ft", "usft", "ftus", "us ft", "us survey feet"), "us-ft")
TRUE, FALSE = ("1", "true", "yes", "y"), ("", "0", "false", "no", "n")
HEADER = re.compile(r"([A-Za-z_ ]+?)[ _]*(?:[\[(]([^\])]*)[\])]|_(ft|feet|us-ft|m))?")


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of a CSV file of a survey by column, lengths in metres.

    Attributes:
        file: path of the file.
        columns: columns of the file, by the names of `NAMES`.
        rows: number of the line, and texts and numbers by column.
        notes: lines about conversions of units.
    """

    file: str
    columns: tuple[str, ...]
    rows: tuple[tuple[int, dict[str, str | float]], ...]
    notes: tuple[str, ...]

    def need(self, *alternatives: str) -> None:
        """Raise an error if the survey table has none of the alternative columns.

        Raises:
            SurveyError: no such column; one line.
        """
        if not set(alternatives) & set(self.columns):
            wanted = " or ".join(f"{name} ({'m' if name in LENGTHS else 'text'})" for name in alternatives)
            raise SurveyError(
                f"{self.file}: line 1: columns: given {', '.join(self.columns) or 'none'}; allowed: with {wanted} "
                "among them"
            )


def read_table(file: Path, units: str | None = None) -> Table:
    """Read a survey table from a CSV file with a header, with `,`, `;` or tabulators between columns.

    Args:
        file: path.
        units: unit of lengths, a key of `FEET`, where the header has none; None: metres.

    Raises:
        SurveyError: with every fault, one line each.
    """
    text = _text(file)
    lines = [(number, line) for number, line in enumerate(text.splitlines(), start=1) if line.strip()]
    remarks = [line for _, line in lines if line.lstrip().startswith("#")]
    lines = [(number, line) for number, line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise SurveyError(f"{file}: given no line; allowed: a header and a row for each point or tower")
    if units is None and (said := _unit_in(remarks)) is not None:
        units = said
    delimiter = separator_of(lines[0][1])
    if len(lines) - 1 > MOST_ROWS:
        raise SurveyError(f"{file}: given {len(lines) - 1} rows; allowed: at most {MOST_ROWS}")
    try:
        header, *rows = csv.reader((line for _, line in lines), delimiter=delimiter)
    except csv.Error as error:
        raise SurveyError(f"{file}: no table ({error}); allowed: a CSV file") from None
    columns, scales, notes = _columns(str(file), header, units)
    faults: list[str] = []
    found = []
    for (number, _), row in zip(lines[1:], rows, strict=False):
        where = f"{file}: line {number}"
        if len(row) != len(header):
            faults.append(f"{where}: given {len(row)} columns; allowed: {len(header)}, as in the header")
            continue
        values: dict[str, str | float] = {}
        for column, scale, cell in zip(columns, scales, row, strict=True):
            if column in LENGTHS or column == "contacts":
                value = _number(cell, delimiter)
                if value is None and (cell.strip() or column in ("x", "z", "z_rope")):
                    unit = ", in m" if column in LENGTHS else ""
                    faults.append(f"{where}: {column}: given {cell.strip() or 'nothing'!r}; allowed: a number{unit}")
                elif value is not None:
                    values[column] = value * scale
            elif column:
                values[column] = cell.strip()
        found.append((number, values))
    if faults:
        more = [f"{file}: {len(faults) - MOST_FAULTS} more such lines"] if len(faults) > MOST_FAULTS else []
        raise SurveyError("\n".join([*faults[:MOST_FAULTS], *more]))
    return Table(str(file), tuple(filter(None, columns)), tuple(found), tuple(notes))


def _text(file: Path) -> str:
    try:
        return limited_text(file, LARGEST)
    except UnicodeDecodeError as error:
        line = error.object.count(b"\n", 0, error.start) + 1
        allowed = "a CSV file in UTF-8, as spreadsheets save it as `CSV UTF-8`"
        raise SurveyError(f"{file}: line {line}: not a text in UTF-8; allowed: {allowed}") from None
    except (OSError, UnreadableYamlError) as error:
        reason = getattr(error, "strerror", None) or error
        raise SurveyError(f"{file}: cannot be read ({reason}); allowed: a CSV file") from None


def _unit_in(remarks: Sequence[str]) -> str | None:
    """Unit of length named in the remarks of a survey table; None if none is named."""
    words = " ".join(remarks).lower()
    return next((UNITS[unit] for unit in ("us-ft", "us survey feet", "feet", "foot", "ft", "metres", "meters")
                 if re.search(rf"\b{unit}\b", words)), None)  # fmt: skip


def _columns(file: str, header: Sequence[str], units: str | None) -> tuple[list[str], list[float], list[str]]:
    """Names of the columns of a survey table from its header ("" if unknown), scales to metres, and notes."""
    columns: list[str] = []
    scales: list[float] = []
    converted: dict[str, list[str]] = {}
    unknown: list[str] = []
    for given in header:
        match = HEADER.fullmatch(given.strip())
        words = (match[1] if match else given).strip().lower().replace(" ", "_")
        if match and words.endswith(("_ft", "_feet")):
            words, own = words.rpartition("_")[0], "ft"
        else:
            own = ((match[2] or match[3] or "") if match else "").strip().lower()
        name = next((name for name, others in NAMES.items() if words in others), "")
        if name in columns:
            raise SurveyError(f"{file}: line 1: given the column {name} twice; allowed: each once")
        unit = UNITS.get(own) if own else (units or "m")
        if name in LENGTHS and unit is None:
            allowed = ", ".join(FEET)
            raise SurveyError(f"{file}: line 1: {name}: given the unit {own!r}; allowed: {allowed}")
        if not name:
            unknown.append(given.strip())
        columns.append(name)
        scales.append(FEET[unit or "m"] if name in LENGTHS else 1.0)
        if name in LENGTHS and unit is not None and unit != "m":
            converted.setdefault(unit, []).append(name)
    notes = [
        f"{file}: {', '.join(names)}: in {unit}, converted to metres with {FEET[unit]:.7g} m"
        for unit, names in converted.items()
    ]
    return columns, scales, notes + ([f"{file}: columns not read: {', '.join(unknown)}"] if unknown else [])


def _number(cell: str, delimiter: str) -> float | None:
    text = cell.strip()
    try:
        value = float(with_point(text, delimiter))
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def read_survey(terrain: Path, towers: Path, units: str | None = None, above_ground: float | None = None) -> Survey:
    """Read a survey from CSV files of terrain and towers.

    Args:
        terrain: with columns x and z.
        towers: with columns x and z_rope or rope_above_ground; name, contacts, length, radius, hold_down where known.
        units: of lengths without a unit in the header; None: metres.
        above_ground: m, assumed height of the rope on towers without a height; None: refuse such towers.

    Raises:
        SurveyError: with a line for each fault.
    """
    ground = read_table(terrain, units)
    ground.need("x")
    ground.need("z")
    points = [(f"line {number}", float(row["x"]), float(row["z"])) for number, row in ground.rows]
    profile = check_terrain(str(terrain), points)
    table = read_table(towers, units)
    table.need("x")
    if above_ground is None:
        table.need("z_rope", "rope_above_ground")
    bare = Survey(profile, (), {})
    found = []
    for number, row in table.rows:
        name = str(row.get("name") or f"T{number - 1}")
        found.append(tower_of(table.file, f"line {number}", name, row, bare, above_ground))
    return surveyed(str(towers), profile, found, (*ground.notes, *table.notes))


def tower_of(
    file: str, where: str, name: str, row: Mapping[str, str | float], bare: Survey, above_ground: float | None
) -> SurveyedTower:
    """Surveyed tower from a row of survey data.

    Args:
        file: of the data, for faults.
        where: place in the file.
        name: of the tower.
        row: texts, and numbers in metres, by the names of `NAMES`.
        bare: survey with the terrain.
        above_ground: m, assumed height of the rope over the ground if not given; None: refuse the tower.

    Raises:
        SurveyError: a value is missing or invalid; one line.
    """
    x, assumed = float(row["x"]), False
    if "z_rope" in row:
        z = float(row["z_rope"])
    elif "rope_above_ground" in row:
        z = bare.ground(x) + float(row["rope_above_ground"])
    elif above_ground is not None:
        z, assumed = bare.ground(x) + above_ground, True
    else:
        raise SurveyError(
            f"{file}: {where}: given no height of the rope; allowed: z_rope or rope_above_ground, in m, or "
            "--rope-above-ground for all"
        )
    hold = str(row.get("hold_down", "")).lower()
    if hold not in (*TRUE, *FALSE):
        raise SurveyError(f"{file}: {where}: hold_down: given {hold!r}; allowed: 1 or 0")
    contacts = row.get("contacts")
    if contacts is not None and not (float(contacts).is_integer() and 1 <= float(contacts) <= MOST_CONTACTS):
        allowed = f"a whole number from 1 to {MOST_CONTACTS}"
        raise SurveyError(f"{file}: {where}: contacts: given {contacts:g}; allowed: {allowed}")
    sizes = {key: float(row[key]) if key in row else None for key in ("length", "radius")}
    return SurveyedTower(
        name=name,
        x=x,
        z=z,
        where=where,
        contacts=None if contacts is None else int(contacts),
        hold_down=hold in TRUE if hold else None,
        rope_assumed=assumed,
        **sizes,
    )
