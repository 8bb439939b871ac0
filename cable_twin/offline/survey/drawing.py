"""Drawing of a calculated line as CSV or DXF, 1:1 in metres: profile, towers, range of ropes, clearance."""

from __future__ import annotations

import csv
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout
from cable_twin.geometry.ground import heights_over_ground

if TYPE_CHECKING:  # `line` writes with this module
    from cable_twin.offline.lines.at_rest import Line

SUFFIXES = (".csv", ".dxf")
EVERY = 1.0  # m, between places of a rope
TEXT = 2.0  # m, height of texts


def drawing_fault(path: Path | None) -> str:
    """Error line about the path of a drawing, option `--profile`; empty for a valid path or None."""
    if path is None:
        return ""
    if path.suffix.lower() not in SUFFIXES:
        return f"--profile: given {str(path)!r}; allowed: a file that ends with {' or '.join(SUFFIXES)}"
    if path.suffix.lower() == ".dxf" and find_spec("ezdxf") is None:
        return "--profile: a DXF file needs ezdxf, which this Python does not have: pip install 'cable_twin[survey]'"
    return ""


def write_drawing(line: Line, path: Path) -> None:
    """Write profile, ropes and clearance of a calculated line, in a format by its suffix.

    Raises:
        OSError: the file cannot be written.
    """
    if path.suffix.lower() == ".dxf":
        _write_dxf(line, path)
    else:
        _write_csv(line, path)


class RopeRange:
    """Range of the heights of a rope over all places of the vehicles.

    Attributes:
        x: (n,) m, along the track.
        lowest: (n,) m, least height z.
        highest: (n,) m, greatest height.
        clearance: (n,) m, least height over the terrain; NaN without terrain.
    """

    def __init__(self, line: Line, part: slice) -> None:
        """Calculate the range of a rope, given by its slice of the rope samples."""
        shapes = np.array([columns.rope_position[part] for columns in line.columns])
        low, high = shapes[..., 0].min(), shapes[..., 0].max()
        self.x: FloatArray = np.append(np.arange(low, high, EVERY), high)
        z, over = [], []
        for shape in shapes:
            order = np.argsort(shape[:, 0])
            z.append(np.interp(self.x, shape[order, 0], shape[order, 2]))
            ground = heights_over_ground(line.scenario, shape) if line.scenario.terrain else np.full(len(shape), np.nan)
            over.append(np.interp(self.x, shape[order, 0], ground[order]))
        self.lowest, self.highest = np.min(z, axis=0), np.max(z, axis=0)
        self.clearance = np.min(over, axis=0)


def _ranges(line: Line) -> dict[str, RopeRange]:
    samples = line.columns[0].rope_tension.size // max(len(line.scenario.ropes), 1)
    parts = Layout.of(line.scenario, samples).ropes
    return {name: RopeRange(line, part) for name, part in parts.items()}


def _write_csv(line: Line, path: Path) -> None:
    """Write a calculated line as CSV: terrain, towers, ropes, vehicles with x, z, highest z and clearance in m."""
    rows: list[tuple[Any, ...]] = []
    rows += [("terrain", "", *map(float, (place[0], place[-1])), "", "") for place in line.scenario.terrain]
    rows += [("tower", name, float(x), float(z), "", "") for name, (x, _, z) in line.scenario.tower_places.items()]
    for name, one in _ranges(line).items():
        over = [round(value, 4) if np.isfinite(value) else "" for value in one.clearance.tolist()]
        columns = (np.round(array, 4).tolist() for array in (one.x, one.lowest, one.highest))
        rows += [("rope", name, *values) for values in zip(*columns, over, strict=True)]
    for seen in line.lowest:
        rows += [
            (
                "vehicle",
                name,
                round(place.x, 4),
                round(_ground(line, place.x) + place.height, 4),
                "",
                round(place.height, 4),
            )
            for name, place in seen.items()
        ]
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["what", "name", "x [m]", "z [m]", "highest z [m]", "clearance [m]"])
        writer.writerows(rows)


def _ground(line: Line, x: float) -> float:
    places = np.array([(place[0], place[-1]) for place in line.scenario.terrain])
    return float(np.interp(x, *places.T))


def _write_dxf(line: Line, path: Path) -> None:
    """Write a calculated line as DXF: x to the right, z upwards, layers for terrain, towers, ropes, clearance."""
    import ezdxf  # noqa: PLC0415 - an extra
    from ezdxf import units  # noqa: PLC0415 - the same

    drawing = ezdxf.new("R2010", setup=True)
    drawing.units = units.M
    sheet = drawing.modelspace()

    def layer(name: str, color: int, kind: str = "CONTINUOUS") -> dict[str, str]:
        if name not in drawing.layers:
            drawing.layers.add(name, color=color, linetype=kind)
        return {"layer": name}

    if line.scenario.terrain:
        places = [(float(place[0]), float(place[-1])) for place in line.scenario.terrain]
        sheet.add_lwpolyline(places, dxfattribs=layer("TERRAIN", 34))
    tops: dict[tuple[float, float], list[str]] = {}
    for name, (x, _, top) in line.scenario.tower_places.items():
        tops.setdefault((float(x), float(top)), []).append(name)
    for (x, top), names in tops.items():
        foot = _ground(line, x) if line.scenario.terrain else top - 10.0
        sheet.add_line((x, foot), (x, top), dxfattribs=layer("TOWERS", 8))
        sheet.add_text(", ".join(names), height=TEXT, dxfattribs={**layer("TEXT", 7), "insert": (x, top + TEXT)})
    for number, (name, one) in enumerate(_ranges(line).items()):
        for what, heights, kind in (("LOWEST", one.lowest, "CONTINUOUS"), ("HIGHEST", one.highest, "DASHED")):
            points = np.column_stack([one.x, heights]).tolist()
            sheet.add_lwpolyline(points, dxfattribs=layer(f"ROPE_{name.upper()}_{what}", 1 + number % 6, kind))
    for seen in line.lowest:
        for place in seen.values():
            ground = _ground(line, place.x)
            sheet.add_line((place.x, ground), (place.x, ground + place.height), dxfattribs=layer("CLEARANCE", 6))
    drawing.saveas(path)
