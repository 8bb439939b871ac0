#!/usr/bin/env python3
"""Control experiment (c): passing a place along the rope at the highest speed with a calm vehicle.

The twin's own model, run ahead without ROS, is asked how much the vehicle swings and accelerates around the place for
a row of passing speeds; the fastest that keeps both limits is driven on the live twin, and what came of it is compared
with what was predicted. The trip: ramp to the speed on the way, ramp to the passing speed before the place, hold it
until after it, ramp to standstill, all shaped as in swing_damping.py unless --unshaped.

The place is an arc length or, where the scenario has towers, the name of one: then the model ahead feels its shoe, and
half the length of that is added to the window.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass

import numpy as np
from control_experiment import (
    REST,
    ExperimentError,
    Law,
    Link,
    Motion,
    SpeedPlan,
    distance_to,
    limits_of,
    main,
    parser,
    positive,
    swing_frequencies,
)
from rich.console import Console
from rich.progress import track

from cable_twin import Simulation, load_scenario

SHARE = 0.7  # of the drive's acceleration for the plan
PERIOD = 0.05  # s between two commands of the model ahead
DEFAULT_PLACE = 200.0  # m, where there is no tower
ROPE_POINTS = 10_000  # among which that at a tower is looked for
CANDIDATES = 8  # passing speeds, evenly spread from the slowest to that on the way
EPILOG = """\
exit codes: 0 done or ended by Ctrl-C, 1 it cannot be done

examples, with `sim` running in another terminal:
  python examples/tower_pass.py cabin --at 200 --speed 8
  python examples/tower_pass.py cabin --at lower_tower          where the scenario has a tower of that name
  python examples/tower_pass.py cabin --at 200 --speed 8 --unshaped --swing-limit 2

It needs a carriage with a drive of its own; lifts are driven by trapezoid_driver.py and wind_speed.py.
"""


@dataclass(frozen=True, slots=True)
class Calm:
    """Largest swing and acceleration of the carriage within the window around the place."""

    swing: float  # deg, of the last body
    acceleration: float  # m/s^2, of its centre of mass

    def keeps(self, options: argparse.Namespace) -> bool:
        """Whether all given limits are kept."""
        return self.beyond(options) <= 1.0

    def beyond(self, options: argparse.Namespace) -> float:
        """Used share of the limit of swing or acceleration, the larger of both."""
        return max(self.swing / options.swing_limit, self.acceleration / options.acceleration_limit)

    def __str__(self) -> str:
        return f"{self.swing:.2f} deg, {self.acceleration:.3f} m/s^2"


def find_place(link: Link, options: argparse.Namespace) -> tuple[float, float]:
    """Arc length (m) of the place and half the length (m) of the window around it.

    Raises:
        ExperimentError: there is no tower of that name.
    """
    towers = link.scenario.get("towers", {})
    given = options.at if options.at is not None else next(iter(towers), DEFAULT_PLACE)
    if not isinstance(given, str):
        return given, options.window
    if given not in towers:
        allowed = "".join(f", {name}" for name in towers)
        raise ExperimentError(f"--at '{given}' given; allowed: an arc length in m{allowed}")
    simulation = Simulation(load_scenario(link.scenario), samples=2)
    arc_lengths = np.linspace(0.0, link.scenario["cable"]["unstrained_length"], ROPE_POINTS)
    (x, *_, z) = towers[given]["position"]
    away = np.linalg.norm(simulation.cable_positions(arc_lengths)[:, [0, 2]] - [x, z], axis=1)
    return float(arc_lengths[away.argmin()]), options.window + 0.5 * towers[given]["length"]


def trip(link: Link, options: argparse.Namespace, passing: float) -> SpeedPlan:
    """Plan the whole trip with one passing speed (m/s).

    Raises:
        ExperimentError: there is not enough room before the place or behind it.
    """
    acceleration, jerk = limits_of(link, options)
    slope = SHARE * acceleration
    distance = distance_to(link, options.at)
    before = abs(distance) - options.window
    least = slope / jerk  # s, as in SpeedPlan.trapezoid
    # from v^2 / 2a up, v * least at the top, and (v^2 - passing^2) / 2a down, within the room before the window
    room = before + passing**2 / (2.0 * slope)
    highest = 0.5 * slope * (math.sqrt(least**2 + 4.0 * room / slope) - least) if room > 0.0 else 0.0
    top = min(options.speed, highest)
    if top < passing:
        raise ExperimentError(f"the {before:.1f} m before {options.at:g} m are too short to reach it")
    up, down, stop = top / slope, (top - passing) / slope, passing / slope
    cruise = (before - 0.5 * top * up - 0.5 * (top + passing) * down) / top
    sign = math.copysign(1.0, distance)
    legs = [(up, top), (cruise, top), (down, passing), (2.0 * options.window / passing, passing), (stop, 0.0)]
    plan = SpeedPlan.through([(duration, sign * speed) for duration, speed in legs])
    end = options.at + sign * (options.window + 0.5 * passing * stop)
    length = link.scenario["cable"]["unstrained_length"]
    if not 0.0 < end < length:
        raise ExperimentError(
            f"--at {options.at:g} m: after it the trip ends at {end:.1f} m; the rope has 0 to {length:g} m"
        )
    if options.unshaped:
        return plan
    return plan.shaped(swing_frequencies(link.scenario["carriages"][link.name]["bodies"], link.scenario["gravity"]))


def predict(link: Link, options: argparse.Namespace, plan: SpeedPlan) -> Calm:
    """Simulate the model ahead from the present place of the carriage."""
    assert link.motion is not None
    scenario = load_scenario(link.scenario, {f"carriages.{link.name}.arc_length": link.motion.arc_length})
    simulation = Simulation(scenario, samples=2)
    swing, acceleration, velocity = 0.0, 0.0, np.zeros(3)
    for frame in range(math.ceil((plan.duration + options.settle) / PERIOD)):
        simulation.command(link.name, speed=plan.speed(frame * PERIOD))
        state = simulation.advance_to((frame + 1) * PERIOD).carriages[link.name]
        body = list(state.bodies.values())[-1]
        before, velocity = velocity, body.velocity
        if abs(state.arc_length - options.at) <= options.window:
            swing = max(swing, abs(math.degrees(body.pitch)))
            acceleration = max(acceleration, float(np.linalg.norm(velocity - before)) / PERIOD)
        elif acceleration > 0.0:
            break  # passed
    return Calm(swing, acceleration)


def choose(link: Link, options: argparse.Namespace) -> tuple[float, SpeedPlan, Calm]:
    """Find the highest passing speed (m/s) that keeps the limits, or the calmest where none does."""
    tried = []
    candidates = np.linspace(options.speed, min(options.slowest, options.speed), CANDIDATES)
    console = Console(stderr=True)
    for passing in track(candidates, "running the model ahead", console=console, disable=not console.is_terminal):
        try:
            plan = trip(link, options, float(passing))
        except ExperimentError as error:
            if passing == candidates[-1] and not tried:
                raise
            print(f"tower_pass.py: {passing:.2f} m/s is not possible: {error}", flush=True)
            continue
        calm = predict(link, options, plan)
        print(f"tower_pass.py: passing at {passing:.2f} m/s: {calm}", flush=True)
        tried.append((float(passing), plan, calm))
        if calm.keeps(options) or link.ended:
            return tried[-1]
    best = min(tried, key=lambda item: item[2].beyond(options))
    print(f"tower_pass.py: none keeps the limits, the calmest is taken: {best[0]:.2f} m/s", flush=True)
    return best


def experiment(link: Link, options: argparse.Namespace) -> Law:
    """Choose the passing speed; the control law follows the plan and reports the result."""
    bodies = link.scenario["carriages"][link.name]["bodies"]
    if not bodies:
        raise ExperimentError(f"'{link.name}' has no body that could swing")
    if options.acceleration_limit is None:
        options.acceleration_limit = link.scenario.get("limits", {}).get("acceleration") or math.inf
    options.at, options.window = find_place(link, options)
    passing, plan, predicted = choose(link, options)
    print(f"tower_pass.py: {options.at:g} m at {passing:.2f} m/s, {plan.duration:.1f} s in all", flush=True)
    swing, told, last = 0.0, False, list(bodies)[-1]

    def law(motion: Motion) -> float | None:
        nonlocal swing, told
        within = abs(motion.arc_length - options.at) <= options.window
        if within:
            swing = max(swing, abs(math.degrees(motion.pitches[last][0])))
        elif swing and not told and abs(motion.speed) > REST:
            told = True
            print(
                f"tower_pass.py: passed with a swing of {swing:.2f} deg; predicted {predicted.swing:.2f} deg",
                flush=True,
            )
        return plan.speed(motion.time) if motion.time < plan.duration + options.settle else None

    return law


def place(text: str) -> float | str:
    """Parse a place from an option: an arc length above 0 m, or a name."""
    try:
        float(text)
    except ValueError:
        return text
    return positive("m")(text)


if __name__ == "__main__":
    arguments = parser("tower_pass.py", "Pass a place as fast as the vehicle stays calm there.", EPILOG)
    arguments.add_argument(
        "--at", type=place, metavar="PLACE", help="arc length in m, or a tower; default: the first tower, else 200 m"
    )
    arguments.add_argument(
        "--window", type=positive("m"), default=10.0, metavar="M", help="m before and after it that count; default: 10"
    )
    arguments.add_argument(
        "--slowest", type=positive("m/s"), default=1.0, metavar="M/S", help="slowest passing speed; default: 1 m/s"
    )
    arguments.add_argument(
        "--swing-limit", type=positive("deg"), default=1.0, metavar="DEG", help="deg within the window; default: 1"
    )
    arguments.add_argument(
        "--acceleration-limit",
        type=positive("m/s^2"),
        metavar="M/S2",
        help="m/s^2 of the vehicle within the window; default: that of the scenario's limits",
    )
    arguments.add_argument(
        "--unshaped", action="store_true", help="plain ramps: the swing they leave reaches the place"
    )
    sys.exit(main(arguments.parse_args(), "tower_pass.py", experiment))
