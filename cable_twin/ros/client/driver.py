"""Drive commands from a terminal until an end condition: repeated speeds and forces, and trips to a place."""

from __future__ import annotations

import argparse
import math
import os
import shutil
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from cable_twin.basics.printable import LONGEST_MESSAGE, printable
from cable_twin.frame.commands import KINDS, Kind
from cable_twin.messages import APPLIED_COMMANDS, REFUSED_COMMANDS
from cable_twin.messages.command_messages import applied_command_from_message
from cable_twin.ros.client.twin_client import ANSWER, TwinError, nobody_listens, published_scenario, spin_until
from cable_twin.ros.startup import Ending

if TYPE_CHECKING:
    from cable_twin.scenario import Scenario

RATE = 20.0  # Hz, well inside the node's command time-out
REFUSING = 0.5  # s without an applied command, after which a refusal is that of our commands
UNANSWERED = (
    f"the twin has applied no command for {ANSWER:g} s: it may have ended, or its emergency stop is in force; its "
    "terminal shows the reason of each refusal"
)
TERMINAL_PERIOD, PIPE_PERIOD = 0.25, 1.0  # s between two state lines on a terminal, and in a file


class Driver:
    """Sender of repeated commands to a carriage or drive, which prints its state and refusals by the twin.

    Args:
        node: node of rclpy.
        kind: kind of the commands.
        value: commanded value, in the unit of the kind.
        options: options of `drive`: `name`, `ramp` (s), `duration` (s or None), `node` and `wait` (s).
        ending: flag of the signals that end the command.
    """

    def __init__(self, node: Any, kind: Kind, value: float, options: argparse.Namespace, ending: Ending) -> None:
        from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415
        from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415
        from std_msgs.msg import String  # noqa: PLC0415

        self._node, self._kind, self._value, self._options, self._ending = node, kind, value, options, ending
        self._message_type = JointState
        self._states: dict[str, tuple[float, float, float]] = {}  # arc length (m), speed (m/s), drive force (N)
        self._heard = False  # whether joint states were received
        self._scenario: dict[str, Any] | None = None
        self._answered = math.inf  # clock (s) of the newest applied command
        self._applied = False  # whether any command was applied
        self._refusal = ""  # message about the newest refused command
        twin = options.node
        self._publisher = node.create_publisher(JointState, f"{twin}/{kind.topic}", 10)
        self._topic = self._publisher.topic_name  # as remapped
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(String, f"{twin}/scenario", self._on_scenario, latched)
        node.create_subscription(JointState, f"{twin}/joint_states", self._on_states, 10)
        node.create_subscription(JointState, f"{twin}/{APPLIED_COMMANDS}", self._on_applied, 50, raw=True)
        node.create_subscription(DiagnosticArray, f"{twin}/{REFUSED_COMMANDS}", self._on_refused, 50)

    def find_twin(self) -> Scenario:
        """Wait for the twin and check the command against its scenario; returns the scenario.

        Raises:
            TwinError: there is no twin, it does not advance, or its scenario excludes the command.
        """
        from cable_twin.scenario import command_fault, load_scenario  # noqa: PLC0415 - takes a second, while it is sought

        def found() -> bool:
            listens = self._publisher.get_subscription_count() > 0
            return listens and self._scenario is not None and self._heard

        if not self._until(found, self._options.wait):
            if self._scenario is None:
                raise TwinError(nobody_listens(self._node, self._topic, self._options.wait))
            raise TwinError(
                f"the twin on {self._topic} does not advance: if it is paused, `drive --resume` continues it"
            )
        assert self._scenario is not None
        scenario = load_scenario(self._scenario)
        if fault := command_fault(scenario, self._kind.name, self._kind.unit, self._options.name, self._value):
            raise TwinError(fault)
        return scenario

    def run(self) -> None:
        """Send commands until the end, and stop the drive in every case.

        Raises:
            TwinError: the twin refuses the command, or does not apply it.
        """
        try:
            self._send_until_the_end()
        except BrokenPipeError:  # the reader of a pipe has ended: as Ctrl-C
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return
        finally:
            self._stop()
        self._check_applied()

    def _send_until_the_end(self) -> None:
        unit = self._kind.unit
        terminal = sys.stdout.isatty()
        started = time.monotonic()
        next_command = next_line = started
        self._answered = started
        value: float | None = 0.0
        try:
            while not self._ending.is_set():
                now = time.monotonic()
                if now - self._answered > ANSWER:
                    raise TwinError(UNANSWERED)
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
                if self._refusal and self._is_refused():
                    raise TwinError(self._refusal)
        finally:
            if terminal:
                print()
        if value is None:
            self._report_end(time.monotonic() - started)

    def _next(self, elapsed: float) -> float | None:
        """Value to command at a time (s) after the first command; None at the end."""
        options = self._options
        if options.duration is not None and elapsed >= options.duration:
            return None
        return self._value * (1.0 if not options.ramp else min(elapsed / options.ramp, 1.0))

    def _is_refused(self) -> bool:
        """Whether the twin refuses this driver's commands: it has applied none for the last `REFUSING` seconds."""
        return time.monotonic() - self._answered >= REFUSING

    def _check_applied(self) -> None:
        """Raise TwinError if no sent command, the final stop included, was applied."""
        if self._ending.is_set():
            return
        if not self._until(lambda: self._applied or self._refusal, ANSWER) or not self._applied:
            raise TwinError(self._refusal or UNANSWERED)

    def _remark(self) -> str:
        """Text at the end of the printed line about the driven vehicle's state; empty here."""
        return ""

    def _report_end(self, elapsed: float) -> None:
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
        line = (
            f"{elapsed:6.1f} s  commanded {commanded}  {name}: {speed:+.2f} m/s at {arc_length:.2f} m{self._remark()}"
        )
        pull = f", drive {force / 1e3:+.2f} kN"
        if terminal:
            width = shutil.get_terminal_size().columns - 3  # room for ^C; a wrapped line would not be overwritten
            line = f"\r{(line + pull if len(line + pull) <= width else line)[:width]:<{width}}"
        else:
            line += pull
        print(line, end="" if terminal else "\n", flush=True)

    def _until(self, condition: Callable[[], Any], seconds: float) -> bool:
        return spin_until(self._node, self._ending, condition, seconds)

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
            self._count_answer()

    def _on_refused(self, message: Any) -> None:
        """Record a refusal message of the twin."""
        for status in message.status:
            if self._answered < math.inf and status.name == self._kind.topic:
                self._refusal = printable(status.message, LONGEST_MESSAGE)

    def _count_answer(self) -> None:
        self._answered, self._applied = time.monotonic(), True


class Trip(Driver):
    """Trip of a carriage, or the cable of a drive, to a place: one goal command, with progress until arrival.

    Args:
        node: node of rclpy.
        options: options of `drive`: `name`, `to` (m, station or tower), `at_most` (m/s or None), `node` and `wait` (s).
        ending: flag of the signals that end the command; the twin then ramps to a stop.
    """

    def __init__(self, node: Any, options: argparse.Namespace, ending: Ending) -> None:
        from rcl_interfaces.msg import Log  # noqa: PLC0415
        from sensor_msgs.msg import PointCloud2  # noqa: PLC0415

        super().__init__(node, KINDS["speed"], options.at_most or 0.0, options, ending)
        self._target = math.nan  # m
        self._sent = self._arrived = False
        self._speed = 0.0  # m/s, commanded by the twin
        self._rope: Any = None  # newest message about the cable
        node.create_subscription(Log, "/rosout", self._on_log, 50)
        node.create_subscription(PointCloud2, f"{options.node}/cable", self._on_rope, 1)

    def find_twin(self) -> Scenario:
        """Wait for the twin and resolve the target place in its scenario; returns the scenario.

        Raises:
            TwinError: there is no twin, or the place is out of its reach.
        """
        from cable_twin.runtime.point_to_point import target_of  # noqa: PLC0415 - numpy and the mechanics, half a second

        scenario, towers = super().find_twin(), {}
        if self._options.to in scenario.towers:
            if not self._until(lambda: self._rope is not None, self._options.wait):
                known = "m along the cable or a station, as the twin does not publish `cable`"
                raise TwinError(f"--to: given tower '{self._options.to}'; allowed: {known}")
            towers = tower_places(scenario, points_of(self._rope))
        try:
            self._target = target_of(scenario, self._options.name, self._options.to, towers)
        except ValueError as error:
            raise TwinError(f"--to: {error}") from None
        return scenario

    def _next(self, elapsed: float) -> float | None:
        """Speed (m/s) commanded by the twin; None after arrival."""
        return None if self._arrived else self._speed

    def _send(self, value: float) -> None:
        if not self._sent:
            self._sent = True
            fastest = {"velocity": [self._value]} if self._value else {}
            self._publish(position=[self._target], **fastest)

    def _stop(self) -> None:
        if self._sent and not self._arrived and not self._refusal:
            super()._stop()

    def _is_refused(self) -> bool:
        return True

    def _check_applied(self) -> None:
        """Skip the check of applied commands, as a trip ends with an arrival or a refusal."""

    def _remark(self) -> str:
        return f", {self._target - self._states[self._options.name][0]:+.2f} m to go"

    def _report_end(self, elapsed: float) -> None:
        place = self._states[self._options.name][0]
        away = f"{abs(self._target - place):.2f} m from {self._target:.2f} m"
        print(f"arrived: {self._options.name} at {place:.2f} m, {away}, after {elapsed:.1f} s", file=sys.stdout)

    def _on_applied(self, data: bytes) -> None:
        from cable_twin.runtime.point_to_point import ARRIVAL, SOURCE  # noqa: PLC0415 - imported by now

        applied = applied_command_from_message(data)
        if applied.source in (SOURCE, ARRIVAL) and self._options.name in applied.command.values:
            self._count_answer()
            self._arrived = self._sent and applied.source == ARRIVAL
            self._speed = applied.command.values[self._options.name]

    def _on_rope(self, message: Any) -> None:
        self._rope = message

    def _on_log(self, message: Any) -> None:
        """Record an abandoned trip from the log of the twin."""
        from cable_twin.runtime.point_to_point import ABANDONED  # noqa: PLC0415 - imported by now

        own = message.name == self._options.node.strip("/").replace("/", ".")
        if own and self._answered < math.inf and message.msg.startswith(f"{ABANDONED}{self._options.name}: "):
            self._refusal = f"the twin has abandoned this trip: {message.msg.partition(': ')[2]}"


def points_of(cloud: Any) -> Any:
    """Points (n, 4) of a cable message: x, y, z, arc length, in m."""
    columns = [
        np.ndarray(cloud.width, "<f4", bytes(cloud.data), field.offset, cloud.point_step)
        for field in cloud.fields
        if field.name in ("x", "y", "z", "arc_length")
    ]
    return np.array(columns, dtype=np.float64).T


def tower_places(scenario: Scenario, points: Any) -> dict[str, float]:
    """Arc length (m) of the cable at each tower, from its points (n, 4): x, y, z, arc length, in m."""
    places = {}
    for name, place in scenario.tower_places.items():
        where = np.array(place[:2])
        start, along = points[:-1, :2], np.diff(points[:, :2], axis=0)
        share = ((where - start) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
        share = share.clip(0.0, 1.0)
        row = int(np.linalg.norm(start + share[:, None] * along - where, axis=1).argmin())
        places[name] = float(points[row, 3] + share[row] * (points[row + 1, 3] - points[row, 3]))
    return places
