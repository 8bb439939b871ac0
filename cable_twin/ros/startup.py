"""Start of the commands `sim` and `drive`: ROS arguments, signals, middleware, executor; without rclpy until needed."""

from __future__ import annotations

import os
import re
import signal
import stat
import sys
import threading
import time
from contextlib import suppress
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from cable_twin.terminal.command_line import ending_signals, leave_at_once, typed

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import Executor

INSTALL_HINT = (
    "{command} needs ROS 2, which this Python does not have ({reason}): install its wheels with\n"
    "    {pip} install '.[ros]'      (in the clone of cable_twin)\n"
    "or source a ROS 2 workspace first: source /opt/ros/jazzy/setup.sh"
)


PROFILES = "FASTDDS_DEFAULT_PROFILES_FILE"
OLDER_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILE = Path(__file__).with_name("fastdds.xml")
ANNOUNCED_EVERY = 0.3  # s between two announcements of a participant with that profile
ANNOUNCEMENTS = 5  # of which one arrives also on a busy machine
DISCOVERY = 3.5  # s: other participants announce themselves every 3 s
SHARED_MEMORY = Path("/dev/shm")
READY = 2  # first word of initialised memory: boost::interprocess, managed_open_or_create_impl
MAKING = 5.0  # s after which a port is not being created any more, which takes microseconds


class Ending:
    """Flag set by ending signals such as SIGINT, which may come twice; while `starting`, a signal ends the process.

    rclpy's own handlers would end the context before the logs are closed, and `ros2 launch` sends SIGINT twice.

    Attributes:
        starting: whether nothing is open yet that has to be closed.
    """

    def __init__(self, command: str) -> None:
        self.starting = True
        self._command = command
        self._flag = threading.Event()
        self._signals = ending_signals()
        for number in self._signals:
            signal.signal(number, self._on_signal)

    def is_set(self) -> bool:
        """Whether a signal to end the process has been received."""
        return self._flag.is_set()

    def close(self) -> None:
        """Ignore ending signals from now on, as all is closed and Python would restore their defaults at its exit."""
        for number in self._signals:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, *_: object) -> None:
        self._flag.set()
        if self.starting:
            leave_at_once(self._command, 0)


def rcl_fault(error: Exception) -> str:
    """Message of an rcl error in one line, without its line in the source of rcl."""
    text = re.sub(r",? at /\S+:\d+", "", " ".join(str(error).split()))
    if "unknown" in type(error).__name__.lower():
        return f"unknown ROS arguments {text}"
    wrong = re.match(r"Trying to set parameter '(.+?)' to '(.*)' of type '\w+', expecting type '(\w+)'", text)
    if wrong:
        return f"parameter '{wrong[1]}': given {wrong[2]!r}; allowed: a {wrong[3].lower()}"
    return text


def print_hint(command: str, error: ImportError) -> None:
    """Print installation instructions after a failed import."""
    print(INSTALL_HINT.format(command=command, reason=error, pip=typed("pip")), file=sys.stderr)


def prepare_middleware(command: str) -> None:
    """Prepare the middleware before the first context; removed files are reported on stderr, a line each."""
    take_profile()
    for line in remove_unfinished_ports():
        print(f"{command}: {line}", file=sys.stderr)


def take_profile() -> None:
    """Set the Fast DDS profile for fast discovery and matching by type name, unless the environment has profiles.

    Fast DDS 3 asks the first participant with an unknown type for its definition, once. If that participant leaves
    before it has answered, all endpoints of this type wait without end, those of the twin too
    (`TypeLookupManager::check_type_identifier_received`). ROS 2 compares names and hashes itself. A twin whose
    endpoints carry no definitions is matched at once, whatever the settings of the other side.

    With LOCALHOST some new participants, 6 of 20, discovered a twin only at its next announcement, by default every
    3 s; an emergency stop from a terminal would be delayed by as much.
    """
    if PROFILES not in os.environ and OLDER_PROFILES not in os.environ:
        os.environ[PROFILES] = str(PROFILE)


def discovery_time(implementation: str) -> float:
    """Time (s) within which participants of a middleware (rmw identifier) have discovered all others."""
    ours = implementation.startswith("rmw_fastrtps") and os.environ.get(PROFILES) == str(PROFILE)
    return ANNOUNCEMENTS * ANNOUNCED_EVERY if ours else DISCOVERY


def remove_unfinished_ports(directory: Path = SHARED_MEMORY) -> list[str]:
    """Remove unfinished shared memory ports of Fast DDS whose maker was killed; returns a line for each.

    A process that opens such a port waits five minutes for its maker, ignores signals, and blocks all later ones.
    Each participant on a machine opens ports from 7000 on, whatever its domain, so that a process killed at the wrong
    moment stops all ROS 2 there. (`SharedMemGlobal::open_port_internal` removes other broken ports itself.)
    """
    lines = []
    for port in sorted(directory.glob("fastdds_port*")):
        if port.name.removeprefix("fastdds_port").isdecimal() and (identity := _unfinished(port)):
            try:
                if not _remove(port, identity):
                    continue
            except PermissionError:
                lines.append(
                    f"{port}: left by a process that was killed while creating it; "
                    "if ROS 2 processes hang, its owner has to remove it"
                )
            else:
                lines.append(
                    f"removed {port}: left by a process that was killed while creating it; "
                    "every ROS 2 process would wait for it"
                )
    return lines


def _unfinished(port: Path) -> tuple[int, int] | None:
    """Device and inode of an abandoned unfinished port; None for all other and unreadable files.

    Everybody may write to that directory: links, pipes and devices are skipped without blocking.
    """
    with suppress(OSError):
        descriptor = os.open(port, os.O_RDONLY | os.O_NONBLOCK | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            state = os.fstat(descriptor)
            if not stat.S_ISREG(state.st_mode) or time.time() - state.st_mtime <= MAKING:
                return None
            if int.from_bytes(os.read(descriptor, 4), sys.byteorder) != READY:
                return state.st_dev, state.st_ino
        finally:
            os.close(descriptor)
    return None


def _remove(port: Path, identity: tuple[int, int]) -> bool:
    """Remove a shared memory port, unless another file has taken its name since its inspection."""
    try:
        state = os.lstat(port)
    except FileNotFoundError:
        return False
    if (state.st_dev, state.st_ino) != identity:
        return False
    port.unlink(missing_ok=True)
    return True


def is_installed(message_type: str) -> bool:
    """Whether a package is installed, given by name or by a message type such as "tf2_msgs/msg/TFMessage"."""
    found = find_spec(message_type.partition("/")[0])
    return found is not None and found.origin is not None  # None: the directory of its sources


def new_executor(context: Context | None = None) -> Executor:
    """Executor of one thread, by default for the context of `rclpy.init`.

    rclpy's events executor is in C++ and builds no wait set for each message. Where it is missing, or does not work
    with the middleware, the single-threaded executor of every rclpy takes its place.
    """
    from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415

    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415 - from Jazzy on

        return EventsExecutor(context=context)
    except Exception:  # a missing library, or an unsuitable middleware
        return SingleThreadedExecutor(context=context)
