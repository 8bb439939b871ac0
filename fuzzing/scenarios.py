"""Scenario files, mutated as data and as text, to the command `simulate` for some steps."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from ruamel.yaml import YAML

from fuzzing import DONE, REFUSED, Case
from fuzzing.mutations import HUGE, changed, changed_bytes, tuned

CONFIG = Path(__file__).parents[1] / "config"
NAMES = ("seed_example", "single_span", "aerial_tramway", "chairlift", "windy_tramway", "jig_back", "bicable")
LARGEST = 2**20  # bytes of a case
WORDS = (
    *(b"&a ", b"*a", b"<<: *a", b"[", b"]", b"{", b"}", b": ", b"- ", b"? ", b"\t", b"\n", b"\x00", b"\xff", b"%"),
    *(b"!!python/object:os.system ", b"!!binary ", b"!!set ", b"!!omap ", b"!!timestamp ", b"---\n", b"...\n", b"|\n"),
    *(b"9" * 5000, b"1" + b"0" * 400, b"1e400", b".nan", b"-.inf", b"[" * 3000, b"{a: " * 1000, b"0o7", b"1:60:60"),
)
OPTIONS = "--duration", "0.03", "--record", "off"


@cache
def shipped(name: str) -> Any:
    """Content of a shipped scenario."""
    return YAML(typ="safe", pure=True).load((CONFIG / f"{name}.yaml").read_text(encoding="utf-8"))


@st.composite
def cases(draw: Callable[..., Any]) -> Case:
    """Shipped scenarios with changes, and sometimes a bomb of aliases."""
    name = draw(st.sampled_from(NAMES))
    way = draw(st.sampled_from(("tuned", "tuned", "tuned", "tuned", "data", "data", "text", "bomb", "deep")))
    if way == "tuned":
        return Case(written(draw(tuned(shipped(name)))), ".yaml")
    if way == "data":
        return Case(written(draw(changed(shipped(name)))), ".yaml")
    if way == "text":
        return Case(draw(changed_bytes((CONFIG / f"{name}.yaml").read_bytes(), WORDS))[:LARGEST], ".yaml")
    if way == "bomb":
        return Case(draw(bombs()), ".yaml")
    opened, closed = draw(st.sampled_from((("[", "]"), ("{a: ", "}"), ("- ", ""), ("? ", ""))))
    depth = draw(st.sampled_from((50, 500, 5000, 100_000)))
    return Case(f"cable: {opened * depth}1{closed * depth}\n".encode(), ".yaml")


@st.composite
def bombs(draw: Callable[..., Any]) -> bytes:
    """YAML texts of few lines whose aliases stand for very many values."""
    kind = draw(st.sampled_from(("list", "map", "merge")))
    return bomb(kind, levels=draw(st.integers(2, 30)), width=draw(st.integers(2, 20))).encode()


def bomb(kind: str, *, levels: int, width: int) -> str:
    """YAML text of lines with many aliases of the previous line each: lists, maps or merge keys."""
    lines = [f"a0: &a0 {'[1, 2, 3]' if kind == 'list' else '{x: 1}'}"]
    for level in range(1, levels):
        before = [f"*a{level - 1}"] * width
        inner = {
            "list": f"[{', '.join(before)}]",
            "map": f"{{{', '.join(f'k{number}: {alias}' for number, alias in enumerate(before))}}}",
            "merge": f"{{<<: [{', '.join(before)}], y{level}: 1}}",
        }
        lines.append(f"a{level}: &a{level} {inner[kind]}")
    return "\n".join(lines) + "\n"


def written(data: Any) -> bytes:
    """YAML text of nested data; integers of too many digits are cut."""
    stream = StringIO()
    yaml = YAML(typ="safe", pure=True)
    yaml.width = 4096
    try:
        yaml.dump(_plain(data), stream)
    except Exception:  # a key that YAML cannot write, such as half a surrogate
        return repr(data).encode(errors="replace")
    return stream.getvalue().encode("utf-8", "replace")


def _plain(data: Any) -> Any:
    if isinstance(data, dict):
        return {_plain(key): _plain(value) for key, value in data.items()}
    if isinstance(data, list):
        return [_plain(value) for value in data]
    if isinstance(data, int) and not isinstance(data, bool) and abs(data) > HUGE:
        return HUGE
    return data


def prepare() -> None:
    """Load the kernels of the shipped scenarios."""
    from cable_twin.offline import simulate  # noqa: PLC0415 - the parent needs no program

    for name in ("seed_example", "chairlift", "windy_tramway", "jig_back"):
        simulate.main([name, *OPTIONS])


def run(file: Path) -> str:
    """Run a scenario by the command `simulate`."""
    from cable_twin.offline import simulate  # noqa: PLC0415

    return DONE if simulate.main([str(file), *OPTIONS]) != simulate.UNUSABLE else REFUSED
