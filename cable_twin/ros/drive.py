"""The command `drive`: drive commands from a terminal, without the ros2 command line."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from typing import Any

from cable_twin.ros.command_line import Ending, OneLineParser, print_hint

RATE = 20.0  # Hz, well inside the node's command time-out
DISCOVERY = 10.0  # s to find the twin, where --wait does not say it
ANSWER = 2.0  # s within which the twin has to apply a command
TERMINAL_PERIOD, PIPE_PERIOD = 0.25, 1.0  # s between two lines for people and for a file
EPILOG = """\
Commands are repeated until Ctrl-C or the end of --duration; the twin is then told to stop, and after silence it stops
by itself.

examples:
  drive cabin --speed 5                  5 m/s along the cable, at the drive's own acceleration
  drive cabin --speed -3 --ramp 20       to -3 m/s within 20 s
  drive cabin --force 40000 --duration 10
"""


def parser() -> OneLineParser:
    """Options of `drive`."""
    result = OneLineParser("drive", "Drive a carriage of a running twin from the terminal.", EPILOG)
    result.add_argument("name", help="carriage or drive, such as cabin or haul_rope")
    what = result.add_mutually_exclusive_group(required=True)
    what.add_argument("--speed", type=_number, help="m/s along the cable", metavar="M/S")
    what.add_argument("--force", type=_number, help="N along the cable", metavar="N")
    result.add_argument(
        "--ramp", type=_not_negative, default=0.0, metavar="S", help="s from zero to the value; default 0"
    )
    result.add_argument("--duration", type=_not_negative, metavar="S", help="s to drive; default: until Ctrl-C")
    result.add_argument("--node", default="/cable_twin", help="name of the twin; default: /cable_twin")
    result.add_argument(
        "--wait",
        type=_not_negative,
        default=DISCOVERY,
        metavar="S",
        help=f"s to wait for the twin, which compiles its solver on its first start; default: {DISCOVERY:g}",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Drive; 0 after the end, 1 when no twin answers, it has no such carriage, or it refuses."""
    options = parser().parse_args(sys.argv[1:] if argv is None else list(argv))
    ending = Ending("drive")
    try:
        import rclpy  # noqa: PLC0415 - the hint stands for the traceback
        import sensor_msgs.msg  # noqa: F401, PLC0415
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    except ImportError as error:
        print_hint("drive", error)
        return 1
    ending.starting = False
    try:
        rclpy.init(args=["drive"], signal_handler_options=SignalHandlerOptions.NO)
        driver = _Driver(rclpy.create_node("cable_twin_drive"), options, ending)
    except Exception as error:
        print(f"drive: {' '.join(str(error).split())}", file=sys.stderr)
        return 1
    try:
        fault = driver.find_twin()
        if fault is None and not ending.is_set():
            fault = driver.run()
    finally:
        driver.close()
        rclpy.try_shutdown()
    if fault is None:
        return 0
    print(f"drive: {fault}", file=sys.stderr)
    return 1


class _Driver:
    """Sends commands to one carriage and watches what the twin makes of them."""

    def __init__(self, node: Any, options: argparse.Namespace, ending: Ending) -> None:
        from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415
        from std_msgs.msg import String  # noqa: PLC0415

        self._node, self._options, self._ending = node, options, ending
        self._message_type = JointState
        self._states: dict[str, tuple[float, float, float]] = {}  # arc length (m), speed (m/s), drive force (N)
        self._heard = False  # any joint states
        self._scenario: dict[str, Any] | None = None
        self._answered = math.inf  # s of the clock
        twin = options.node.rstrip("/")
        self._topic = f"{twin}/joint_commands"
        self._publisher = node.create_publisher(JointState, self._topic, 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(String, f"{twin}/scenario", self._on_scenario, latched)
        node.create_subscription(JointState, f"{twin}/joint_states", self._on_states, 10)
        node.create_subscription(JointState, f"{twin}/applied_commands", self._on_applied, 50)

    def close(self) -> None:
        self._node.destroy_node()

    def find_twin(self) -> str | None:
        """Wait for the twin and check the command against its scenario; returns what is wrong."""
        deadline = time.monotonic() + self._options.wait
        while not (self._publisher.get_subscription_count() and self._scenario is not None and self._heard):
            self._spin(0.05)
            if self._ending.is_set():
                return None
            if time.monotonic() > deadline:
                if self._scenario is not None:
                    return f"the twin on {self._topic} does not move on: is it paused, and ~/pause wants a false?"
                return (
                    f"no twin listens on {self._topic} after {self._options.wait:g} s: is `sim` running, "
                    "with the same ROS_DOMAIN_ID?"
                )
        carriages = {
            name: one.get("drive", {})
            for name, one in self._scenario["carriages"].items()
            if one.get("joint") != "clamped"  # goes with the cable
        }
        drives = carriages | self._scenario.get("drives", {})
        name = self._options.name
        if name not in drives:
            return f"the twin has no carriage or drive '{name}' to command; it has: {', '.join(drives) or 'none'}"
        quantity, unit, value = self._command
        if quantity == "force" and name not in carriages:
            return f"'{name}' moves the cable and takes no force; give it a speed (m/s)"
        limit = drives[name].get("limits", {}).get(quantity)
        if limit is not None and abs(value) > limit:
            return f"{quantity} of '{name}' is {value:g} {unit}; allowed are -{limit:g} to {limit:g} {unit}"
        return None

    def run(self) -> str | None:
        """Send until the end, and tell the twin to stop however that comes; returns what went wrong."""
        try:
            return self._send_until_the_end()
        except BrokenPipeError:  # nobody reads on: as Ctrl-C
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return None
        finally:
            self._stop()

    def _send_until_the_end(self) -> str | None:
        options = self._options
        _, unit, value = self._command
        terminal = sys.stdout.isatty()
        started = time.monotonic()
        next_command = next_line = started
        self._answered = started
        fault = None
        while not self._ending.is_set():
            now = time.monotonic()
            if options.duration is not None and now - started >= options.duration:
                break
            if now - self._answered > ANSWER:
                fault = (
                    f"the twin has applied no command for {ANSWER:g} s: is it still there, or is its emergency stop "
                    "in force? It names every refusal in its own terminal"
                )
                break
            if now >= next_command:
                share = 1.0 if options.ramp == 0.0 else min((now - started) / options.ramp, 1.0)
                self._send(value * share)
                next_command = max(next_command + 1.0 / RATE, now)
                if now >= next_line:
                    self._print_state(now - started, f"{value * share:+9.2f} {unit}", terminal)
                    next_line = now + (TERMINAL_PERIOD if terminal else PIPE_PERIOD)
            self._spin(max(min(next_command - time.monotonic(), 0.05), 0.0))
        if terminal:
            print()
        return fault

    @property
    def _command(self) -> tuple[str, str, float]:
        """Quantity, unit and value."""
        if self._options.force is not None:
            return "force", "N", self._options.force
        return "speed", "m/s", self._options.speed

    def _send(self, value: float) -> None:
        message = self._message_type(name=[self._options.name])
        message.header.stamp = self._node.get_clock().now().to_msg()
        if self._options.force is not None:
            message.effort = [value]
        else:
            message.velocity = [value]
        self._publisher.publish(message)

    def _stop(self) -> None:
        """Tell the twin to stop; a force of zero would let the carriage roll down."""
        from rclpy.duration import Duration  # noqa: PLC0415

        self._publisher.publish(self._message_type(name=[self._options.name], velocity=[0.0]))
        self._publisher.wait_for_all_acked(Duration(seconds=1.0))

    def _print_state(self, elapsed: float, commanded: str, terminal: bool) -> None:
        name = self._options.name
        arc_length, speed, force = self._states.get(name, (math.nan, math.nan, math.nan))
        line = (
            f"{elapsed:7.1f} s  commanded {commanded}  {name}: "
            f"{speed:+7.2f} m/s at {arc_length:8.2f} m, drive {force / 1e3:+9.3f} kN"
        )
        print(f"\r{line}  " if terminal else line, end="" if terminal else "\n", flush=True)

    def _spin(self, seconds: float) -> None:
        import rclpy  # noqa: PLC0415

        rclpy.spin_once(self._node, timeout_sec=seconds)

    def _on_states(self, message: Any) -> None:
        self._heard = True
        for name, *state in zip(message.name, message.position, message.velocity, message.effort, strict=True):
            self._states[name] = (state[0], state[1], state[2])

    def _on_scenario(self, message: Any) -> None:
        self._scenario = json.loads(message.data)

    def _on_applied(self, message: Any) -> None:
        if self._options.name in message.name and message.header.frame_id.endswith(":joint_commands"):
            self._answered = time.monotonic()


def _number(text: str) -> float:
    """Finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} given, a finite number is needed")
    return value


def _not_negative(text: str) -> float:
    """Finite number of seconds, zero or more."""
    value = _number(text)
    if value < 0.0:
        raise argparse.ArgumentTypeError(f"{text} s given, zero or more is needed")
    return value


if __name__ == "__main__":
    sys.exit(main())
