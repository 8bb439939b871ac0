"""Write `docs/verification.md`: every case with what it gives now."""

from __future__ import annotations

import sys
from pathlib import Path

from rich.progress import track

from verification import Case, load_cases

PAGE = Path(__file__).parents[1] / "docs" / "verification.md"
HEAD = """\
# Verification of the mechanics

Each row is a closed form, an invariant or a published number beside what the solver gives. Written by
`python -m verification`; the tests run the same cases with the same tolerances.

| case | source | quantity | expected | got | error | tolerance |
| --- | --- | --- | --- | --- | --- | --- |
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
    """Write the page; 1 when a case misses its tolerance."""
    lines = [line for one in track(load_cases(), description="verifying") for line in rows(one)]
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(HEAD + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"wrote {PAGE}: {len(lines)} rows")
    return int(any("**missed**" in line for line in lines))


if __name__ == "__main__":
    sys.exit(main())
