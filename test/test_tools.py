"""Commands for developers: help without a run, and a short part of each."""

from pathlib import Path

import pytest
from twin_process import run_python

from fuzzing import FUZZERS

ROOT = Path(__file__).resolve().parents[1]
PARTS = {
    "verification": "statics",
    "verification.long_runs": "tramway_trip",
    "benchmarks": "startup",
    "examples.pictures": "softer_brake",
}


@pytest.mark.parametrize("name", PARTS)
def test_help_is_printed_and_nothing_is_run(name, ended):
    pages = {page: page.stat().st_mtime_ns for page in (ROOT / "docs").rglob("*") if page.is_file()}
    code, said, _ = ended(name, "--help")
    assert code == 0
    assert said.startswith("usage: ")
    assert PARTS[name] in said
    assert pages == {page: page.stat().st_mtime_ns for page in pages}


@pytest.mark.parametrize("name", PARTS)
def test_a_part_that_is_none_is_refused_with_those_that_are(name, ended):
    code, _, errors = ended(name, "statiks")
    assert code == 2
    error = errors.splitlines()[-1]
    assert "statiks" in error
    assert PARTS[name] in error


def test_the_fuzzer_refuses_what_it_does_not_know(ended):
    code, _, errors = ended("fuzzing", "nothing")
    assert code == 2
    assert f"given 'nothing'; allowed: {', '.join(FUZZERS)}" in errors


@pytest.mark.long
def test_one_section_is_verified_and_its_rows_printed():
    page = (ROOT / "docs" / "verification.md").read_text(encoding="utf-8")
    result = run_python("-m", "verification", "hinges")
    assert result.returncode == 0, result.stdout + result.stderr
    head, _, *rows = result.stdout.splitlines()
    assert head.startswith("| case | source |")
    known = {line.split(" | ")[0] for line in page.splitlines()}
    assert rows
    assert {row.split(" | ")[0] for row in rows} <= known
    assert (ROOT / "docs" / "verification.md").read_text(encoding="utf-8") == page


@pytest.mark.long
def test_a_long_run_begins_and_its_energy_is_found():
    """First seconds of the tramway: drive work found in ropes, cabin, friction, dampers and air."""
    result = run_python("-m", "verification.long_runs", "tramway_trip", "--share", 0.02)
    assert result.returncode == 0, result.stderr
    cells = [cell.strip() for cell in result.stdout.splitlines()[-1].split("|")]
    assert cells[1:6] == ["tramway_trip", "7 s", "738", "0", "0"]  # in steps of 0.01 s
    assert float(cells[8].removesuffix(" %")) < 1.0
