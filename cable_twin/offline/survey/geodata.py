"""Reader of surveys in GPX, GeoJSON, GeoPackage: terrain and towers in geographic or projected coordinates, heights."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey.profile import (
    FEET,
    Survey,
    SurveyedTower,
    SurveyError,
    check_terrain,
    surveyed,
)
from cable_twin.offline.survey.tables import MOST_ROWS, NAMES, tower_of

SUFFIXES = (".gpx", ".geojson", ".json", ".gpkg")
NEEDED = ("pyproj", "pyogrio", "shapely")
EARTH = 6.371e6  # m, mean radius
ASIDE, GROUND_ASIDE = 5.0, 25.0  # m, from the straight line, up to which towers and terrain are taken
GROUND = re.compile("terrain|ground|gel|profil", re.IGNORECASE)  # in names of layers and tracks
ROPES = re.compile("seil|cable|rope", re.IGNORECASE)
PAIRS = re.compile(r"(\w+)\s*[=:]\s*([-+.\w]+)")  # in the remarks of a waypoint
OTHER_NAMES = {"bezeichnung": "name", "h": "rope_above_ground"}  # those of SEILAPLAN's GeoPackage
REMARKS = ("desc", "cmt", "description")


class Feature(NamedTuple):
    """Line or point of a geodata file, with heights and attributes.

    Attributes:
        where: layer and number, for faults.
        places: (points, 3), coordinates and height in the units of the file; NaN without a height.
        values: attributes, by the column names of survey tables.
        is_line: whether the feature is a line, not a point.
        ground: whether layer or name call the feature terrain.
    """

    where: str
    places: FloatArray
    values: Mapping[str, Any]
    is_line: bool
    ground: bool


def is_geodata(file: Path) -> bool:
    """Whether a survey file is of geodata, not a table, by its suffix."""
    return file.suffix.lower() in SUFFIXES


def read_geodata(terrain: Path, towers: Path, units: str | None = None, above_ground: float | None = None) -> Survey:
    """Read a survey from geodata files of terrain and towers, or from one file with both.

    Args:
        terrain: with a line of the ground, or points of it.
        towers: with a point for each tower.
        units: of heights, a key of `FEET`; None: metres, not allowed for coordinates in feet.
        above_ground: m, assumed height of the rope on towers without a height; None: refuse such towers.

    Raises:
        SurveyError: with a line for each fault.
    """
    if missing := [name for name in NEEDED if find_spec(name) is None]:
        raise SurveyError(
            f"{terrain}: needs {', '.join(missing)}, which this Python does not have: pip install 'cable_twin[survey]'"
        )
    (ground, plane), (points, other) = _features(terrain), _features(towers)
    if plane != other:
        raise SurveyError(f"{towers}: given coordinates in {other}; allowed: those of the terrain, {plane}")
    line = _ground(terrain, ground, same=terrain == towers)
    flat, notes = _metres(terrain, plane, units, line)
    if len(line) > MOST_ROWS:
        raise SurveyError(f"{terrain}: terrain: given {len(line)} points; allowed: at most {MOST_ROWS}")
    if not np.isfinite(line[:, 2]).all():
        raise SurveyError(f"{terrain}: terrain: given a line without heights; allowed: a height at each point")
    profile, along = _along(terrain, flat(line))
    places = [(f"point {number}", x, z) for number, (x, z) in enumerate(profile.tolist(), start=1)]
    bare = Survey(check_terrain(str(terrain), places), (), {})
    found: list[SurveyedTower] = []
    scale = FEET[units or "m"]
    for one in points:
        if one.is_line or (one.ground and terrain == towers):
            continue
        if _number(one.values.get("rope_above_ground")) == 0.0:
            notes.append(f"{towers}: {one.where}: left out, as it has no height: an anchor")
            continue
        x, aside = along(flat(one.places))
        name = str(one.values.get("name") or one.where)
        if abs(aside) > ASIDE:
            raise SurveyError(
                f"{towers}: {one.where}: given {name} {abs(aside):.1f} m beside the straight line from the first to "
                f"the last point of the terrain; allowed: at most {ASIDE:g} m"
            )
        row = _row(one.values, x, scale)
        found.append(tower_of(str(towers), one.where, name, row, bare, above_ground))
    return surveyed(str(towers), bare.terrain, found, notes)


def _features(file: Path) -> tuple[list[Feature], str]:
    """Lines and points of all layers of a geodata file, and its coordinate system."""
    import pyogrio  # noqa: PLC0415 - an extra
    import shapely  # noqa: PLC0415 - the same

    pyogrio.set_gdal_config_options({"GPX_ELE_AS_25D": True})
    found: list[Feature] = []
    plane = ""
    try:
        layers = [str(name) for name, _ in pyogrio.list_layers(file)]
        for layer in layers:
            if layer in ("track_points", "route_points"):
                continue  # those of tracks and routes
            meta, _, shapes, columns = pyogrio.raw.read(file, layer=layer)
            if len(shapes) == 0:
                continue
            plane = str(meta["crs"] or "")
            names = [str(name) for name in meta["fields"]]
            with np.errstate(invalid="ignore"):  # places that are no numbers, refused below
                there = shapely.from_wkb(shapes)
            for number, shape in enumerate(there, start=1):
                if shape is None or shape.is_empty:
                    continue
                values = _named({name: column[number - 1] for name, column in zip(names, columns, strict=True)})
                places = shapely.get_coordinates(shape, include_z=True)
                if not np.isfinite(places[:, :2]).all():
                    where = f"{file}: {layer}, feature {number}"
                    raise SurveyError(f"{where}: given a place that is no number; allowed: finite coordinates")
                is_line = shape.geom_type in ("LineString", "MultiLineString")
                said = f"{layer} {values.get('name', '')} {values.get('kind', '')}"
                ground = bool(GROUND.search(said)) and not ROPES.search(said)
                if is_line and ROPES.search(said) and not GROUND.search(said):
                    continue
                found.append(Feature(f"{layer}, feature {number}", places, values, is_line, ground))
    except SurveyError:
        raise
    except (pyogrio.errors.DataSourceError, pyogrio.errors.DataLayerError, ValueError) as error:
        reason = " ".join(str(error).split())
        raise SurveyError(f"{file}: cannot be read ({reason}); allowed: {', '.join(SUFFIXES)}") from None
    if not found:
        raise SurveyError(f"{file}: given no line or point; allowed: a line of terrain and a point for each tower")
    if not plane:
        raise SurveyError(f"{file}: given no coordinate system; allowed: geographic or projected coordinates with one")
    return found, plane


def _named(values: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes of a feature by the column names of survey tables, with KEY=VALUE pairs of its remarks."""
    given = {key.lower(): value for key, value in values.items() if value is not None and value != ""}
    for remark in REMARKS:
        given = {key.lower(): value for key, value in PAIRS.findall(str(given.get(remark, "")))} | given
    found: dict[str, Any] = {}
    for key, value in given.items():
        name = OTHER_NAMES.get(key) or next((name for name, others in NAMES.items() if key in others), key)
        if not (isinstance(value, float | np.floating) and np.isnan(value)):
            found.setdefault(name, value)
    return found


def _ground(file: Path, features: Sequence[Feature], same: bool) -> FloatArray:
    """Terrain points (n, 3) of a survey: of the line called terrain, else of the first line, else all points."""
    lines = [one for one in features if one.is_line]
    for choice in ([one for one in lines if one.ground], lines):
        if choice:
            return choice[0].places
    points = [one.places for one in features if one.ground or not same]
    if len(points) < 2:
        raise SurveyError(f"{file}: given no line of terrain; allowed: a line, or a point for each place of the ground")
    return np.concatenate(points)


def _metres(file: Path, plane: str, units: str | None, places: FloatArray) -> tuple[Any, list[str]]:
    """Make a function that converts places (n, 3) of a coordinate system to metres; returns it, and notes as text.

    Args:
        file: for faults and notes.
        plane: coordinate system.
        units: of heights; None: metres.
        places: (points, 3) of the terrain.
    """
    import pyproj  # noqa: PLC0415 - an extra

    system = pyproj.CRS.from_user_input(plane)
    scale = FEET[units or "m"]
    notes = [f"{file}: heights: in {units}, converted to metres with {scale:.7g} m"] if scale != 1.0 else []
    if system.is_projected:
        axis = system.axis_info[0]
        factor = float(axis.unit_conversion_factor)
        if abs(factor - 1.0) > 1e-9 and units is None:
            raise SurveyError(
                f"{file}: given coordinates in {axis.unit_name} ({plane}), and heights without a unit; allowed: "
                "--units m, ft or us-ft for the heights"
            )
        if abs(factor - 1.0) > 1e-9:
            notes.append(f"{file}: coordinates: in {axis.unit_name}, converted to metres with {factor:.7g} m")
        return lambda places: places * [factor, factor, scale], notes
    middle: list[FloatArray] = []

    def flat(places: FloatArray) -> FloatArray:
        if not (np.abs(places[:, :2]) <= [180.0, 90.0]).all():
            lon, lat = places[~(np.abs(places[:, :2]) <= [180.0, 90.0]).all(axis=1)][0, :2]
            raise SurveyError(
                f"{file}: given longitude {lon:g} and latitude {lat:g}; allowed: at most 180 and 90 degrees, in the "
                "order of the format, in GeoJSON the longitude first"
            )
        if not middle:  # that of the terrain, which comes first
            middle.append(places.mean(axis=0))
        lon, lat, height = middle[0].tolist()
        local = pyproj.CRS.from_proj4(f"+proj=aeqd +lat_0={lat!r} +lon_0={lon!r} +ellps=WGS84 +units=m")
        change = pyproj.Transformer.from_crs(system, local, always_xy=True)
        east, north = change.transform(places[:, 0], places[:, 1])
        wider = 1.0 + (0.0 if np.isnan(height) else height * scale) / EARTH  # at that height, not at sea level
        return np.column_stack([np.asarray(east) * wider, np.asarray(north) * wider, places[:, 2] * scale])

    lon, lat = places[:, :2].mean(axis=0)
    where = f"{abs(lat):.4f}° {'N' if lat >= 0.0 else 'S'}, {abs(lon):.4f}° {'E' if lon >= 0.0 else 'W'}"
    notes.append(f"{file}: {plane}, projected around the middle of the terrain, {where}, at its mean height")
    return flat, notes


def _along(file: Path, places: FloatArray) -> tuple[FloatArray, Any]:
    """Terrain (n, 2) along the straight line from its first point to its last, and a projection onto that line.

    The projection returns the distance of a place along the line, and its distance to the left, both in m.
    """
    way = places[-1, :2] - places[0, :2]
    if (length := float(np.hypot(*way))) == 0.0:
        raise SurveyError(f"{file}: terrain: given a line that ends where it begins; allowed: one along the ropeway")
    unit, first = way / length, places[0, :2]

    def along(others: FloatArray) -> tuple[float, float]:
        from_first = others[0, :2] - first
        return float(from_first @ unit), float(unit[0] * from_first[1] - unit[1] * from_first[0])

    aside = (places[:, :2] - first) @ np.array([-unit[1], unit[0]])
    if np.abs(aside).max() > GROUND_ASIDE:
        raise SurveyError(
            f"{file}: terrain: given a line up to {np.abs(aside).max():.1f} m beside the straight line from its first "
            f"point to its last; allowed: at most {GROUND_ASIDE:g} m"
        )
    return np.column_stack([(places[:, :2] - first) @ unit, places[:, 2]]), along


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def _row(values: Mapping[str, Any], x: float, scale: float) -> dict[str, str | float]:
    """Table row of a surveyed tower from the attributes of its feature."""
    row: dict[str, str | float] = {"x": round(x, 3)}
    for key in ("z_rope", "rope_above_ground", "length", "radius", "contacts"):
        if (number := _number(values.get(key))) is not None:
            row[key] = number * (1.0 if key == "contacts" else scale)
    if "hold_down" in values:
        number = _number(values["hold_down"])  # whole ones beside features without are floating-point numbers
        row["hold_down"] = str(values["hold_down"]) if number is None else f"{number:g}"
    return row
