"""Running twin for fuzzers, with its invariants under any input: alive, answering, finite numbers, no traceback."""

from __future__ import annotations

import ctypes
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

MEMORY = 4 * 2**30  # bytes
STARTED, ANSWERED = 600.0, 25.0  # s: with a compilation; below the limit of a case
NODE = "/cable_twin"
DIE_WITH_PARENT = 1  # PR_SET_PDEATHSIG of prctl(2)
HARMLESS = frozenset(b"\n\t")


class TwinEndedError(AssertionError):
    """End of the twin."""


class NoAnswerError(AssertionError):
    """Emergency stop without an answer, or no frames from the twin."""


class PrintedError(AssertionError):
    """Traceback or control character in the output of the twin."""


class NotFiniteError(AssertionError):
    """Non-finite number on a topic of the twin."""


class LiveTwin:
    """Process of `sim`, restarted after its end, and a node that talks to it.

    Args:
        arguments: of `sim`, the scenario first.
        subscribed: topics of joint states to look at, below the node.
    """

    def __init__(self, arguments: Sequence[str], subscribed: Sequence[str]) -> None:
        import rclpy  # noqa: PLC0415 - the parent needs no ROS, and no program
        from rclpy.executors import SingleThreadedExecutor  # noqa: PLC0415
        from sensor_msgs.msg import JointState  # noqa: PLC0415
        from std_srvs.srv import SetBool  # noqa: PLC0415

        from cable_twin.key_figures import compile_figures  # noqa: PLC0415
        from cable_twin.scenario import load_scenario  # noqa: PLC0415
        from cable_twin.simulation import Simulation  # noqa: PLC0415

        # kernels are compiled here, where it is seen that they are
        Simulation(load_scenario(arguments[0]), meanwhile=compile_figures).advance_to(0.02)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        domain = int(os.environ.get("ROS_DOMAIN_ID") or 20 + os.getpid() % 80)
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        self.directory = Path(tempfile.mkdtemp(prefix="live_", dir=Path.cwd()))
        self._arguments = arguments
        rclpy.init(domain_id=domain)
        self.node = rclpy.create_node("fuzzer")
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self.received: dict[str, int] = dict.fromkeys(subscribed, 0)
        self._unfinite = ""
        self._clients: dict[str, Any] = {}
        for topic in subscribed:
            self.node.create_subscription(
                JointState, f"{NODE}/{topic}", lambda message, topic=topic: self._take(topic, message), 100
            )
        self._stop, self._stop_request = self.node.create_client(SetBool, f"{NODE}/emergency_stop"), SetBool.Request
        self._start()

    def call(self, kind: Any, service: str, **fields: Any) -> Any:
        """Call a service below the name of the node; returns its answer."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, f"{NODE}/{service}")
        client = self._clients[service]
        self.until(client.service_is_ready, service)
        future = client.call_async(kind.Request(**fields))
        return self.until(lambda: future.done() and future.result(), service)

    def release(self) -> None:
        """Release the emergency stop, and wait for the answer."""
        self.until(self._stop.service_is_ready, "emergency_stop")
        future = self._stop.call_async(self._stop_request(data=False))
        self.until(future.done, "emergency_stop")

    def check(self) -> None:
        """Raise an error for a violated invariant."""
        self.release()
        self._look()

    def spin(self, seconds: float) -> None:
        """Take messages for a time (s)."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            self._executor.spin_once(timeout_sec=left)

    def until(self, condition: Callable[[], Any], what: str, seconds: float = ANSWERED) -> Any:
        """Take messages until a condition holds; returns its result."""
        since, delayed = time.monotonic(), self._delay()
        while not (found := condition()):
            if self._process.poll() is not None:
                self._look()
            if time.monotonic() - since > seconds + self._delay() - delayed:
                raise NoAnswerError(f"{what}: not within {seconds:g} s\n{self._tail()}")
            self._executor.spin_once(timeout_sec=0.05)
        return found

    def _delay(self) -> float:
        """Longest time (s) for which a thread of the twin has waited for a core used by others."""
        found = [0.0]
        for thread in Path(f"/proc/{self._process.pid}/task").glob("*/schedstat"):
            with suppress(OSError):
                found.append(1e-9 * int(thread.read_text().split()[1]))
        return max(found)

    def _start(self) -> None:
        self._output = self.directory / f"sim_{time.monotonic_ns()}.txt"
        self._read = 0
        with self._output.open("wb") as output:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "cable_twin.ros.sim", *self._arguments],
                cwd=self.directory,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                preexec_fn=_die_with_parent,  # noqa: PLW1509 - the process has one thread of Python
            )
        self.until(lambda: b" runs at " in self._output.read_bytes(), "the twin", STARTED)

    def _look(self) -> None:
        """Check process, memory and output since the last call."""
        ended = self._process.poll()
        new = self._output.read_bytes()[self._read :]
        self._read += len(new)
        if ended is not None:
            tail = self._tail()
            self._start()
            name = signal.Signals(-ended).name if ended < 0 else f"exit code {ended}"
            raise TwinEndedError(f"{name}\n{tail}")
        if b"Traceback" in new or b"fault of the program" in new:
            raise PrintedError(new.decode(errors="replace")[-4000:])
        if any(one < 0x20 and one not in HARMLESS for one in new) or "\x9b" in new.decode(errors="replace"):
            raise PrintedError(f"control characters: {new[-1000:]!r}")
        if self._unfinite:
            fault, self._unfinite = self._unfinite, ""
            raise NotFiniteError(fault)
        for line in Path(f"/proc/{self._process.pid}/status").read_text().splitlines():
            if line.startswith("VmHWM:") and int(line.split()[1]) * 1024 > MEMORY:
                self._process.kill()
                self._process.wait()
                self._start()
                raise MemoryError(f"the twin had {line.split()[1]} kB")

    def _take(self, topic: str, message: Any) -> None:
        self.received[topic] += 1
        if not all(map(math.isfinite, (*message.position, *message.velocity, *message.effort))):
            self._unfinite = f"{topic}: {message}"

    def _tail(self) -> str:
        return self._output.read_bytes()[-4000:].decode(errors="replace")


def _die_with_parent() -> None:
    ctypes.CDLL(None).prctl(DIE_WITH_PARENT, signal.SIGKILL)
