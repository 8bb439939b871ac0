"""Write `docs/verification.md`: every case with what it gives now; see `python -m verification --help`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rich.console import Console
from rich.progress import track

from cable_twin.terminal.command_line import Filled
from verification import MODULES, Case, load_cases

PAGE = Path(__file__).parents[1] / "docs" / "verification.md"
HEAD = """\
# Verification of the mechanics

Each row is a closed form, an invariant or a published number beside what the solver gives. Written by
`python -m verification`; the tests run the same cases with the same tolerances.

Contact forces of EN 50318 are low-passed: Butterworth of 3rd order at 20 Hz, run forwards and backwards, so without
delay and with half the amplitude at 20 Hz; uplift and slack times are of every step.

"""
TABLE = """\
| case | source | quantity | expected | got | error | tolerance |
| --- | --- | --- | --- | --- | --- | --- |
"""
EPILOG = """\
examples:
  python -m verification
  python -m verification statics hinges

exit codes: 0 all cases hold; 1 one misses its tolerance; 2 wrong arguments
"""


def rows(one: Case) -> list[str]:
    """Rows of the table for one case."""
    lines = []
    for result in one.run():
        unit = f" {result.unit}" if result.unit else ""
        mark = "" if result.passed else " **missed**"
        lines.append(
            f"| {one.name} | {one.source} | {result.quantity} | {result.expected:.8g}{unit} | "
            f"{result.got:.8g}{unit} | {result.error:.2g} | {result.tolerance:.2g}{mark} |"
        )
    return lines


def main() -> int:
    """Run the command line: write the page, or print the rows of some cases; 1 when one misses its tolerance."""
    parser = argparse.ArgumentParser(
        prog="python -m verification",
        description="Run the cases of docs/verification.md and write the page anew, which takes minutes.",
        epilog=EPILOG,
        formatter_class=Filled,
    )
    sections = parser.add_argument("sections", nargs="*", metavar="SECTION")
    sections.help = f"only the cases of these, printed and not written; of {', '.join(MODULES)}"
    chosen = parser.parse_args().sections
    if unknown := [name for name in chosen if name not in MODULES]:
        parser.error(f"SECTION: given {unknown[0]!r}; allowed: {', '.join(MODULES)}")
    cases = load_cases(chosen or MODULES)
    lines = [line for one in track(cases, description="verifying", console=Console(stderr=True)) for line in rows(one)]
    if chosen:
        print(TABLE + "\n".join(lines))
    else:
        PAGE.parent.mkdir(exist_ok=True)
        PAGE.write_text(HEAD + TABLE + "\n".join(lines) + "\n", encoding="utf-8")
        print(f"wrote {PAGE}: {len(lines)} rows")
    return int(any("**missed**" in line for line in lines))


if __name__ == "__main__":
    sys.exit(main())
