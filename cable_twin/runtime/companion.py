"""Companion process, which runs beside a twin all the time: started again after its end, ended with the twin.

Twin and process talk over two pipes. The process has less priority than the twin, whose frames it does not delay.
"""

from __future__ import annotations

import os
import pickle
import struct
import subprocess
import sys
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import IO, Any, cast

from cable_twin.runtime.separate_process import start_process

AGAIN = 30.0  # s after the end of the process until another one is started
GLANCE = 0.5  # s between two looks whether to end
SIZE = struct.Struct("<Q")  # bytes of what follows in the pipe


def send(stream: IO[bytes], item: Any) -> None:
    """Write an object into a pipe between a twin and its companion process."""
    data = pickle.dumps(item, protocol=5)
    stream.write(SIZE.pack(len(data)) + data)
    stream.flush()


def receive(stream: IO[bytes]) -> Any:
    """Read an object from a pipe between a twin and its companion process; None at the end of the pipe."""
    head = stream.read(SIZE.size)
    if len(head) < SIZE.size:
        return None
    data = stream.read(SIZE.unpack(head)[0])
    try:
        return pickle.loads(data)
    except (pickle.UnpicklingError, EOFError):  # cut short
        return None


class Companion(ABC):
    """Companion process of a running twin: started, started again after a failure, and ended.

    Attributes:
        stopping: set as soon as the twin ends the process.

    Args:
        module: name of the module within the package, such as "runtime.outlook_process".
        first: time (s) from the start until the first process is started.
    """

    def __init__(self, module: str, first: float = 0.0) -> None:
        self._module, self._first = module, first
        self.stopping = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._run, name=module, daemon=True)

    @abstractmethod
    def talk(self, questions: IO[bytes], answers: IO[bytes]) -> None:
        """Talk over the pipes to and from the process; the return, and an `OSError` of a pipe, end the process."""

    @abstractmethod
    def ended(self) -> None:
        """Take note of an end that the twin did not want, before another process is started."""

    def start(self) -> None:
        """Start the thread that starts the companion process."""
        self._thread.start()

    def stop(self) -> None:
        """End the companion process and the thread."""
        self.stopping.set()
        self._end_process()
        if self._thread.is_alive():
            self._thread.join(4.0 * GLANCE)
        self._end_process()  # if it was about to begin

    def _run(self) -> None:
        seconds = self._first
        while not self.stopping.wait(seconds):
            with suppress(OSError):  # of the pipe, or there is no room for a process
                process = self._process = start_process(self._module)
                self.talk(cast(IO[bytes], process.stdin), cast(IO[bytes], process.stdout))
            self._end_process()
            seconds = AGAIN
            if not self.stopping.is_set():
                self.ended()

    def _end_process(self) -> None:
        """End the companion process at once, which also ends a wait for its answer."""
        process: Any = self._process
        if process is None:
            return
        process.kill()
        process.wait()
        with suppress(OSError):
            process.stdin.close()


def inbox(source: IO[bytes], leave: Callable[[], None]) -> SimpleQueue[Any]:
    """Queue of the objects that arrive in a pipe, read by a thread; `leave` is called when the pipe is closed."""
    waiting: SimpleQueue[Any] = SimpleQueue()

    def read() -> None:
        while (item := receive(source)) is not None:
            waiting.put(item)
        leave()

    threading.Thread(target=read, name="inbox", daemon=True).start()
    return waiting


def serve_twin(serve: Callable[[IO[bytes], IO[bytes], Callable[[], None]], None]) -> None:
    """Run the work of a companion process between its standard input and output, until the twin closes the pipe.

    Args:
        serve: called with both pipes, and with a function that it has to call as soon as the input is closed.
    """
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # nobody else writes into the pipe
    serve(sys.stdin.buffer, sink, lambda: os._exit(0))
