"""Surveys in GeoJSON, GPX and GeoPackage: the nine towers of the CSV files, in geographic and projected coordinates."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from cable_twin.offline import import_profile
from cable_twin.offline.survey.geodata import read_geodata
from cable_twin.offline.survey.profile import SurveyError
from cable_twin.offline.survey.tables import read_survey

pyproj, pyogrio, shapely = map(pytest.importorskip, ("pyproj", "pyogrio", "shapely"))

SURVEY = Path(__file__).resolve().parents[2] / "examples" / "survey"
LINE = SURVEY / "line.geojson"
SHIFT, DATUM = 20.0, 1000.0  # m, from the x and z of the CSV files to distance from the first point and height


@pytest.fixture(scope="module")
def features():
    """Features of the shipped file, made along a geodesic."""
    return json.loads(LINE.read_text())["features"]


def written(file, features):
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def packaged(file, features, system, up=1.0):
    """GeoPackage in a coordinate system with layers as SEILAPLAN writes them; `up`: units of height in a metre."""
    change = pyproj.Transformer.from_crs("EPSG:4326", system, always_xy=True).transform

    def moved(places):
        return np.column_stack([*change(places[:, 0], places[:, 1]), places[:, 2] * up])

    shapes = [
        shapely.transform(shapely.from_geojson(json.dumps(one["geometry"])), moved, include_z=True) for one in features
    ]
    binary = np.array([shapely.to_wkb(one, output_dimension=3) for one in shapes], dtype=object)
    names, heights = (np.array([one["properties"][key] for one in features[1:]]) for key in ("name", "z_rope"))
    for layer, part, kind, columns in (
        ("leerseil", binary[:1], "LineString Z", {}),
        ("terrain", binary[:1], "LineString Z", {}),
        ("stuetzen", binary[1:], "Point Z", {"bezeichnung": names, "z_rope": heights * up}),
    ):
        options = {"layer": layer, "geometry_type": kind, "crs": system, "driver": "GPKG", "append": file.exists()}
        pyogrio.raw.write(file, part, [*columns.values()], [*columns], **options)
    return file


def as_in_tables(survey, tolerance):
    """Check terrain and towers against the CSV files."""
    table = read_survey(SURVEY / "terrain.csv", SURVEY / "towers.csv")
    assert survey.terrain == pytest.approx(table.terrain + np.array([SHIFT, DATUM]), abs=tolerance)
    assert [one.name for one in survey.towers] == [one.name for one in table.towers]
    for one, other in zip(survey.towers, table.towers, strict=True):
        assert (one.x, one.z) == pytest.approx((other.x + SHIFT, other.z + DATUM), abs=tolerance)


def test_geojson_in_degrees_has_the_distances_of_the_tables(tmp_path, capsys):
    survey = read_geodata(LINE, LINE)
    as_in_tables(survey, 0.01)
    assert survey.stations["end"] == pytest.approx((970.0, 1240.0), abs=0.01)
    assert [one.hold_down for one in survey.towers].index(True) == 2
    assert import_profile.main([str(LINE), "--no-rest", "--output", str(tmp_path / "lift.yaml")]) == 0
    assert "EPSG:4326, projected around the middle of the terrain, 4" in capsys.readouterr().err


def test_a_geopackage_in_projected_coordinates(tmp_path, features):
    """Layers of SEILAPLAN: ground from `terrain` and not from the rope; coordinates of a map are 2e-4 shorter."""
    file = packaged(tmp_path / "line.gpkg", features, "EPSG:31254")
    as_in_tables(read_geodata(file, file), 0.3)


def test_a_map_in_feet_is_refused_without_a_unit_of_heights(tmp_path, features):
    file = packaged(tmp_path / "feet.gpkg", features, "EPSG:32124", up=1.0 / 0.3048)  # North Dakota North, NAD83
    assert read_geodata(file, file, "ft").terrain[:, 1] == pytest.approx(read_geodata(LINE, LINE).terrain[:, 1])
    feet = packaged(tmp_path / "us.gpkg", features, "EPSG:2225")
    with pytest.raises(SurveyError, match=r"given coordinates in US survey foot .*, and heights without a unit; allow"):
        read_geodata(feet, feet)


def test_gpx_has_towers_as_waypoints(tmp_path, features):
    def point(tag, place, rest=""):
        lon, lat, ele = (*place, None)[:3]
        return f'<{tag} lat="{lat}" lon="{lon}">{f"<ele>{ele}</ele>" if ele is not None else ""}{rest}</{tag}>'

    line, *towers = features
    ways = [
        point("wpt", one["geometry"]["coordinates"], f"<name>{one['properties']['name']}</name><desc>z_rope="
              f"{one['properties']['z_rope']}</desc>")
        for one in towers
    ]  # fmt: skip
    track = "".join(point("trkpt", place) for place in line["geometry"]["coordinates"])
    text = f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">{"".join(ways)}<trk><trkseg>'
    file = tmp_path / "line.gpx"
    file.write_text(f"{text}{track}</trkseg></trk></gpx>")
    as_in_tables(read_geodata(file, file), 0.01)


def test_wrong_geodata_is_a_line_each(tmp_path, features, capsys):
    line, start, first, second, *others = features

    def fault(*features):
        with pytest.raises(SurveyError) as error:
            read_geodata(file := written(tmp_path / "wrong.geojson", features), file)
        (told,) = str(error.value).splitlines()
        return told

    flat = {"type": "LineString", "coordinates": [place[:2] for place in line["geometry"]["coordinates"]]}
    assert "terrain: given a line without heights; allowed: a height at" in fault({**line, "geometry": flat}, start)
    assert "given no line of terrain; allowed: a line, or a point for" in fault(start, first)
    assert "T1 at x = 65" in fault(line, start, second, first, *others)  # after T2: wrong order
    ground = line["geometry"]["coordinates"]
    back = {"type": "LineString", "coordinates": [*ground[:4], ground[2], *ground[4:]]}
    assert "the terrain folds back; allowed: rising x" in fault({**line, "geometry": back}, first)
    swapped = {"type": "LineString", "coordinates": [[11.35 + 1e-3 * row, 95.0, 1e3] for row in range(9)]}
    assert "given longitude 11.35 and latitude 95; allowed: at most 180 and" in fault({**line, "geometry": swapped})
    nowhere = {"type": "LineString", "coordinates": [[float("nan"), 47.2, 1e3], *ground[1:]]}
    assert "feature 1: given a place that is no number; allowed: finite" in fault({**line, "geometry": nowhere}, first)
    beside = {"type": "Point", "coordinates": [11.3530, 47.2000]}
    assert "beside the straight line from the first to the last point" in fault(line, {**first, "geometry": beside})
    bare = {**first, "properties": {"name": "T1"}}
    assert "given no height of the rope; allowed: z_rope or rope_above_ground" in fault(line, bare)
    assert import_profile.main([str(SURVEY / "terrain.csv")]) == 2
    assert import_profile.main([str(LINE), str(SURVEY / "towers.csv")]) == 2
    assert import_profile.main([str(tmp_path / "none.gpx")]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3
    assert all("allowed: " in one for one in lines)
