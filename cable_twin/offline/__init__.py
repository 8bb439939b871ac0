"""Offline tools without ROS: run a scenario, review a log, and replay it."""

import sys

from cable_twin.basics.cpu import hold_numpy_to_the_class

if sys.argv[:1] == ["-m"]:  # until `python -m cable_twin.offline.replay` has found its module: as `replay`
    hold_numpy_to_the_class()
