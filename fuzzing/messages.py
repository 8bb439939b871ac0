"""Valid, extreme and damaged messages on the command topics of `sim`, single ones and hundreds at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import nullcontext, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st

from fuzzing import DONE, REFUSED, Case
from fuzzing.live_twin import LiveTwin
from fuzzing.mutations import changed_bytes, texts

SCENARIO = "windy_tramway"  # takes all: speeds, forces, places, masses, and wind from the side
TOPICS = ("joint_commands", "payload", "wind")
NAMES = ("cabin", "Cabin", "cabin/hanger", "/cable_twin", "cabin\x1b[2J", "", "n" * 5000)
WORDS = (b"\xff\xff\xff\xff", b"\x00" * 8, b"\x00\x00\x00\x80", b"\x01\x00\x00\x00", b"cabin\x00", b"\x00\x00\xf0\x7f")
MOST = 60_000_000  # bytes of one case
TAKEN = 0.02  # s within which a frame has taken what came
TRIES = 50  # to send one message

columns = st.lists(
    st.one_of(
        st.floats(-10.0, 10.0),
        st.floats(-150e3, 150e3),
        st.floats(width=64),
        st.sampled_from((math.nan, math.inf, -math.inf, 0.0, 5e-324, 1.7e308)),
    ),
    max_size=3,
)
names = st.one_of(
    st.just(["cabin"]),
    st.lists(st.one_of(st.sampled_from(NAMES), texts.filter(lambda text: "\0" not in text)), max_size=4),
    st.integers(2, 20_000).map(lambda count: [f"n{number}" for number in range(count)]),
    st.integers(2, 20_000).map(lambda count: ["cabin"] * count),
)


@st.composite
def cases(draw: Callable[..., Any]) -> Case:
    """Name of a topic, number of repetitions, and the bytes of a message."""
    topic, times = draw(st.sampled_from(TOPICS)), draw(st.sampled_from((1, 1, 1, 1, 10, 300)))
    data = draw(_messages(topic))
    way = draw(st.sampled_from(("whole", "whole", "changed", "other topic", "noise")))
    if way == "changed":
        data = draw(changed_bytes(data, WORDS))
    elif way == "noise":
        data = draw(st.binary(min_size=1, max_size=200))
    elif way == "other topic":
        topic = draw(st.sampled_from(TOPICS))
    times = max(min(times, MOST // max(len(data), 1)), 1)
    return Case(f"{topic} {times}\n".encode() + (data or b"\0"), ".cdr")


@st.composite
def _messages(draw: Callable[..., Any], topic: str) -> bytes:
    from cable_twin.messages import TYPESTORE, serialize  # noqa: PLC0415 - only where cases are made

    types = TYPESTORE.types
    stamp = types["builtin_interfaces/msg/Time"](draw(st.integers(-(2**31), 2**31 - 1)), draw(st.integers(0, 10**9)))
    frame = draw(st.sampled_from(("", "", "map", "\x1b[31m", "f" * 1000, "f" * 5_500_000)))
    header = types["std_msgs/msg/Header"](stamp, frame)
    if topic == "wind":
        x, y, z = draw(st.tuples(*[st.floats(-50.0, 50.0) | st.floats()] * 3))
        return serialize(types["geometry_msgs/msg/Vector3Stamped"](header, types["geometry_msgs/msg/Vector3"](x, y, z)))
    given = draw(names)
    filled = draw(st.lists(st.sampled_from(("position", "velocity", "effort")), max_size=3))
    fields = {name: np.empty(0) for name in ("position", "velocity", "effort")}
    for field in filled:
        numbers = draw(columns)
        whole = draw(st.booleans()) and bool(numbers)
        fields[field] = np.resize(np.array(numbers, dtype=np.float64), len(given)) if whole else np.array(numbers)
    return serialize(types["sensor_msgs/msg/JointState"](header, [_sound(one) for one in given], **fields))


def _sound(name: str) -> str:
    return name.encode("utf-8", "replace").decode()


@cache
def twin() -> LiveTwin:
    """Twin that receives the messages."""
    return LiveTwin(
        [SCENARIO, "--rerun", "none", "--keep-size", "200", "--split-size", "50"], ("joint_states", "applied_commands")
    )


@cache
def publishers() -> dict[str, Any]:
    """Publisher by topic, matched with the twin."""
    from geometry_msgs.msg import Vector3Stamped  # noqa: PLC0415
    from sensor_msgs.msg import JointState  # noqa: PLC0415

    node, made = twin().node, {}
    for topic in TOPICS:
        kind = Vector3Stamped if topic == "wind" else JointState
        made[topic] = node.create_publisher(kind, f"/cable_twin/{topic}", 50)
    return made


def _publish(topic: str, data: bytes) -> None:
    """Send one message, repeated while the writer has no room for it."""
    from rclpy._rclpy_pybind11 import RCLError  # noqa: PLC0415

    left = TRIES
    while left > 0:
        left -= 1
        with suppress(RCLError) if left else nullcontext():
            publishers()[topic].publish(data)
            return
        twin().spin(TAKEN)


def prepare() -> None:
    """Start the twin."""
    for topic, publisher in publishers().items():
        twin().until(publisher.get_subscription_count, topic)
    twin().check()


def run(file: Path) -> str:
    """Send a case, and check that the twin takes a command, answers and keeps its invariants."""
    head, _, data = file.read_bytes().partition(b"\n")
    topic, times = head.decode().split()
    applied, frames = (twin().received[name] for name in ("applied_commands", "joint_states"))
    twin().release()
    before = twin().received["applied_commands"]
    for _ in range(int(times)):
        _publish(topic, data)
    twin().spin(TAKEN)
    done = twin().received["applied_commands"] > before
    twin().check()
    twin().until(lambda: twin().received["joint_states"] > frames, "frames")
    return DONE if done or twin().received["applied_commands"] > applied + 2 else REFUSED
