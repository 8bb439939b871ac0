"""Example of key figures from Python against the output of the commands."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

from cable_twin.offline.line import main as line
from examples import key_figures

PAGE = Path(__file__).resolve().parents[1] / "docs" / "experiments.md"


def test_it_prints_figures_of_a_run_and_of_a_line_at_rest(capsys, tmp_path):
    key_figures.main([])
    printed = capsys.readouterr().out.splitlines()
    limited = [row for row in printed if row.endswith((": kept", ": NOT KEPT"))]
    assert any(row.startswith("cabin: stopping") or row.startswith("rope safety factor: ") for row in limited)
    tensions = [float(re.findall(r"([\d.]+) kN", row)[0]) for row in printed if row.startswith("cabin at ")]
    assert len(tensions) == 5
    assert line(["aerial_tramway", "--places", "5"]) == 0
    highest, _ = re.findall(r"rope tension, highest +([\d.]+) +kN", capsys.readouterr().out)  # and of the haul rope
    assert round(max(tensions)) == round(float(highest))


def test_the_page_shows_the_code_of_the_example():
    text = PAGE.read_text(encoding="utf-8")
    for function in (key_figures.run, key_figures.at_rest):
        body = inspect.getsource(function).partition('"""\n')[2]
        lines = [row.strip() for row in body.splitlines() if not row.strip().startswith("return")]
        assert all(row in text for row in lines), function.__name__


def test_each_block_of_the_page_runs_by_itself():
    text = PAGE.read_text(encoding="utf-8").partition("## Key figures from Python")[2].partition("\n## ")[0]
    blocks = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 2
    for block in blocks:
        exec(block.replace("7.0, 20.0", "7.0, 0.1").replace('tramway", 20', 'tramway", 2'), {})
