"""Trip to a place: goal command to the twin, which finds the speeds, with progress until arrival."""

from __future__ import annotations

import argparse
import math
import sys
import time
from typing import Any

import numpy as np

from cable_twin.frame.commands import KINDS
from cable_twin.messages.command_messages import applied_command_from_message
from cable_twin.ros.client.repeated_drive import Driver
from cable_twin.ros.command_line import Ending
from cable_twin.scenario import Scenario, load_scenario


class Trip(Driver):
    """Goal command to a place, sent once, with progress until arrival of the carriage or the cable of a drive.

    Args:
        node: of rclpy.
        options: `name`, `to` (m, a station or a tower), `at_most` (m/s or None), `node`, `wait` (s), of the command.
        ending: whether to end: the twin is told to stop then.
    """

    def __init__(self, node: Any, options: argparse.Namespace, ending: Ending) -> None:
        from rcl_interfaces.msg import Log  # noqa: PLC0415
        from sensor_msgs.msg import PointCloud2  # noqa: PLC0415

        super().__init__(node, KINDS["speed"], options.at_most or 0.0, options, ending)
        self._target = math.nan  # m
        self._given = False
        self._asked = 0.0  # m/s, by the twin
        self._arrived = False
        self._rope: Any = None  # the newest cable
        node.create_subscription(Log, "/rosout", self._on_log, 50)
        node.create_subscription(PointCloud2, f"{options.node}/cable", self._on_rope, 1)

    def find_twin(self) -> str | None:
        """Wait for the twin and resolve the target place in its scenario; returns the error message."""
        from cable_twin.runtime.point_to_point import target_of  # noqa: PLC0415 - numpy and the mechanics, half a second

        fault = super().find_twin()
        if fault is not None or self._ending.is_set():
            return fault
        assert self._scenario is not None
        scenario = load_scenario(self._scenario)
        towers: dict[str, float] = {}
        if self._options.to in scenario.towers:
            deadline = time.monotonic() + self._options.wait
            while self._rope is None and not self._ending.is_set():
                if time.monotonic() > deadline:
                    return f"tower '{self._options.to}' cannot be found: the twin does not publish `cable`"
                self._spin(0.05)
            towers = tower_places(scenario, points_of(self._rope))
        try:
            self._target = target_of(scenario, self._options.name, self._options.to, towers)
        except ValueError as error:
            return f"--to {error}"
        return None

    def _next(self, elapsed: float) -> float | None:
        """Speed (m/s) commanded by the twin; None after arrival."""
        return None if self._arrived else self._asked

    def _send(self, value: float) -> None:
        if not self._given:
            self._given = True
            fastest = {"velocity": [self._value]} if self._value else {}
            self._publish(position=[self._target], **fastest)

    def _stop(self) -> None:
        if self._given and not self._arrived and not self._refusal:
            super()._stop()

    def _fault(self) -> str | None:
        return self._refusal or None

    def _unheard(self) -> str | None:
        return None  # it has seen what came of it

    def _note(self) -> str:
        return f", {self._target - self._states[self._options.name][0]:+.2f} m to go"

    def _tell_end(self, elapsed: float) -> None:
        place = self._states[self._options.name][0]
        away = f"{abs(self._target - place):.2f} m from {self._target:.2f} m"
        print(f"arrived: {self._options.name} at {place:.2f} m, {away}, after {elapsed:.1f} s", file=sys.stdout)

    def _on_applied(self, data: bytes) -> None:
        from cable_twin.runtime.point_to_point import ARRIVAL, SOURCE  # noqa: PLC0415 - is there by now

        applied = applied_command_from_message(data)
        if applied.source in (SOURCE, ARRIVAL) and self._options.name in applied.command.values:
            self._note_answer()
            self._arrived = self._given and applied.source == ARRIVAL
            self._asked = applied.command.values[self._options.name]

    def _on_rope(self, message: Any) -> None:
        self._rope = message

    def _on_log(self, message: Any) -> None:
        """Record an abandoned trip from the log of the twin."""
        from cable_twin.runtime.point_to_point import ABANDONED  # noqa: PLC0415 - is there by now

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


__all__ = ["Trip", "points_of", "tower_places"]
