"""Common strategies of the fuzzers: extreme values, changes of nested data, and changes of bytes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from typing import Any

from hypothesis import strategies as st

HUGE = 10**400  # above what a float takes
EXTREMES = (0, -1, 1, 2**31, -(2**31), 2**63, 1e-300, 1e-30, -1e-9, 1e9, 1e30, 1e200, 1e300, 1.7e308, 5e-324)
NOT_FINITE = (math.nan, math.inf, -math.inf)
ESCAPES = "\x1b]0;owned\x07", "\x1b[2J", "a\rb", "a\nb", "\u202egnp", "\x00", "\x9b31m"
TEXTS = ("", "null", "true", "cable", "cabin", "haul_rope", "$\\frac{$", "~", "1e6", "0x10", "1_000", "..", "%s", "{0}")

numbers = st.one_of(
    st.sampled_from(EXTREMES),
    st.sampled_from(NOT_FINITE),
    st.floats(),
    st.integers(),
    st.sampled_from((HUGE, -HUGE)),
)
texts = st.one_of(st.sampled_from(TEXTS), st.sampled_from(ESCAPES), st.text(max_size=12))
scalars = st.one_of(numbers, texts, st.booleans(), st.none())
values = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(texts, inner, max_size=3)),
    max_leaves=6,
)
scales = st.sampled_from((-1, 0, 0.5, 2, 10, 1e3, 1e6, 1e-3, 1e-6, 1e100, 1e-100))


MILD = st.sampled_from((0, 0.1, 0.5, 0.9, 0.999, 1.001, 1.1, 2, 10, 100, -1))


def places_in(data: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of all items in nested dicts and lists."""
    inner = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    for key, value in inner:
        yield (*path, key)
        yield from places_in(value, (*path, key))


@st.composite
def changed(draw: Callable[..., Any], data: Any, most: int = 4) -> Any:
    """Nested data with some values replaced, scaled, removed, doubled or moved."""
    data = deepcopy(data)
    for _ in range(draw(st.integers(1, most))):
        if not (places := list(places_in(data))):
            break
        *path, last = draw(st.sampled_from(places))
        node = data
        for key in path:
            node = node[key]
        old = node[last]
        way = draw(st.sampled_from(("value", "value", "scale", "scale", "leave out", "other", "key", "double")))
        if way == "scale" and isinstance(old, int | float) and not isinstance(old, bool) and abs(old) < 1e300:
            node[last] = old * draw(scales)
        elif way == "leave out":
            del node[last]
        elif way == "other":
            node[last] = deepcopy(_at(data, draw(st.sampled_from(places))))
        elif way == "key" and isinstance(node, dict):
            node[draw(texts)] = node.pop(last)
        elif way == "double" and isinstance(node, list):
            node.insert(last, deepcopy(old))
        else:
            node[last] = draw(values)
    return data


@st.composite
def tuned(draw: Callable[..., Any], data: Any, most: int = 3) -> Any:
    """Nested data with some moderately changed numbers, which most checks accept."""
    data = deepcopy(data)
    places = [place for place in places_in(data) if type(_at(data, place)) in (int, float)]
    for *path, last in draw(st.lists(st.sampled_from(places), min_size=1, max_size=most)):
        node = _at(data, path)
        old = node[last]
        mild = draw(st.booleans()) and abs(old) < 1e300
        node[last] = type(old)(old * draw(MILD)) if mild else draw(numbers)
    return data


def _at(data: Any, path: Sequence[Any]) -> Any:
    for key in path:
        data = data[key]
    return data


@st.composite
def changed_bytes(draw: Callable[..., Any], content: bytes, words: Sequence[bytes] = (b"\x00",)) -> bytes:
    """Bytes with some flipped, removed, doubled, or with inserted words of the format."""
    data = bytearray(content)
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, len(data)))
        way = draw(st.sampled_from(("flip", "flip", "cut", "double", "word", "end")))
        length = draw(st.sampled_from((1, 2, 8, 64, 1024)))
        if way == "flip" and place < len(data):
            data[place] ^= 1 << draw(st.integers(0, 7))
        elif way == "cut":
            del data[place : place + length]
        elif way == "double":
            data[place:place] = data[place : place + length]
        elif way == "end" and draw(st.booleans()):
            del data[place:]
        else:
            data[place:place] = draw(st.sampled_from(list(words)))
    return bytes(data)
