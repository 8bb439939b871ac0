"""The services of the node: each answers once the frame loop has done what was asked."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as FutureTimeoutError  # another class than the builtin in Python 3.10
from pathlib import Path
from typing import Any

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from cable_twin.records import Command, CommandError
from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.snapshot_file import SUFFIX

SERVICE_TIMEOUT = 5.0  # s
NO_ANSWER = f"no frame boundary within {SERVICE_TIMEOUT:g} s; it is done at the next one"


class Services:
    """Reset, pause, step, emergency stop and snapshots of a frame loop."""

    def __init__(self, loop: FrameLoop, directory: Callable[[], Path]) -> None:
        """Offer nothing yet; snapshots are written to what `directory` says then."""
        self._loop = loop
        self._directory = directory

    def offer(self, node: Node) -> None:
        """Create the services, below the name of the node."""
        node.create_service(Trigger, "~/reset", self._on_reset)
        node.create_service(SetBool, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/step", self._on_step)
        node.create_service(SetBool, "~/emergency_stop", self._on_emergency_stop)
        node.create_service(Trigger, "~/save_snapshot", self._on_save_snapshot)

    def _serve(self, command: Command, response: Any, done: str) -> Any:
        try:
            applied = self._loop.submit(command, "service").result(SERVICE_TIMEOUT)
        except (CommandError, FutureTimeoutError, CancelledError) as error:
            response.success, response.message = False, str(error) or NO_ANSWER
        else:
            when = applied.time if applied is not None else self._loop.simulated_time
            response.success, response.message = True, f"{done} at {when:.3f} s of simulated time"
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        return self._serve(Command("reset", {}), response, "state put back to the start")

    def _on_emergency_stop(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if request.data:
            return self._serve(Command("emergency_stop", {}), response, "emergency stop")
        return self._serve(Command("release", {}), response, "emergency stop released")

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._loop.fault and not request.data:
            response.success, response.message = False, f"{self._loop.fault}; call ~/reset first"
            return response
        self._loop.pause(request.data)
        response.success = True
        state = "paused" if request.data else "running"
        response.message = f"{state} at {self._loop.simulated_time:.3f} s of simulated time"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if not self._loop.paused:
            response.success, response.message = False, "not paused: call ~/pause with true first"
            return response
        try:
            self._loop.step().result(SERVICE_TIMEOUT)
        except (FutureTimeoutError, CancelledError):
            response.success, response.message = False, NO_ANSWER
        else:
            response.success = not self._loop.fault
            response.message = self._loop.fault or f"one frame, to {self._loop.simulated_time:.3f} s of simulated time"
        return response

    def _on_save_snapshot(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Copy the state between two frames, and write it here, where no frame waits for the disk."""
        try:
            full = self._loop.capture().result(SERVICE_TIMEOUT)
        except (FutureTimeoutError, CancelledError):
            response.success, response.message = False, f"no frame boundary within {SERVICE_TIMEOUT:g} s; nothing saved"
            return response
        path = Path(f"snapshot_{full.time:.3f}_s{SUFFIX}")
        try:
            path = self._directory() / path
            path.parent.mkdir(parents=True, exist_ok=True)
            full.write(path)
        except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
            reason = getattr(error, "strerror", None) or error
            response.success, response.message = False, f"nothing saved: {path}: {reason}"
        else:
            response.success, response.message = True, f"saved at {full.time:.3f} s of simulated time: {path}"
        return response
