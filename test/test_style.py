"""Lint, formatting and types in the test run, and ament's linters where ROS 2 has them.

ament_copyright has no part in it: the licence stands once, in LICENSE, and not in each file.
"""

import re
from configparser import ConfigParser
from pathlib import Path

import pytest
from twin_process import run_python

ROOT = Path(__file__).resolve().parents[1]
CHECKED = ("cable_twin", "launch", "setup.py")
LINTERS = {
    "ament_flake8": ["--config", "setup.cfg"],
    # as ruff is told to: the convention of Google, without docstrings of magic methods, and names that begin a line
    "ament_pep257": ["--convention", "google", "--add-ignore", "D105", "D107", "D402", "D403"],
}


@pytest.mark.parametrize("command", ["ruff check", "ruff format --check", "mypy"])
def test_style(command):
    tool, *arguments = command.split()
    pytest.importorskip(tool)
    result = run_python("-m", tool, *arguments)
    assert result.returncode == 0, result.stdout + result.stderr


@pytest.mark.parametrize("linter", LINTERS)
def test_nothing_is_wrong_but_what_is_declared(linter):
    pytest.importorskip(linter)
    result = run_python("-m", f"{linter}.main", *LINTERS[linter], "--", *CHECKED)
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]


def test_lines_are_as_long_for_flake8_as_for_ruff():
    setup = ConfigParser()
    setup.read(ROOT / "setup.cfg")
    (length,) = re.findall(
        r"^line-length = (\d+)$", (ROOT / "pyproject.toml").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert setup["flake8"]["max-line-length"] == length
