"""Profile, ropes and clearance of a calculated line as CSV and DXF."""

from __future__ import annotations

import csv

import pytest

from cable_twin.offline import line


def test_profile_and_clearance_are_those_of_the_line_in_csv_and_dxf(tmp_path):
    files = [tmp_path / f"profile.{kind}" for kind in ("csv", "dxf")]
    for file in files:
        assert line.main(["aerial_tramway", "--places", "2", "--profile", str(file)]) == 0
    with files[0].open() as file:
        rows = list(csv.DictReader(file))
    rope = [row for row in rows if row["what"] == "rope"]
    assert float(rope[0]["x [m]"]) == pytest.approx(0.0, abs=3.0)
    heights = {float(row["x [m]"]): float(row["clearance [m]"]) for row in rope}
    assert min(heights.values()) == pytest.approx(13.0, abs=3.0)
    assert [row["x [m]"] for row in rows if row["what"] == "tower"] == ["400.0"]
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.readfile(files[1])
    assert not drawing.audit().errors
    lines = {one.dxf.layer: one for one in drawing.modelspace().query("LWPOLYLINE")}
    assert set(lines) == {"TERRAIN", "ROPE_CABLE_LOWEST", "ROPE_CABLE_HIGHEST"}
    assert lines["TERRAIN"].get_points("xy")[0] == (-30.0, -14.0)
    drawn = dict(lines["ROPE_CABLE_LOWEST"].get_points("xy"))
    assert [round(z, 4) for z in drawn.values()] == pytest.approx([float(row["z [m]"]) for row in rope])


def test_a_wrong_name_is_a_line(capsys):
    assert line.main(["--profile", "line.dwg"]) == 2
    assert "--profile: given 'line.dwg'; allowed: a file that ends with .csv or .dxf" in capsys.readouterr().err
