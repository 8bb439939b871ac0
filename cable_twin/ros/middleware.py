"""Preparation of the ROS middleware before the first node."""

from __future__ import annotations

import os
import stat
import sys
import time
from contextlib import suppress
from pathlib import Path

PROFILES = "FASTDDS_DEFAULT_PROFILES_FILE"
OLDER_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILE = Path(__file__).with_name("fastdds.xml")
ANNOUNCED_EVERY = 0.3  # s, by participants with that profile
ANNOUNCEMENTS = 5  # of which one arrives where the machine is busy
DISCOVERY = 3.5  # s: others announce themselves every 3 s
SHARED_MEMORY = Path("/dev/shm")
READY = 2  # in the first word of memory that its maker has finished: boost::interprocess, managed_open_or_create_impl
MAKING = 5.0  # s that nobody needs to make a port, which takes microseconds


def prepare_middleware(command: str) -> None:
    """Prepare the middleware before the first context; removed files are reported on stderr, a line each."""
    take_profile()
    for line in remove_unfinished_ports():
        print(f"{command}: {line}", file=sys.stderr)


def take_profile() -> None:
    """Set the Fast DDS profile for fast discovery and matching by type name, unless the environment has profiles.

    Fast DDS 3 asks the first participant that shows a type it does not know for its definition, once. Where that one
    leaves before it has answered, all endpoints of this type wait without end, those of the twin too
    (`TypeLookupManager::check_type_identifier_received`). ROS 2 compares names and hashes itself. A twin whose
    endpoints carry no definitions is matched at once, whatever the other side has set.

    With LOCALHOST some newcomers, 6 of 20, heard of a twin only when that announced itself again, by default every 3 s;
    an emergency stop from a terminal would come as late.
    """
    if PROFILES not in os.environ and OLDER_PROFILES not in os.environ:
        os.environ[PROFILES] = str(PROFILE)


def discovery_time(implementation: str) -> float:
    """Time (s) within which participants of a middleware (rmw identifier) have discovered all others."""
    ours = implementation.startswith("rmw_fastrtps") and os.environ.get(PROFILES) == str(PROFILE)
    return ANNOUNCEMENTS * ANNOUNCED_EVERY if ours else DISCOVERY


def remove_unfinished_ports(directory: Path = SHARED_MEMORY) -> list[str]:
    """Remove unfinished shared memory ports of Fast DDS whose maker was killed; returns a line for each.

    Whoever opens such a port waits for its maker, five minutes, deaf to signals, and holds up all who come after.
    Ports from 7000 on are opened by each participant of a machine, whatever its domain, so that a process killed at
    the wrong moment stops all ROS 2 there. (`SharedMemGlobal::open_port_internal` removes other broken ports itself.)
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
    """Device and inode of an abandoned unfinished port; None of others and of unreadable ones.

    Everybody may write to that directory: what is a link, a pipe or a device is left alone, and none of it holds up.
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
    """Remove a port, unless another file has taken its name since its inspection."""
    try:
        state = os.lstat(port)
    except FileNotFoundError:
        return False
    if (state.st_dev, state.st_ino) != identity:
        return False
    port.unlink(missing_ok=True)
    return True
