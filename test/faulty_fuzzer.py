"""Fuzzer of a program that fails in every way, as ordered by each case."""

import os
import signal
import time

from hypothesis import strategies as st

from fuzzing import DONE, REFUSED, Case

WAYS = "done", "refused", "usage", "traceback", "hang", "memory", "signal", "exit"
HANG = 60.0  # s


def cases():
    return st.sampled_from(WAYS).map(lambda way: Case(way.encode(), ".txt"))


def prepare():
    print("ready")


def run(file):
    way = file.read_text()
    print(f"at it: {way}")
    if way == "usage":
        raise SystemExit(2)
    if way == "traceback":
        raise IndexError(way)
    if way == "hang":
        time.sleep(HANG)
    if way == "memory":
        bytearray(2**40)
    if way == "signal":
        os.kill(os.getpid(), signal.SIGSEGV)
    if way == "exit":
        os._exit(3)
    return REFUSED if way == "refused" else DONE
