"""Short scheduler slice of the solver's thread, without a larger share of the processor."""

from __future__ import annotations

import ctypes
import os
import platform
import threading

import pytest

from cable_twin.runtime.frame_loop import ATTRIBUTES, SHORTEST, SYSTEM_CALLS, wake_promptly

KERNEL = tuple(int(part) for part in platform.release().split("-")[0].split(".")[:2])
pytestmark = pytest.mark.skipif(
    platform.machine() not in SYSTEM_CALLS or KERNEL < (6, 12), reason="Linux 6.12 on a known processor"
)


def attributes():
    """Nice value and slice (ns) of this thread by the system call sched_getattr."""
    buffer = ctypes.create_string_buffer(ATTRIBUTES.size)
    call = SYSTEM_CALLS[platform.machine()] + 1
    assert ctypes.CDLL(None).syscall(call, 0, buffer, ATTRIBUTES.size, 0) == 0
    _, _, _, nice, _, runtime, _, _ = ATTRIBUTES.unpack(buffer.raw)
    return nice, runtime


def in_a_thread(function):
    results = []
    thread = threading.Thread(target=lambda: results.append(function()))
    thread.start()
    thread.join()
    return results[0]


def test_only_the_calling_thread_gets_a_short_slice():
    before = attributes()
    assert before[1] != SHORTEST
    assert in_a_thread(lambda: (wake_promptly(), attributes())) == (True, (before[0], SHORTEST))
    assert attributes() == before


def test_a_nice_thread_stays_nice():
    def nice():
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), 19)
        return wake_promptly(), attributes()

    assert in_a_thread(nice) == (True, (19, SHORTEST))
