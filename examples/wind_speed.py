#!/usr/bin/env python3
"""Control experiment (d): trip at a speed reduced with the wind, and stopped in too strong a wind.

The law, with the horizontal wind w (m/s) of the topic `air/wind`, the highest of the last 10 s, and the roll of the
vehicle (of a lift the largest of all) from its pose, likewise:

    v(w) = v                          up to the wind of full speed
    v(w) = v + (v_slow - v) (w - w_full) / (w_stop - w_full)    up to the wind at which the ropeway stops
    v(w) = 0                          from there on, or with more roll than is allowed, until it was calmer for 20 s

At the end of the way it is no faster than sqrt(2 0.5 a s) and 0.3 s, with s (m) to go. `key_figures` are the twin's own
judgement: where one of its figures of the swing of this vehicle, or of any on a lift, comes to 0.8 of its limit, the
trip goes on at v_slow.
A ropeway has such speeds and winds in its permit; those that are the defaults here are assumed, of a usual size.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections import deque
from collections.abc import Collection, Iterable
from typing import Any

from control_experiment import (
    ExperimentError,
    Law,
    Link,
    Motion,
    check_place,
    drive_limits,
    limits_of,
    main,
    parser,
    positive,
)

from cable_twin import load_scenario

NAME = "wind_speed.py"
HELD = 10.0  # s, for which a gust is remembered
CALM = 20.0  # s below the limits after which it goes on
CALMER = 0.9  # of the limits, below which it is
SHARE = 0.5  # of the drive's deceleration, with which it stops at the end
ENDING = 0.3  # 1/s, speed for what is left of the way, on its last metres
SWINGS = ("swing", "lateral_swing")  # quantities of key figures, along and across the track
NEAR = 0.8  # of the limit of a key figure
ARRIVED = 0.1  # m
SAID = 0.5  # m/s, by which the speed changes before it is said
EPILOG = """\
exit codes: 0 done or ended by Ctrl-C, 1 it cannot be done

examples, with `sim windy_tramway`, or `sim gondola --set space=3`, running in another terminal, and
`drive --wind 0 0 18` in a third:
  python examples/wind_speed.py cabin --to 500 --speed 7
  python examples/wind_speed.py haul_rope --to 100         m of travel of the rope of a lift
"""


class Peak:
    """Highest measurement of the last `HELD` seconds."""

    def __init__(self) -> None:
        self._measured: deque[tuple[float, float]] = deque()

    @property
    def known(self) -> bool:
        """Whether any measurement exists."""
        return bool(self._measured)

    def take(self, time: float, value: float) -> None:
        """Take a measurement at a time (s); lower and older ones are dropped."""
        while self._measured and self._measured[-1][1] <= value:
            self._measured.pop()
        self._measured.append((time, value))

    def at(self, time: float) -> float:
        """Highest measurement at a time (s), 0 without any; the last one stays."""
        while len(self._measured) > 1 and self._measured[0][0] < time - HELD:
            self._measured.popleft()
        return max((value for _, value in self._measured), default=0.0)


class WindLaw:
    """Control law of the speed by the wind, with its messages.

    Args:
        options: as given.
        target: m, arc length, or travel of a lift's rope, to go to.
        deceleration: m/s^2, that the drive is capable of.
    """

    def __init__(self, options: argparse.Namespace, target: float, deceleration: float) -> None:
        self._options, self._target, self._deceleration = options, target, deceleration
        self.wind, self.roll = Peak(), Peak()
        self.now = 0.0  # s of the experiment
        self.careful = ""  # key figure that has come near its limit
        self.strongest, self.largest = 0.0, 0.0  # m/s, rad
        self._calm_since = -math.inf  # s; nan while it is not calm
        self._arrived = math.nan  # s
        self._said = -1.0  # m/s

    def allowed(self, wind: float) -> float:
        """Speed (m/s) allowed by a wind (m/s), stops left out."""
        full, stop = self._options.full_speed_wind, self._options.stop_wind
        share = min(max((wind - full) / (stop - full), 0.0), 1.0)
        slow = min(self._options.slow_speed, self._options.speed)
        return slow if self.careful else self._options.speed + share * (slow - self._options.speed)

    def stands(self, wind: float, roll: float) -> bool:
        """Whether wind (m/s) or roll (rad) is too strong now, or was recently."""
        share = max(wind / self._options.stop_wind, math.degrees(roll) / self._options.roll_limit)
        if share >= 1.0:
            self._calm_since = math.nan
        elif math.isnan(self._calm_since) and share < CALMER:
            self._calm_since = self.now
        return not self.now - self._calm_since >= CALM

    def __call__(self, motion: Motion) -> float | None:
        """Speed (m/s) along the rope; None at the end."""
        self.now = motion.time
        if not self.wind.known:
            if self.now > HELD:
                raise ExperimentError(f"nothing heard of the wind for {HELD:g} s: the twin has no topic air/wind")
            return 0.0
        wind, roll = self.wind.at(self.now), self.roll.at(self.now)
        self.strongest, self.largest = max(self.strongest, wind), max(self.largest, roll)
        if not math.isnan(self._arrived):
            return 0.0 if self.now < self._arrived + self._options.settle else None
        allowed = 0.0 if self.stands(wind, roll) else self.allowed(wind)
        self._say(motion, wind, roll, allowed)
        left = self._target - motion.arc_length
        if abs(left) < ARRIVED:
            self._arrived = self.now
            return 0.0
        ending = min(math.sqrt(2.0 * SHARE * self._deceleration * abs(left)), ENDING * abs(left))
        return math.copysign(min(allowed, ending), left)

    def judged(self, subjects: Collection[str], message: Any) -> None:
        """Take in key figures of the twin: swing of vehicles, by their subjects, near its limit."""
        for status in message.status:
            values = {item.key: item.value for item in status.values}
            quantity, _, rest = values["id"].partition("/")  # quantity/subject/statistic
            swings = quantity in SWINGS and rest.rpartition("/")[0] in subjects
            if not swings or "limit" not in values or self.careful:
                continue
            if float(values["value"]) > NEAR * float(values["limit"]):
                self.careful = status.name

    def _say(self, motion: Motion, wind: float, roll: float, allowed: float) -> None:
        if abs(allowed - self._said) >= SAID or (allowed == 0.0) != (self._said == 0.0):
            why = f", {self.careful} is near its limit" if self.careful else ""
            print(
                f"{NAME}: {motion.time:6.1f} s, {motion.arc_length:7.1f} m: wind {wind:.1f} m/s, "
                f"roll {math.degrees(roll):.1f} deg{why}: {allowed:.2f} m/s",
                flush=True,
            )
            self._said = allowed


def roll_of(q: Any) -> float:
    """Roll (rad) of an orientation, a quaternion."""
    return math.atan2(2.0 * (q.y * q.z + q.w * q.x), 1.0 - 2.0 * (q.x * q.x + q.y * q.y))


def experiment(link: Link, options: argparse.Namespace) -> Law:
    """Subscribe to wind, roll and key figures, which the control law follows."""
    from diagnostic_msgs.msg import DiagnosticArray  # noqa: PLC0415 - as rclpy in control_experiment
    from geometry_msgs.msg import PoseArray, PoseStamped, Vector3Stamped  # noqa: PLC0415

    acceleration, _ = limits_of(link, options)
    check_place(link, options.to)
    if options.stop_wind <= options.full_speed_wind:
        raise ExperimentError(
            f"--stop-wind {options.stop_wind:g} m/s given; allowed: more than that of full speed, "
            f"{options.full_speed_wind:g} m/s"
        )
    scenario = load_scenario(link.scenario)
    if scenario.dim != 3:
        raise ExperimentError(f"scenario '{scenario.name}' is one in a plane; needed is one in space, as windy_tramway")
    law = WindLaw(options, options.to, drive_limits(link).deceleration or acceleration)

    def measure_wind(message: Any) -> None:
        law.wind.take(law.now, math.hypot(message.vector.x, message.vector.y))

    def measure_roll(poses: Iterable[Any]) -> None:
        # a carrier in a station has none
        rolls = [abs(roll_of(pose.orientation)) for pose in poses]
        law.roll.take(law.now, max((roll for roll in rolls if math.isfinite(roll)), default=0.0))

    vehicles = [link.name] if link.name in scenario.carriages else [*scenario.carriages]
    subjects = {f"carriages.{name}" for name in vehicles} | ({"carriers"} if link.name in scenario.drives else set())
    link.listen(Vector3Stamped, "air/wind", measure_wind)
    for name in vehicles:
        link.listen(
            PoseStamped,
            f"carriages/{name}/{[*scenario.carriages[name].bodies][-1]}/pose",
            lambda message: measure_roll([message.pose]),
        )
    if link.name in scenario.drives and scenario.carriers is not None:
        link.listen(PoseArray, "carriers/poses", lambda message: measure_roll(message.poses))
    link.listen(DiagnosticArray, "key_figures", lambda message: law.judged(subjects, message))

    def drive(motion: Motion) -> float | None:
        speed = law(motion)
        if speed is None:
            print(
                f"{NAME}: strongest wind {law.strongest:.1f} m/s; largest swing across the track, or roll, "
                f"{math.degrees(law.largest):.1f} deg in it",
                flush=True,
            )
        return speed

    return drive


if __name__ == "__main__":
    what = "Drive a carriage or lift to a place, slower in wind and not at all in a storm."
    arguments = parser(NAME, what, EPILOG, drives=True)
    for option, unit, default, what in (
        ("--to", "m", 500.0, "arc length (m), or travel of a lift's rope (m), to go to"),
        ("--full-speed-wind", "m/s", 10.0, "wind (m/s) up to which it goes at full speed"),
        ("--stop-wind", "m/s", 20.0, "wind (m/s) in which it stands"),
        ("--slow-speed", "m/s", 2.0, "speed (m/s) just below that wind"),
        ("--roll-limit", "deg", 11.3, "roll (deg) with which it stands"),
    ):
        arguments.add_argument(
            option, type=positive(unit), default=default, metavar=unit.upper(), help=f"{what}; default: {default:g}"
        )
    sys.exit(main(arguments.parse_args(), NAME, experiment))
