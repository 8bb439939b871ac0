"""What calls the node's callbacks: the executor of events where this rclpy has one, which costs less."""

from __future__ import annotations

from rclpy.context import Context
from rclpy.executors import Executor, SingleThreadedExecutor


def new_executor(context: Context | None = None) -> Executor:
    """An executor of one thread, by default for the context of `rclpy.init`.

    rclpy's executor of events is in C++ and waits for no set of entities that is built anew for each message. Where it
    is not there, or cannot work with the middleware, the one that every rclpy has takes its place.
    """
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415 - from Jazzy on

        return EventsExecutor(context=context)
    except Exception:  # whatever its library or the middleware lacks: the other one works with each
        return SingleThreadedExecutor(context=context)


__all__ = ["new_executor"]
