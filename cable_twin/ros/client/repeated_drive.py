"""Repeated drive commands from a terminal, until an end condition."""

from __future__ import annotations

import argparse
import math
import os
import shutil
import sys
import time
from typing import Any

from cable_twin.basics.printable import LONGEST_MESSAGE, printable
from cable_twin.frame.commands import Kind
from cable_twin.messages import APPLIED_COMMANDS, REFUSED_COMMANDS
from cable_twin.messages.command_messages import applied_command_from_message
from cable_twin.ros.client.twin_client import ANSWER, nobody_listens
from cable_twin.ros.client.twin_list import published_scenario
from cable_twin.ros.command_line import Ending

RATE = 20.0  # Hz, well inside the node's command time-out
REFUSING = 0.5  # s without a command that is applied, from which on a refusal is one of ours
UNANSWERED = (
    f"the twin has applied no command for {ANSWER:g} s: it may have ended, or its emergency stop is in force; its "
    "terminal shows the reason of each refusal"
)
TERMINAL_PERIOD, PIPE_PERIOD = 0.25, 1.0  # s between two lines for people and for a file


class Driver:
    """Repeated commands to one carriage or drive, with the answers of the twin.

    Args:
        node: of rclpy.
        kind: of the commands.
        value: in its unit.
        options: `name`, `ramp` (s), `duration` (s or None), `node` and `wait` (s), as the command has them.
        ending: whether to end.
    """

    def __init__(self, node: Any, kind: Kind, value: float, options: argparse.Namespace, ending: Ending) -> None:
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
        from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415
        from std_msgs.msg import String  # noqa: PLC0415

        self._node, self._kind, self._value, self._options, self._ending = node, kind, value, options, ending
        self._message_type = JointState
        self._states: dict[str, tuple[float, float, float]] = {}  # arc length (m), speed (m/s), drive force (N)
        self._heard = False  # any joint states
        self._scenario: dict[str, Any] | None = None
        self._answered = math.inf  # s of the clock
        self._applied = False  # any command
        self._refusal = ""  # why the twin has refused the newest one
        twin = options.node
        self._publisher = node.create_publisher(JointState, f"{twin}/{kind.topic}", 10)
        self._topic = self._publisher.topic_name  # as remapped
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(String, f"{twin}/scenario", self._on_scenario, latched)
        node.create_subscription(JointState, f"{twin}/joint_states", self._on_states, 10)
        node.create_subscription(JointState, f"{twin}/{APPLIED_COMMANDS}", self._on_applied, 50, raw=True)
        node.create_subscription(DiagnosticArray, f"{twin}/{REFUSED_COMMANDS}", self._on_refused, 50)

    def find_twin(self) -> str | None:
        """Wait for the twin and check the command against its scenario; returns the error message."""
        from cable_twin.scenario import command_fault, load_scenario  # noqa: PLC0415 - takes a second, while it is sought

        deadline = time.monotonic() + self._options.wait
        while not (self._publisher.get_subscription_count() and self._scenario is not None and self._heard):
            self._spin(0.05)
            if self._ending.is_set():
                return None
            if time.monotonic() > deadline:
                if self._scenario is not None:
                    return f"the twin on {self._topic} does not advance: if it is paused, `drive --resume` continues it"
                return nobody_listens(self._node, self._topic, self._options.wait)
        scenario = load_scenario(self._scenario)
        return command_fault(scenario, self._kind.name, self._kind.unit, self._options.name, self._value)

    def run(self) -> str | None:
        """Send commands until the end, and stop the drive in every case; returns the error message."""
        try:
            fault = self._send_until_the_end()
        except BrokenPipeError:  # nobody reads on: as Ctrl-C
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return None
        finally:
            self._stop()
        return fault or self._unheard()

    def _send_until_the_end(self) -> str | None:
        unit = self._kind.unit
        terminal = sys.stdout.isatty()
        started = time.monotonic()
        next_command = next_line = started
        self._answered = started
        fault = None
        value: float | None = 0.0
        while not self._ending.is_set() and fault is None:
            now = time.monotonic()
            if now - self._answered > ANSWER:
                fault = UNANSWERED
                break
            if now >= next_command:
                value = self._next(now - started)
                if value is None:
                    break
                self._send(value)
                next_command = max(next_command + 1.0 / RATE, now)
                if now >= next_line:
                    given = f"{value / 1e3:+.2f} kN" if unit == "N" else f"{value:+.2f} {unit}"
                    self._print_state(now - started, given, terminal)
                    next_line = now + (TERMINAL_PERIOD if terminal else PIPE_PERIOD)
            self._spin(max(min(next_command - time.monotonic(), 0.05), 0.0))
            fault = self._fault()
        if terminal:
            print()
        if value is None:
            self._tell_end(time.monotonic() - started)
        return fault

    def _next(self, elapsed: float) -> float | None:
        """Command value due at a time (s) after the first command; None at the end."""
        options = self._options
        if options.duration is not None and elapsed >= options.duration:
            return None
        return self._value * (1.0 if not options.ramp else min(elapsed / options.ramp, 1.0))

    def _fault(self) -> str | None:
        """Refusal message that ends the command, in a line; None otherwise."""
        taken = time.monotonic() - self._answered < REFUSING  # then it was somebody else's that was refused
        return None if taken else self._refusal or None

    def _unheard(self) -> str | None:
        """Error message where no sent command, the final stop included, was applied; None otherwise."""
        deadline = time.monotonic() + ANSWER
        while not self._applied and not self._ending.is_set():
            if self._refusal or time.monotonic() > deadline:
                return self._refusal or UNANSWERED
            self._spin(0.05)
        return None

    def _note(self) -> str:
        """Additional text for the state line."""
        return ""

    def _tell_end(self, elapsed: float) -> None:
        """Report the end of the command after an elapsed time (s)."""

    def _send(self, value: float) -> None:
        self._publish(**{self._kind.field: [value]})

    def _stop(self) -> None:
        """Send a speed of zero to the twin, as zero force would let the carriage roll down."""
        from rclpy.duration import Duration  # noqa: PLC0415

        self._publish(velocity=[0.0])
        self._publisher.wait_for_all_acked(Duration(seconds=1.0))

    def _publish(self, **fields: list[float]) -> None:
        message = self._message_type(name=[self._options.name], **fields)
        message.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(message)

    def _print_state(self, elapsed: float, commanded: str, terminal: bool) -> None:
        name = self._options.name
        arc_length, speed, force = self._states.get(name, (math.nan, math.nan, math.nan))
        line = f"{elapsed:6.1f} s  commanded {commanded}  {name}: {speed:+.2f} m/s at {arc_length:.2f} m{self._note()}"
        pull = f", drive {force / 1e3:+.2f} kN"
        if terminal:
            width = shutil.get_terminal_size().columns - 3  # a line that wraps is not written over, nor one before ^C
            line = f"\r{(line + pull if len(line + pull) <= width else line)[:width]:<{width}}"
        else:
            line += pull
        print(line, end="" if terminal else "\n", flush=True)

    def _spin(self, seconds: float) -> None:
        import rclpy  # noqa: PLC0415

        rclpy.spin_once(self._node, timeout_sec=seconds)

    def _on_states(self, message: Any) -> None:
        self._heard = True
        for name, *state in zip(message.name, message.position, message.velocity, message.effort, strict=False):
            self._states[name] = (state[0], state[1], state[2])

    def _on_scenario(self, message: Any) -> None:
        scenario = published_scenario(message.data)
        if isinstance(scenario.get("carriages"), dict):
            self._scenario = scenario

    def _on_applied(self, data: bytes) -> None:
        applied = applied_command_from_message(data)
        if self._options.name in applied.command.values and applied.source == self._kind.topic:
            self._refusal = ""
            self._note_answer()

    def _on_refused(self, message: Any) -> None:
        """Record a refusal message of the twin."""
        for status in message.status:
            if self._answered < math.inf and status.name == self._kind.topic:
                self._refusal = printable(status.message, LONGEST_MESSAGE)

    def _note_answer(self) -> None:
        self._answered, self._applied = time.monotonic(), True
