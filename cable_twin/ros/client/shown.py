"""One message of a running twin in lines for a terminal: its state, key figures, outlook or estimates."""

from __future__ import annotations

from typing import Any

from cable_twin.basics.printable import LONGEST_MESSAGE, printable
from cable_twin.ros.client.twin_client import DIAGNOSTICS, TwinError, spin_until
from cable_twin.ros.startup import Ending

# what `drive --show` prints: topic, and what makes a twin publish it; `messages` has the names too, and takes long
SHOWN = {
    "state": (DIAGNOSTICS, "always"),
    "figures": ("key_figures", "always"),
    "outlook": ("outlook", "unless --outlook false"),
    "estimate": ("estimate", "with `sim --follow`, as soon as the twin follows its plant"),
}


def show(node: Any, twin: str, what: str, wait: float, ending: Ending) -> list[str]:
    """Wait for one message of a running twin; returns its lines, a status each, warnings marked.

    Args:
        node: node of rclpy.
        twin: full name of the twin.
        what: one of `SHOWN`.
        wait: time (s) to wait for the message.
        ending: flag of the signals that end the command.

    Raises:
        TwinError: no such message has come; one line.
    """
    from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415 - it takes its time

    topic, published = SHOWN[what]
    name = topic if topic.startswith("/") else f"{twin}/{topic}"
    found: list[list[str]] = []

    def on_message(message: Any) -> None:
        own = [one for one in message.status if name != DIAGNOSTICS or one.name.startswith(f"{twin.lstrip('/')}: ")]
        if own:
            stamp = message.header.stamp
            found.append([f"{name}, stamped {stamp.sec + 1e-9 * stamp.nanosec:.3f} s", *map(_line, own)])

    subscription = node.create_subscription(DiagnosticArray, name, on_message, 10)
    came = spin_until(node, ending, lambda: found, wait)
    node.destroy_subscription(subscription)
    if not came:
        raise TwinError(f"{name}: no message within {wait:g} s; a twin publishes it {published}; --wait allows longer")
    return found[0]


def _line(status: Any) -> str:
    """Line of a diagnostic status; those that are no single figure or estimate with their values."""
    level = int.from_bytes(status.level, "little") if isinstance(status.level, bytes) else int(status.level)
    mark = "" if level == 0 else "warning: " if level == 1 else "error: "
    given = {pair.key: pair.value for pair in status.values}
    values = "" if {"value", "unit"} <= given.keys() else "".join(f", {key} {value}" for key, value in given.items())
    return printable(f"{mark}{status.name}: {status.message}{values}", LONGEST_MESSAGE)
