"""Request to Linux for a short scheduler slice, so that a thread runs soon after it wakes; needs no privilege.

A thread that wakes waits until the slice of the one that has the processor has run out, some milliseconds; unless its
own slice is the shorter one, which it may choose since Linux 6.12 (sched(7), sched_setattr(2)). Its share of the
processor stays what it was.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import threading

SYSTEM_CALLS = {"x86_64": 314, "aarch64": 274}  # sched_setattr, for which C libraries have a function only lately
ATTRIBUTES = struct.Struct("=IIQiIQQQ")  # struct sched_attr: size, policy, flags, nice, priority, runtime, two more
SHORTEST = 100_000  # ns, the shortest slice that Linux gives


def wake_promptly() -> bool:
    """Give the calling thread the shortest scheduler slice; returns False on systems without support."""
    number = SYSTEM_CALLS.get(platform.machine())
    if platform.system() != "Linux" or number is None or os.sched_getscheduler(0) != os.SCHED_OTHER:
        return False
    nice = os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
    attributes = ATTRIBUTES.pack(ATTRIBUTES.size, os.SCHED_OTHER, 0, nice, 0, SHORTEST, 0, 0)
    return ctypes.CDLL(None).syscall(number, 0, attributes, 0) == 0
