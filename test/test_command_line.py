"""What the commands of the package share."""

from __future__ import annotations

import pytest

from cable_twin.command_line import OneLineParser


def test_help_fills_paragraphs_and_leaves_examples_as_they_are(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    example = f"  drive cabin --speed 5    {'what it does ' * 5}".rstrip()
    parser = OneLineParser("drive", "Tell a twin.", f"{'many words ' * 20}\nand more\n\nexamples:\n{example}\n")
    with pytest.raises(SystemExit, match="0"):
        parser.parse_args(["--help"])
    paragraph, examples = capsys.readouterr().out.rpartition("\n\nexamples:\n")[::2]
    assert max(map(len, paragraph.splitlines())) < 60
    assert " ".join(paragraph.split()).endswith("many words and more")
    assert examples == f"{example}\n"
