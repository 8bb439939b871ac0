"""Study of the paper's example as one command, with its results in words."""

import struct
import sys
from importlib import import_module
from math import isfinite
from pathlib import Path

import pytest
from twin_process import run_python

ROOT = Path(__file__).resolve().parents[1]
STUDY = ROOT / "examples" / "paper_study.py"
PNG = b"\x89PNG\r\n\x1a\n"

pytest.importorskip("matplotlib")


def rows(text):
    """Lines of the printed table as (model, elements, time, x, z, distance)."""
    return [line.split() for line in text.splitlines() if line.startswith(("continuum ", "element_frame "))]


@pytest.mark.long
def test_writes_figures_recordings_and_table(tmp_path):
    output = tmp_path / "new" / "study"
    result = run_python(STUDY, "--output", output, "--duration", 0.1, "--elements", 12, variables={"COLUMNS": "120"})
    assert result.returncode == 0, result.stderr

    assert {path.name for path in output.iterdir()} == {
        "behaviour.png",
        "path.png",
        "continuum.rrd",
        "element_frame.rrd",
    }
    for name in ("behaviour.png", "path.png"):
        data = (output / name).read_bytes()
        width, height = struct.unpack(">II", data[16:24])
        assert data.startswith(PNG)
        assert data[12:16] == b"IHDR"
        assert (width > 1000, height > 600, len(data) > 20_000) == (True, True, True)
    for name in ("continuum.rrd", "element_frame.rrd"):
        data = (output / name).read_bytes()
        assert data[:3] == b"RRF"
        assert len(data) > 20_000

    said = " ".join(result.stdout.split())
    assert "Point 1 (taken as the sliding joint) are a declared reconstruction" in said
    assert "it does not claim to reproduce Fig. 5 or Fig. 6" in said
    (reference,), others = rows(result.stdout)[:1], rows(result.stdout)[1:]
    assert [row[:3] for row in others] == [["continuum", "12", "0.1"], ["element_frame", "12", "0.1"]]
    assert reference[:3] == ["continuum", "96", "0.1"]
    assert reference[-1] == "reference"
    for row in others:
        x, z, distance = map(float, row[3:])
        assert all(map(isfinite, (x, z, distance)))
        # It has begun to move, and meshes agree early on.
        assert x == pytest.approx(float(reference[3]), abs=0.03)
        assert z == pytest.approx(float(reference[4]), abs=0.03)
        assert 0.0 < distance < 30.0


@pytest.mark.parametrize(
    ("arguments", "fault"),
    [
        (("--duration", "0"), "allowed are"),
        (("--duration", "nan"), "allowed are"),
        (("--elements", "2"), "allowed are"),
        (("--elements", "96"), "are the reference"),
        (("--elements", "many"), "invalid"),
    ],
)
def test_refuses_wrong_arguments(tmp_path, monkeypatch, capsys, arguments, fault):
    monkeypatch.syspath_prepend(STUDY.parent)
    monkeypatch.setattr(sys, "argv", [str(STUDY), "--output", str(tmp_path / "study"), *arguments])
    with pytest.raises(SystemExit) as ended:
        import_module(STUDY.stem).main()
    assert ended.value.code == 2
    assert fault in capsys.readouterr().err
    assert not (tmp_path / "study").exists()


def test_says_where_it_cannot_write(tmp_path, ended):
    (tmp_path / "file").touch()
    code, _, errors = ended(STUDY, "--output", tmp_path / "file", "--duration", 0.1, "--elements", 12, "--no-rerun")
    assert code == 1
    assert errors.startswith("paper_study.py: ")
    assert "Traceback" not in errors
