"""Control characters in foreign names kept from the terminal."""

from __future__ import annotations

import pytest

from cable_twin.basics.printable import printable, printable_lines


@pytest.mark.parametrize(
    ("given", "shown"),
    [
        ("cabin", "cabin"),
        ("Gondelbahn Süd, 3 m²", "Gondelbahn Süd, 3 m²"),
        ("\x1b[2J\x1b[1;31mred\x07", r"\x1b[2J\x1b[1;31mred\x07"),
        ("a\r\nb\tc\x7f\x9b31m", r"a\r\nb\tc\x7f\x9b31m"),
        ("left\u202eright\u2066\u200b", r"left\u202eright\u2066\u200b"),  # bidirectional marks, no width
        ("\u2028\ud800\U000e0001", r"\u2028\ud800\U000e0001"),
        (ValueError("a\x1b"), r"a\x1b"),
        (12, "12"),
    ],
)
def test_what_is_not_printable_is_escaped(given, shown):
    assert printable(given) == shown
    assert printable(given).isprintable()


def test_what_is_long_is_cut_also_by_its_escapes():
    assert printable("a" * 80) == "a" * 80
    assert printable("a" * 81) == "a" * 77 + "..."
    assert len(printable("\x1b" * 10_000_000)) == 80


def test_lines_stay_lines():
    assert printable_lines("one\x1b\ntwo") == "one\\x1b\ntwo"
    assert len(printable_lines("line\n" * 1000, 100)) == 100
