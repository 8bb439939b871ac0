"""The command `drive`: drive commands from a terminal, without the ros2 command line."""

from __future__ import annotations

import argparse
import math
import signal
import sys
import threading
import time
from collections.abc import Sequence
from typing import Any

from cable_twin.ros.sim import INSTALL_HINT

RATE = 20.0  # Hz, well inside the node's command time-out
DISCOVERY = 10.0  # s to find the twin
EPILOG = """\
Commands are repeated until Ctrl-C or the end of --duration; the twin is then told to stop, and after silence it stops
by itself.

examples:
  drive cabin --speed 5                  5 m/s along the cable, at the drive's own acceleration
  drive cabin --speed -3 --ramp 20       to -3 m/s within 20 s
  drive cabin --force 40000 --duration 10
"""


def parser() -> argparse.ArgumentParser:
    """Options of `drive`."""
    result = argparse.ArgumentParser(
        prog="drive",
        description="Drive a carriage of a running twin from the terminal.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("name", help="carriage to drive, such as cabin")
    what = result.add_mutually_exclusive_group(required=True)
    what.add_argument("--speed", type=_number, help="m/s along the cable", metavar="M/S")
    what.add_argument("--force", type=_number, help="N along the cable", metavar="N")
    result.add_argument(
        "--ramp", type=_not_negative, default=0.0, metavar="S", help="s from zero to the value; default 0"
    )
    result.add_argument("--duration", type=_not_negative, metavar="S", help="s to drive; default: until Ctrl-C")
    result.add_argument("--node", default="/cable_twin", help="name of the twin; default: /cable_twin")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Drive; 0 after the end, 1 when no twin answers or it has no such carriage."""
    options = parser().parse_args(sys.argv[1:] if argv is None else list(argv))
    try:
        import rclpy  # noqa: PLC0415 - the message below stands for the traceback
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    except ImportError:
        print(INSTALL_HINT.format(command="drive"), file=sys.stderr)
        return 1
    ending = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: ending.set())
    rclpy.init(args=["drive"], signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("cable_twin_drive")
    try:
        return _drive(node, options, ending)
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _drive(node: Any, options: argparse.Namespace, ending: threading.Event) -> int:
    import rclpy  # noqa: PLC0415
    from sensor_msgs.msg import JointState  # noqa: PLC0415

    topic = f"{options.node.rstrip('/')}/joint_commands"
    publisher = node.create_publisher(JointState, topic, 10)
    latest: dict[str, tuple[float, float, float]] = {}

    def on_states(message: JointState) -> None:
        for name, *state in zip(message.name, message.position, message.velocity, message.effort, strict=True):
            latest[name] = (state[0], state[1], state[2])

    node.create_subscription(JointState, f"{options.node.rstrip('/')}/joint_states", on_states, 10)
    deadline = time.monotonic() + DISCOVERY
    while not (publisher.get_subscription_count() and latest):
        rclpy.spin_once(node, timeout_sec=0.05)
        if ending.is_set():
            return 0
        if time.monotonic() > deadline:
            print(
                f"drive: no twin listens on {topic} after {DISCOVERY:g} s: is `sim` running, "
                "with the same ROS_DOMAIN_ID?",
                file=sys.stderr,
            )
            return 1
    if options.name not in latest:
        known = ", ".join(name for name in latest if "/" not in name) or "none"
        print(f"drive: the twin has no carriage '{options.name}'; it has: {known}", file=sys.stderr)
        return 1

    quantity, unit, value = ("speed", "m/s", options.speed)
    if options.force is not None:
        quantity, unit, value = ("force", "N", options.force)

    def send(share: float) -> None:
        message = JointState(name=[options.name])
        message.header.stamp = node.get_clock().now().to_msg()
        if quantity == "speed":
            message.velocity = [value * share]
        else:
            message.effort = [value * share]
        publisher.publish(message)

    started = time.monotonic()
    next_command = started
    next_line = started
    while not ending.is_set():
        now = time.monotonic()
        if options.duration is not None and now - started >= options.duration:
            break
        if now >= next_command:
            share = 1.0 if options.ramp == 0.0 else min((now - started) / options.ramp, 1.0)
            send(share)
            next_command += 1.0 / RATE
            if now >= next_line:
                arc_length, speed, force = latest[options.name]
                print(
                    f"\r{now - started:7.1f} s  commanded {value * share:+9.2f} {unit}  {options.name}: "
                    f"{speed:+7.2f} m/s at {arc_length:8.2f} m, drive {force / 1e3:+9.3f} kN  ",
                    end="",
                    flush=True,
                )
                next_line += 0.25
        rclpy.spin_once(node, timeout_sec=max(min(next_command - time.monotonic(), 0.05), 0.0))
    send(0.0)
    rclpy.spin_once(node, timeout_sec=0.1)  # let the last command leave
    print()
    return 0


def _number(text: str) -> float:
    """Finite number."""
    value = float(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} given, a finite number is needed")
    return value


def _not_negative(text: str) -> float:
    """Finite number of seconds, zero or more."""
    value = _number(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"{text} s given, zero or more is needed")
    return value


if __name__ == "__main__":
    sys.exit(main())
