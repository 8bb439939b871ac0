#!/usr/bin/env python3
"""Control experiment (b): a trip with damped swing of the vehicle, by shaping speed from `joint_states`.

The law, with the pitch q (rad) and its rate (rad/s) of the hanger, t in s:

    v(t) = v_shaped(t) - k (q - q_0(t) + tau dq/dt) + c (s_to - s)

v_shaped (m/s) is a trapezoid, with 0.7 of the drive's acceleration, after a zero-vibration shaper for every swing
frequency w (rad/s) of the vehicle: it is the mean of copies of itself half a period pi / w apart, and leaves none of
them swinging. What this model does not know is left to the feedback, and the rest of the acceleration with it:

    k = 2 zeta g / (w_1 cos b)   m/s per rad: gives the slowest swing a damping ratio zeta (0.15) on a rope of slope b
    tau = 0.3 s                  lead, about what the drive takes to follow
    q_0 = a cos b / g            rad, at which the vehicle hangs under the acceleration a (m/s^2) of the plan
    c = 0.1 1/s                  only at the end, where the plan stands still: back to the place s_to (m)
"""

from __future__ import annotations

import argparse
import math
import sys

from control_experiment import (
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

SHARE = 0.7  # of the drive's acceleration for the plan
LEAD = 0.3  # s
PLACE_GAIN = 0.1  # 1/s
EPILOG = """\
exit codes: 0 done or ended by Ctrl-C, 1 it cannot be done

example, with `sim` running in another terminal:
  python examples/swing_damping.py cabin --to 160 --speed 5

It needs a carriage with a drive of its own; lifts are driven by trapezoid_driver.py and wind_speed.py.
"""


def experiment(link: Link, options: argparse.Namespace) -> Law:
    """Plan the shaped trip; the control law follows the plan with feedback."""
    bodies = link.scenario["carriages"][link.name]["bodies"]
    if not bodies:
        raise ExperimentError(f"'{link.name}' has no body that could swing")
    body = options.body or list(bodies)[-2:][0]  # what hangs above the last one
    if body not in bodies:
        raise ExperimentError(f"'{link.name}' has no body '{body}'; it has: {', '.join(bodies)}")
    gravity, cable = link.scenario["gravity"], link.scenario["cable"]
    frequencies = swing_frequencies(bodies, gravity)
    (x_0, *_, z_0), (x_1, *_, z_1) = cable["start"]["position"], cable["end"]["position"]
    slope = math.cos(math.atan2(z_1 - z_0, abs(x_1 - x_0)))
    acceleration, jerk = limits_of(link, options)
    distance = distance_to(link, options.to)
    plan = SpeedPlan.trapezoid(distance, options.speed, SHARE * acceleration, jerk).shaped(frequencies)
    gain = 2.0 * options.damping * gravity / (frequencies[0] * slope)
    lag = SHARE * acceleration / (2.0 * jerk)  # s, by which a drive with this jerk follows a ramp
    periods = ", ".join(f"{2.0 * math.pi / frequency:.2f}" for frequency in frequencies)
    print(
        f"swing_damping.py: {plan.duration:.1f} s, shaped for swing periods of {periods} s; "
        f"feedback of {body}: {gain:.2f} m/s per rad",
        flush=True,
    )

    def law(motion: Motion) -> float | None:
        if motion.time >= plan.duration + options.settle:
            return None
        pitch, rate = motion.pitches[body]
        hanging = plan.acceleration(motion.time - lag) * slope / gravity
        speed = plan.speed(motion.time) - gain * (pitch - hanging + LEAD * rate)
        if motion.time > plan.duration + lag:
            speed += PLACE_GAIN * (options.to - motion.arc_length)
        return min(max(speed, -options.speed), options.speed)

    return law


if __name__ == "__main__":
    arguments = parser("swing_damping.py", "Drive a carriage to a place with the swing of its vehicle damped.", EPILOG)
    arguments.add_argument(
        "--to", type=positive("m"), default=160.0, metavar="M", help="arc length (m) to go to; default: 160"
    )
    arguments.add_argument(
        "--damping", type=positive("-"), default=0.15, metavar="RATIO", help="damping ratio of the swing; default: 0.15"
    )
    arguments.add_argument("--body", metavar="NAME", help="body whose pitch is fed back; default: the last but one")
    sys.exit(main(arguments.parse_args(), "swing_damping.py", experiment))
