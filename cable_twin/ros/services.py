"""Services of the node, each answered after the frame loop has carried out the request."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Generator, Mapping
from concurrent.futures import CancelledError, Future, ThreadPoolExecutor
from concurrent.futures import TimeoutError as FutureTimeoutError  # another class than the builtin in Python 3.10
from functools import partial
from io import BytesIO
from itertools import count
from pathlib import Path
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from cable_twin.frame.commands import Kind, kinds_by_service
from cable_twin.frame.records import Command, CommandError
from cable_twin.recording.splitting import MEGABYTE, STATES, STATES_SHARE, size_of_states
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.simulation.snapshot_file import SUFFIX, FullState

EMERGENCY_STOP = "emergency_stop"  # a service with a participant of its own, see `emergency_stop`
TURN = 0.005  # s for which a waiting callback delays the others
SERVICE_TIMEOUT = 5.0  # s that a request waits for a frame boundary
WRITING_TIMEOUT = 2.0  # s that an answer waits for the disk
NO_ANSWER = f"no frame boundary within {SERVICE_TIMEOUT:g} s; the request is carried out at the next one"


async def done(future: Future[Any], *, turn: float = TURN, within: float = math.inf) -> None:
    """Wait in a callback of a node for the future of another thread, while the executor runs other callbacks.

    rclpy would resume a callback that awaits a future of its own as fast as it can, which takes as much of a core as
    the solver does.

    Args:
        future: future of the other thread.
        turn: time (s) for which other callbacks are delayed at a time.
        within: time (s) after which to return in any case.
    """
    ended = threading.Event()
    future.add_done_callback(lambda _: ended.set())
    until = time.monotonic() + within
    while not ended.wait(turn) and time.monotonic() < until:
        await _Turn()


class _Turn:
    """Awaitable that lets other callbacks of an executor run once."""

    def __await__(self) -> Generator[None, None, None]:
        yield


class NothingSavedError(Exception):
    """Failure to save a snapshot: the reason, in one line."""


class SnapshotWriter:
    """Writer of snapshots to files beside the log.

    Args:
        directory: returns the directory for saved states.
        keep_size: size (MB) that logs and saved states together may have there; 0 for no limit.
    """

    def __init__(self, directory: Callable[[], Path], keep_size: float) -> None:
        self._directory, self._keep_size = directory, keep_size

    def write(self, full: FullState) -> Path:
        """Write a snapshot to a new file; returns its path.

        Raises:
            NothingSavedError: the directory cannot be written, or the room for saved states is used up.
        """
        path = Path(_title(full) + SUFFIX)
        try:
            path = self._directory() / path
            path.parent.mkdir(parents=True, exist_ok=True)
            self._check_room(full, path.parent)
            for number in count(2):
                if not path.exists():
                    break
                path = path.with_name(f"{_title(full)}_{number}{SUFFIX}")  # saved before in a pause, or in another run
            full.write(path)
        except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
            raise NothingSavedError(f"nothing saved: {path}: {getattr(error, 'strerror', None) or error}") from error
        return path

    def _check_room(self, full: FullState, directory: Path) -> None:
        """Refuse a snapshot where all saved ones would exceed half of `keep_size`; none is removed."""
        if not self._keep_size:
            return
        saved, allowed = size_of_states(directory), STATES_SHARE * self._keep_size
        stream = BytesIO()
        full.write(stream)
        if saved + stream.tell() > allowed * MEGABYTE:
            raise NothingSavedError(
                f"nothing saved: {directory} has {saved / MEGABYTE:.3g} MB of saved states, and this one has "
                f"{stream.tell() / MEGABYTE:.3g} MB; allowed: half of keep_size, {allowed:g} MB; remove some"
            )


class Services:
    """ROS services of a twin for commands without values, pause, step and saved snapshots.

    Args:
        node: node of the twin.
        loop: frame loop.
        writer: writer of snapshots.
        step_count: returns the number of frames of a step.
    """

    def __init__(self, node: Node, loop: FrameLoop, writer: SnapshotWriter, step_count: Callable[[], int]) -> None:
        self._loop, self._logger, self._snapshots, self._step_count = loop, node.get_logger(), writer, step_count
        self._writer = ThreadPoolExecutor(1, "snapshots")
        for service, kinds in kinds_by_service().items():
            if service == EMERGENCY_STOP:
                continue
            service_type = Trigger if None in kinds else SetBool
            node.create_service(service_type, f"~/{service}", partial(self._on_command, kinds))
        node.create_service(SetBool, "~/pause", self._on_pause)
        # in a callback group of its own, so that others do not wait until a step is finished
        node.create_service(Trigger, "~/step", self._on_step, callback_group=ReentrantCallbackGroup())
        node.create_service(Trigger, "~/save_snapshot", self._on_save_snapshot)

    def close(self) -> None:
        """Finish writing queued snapshot files to disk."""
        self._writer.shutdown()

    def _on_command(self, kinds: Mapping[bool | None, Kind], request: Any, response: Any) -> Any:
        kind = kinds[getattr(request, "data", None)]
        try:
            applied = self._loop.submit(Command(kind.name, {}), "service").result(SERVICE_TIMEOUT)
        except (CommandError, FutureTimeoutError, CancelledError) as error:
            response.success, response.message = False, str(error) or NO_ANSWER
        else:
            when = applied.time if applied is not None else self._loop.simulated_time
            response.success, response.message = True, f"{kind.done} at {when:.3f} s of simulated time"
            if kind.name == "reset" and self._loop.paused and not self._loop.stepping:
                self._loop.step()  # a frame that shows it, on all topics and in the log
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._loop.fault and not request.data:
            response.success, response.message = False, f"{self._loop.fault}; call ~/reset first"
            return response
        changed = request.data != self._loop.paused
        self._loop.pause(request.data)
        response.success = True
        state = "paused" if request.data else "running"
        response.message = f"{state} at {self._loop.simulated_time:.3f} s of simulated time"
        if changed:
            self._logger.info(response.message)
        return response

    async def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = await self.step(self._step_count())
        return response

    async def step(self, count: int, on_frame: Callable[[int], bool] | None = None) -> tuple[bool, str]:
        """Compute frames while paused, as fast as possible, while the node takes commands; returns success and message.

        After each frame `on_frame` takes the number of frames so far, in the solver's thread, and returns whether to
        continue.
        """
        if not self._loop.paused:
            return False, "not paused: call ~/pause with true first, as drive --pause does"
        stepping = self._loop.step(count, on_frame)
        await done(stepping)
        if stepping.cancelled():
            return False, "the twin is shutting down"
        if stepping.result() < count:
            return False, self._loop.fault or f"paused after {stepping.result()} of {count} frames"
        frames = "one frame" if count == 1 else f"{count} frames"
        return True, f"{frames}, to {self._loop.simulated_time:.3f} s of simulated time"

    async def _on_save_snapshot(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Copy the state between two frames and write it to disk without delaying frames or commands."""
        try:
            full = self._loop.capture().result(SERVICE_TIMEOUT)
        except (FutureTimeoutError, CancelledError):
            response.success, response.message = False, f"no frame boundary within {SERVICE_TIMEOUT:g} s; nothing saved"
            return response
        writing = self._writer.submit(self._snapshots.write, full)
        try:
            await done(writing, within=WRITING_TIMEOUT)
            path = writing.result(0.0)
        except FutureTimeoutError:
            writing.add_done_callback(self._log_written)
            response.success = False
            response.message = f"{_title(full)} is still being written: the log of the node says when it is saved"
        except NothingSavedError as error:
            response.success, response.message = False, str(error)
        else:
            response.success, response.message = True, f"saved at {full.time:.3f} s of simulated time: {path}"
        return response

    def _log_written(self, writing: Future[Path]) -> None:
        if writing.exception() is not None:
            self._logger.error(str(writing.exception()))
        else:
            self._logger.info(f"snapshot saved: {writing.result()}")


def _title(full: FullState) -> str:
    """File title of a snapshot from its simulated time."""
    return f"{STATES}{full.time:.3f}_s"
