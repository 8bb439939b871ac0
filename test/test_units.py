"""Text of numbers in engineers' units."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from named_figures import named

import cable_twin
from cable_twin.basics.units import rounded, with_unit
from cable_twin.messages.figure_messages import describe
from cable_twin.offline.figure_table import verdict_lines

PACKAGE = Path(cable_twin.__file__).parent


@pytest.mark.parametrize(
    ("value", "unit", "written"),
    [
        (56460.0, "N m", "56.46 kN m"),
        (1.234e6, "N m", "1.234 MN m"),
        (19800.0, "kg", "19.8 t"),
        (1200.0, "kg", "1200 kg"),
        (-123456.0, "N", "-123.5 kN"),
        (0.5, "rad", "28.65 deg"),
        (2.5e5, "J", "250 kJ"),
        (12345.6, "m", "12350 m"),
        (0.0001234, "-", "0.0001234"),
        (0.0, "N", "0 N"),
    ],
)
def test_a_value_has_the_unit_that_reads_well_and_no_exponent(value, unit, written):
    assert with_unit(value, unit) == written


def test_a_number_is_rounded_to_its_digits():
    assert [rounded(value) for value in (9999.96, 29526.3, 1e7, 1e-5, float("inf"))] == [
        "10000",
        "29530",
        "1e+07",
        "1e-05",
        "inf",
    ]


def test_a_figure_on_a_topic_is_in_one_unit_with_its_limit():
    figure = named("drive: drive force", 900.0, "N", 1.0, limit=106000.0, source="scenario")
    assert describe(figure) == "0.9 kN at 1.00 s, allowed: at most 106 kN (scenario)"
    passed = named("cabin: acceleration", 1.500004, "m/s^2", 1.0, limit=1.5, source="usual")
    assert describe(passed) == "1.500004 m/s^2 at 1.00 s, allowed: at most 1.5 m/s^2 (usual)"


def test_what_a_comparison_comes_to_says_which_run_is_beyond():
    runs = [[named("sag", value, "m", 1.0, limit=5.0), named("speed", 1.0, "m/s", 0.0)] for value in (4.0, 6.0)]
    assert verdict_lines(runs) == ["1 of 1 limits is not kept:", "  sag: not kept by b: 6 m, at most 5 m"]
    assert verdict_lines(runs[:1]) == ["the limit is kept"]
    near = replace(runs[1][0], value=5.1, uncertainty=0.2, place="x 3 m")
    assert verdict_lines([[near]])[1] == "  sag: not decided: 5.1 m, at most 5 m, at 1.00 s, x 3 m"
    assert verdict_lines([[named("speed", 1.0, "m/s", 0.0)]]) == []


def test_messages_write_forces_and_energies_in_one_place():
    """Forces and energies in every message through `with_unit`: 6.74 kN, not 6.74e+03 N."""
    own = re.compile(r"\{[^{}]*:(\.\d)?[eg]\} (N|N m|W|J)\b|:\.[23]g\} m(?![\w/])")
    wrong = {
        f"{path}:{number}"
        for path in sorted(PACKAGE.rglob("*.py"))
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if own.search(line)
    }
    assert wrong == set()
