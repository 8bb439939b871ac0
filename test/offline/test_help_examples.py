"""Examples in the help of the engineer's commands: their options are valid, and their files are in a fresh clone."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from cable_twin.offline import design, envelope, import_profile, replay, report, review, rules, simulate_options, study

ROOT = Path(__file__).resolve().parents[2]
MODULES = design, envelope, import_profile, replay, report, review, rules, simulate_options, study
COMMANDS = {one.__name__.rpartition(".")[2].removesuffix("_options"): one for one in MODULES}


def examples(module):
    """Commands of the help, as lists of words."""
    told = re.sub(r"\s*\\\n\s*", " ", module.EPILOG.partition("\nexamples:\n")[2])
    lines = [re.split(r"\s{3,}", line.strip())[0] for line in told.splitlines()]  # without remarks behind them
    return [shlex.split(line.partition(" | ")[0]) for line in lines if line]


@pytest.mark.parametrize("name", COMMANDS)
def test_examples_of_the_help_are_valid(name):
    found = examples(COMMANDS[name])
    assert any(words[0] == name for words in found)
    for command, *given in found:
        COMMANDS[command].parser().parse_args([one for one in given if one not in ("runs/*", "--list")])
        for one in given:
            assert not one.startswith("examples/") or (ROOT / one).is_file(), one


@pytest.mark.parametrize("name", COMMANDS)
def test_the_help_tells_exit_codes(name):
    assert re.search(r"^exit codes: 0 ", COMMANDS[name].EPILOG, re.MULTILINE)
