"""Event loops of asyncio in threads: one for OPC UA clients, and one for the server, whose start takes seconds."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Coroutine
from contextlib import suppress
from typing import Any

LONGEST_END = 5.0  # s in which connections are closed


class Background:
    """Event loop of asyncio in a thread of its own, which starts with its first task.

    Args:
        name: name of the thread.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        self._tasks: list[Any] = []

    def start(self, work: Coroutine[Any, Any, None]) -> None:
        """Start a coroutine in the event loop as a task that runs until `stop`."""
        if self._loop is None:
            self._loop = asyncio.new_event_loop()
            self._thread = threading.Thread(target=self._loop.run_forever, name=f"plant_door {self._name}", daemon=True)
            self._thread.start()
        self._tasks.append(asyncio.run_coroutine_threadsafe(work, self._loop))

    def call(self, function: Callable[..., None], *arguments: Any) -> None:
        """Schedule a call of a function in the event loop, from any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(function, *arguments)

    def faults(self) -> list[BaseException]:
        """Exceptions by which tasks of the event loop have ended."""
        ended = [task for task in self._tasks if task.done() and not task.cancelled()]
        return [error for task in ended if (error := task.exception()) is not None]

    def stop(self) -> None:
        """Cancel all tasks of the event loop, wait for their end, and end the thread."""
        if self._loop is None or self._thread is None:
            return
        for task in self._tasks:
            task.cancel()
        with suppress(Exception):  # what fails at the end is lost connections
            asyncio.run_coroutine_threadsafe(_all_others(), self._loop).result(LONGEST_END)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(LONGEST_END)


async def _all_others() -> None:
    """Cancel all other tasks of this event loop, and wait for their end."""
    others = [task for task in asyncio.all_tasks() if task is not asyncio.current_task()]
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)
