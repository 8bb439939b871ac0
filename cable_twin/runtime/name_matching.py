"""Names that match a regular expression of another node, found in a separate process, as some take hours."""

from __future__ import annotations

import re
from collections.abc import Sequence
from concurrent.futures import Future
from threading import Thread
from typing import Any

from cable_twin.basics.printable import printable
from cable_twin.runtime.beside import BesideError, answer, ask_beside

LONGEST = 1000  # characters of an expression
SECONDS = 2.0  # s for all names
ALLOWED = f"allowed: a regular expression of names, of up to {LONGEST} characters and {SECONDS:g} s"


class FilterError(ValueError):
    """Regular expression that cannot be applied, in a line."""


def matching_names(expression: str, names: Sequence[str]) -> Future[list[str]]:
    """Names that match an expression, at once for plain text; the future may give `FilterError`."""
    future: Future[list[str]] = Future()
    if len(expression) > LONGEST:
        future.set_exception(FilterError(f"filter of {len(expression)} characters given; {ALLOWED}"))
    elif re.fullmatch(r"[\w/ -]*", expression):
        future.set_result([name for name in names if expression in name])
    else:
        Thread(target=_match, args=(future, expression, list(names)), name="name matching", daemon=True).start()
    return future


def _match(future: Future[list[str]], expression: str, names: list[str]) -> None:
    try:
        found = ask_beside("runtime.name_matching", [expression, names], SECONDS)
    except BesideError as error:
        found = str(error)
    if isinstance(found, str):
        future.set_exception(FilterError(f"filter '{printable(expression)}' given: {printable(found)}; {ALLOWED}"))
    else:
        future.set_result(found)


def _found(request: Any) -> list[str] | str:
    expression, names = request
    try:
        wanted = re.compile(expression)
    except (re.error, OverflowError, RecursionError) as error:
        return str(error)
    return [name for name in names if wanted.search(name)]


if __name__ == "__main__":
    answer(_found)
