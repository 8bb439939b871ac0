"""Foreign text made safe for a terminal: unprintable characters escaped, long text cut."""

from __future__ import annotations

LONGEST = 80  # characters of a name that came from elsewhere
LONGEST_MESSAGE = 2000  # characters of a message of several lines, such as the faults of a scenario
CUT = "..."


def printable(text: object, longest: int = LONGEST) -> str:
    r"""Text on one line, safe for a terminal: control characters, line ends and bidirectional marks are escaped.

    Whatever names something that this process has not made (a message, a file, another node) goes through here before
    it is printed, logged or answered.

    Args:
        text: of anybody; other objects as `str` has them.
        longest: characters of the result, which ends in `...` where there were more.

    Returns:
        The text where it is harmless, else with escapes as in `"\x1b[2J"`.
    """
    given = str(text)
    escaped = "".join(
        one if one.isprintable() else one.encode("unicode_escape").decode("ascii") for one in given[: longest + 1]
    )
    return escaped if len(escaped) <= longest else f"{escaped[: longest - len(CUT)]}{CUT}"


def printable_lines(text: object, longest: int = LONGEST_MESSAGE) -> str:
    """Text of several lines, each made safe by `printable`, cut to `longest` characters in all."""
    joined = "\n".join(printable(line, longest) for line in str(text)[: longest + 1].split("\n"))
    return joined if len(joined) <= longest else f"{joined[: longest - len(CUT)]}{CUT}"
