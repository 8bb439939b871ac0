"""Common parts of the control experiments: a link to the running twin, speed plans, and the swing modes of a vehicle.

What is driven is a carriage with a drive of its own or, where an experiment can do with it, the drive of a lift, whose
place is the travel of its rope.

A controller is a function from what `joint_states` says to a speed. It is called at the times of the stamps, so that an
experiment gives the same whatever the pacing of the twin is (`sim --real-time-factor 4`).
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from cable_twin import load_scenario
from cable_twin.ros.startup import Ending, prepare_middleware, print_hint
from cable_twin.scenario import Scenario, command_limits
from cable_twin.scenario.command_limits import places_of
from cable_twin.scenario.sections.drives import Limits
from cable_twin.terminal.command_line import OneLineParser

COMMAND_PERIOD = 0.02  # s of simulated time between two commands
DISCOVERY = 10.0  # s of the clock to find the twin, where --wait does not say it
SILENCE = 2.0  # s of the clock without an answer of the twin
REST = 1e-3  # m/s


@dataclass(frozen=True, slots=True)
class Motion:
    """Motion of one carriage or drive as the twin publishes it."""

    time: float  # s of simulated time since the experiment began
    arc_length: float  # m, of a drive the travel of its rope
    speed: float  # m/s
    pitches: Mapping[str, tuple[float, float]]  # rad and rad/s of each body of a carriage, from the rope down


Law = Callable[[Motion], "float | None"]  # speed (m/s) along the rope, None when the experiment is over


class ExperimentError(Exception):
    """Reason in one line for the end of an experiment."""


class Link:
    """Connection to one carriage or drive of a running twin.

    Args:
        name: of the carriage or drive.
        twin: full name of the node.
        wait: s of the clock to find it.
        ending: a signal ends the experiment.
        drives: whether the drive of a lift will do.

    Raises:
        ExperimentError: no twin answers, or it has no such carriage or drive.
    """

    def __init__(self, name: str, twin: str, wait: float, ending: Ending, *, drives: bool = False) -> None:
        import rclpy  # noqa: PLC0415 - the hint stands for the traceback
        from rclpy.qos import DurabilityPolicy, QoSProfile  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415
        from std_msgs.msg import String  # noqa: PLC0415

        self.name = name
        self.scenario: dict[str, Any] = {}
        self.motion: Motion | None = None
        self._spin_once = rclpy.spin_once
        self._ending = ending
        self._message_type = JointState
        self._start_ns: int | None = None
        self._heard = self._answered = time.monotonic()
        self._law: Law | None = None
        self._next_command = 0.0  # s of the experiment
        self._over = False
        self._node = rclpy.create_node("control_experiment")
        self._twin = twin = "/" + twin.strip("/")
        self._publisher = self._node.create_publisher(JointState, f"{twin}/joint_commands", 10)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._node.create_subscription(String, f"{twin}/scenario", self._on_scenario, latched)
        self._node.create_subscription(JointState, f"{twin}/joint_states", self._on_states, 50)
        self._node.create_subscription(JointState, f"{twin}/applied_commands", self._on_applied, 50)
        deadline = time.monotonic() + wait
        while (missing := self._missing()) and not ending.is_set():
            self._spin_once(self._node, timeout_sec=0.05)
            if self.scenario:
                check_name(load_scenario(self.scenario), name, drives=drives)
            if time.monotonic() > deadline:
                raise ExperimentError(
                    f"no twin that moves on answers as {twin} after {wait:g} s ({', '.join(missing)}): "
                    "is `sim` running, not paused, and with the same ROS_DOMAIN_ID?"
                )

    def _missing(self) -> list[str]:
        """Names of needed data that the twin has not sent yet."""
        there = {
            "no listener to joint_commands": self._publisher.get_subscription_count(),
            "no scenario": self.scenario,
            "no joint_states": self.motion,
        }
        return [what for what, found in there.items() if not found]

    @property
    def ended(self) -> bool:
        """Whether an ending signal has been received."""
        return self._ending.is_set()

    def run(self, law: Law) -> bool:
        """Drive by a control law to its end, and stop; returns False after an ending signal.

        Raises:
            ExperimentError: the twin does not answer any more, or refuses.
        """
        self._law, self._start_ns, self._next_command, self._over = law, None, 0.0, False
        self._heard = self._answered = time.monotonic()
        while not self._over and not self._ending.is_set():
            self._spin_once(self._node, timeout_sec=0.05)
            now = time.monotonic()
            if now - self._heard > SILENCE:
                raise ExperimentError(
                    f"nothing heard of the twin for {SILENCE:g} s: is it still there, and not paused?"
                )
            if now - self._answered > SILENCE:
                raise ExperimentError(
                    f"the twin has applied no command for {SILENCE:g} s: is its emergency stop in force? "
                    "Its terminal shows the reason of each refusal"
                )
        return self._over

    def listen(self, message_type: Any, topic: str, take: Callable[[Any], None]) -> None:
        """Take messages of one more topic of the twin during the control law."""
        self._node.create_subscription(message_type, f"{self._twin}/{topic}", take, 50)

    def close(self) -> None:
        """Stop the carriage or drive and end the connection."""
        from rclpy.duration import Duration  # noqa: PLC0415

        if self._law is not None:
            self._send(0.0)
            self._publisher.wait_for_all_acked(Duration(seconds=1.0))
        self._node.destroy_node()

    def _send(self, speed: float) -> None:
        self._publisher.publish(self._message_type(name=[self.name], velocity=[speed]))

    def _on_states(self, message: Any) -> None:
        self._heard = time.monotonic()
        stamp = message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec
        if self._start_ns is None:
            self._start_ns = stamp
        states = dict(zip(message.name, zip(message.position, message.velocity, strict=True), strict=True))
        if self.name not in states:
            return
        self.motion = Motion((stamp - self._start_ns) / 1e9, *states[self.name], self._pitches(states))
        if self._law is None or self._over or self.motion.time < self._next_command:
            return
        speed = self._law(self.motion)
        if speed is None:
            self._over = True
            return
        self._next_command = self.motion.time + COMMAND_PERIOD - 1e-6
        self._send(speed)

    def _pitches(self, states: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
        """Pitch and pitch rate of each body, summed over the joints from the rope down."""
        pitches, pitch, rate = {}, 0.0, 0.0
        for body in self.scenario.get("carriages", {}).get(self.name, {}).get("bodies", ()):
            joint = states[f"{self.name}_{body}"]
            pitch, rate = pitch + joint[0], rate + joint[1]
            pitches[body] = (pitch, rate)
        return pitches

    def _on_scenario(self, message: Any) -> None:
        self.scenario = json.loads(message.data)

    def _on_applied(self, message: Any) -> None:
        if f"speed/{self.name}/joint_commands" in message.name:
            self._answered = time.monotonic()


@dataclass(frozen=True, slots=True)
class SpeedPlan:
    """Speed over time, linear between knots, zero before and after."""

    times: NDArray[np.float64]  # (n,) s
    speeds: NDArray[np.float64]  # (n,) m/s
    weights: NDArray[np.float64]  # (m,) of the impulses of the shaper, sum 1
    delays: NDArray[np.float64]  # (m,) s of the same

    @classmethod
    def through(cls, legs: Sequence[tuple[float, float]]) -> SpeedPlan:
        """Speed plan from rest through legs of (duration in s, speed in m/s at the end)."""
        times = np.cumsum([0.0, *(duration for duration, _ in legs)])
        return cls(times, np.array([0.0, *(speed for _, speed in legs)]), np.ones(1), np.zeros(1))

    @classmethod
    def trapezoid(cls, distance: float, speed: float, acceleration: float, jerk: float) -> SpeedPlan:
        """Speed plan over a distance (m, either sign) at a speed (m/s) and an acceleration (m/s^2).

        The cruise is long enough for a drive with this jerk (m/s^3) to change from ramp to ramp; on a short way the
        speed is lower.
        """
        least = acceleration / jerk  # s
        highest = 0.5 * acceleration * (math.sqrt(least**2 + 4.0 * abs(distance) / acceleration) - least)
        top = math.copysign(min(speed, highest), distance)
        ramp = abs(top) / acceleration
        cruise = abs(distance / top) - ramp if top else 0.0
        return cls.through([(ramp, top), (cruise, top), (ramp, 0.0)])

    def shaped(self, frequencies: NDArray[np.float64]) -> SpeedPlan:
        """Speed plan convolved with two halves, half a period apart, for each angular frequency (rad/s).

        Neither of them is left swinging (zero-vibration input shaping: Singer and Seering 1990); the distance stays.
        """
        weights, delays = self.weights, self.delays
        for frequency in frequencies:
            weights = np.concatenate([0.5 * weights, 0.5 * weights])
            delays = np.concatenate([delays, delays + math.pi / frequency])
        return SpeedPlan(self.times, self.speeds, weights, delays)

    @property
    def duration(self) -> float:
        """End time (s) of the plan."""
        return float(self.times[-1] + self.delays.max())

    def speed(self, when: float) -> float:
        """Speed (m/s) at a time (s)."""
        return float(self.weights @ np.interp(when - self.delays, self.times, self.speeds, left=0.0, right=0.0))

    def acceleration(self, when: float) -> float:
        """Acceleration (m/s^2) at a time (s), as mean over the next hundredth of a second."""
        return (self.speed(when + 0.01) - self.speed(when)) / 0.01


def swing_frequencies(bodies: Mapping[str, Mapping[str, Any]], gravity: float) -> NDArray[np.float64]:
    """Angular frequencies (rad/s), slowest first, of a chain of bodies hanging from a point at rest.

    Small pitches about straight down: M q'' + K q = 0 with the lever (m) of each pitch on each centre of mass.

    Args:
        bodies: of a carriage, as a scenario has them, from the rope down.
        gravity: m/s^2.
    """
    chain = list(bodies.values())
    mass, stiffness = np.zeros((len(chain), len(chain))), np.zeros((len(chain), len(chain)))
    for index, body in enumerate(chain):
        levers = np.zeros(len(chain))
        for above, other in enumerate(chain[:index]):
            levers[above] = other["upper_pivot"][1] - other["lower_pivot"][1]
        levers[index] = body["upper_pivot"][1]
        mass += body["mass"] * np.outer(levers, levers)
        mass[index, index] += body["inertia"]
        stiffness += np.diag(body["mass"] * gravity * levers)
    return np.sqrt(eigh(stiffness, mass, eigvals_only=True))


def parser(name: str, description: str, epilog: str, *, drives: bool = False) -> OneLineParser:
    """Parser of the options common to all experiments; `drives`: whether the drive of a lift will do."""
    result = OneLineParser(name, description, epilog)
    result.set_defaults(drives=drives)
    what = "carriage with a drive of its own, or drive of a lift" if drives else "carriage with a drive of its own"
    result.add_argument("name", nargs="?", default="cabin", help=f"{what}; default: cabin")
    result.add_argument("--node", default="/cable_twin", help="name of the twin; default: /cable_twin")
    result.add_argument(
        "--wait", type=positive("s"), default=DISCOVERY, metavar="S", help=f"s to find it; default: {DISCOVERY:g}"
    )
    result.add_argument("--speed", type=positive("m/s"), default=5.0, metavar="M/S", help="m/s on the way; default: 5")
    result.add_argument(
        "--settle", type=positive("s"), default=15.0, metavar="S", help="s to watch the swing in the end; default: 15"
    )
    return result


def positive(unit: str) -> Callable[[str], float]:
    """Parser of an option with a finite number above zero, in a unit."""

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not 0.0 < value < math.inf:
            raise argparse.ArgumentTypeError(f"{text!r} given, more than 0 {unit} is needed")
        return value

    return convert


def check_name(scenario: Scenario, name: str, *, drives: bool) -> None:
    """Raise ExperimentError where a name is not of a carriage with a drive of its own, or of a drive if one will do."""
    known = [one for one in command_limits(scenario) if drives or one not in scenario.drives]
    if name not in known:
        what = "carriage or drive" if drives else "carriage with a drive of its own"
        raise ExperimentError(f"{what}: given '{name}'; allowed: {', '.join(known) or 'none of this twin'}")


def drive_limits(link: Link) -> Limits:
    """Limits of the drive, be it that of a carriage or of a lift."""
    scenario = load_scenario(link.scenario)
    drive = scenario.drives.get(link.name)
    return scenario.carriages[link.name].drive.limits if drive is None else drive.limits


def limits_of(link: Link, options: argparse.Namespace) -> tuple[float, float]:
    """Acceleration (m/s^2) and jerk (m/s^3, or infinite) of the drive.

    Raises:
        ExperimentError: the speed is over the limit, or the drive has no limit of acceleration.
    """
    limits = drive_limits(link)
    if limits.speed is not None and options.speed > limits.speed:
        raise ExperimentError(
            f"--speed {options.speed:g} m/s given; the drive of '{link.name}' allows {limits.speed:g} m/s"
        )
    if limits.acceleration is None:
        raise ExperimentError(f"the drive of '{link.name}' has no limit of acceleration to plan with")
    return limits.acceleration, limits.jerk or math.inf


def distance_to(link: Link, destination: float) -> float:
    """Distance (m) from the present place of the carriage to an arc length (m), or of a drive to a travel (m).

    Raises:
        ExperimentError: it does not stand, or the place is not on the rope, or beyond the travel.
    """
    assert link.motion is not None
    check_place(link, destination)
    if abs(link.motion.speed) > REST:
        raise ExperimentError(f"'{link.name}' moves at {link.motion.speed:.2f} m/s; it has to stand at the start")
    return destination - link.motion.arc_length


def check_place(link: Link, place: float) -> None:
    """Raise ExperimentError where an arc length (m) is not on the rope, or a travel (m) not one of the drive."""
    scenario = load_scenario(link.scenario)
    if link.name in scenario.drives:
        low, high = places_of(scenario, link.name)
        if not low <= place <= high:
            raise ExperimentError(f"travel {place:g} m given; allowed: {low:g} to {high:g} m")
        return
    length = scenario.cables[scenario.rope_of(scenario.carriages[link.name])].unstrained_length
    if not 0.0 < place < length:
        raise ExperimentError(f"arc length {place:g} m given; allowed: more than 0 and less than {length:g} m")


def main(options: argparse.Namespace, command: str, experiment: Callable[[Link, argparse.Namespace], Law]) -> int:
    """Run an experiment; returns 0 after its end or Ctrl-C, 1 after a failure.

    Args:
        options: as given.
        command: name of the script.
        experiment: looks at the twin and makes the law.
    """
    ending = Ending(command)
    try:
        import rclpy  # noqa: PLC0415
        from rclpy.signals import SignalHandlerOptions  # noqa: PLC0415
    except ImportError as error:
        print_hint(command, error)
        return 1
    ending.starting = False
    prepare_middleware(command)
    rclpy.init(args=[command], signal_handler_options=SignalHandlerOptions.NO)
    link = None
    try:
        link = Link(options.name, options.node, options.wait, ending, drives=options.drives)
        law = None if link.ended else experiment(link, options)
        if law is None or link.ended:
            print(f"{command}: ended before it had begun")
            return 0
        done, motion = link.run(law), link.motion
        how = "done" if done else "ended by a signal, the twin is told to stop,"
        if motion is not None:
            print(f"{command}: {how} after {motion.time:.1f} s: {motion.speed:+.3f} m/s at {motion.arc_length:.2f} m")
    except ExperimentError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 1
    finally:
        if link is not None:
            link.close()
        rclpy.try_shutdown()
    return 0
