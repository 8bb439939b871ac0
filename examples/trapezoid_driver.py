#!/usr/bin/env python3
"""Control experiment (a): trip of a carriage or lift to a place with a trapezoidal speed, as fast as its drive allows.

The law: speed over time is a ramp, a cruise and a ramp, v(t), planned from the distance. Nothing is measured on the
way, so vehicles swing as the ramps leave them.
"""

from __future__ import annotations

import argparse
import sys

from control_experiment import Law, Link, Motion, SpeedPlan, distance_to, limits_of, main, parser, positive

EPILOG = """\
exit codes: 0 done or ended by Ctrl-C, 1 it cannot be done

examples, with `sim`, or `sim gondola`, running in another terminal:
  python examples/trapezoid_driver.py cabin --to 160 --speed 5
  python examples/trapezoid_driver.py haul_rope --to 100          m of travel of the rope of a lift
"""


def experiment(link: Link, options: argparse.Namespace) -> Law:
    """Plan the trapezoid; the control law follows the plan, and holds the carriage until its swing has decayed."""
    acceleration, jerk = limits_of(link, options)
    plan = SpeedPlan.trapezoid(distance_to(link, options.to), options.speed, acceleration, jerk)
    print(f"trapezoid_driver.py: {plan.duration:.1f} s with ramps of {acceleration:g} m/s^2", flush=True)

    def law(motion: Motion) -> float | None:
        return plan.speed(motion.time) if motion.time < plan.duration + options.settle else None

    return law


if __name__ == "__main__":
    what = "Drive a carriage or lift to a place with a trapezoid of speed."
    arguments = parser("trapezoid_driver.py", what, EPILOG, drives=True)
    arguments.add_argument(
        "--to",
        type=positive("m"),
        default=160.0,
        metavar="M",
        help="arc length (m), or travel of a lift's rope (m), to go to; default: 160",
    )
    sys.exit(main(arguments.parse_args(), "trapezoid_driver.py", experiment))
