"""Parameters, scenarios loaded by them, and calls of all services, in any order, to `sim`."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from fuzzing import DONE, REFUSED, Case
from fuzzing.live_twin import LiveTwin
from fuzzing.mutations import changed, changed_bytes, texts, tuned
from fuzzing.scenarios import WORDS, bombs, shipped, written

SCENARIO = "single_span"
KINDS = {  # of a value: number of its type, and the field
    "not set": (0, ""),
    "bool": (1, "bool_value"),
    "integer": (2, "integer_value"),
    "double": (3, "double_value"),
    "string": (4, "string_value"),
    "doubles": (8, "double_array_value"),
    "strings": (9, "string_array_value"),
}
SERVICES = {  # name: type, and whether it has a switch; the twin runs on afterwards
    "emergency_stop": ("SetBool", True),
    "pause": ("SetBool", True),
    "reset": ("Trigger", False),
    "step": ("Trigger", False),
    "save_snapshot": ("Trigger", False),
}
PATHS = (
    "/etc/passwd",
    "/dev/zero",
    "/dev/stdin",
    "/proc/self/mem",
    "~",
    "..",
    "pipe.yaml",
    "link.yaml",
    "a" * 5000,
    "",
)

whole = st.one_of(st.integers(-(2**63), 2**63 - 1), st.integers(-2, 50))
doubles = st.one_of(st.floats(), st.floats(0.02, 5.0), st.sampled_from((math.nan, math.inf)))
plain = texts.filter(lambda text: "\0" not in text).map(lambda text: text.encode("utf-8", "replace").decode())
strings = st.one_of(plain, st.sampled_from(PATHS), st.sampled_from((SCENARIO, "none", "off")))


@st.composite
def cases(draw: Callable[..., Any]) -> Case:
    """Sequence of operations, as JSON."""
    return Case(json.dumps(draw(st.lists(_operations(), min_size=1, max_size=4))).encode(), ".json")


@st.composite
def _operations(draw: Callable[..., Any]) -> dict[str, Any]:
    way = draw(st.sampled_from(("set", "set", "set", "ask", "call", "call", "call", "load")))
    if way == "set":
        return {"set": draw(st.lists(_parameters(), max_size=3)), "atomically": draw(st.booleans())}
    if way == "ask":
        service = draw(st.sampled_from(("GetParameters", "DescribeParameters", "GetParameterTypes", "ListParameters")))
        return {"ask": service, "names": draw(st.lists(st.one_of(_names(), plain), max_size=5))}
    if way == "call":
        return {"call": draw(st.sampled_from(sorted(SERVICES))), "switch": draw(st.booleans())}
    content = draw(
        st.one_of(
            tuned(shipped(SCENARIO)).map(written),
            changed(shipped(SCENARIO)).map(written),
            changed_bytes(written(shipped(SCENARIO)), WORDS),
            bombs(),
        )
    )
    return {"load": content[: 2**21].decode("latin-1")}


def _names() -> st.SearchStrategy[str]:
    from cable_twin.ros.parameter_table import PARAMETERS  # noqa: PLC0415 - only where cases are made

    return st.sampled_from([*(one.name for one in PARAMETERS), "use_sim_time", "scenario", "command_timeout"])


@st.composite
def _parameters(draw: Callable[..., Any]) -> list[Any]:
    kind = draw(st.sampled_from(sorted(KINDS)))
    values: dict[str, st.SearchStrategy[Any]] = {
        "not set": st.none(),
        "bool": st.booleans(),
        "integer": whole,
        "double": doubles,
        "string": strings,
        "doubles": st.lists(doubles, max_size=3),
        "strings": st.lists(strings, max_size=3),
    }
    return [draw(st.one_of(_names(), plain)), kind, draw(values[kind])]


@cache
def twin() -> LiveTwin:
    """Twin that receives the operations, beside the files they name."""
    made = Path.cwd() / "scenarios"
    shutil.rmtree(made, ignore_errors=True)  # of a process before
    made.mkdir()
    os.mkfifo(made / "pipe.yaml")
    (made / "link.yaml").symlink_to("/etc/passwd")
    arguments = [SCENARIO, "--rerun", "none", "--keep-size", "100", "--scenario-directories", str(made)]
    return LiveTwin(arguments, ("joint_states",))


def prepare() -> None:
    """Start the twin."""
    twin().check()


def run(file: Path) -> str:
    """Carry out a sequence of operations, and check that the twin runs, answers and keeps its invariants."""
    taken = [_do(operation) for operation in json.loads(file.read_text(encoding="utf-8"))]
    set_bool = import_module("std_srvs.srv").SetBool
    twin().call(set_bool, "pause", data=False)
    twin().check()
    frames = twin().received["joint_states"]
    twin().until(lambda: twin().received["joint_states"] > frames, "frames")
    return DONE if any(taken) else REFUSED


def _do(operation: dict[str, Any]) -> bool:
    """Carry out one operation; returns whether the twin has accepted it."""
    services = import_module("rcl_interfaces.srv")
    if "call" in operation:
        kind, switched = SERVICES[operation["call"]]
        fields = {"data": operation["switch"]} if switched else {}
        return bool(twin().call(getattr(import_module("std_srvs.srv"), kind), operation["call"], **fields).success)
    if "ask" in operation:
        names = operation["names"]
        fields = {"prefixes": names, "depth": len(names)} if operation["ask"] == "ListParameters" else {"names": names}
        service = "".join(f"_{one.lower()}" if one.isupper() else one for one in operation["ask"]).lstrip("_")
        twin().call(getattr(services, operation["ask"]), service, **fields)
        return True
    if "load" in operation:
        loaded = Path.cwd() / "scenarios" / "loaded.yaml"
        loaded.write_bytes(operation["load"].encode("latin-1"))
        given, atomically = [["scenario", "string", str(loaded)]], False
    else:
        given, atomically = operation["set"], operation["atomically"]
    given = [_located(*one) for one in given]
    parameters = [_message(*one) for one in given]
    if atomically:
        result = twin().call(services.SetParametersAtomically, "set_parameters_atomically", parameters=parameters)
        return bool(result.result.successful)
    results = twin().call(services.SetParameters, "set_parameters", parameters=parameters).results
    assert len(results) == len(parameters)
    assert all(one.successful or one.reason for one in results)
    return any(one.successful for one in results)


def _located(name: str, kind: str, value: Any) -> tuple[str, str, Any]:
    """Parameter with the full path of a file beside the twin."""
    if isinstance(value, str) and value in ("pipe.yaml", "link.yaml"):
        value = str(Path.cwd() / "scenarios" / value)
    return name, kind, value


def _message(name: str, kind: str, value: Any) -> Any:
    messages = import_module("rcl_interfaces.msg")
    number, field = KINDS[kind]
    made = messages.ParameterValue(type=number)
    if field:
        setattr(made, field, value)
    return messages.Parameter(name=name, value=made)
