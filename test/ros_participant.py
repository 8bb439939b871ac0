"""Node in the process of a test that talks to a twin in another process."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState
from twin_process import COMPILING, PATIENCE, check_alive

from cable_twin.frame.records import AppliedCommand
from cable_twin.messages import decode, serialize
from cable_twin.messages.command_messages import applied_command_from_message
from cable_twin.ros.startup import remove_unfinished_ports

AGAIN = 10.0  # s after which a call without an answer is made again


def values_of(status: Any) -> dict[str, str]:
    """Values of a status by key."""
    return {pair.key: pair.value for pair in status.values}


class Participant:
    """Node in the process of a test, in the ROS domain of a twin."""

    def __init__(self, domain: int, node: str = "/cable_twin") -> None:
        self.twin, self.domain = node, domain
        remove_unfinished_ports()  # of twins that were killed
        self.context = rclpy.Context()
        rclpy.init(context=self.context, domain_id=domain)
        self.node = rclpy.create_node("test_participant", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.received: dict[str, list[Any]] = defaultdict(list)  # decoded messages by relative topic
        self._clients: dict[str, Any] = {}
        self._publisher: Any = None
        self._streaming: Any = None

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()

    def subscribe(self, topic: str, kind: type, qos: Any = 100) -> None:
        """Collect a topic of the twin; raw, as rosbags decodes faster than rclpy."""
        name = topic if topic.startswith("/") else f"{self.twin}/{topic}"
        type_name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
        self.node.create_subscription(
            kind, name, lambda data: self.received[topic].append(decode(data, type_name)), qos, raw=True
        )

    def subscribe_standard(self, *, paused: bool = False) -> None:
        """Collect the topics that most tests need, and wait for the first frame where time runs."""
        self.subscribe("joint_states", JointState)
        self.subscribe("applied_commands", JointState)
        self.subscribe("/diagnostics", DiagnosticArray)
        if paused:
            self.until(lambda: self.received["/diagnostics"], COMPILING, "/diagnostics")
        else:
            self.until(lambda: self.received["joint_states"], COMPILING, "joint_states")

    def spin(self, seconds: float) -> None:
        """Take messages for a time (s)."""
        deadline = time.monotonic() + seconds
        while (remaining := deadline - time.monotonic()) > 0.0:
            self.executor.spin_once(timeout_sec=min(remaining, 0.05))

    def until(self, condition: Callable[[], Any], timeout: float = PATIENCE, what: str = "") -> Any:
        """Take messages until a condition holds; returns what it gave. No message yet, where it asks for the newest
        one, is a condition that does not hold yet."""
        missing: IndexError | None = None

        def holds() -> Any:
            nonlocal missing
            try:
                return condition()
            except IndexError as error:
                missing = error
                return None

        deadline = time.monotonic() + timeout
        while not (value := holds()):
            if time.monotonic() > deadline:
                raise AssertionError(f"not within {timeout:g} s: {what or condition}") from missing
            if timeout >= COMPILING:
                check_alive(self.domain)
            self.executor.spin_once(timeout_sec=0.05)
        return value

    @property
    def publisher(self) -> Any:
        """Publisher of commands, matched with the twin."""
        if self._publisher is None:
            self._publisher = self.node.create_publisher(JointState, f"{self.twin}/joint_commands", 50)
            self.until(self._publisher.get_subscription_count, what="a twin that listens")
        return self._publisher

    def publish(self, **fields: Any) -> None:
        """Publish one command."""
        self.publisher.publish(JointState(**fields))

    @contextmanager
    def stream(self, **fields: Any) -> Iterator[None]:
        """Repeat a command at 20 Hz while taking messages."""
        self.publish(**fields)
        timer = self.node.create_timer(0.05, lambda: self.publish(**fields))
        try:
            yield
        finally:
            self.node.destroy_timer(timer)

    def call(self, service: str, kind: type, **fields: Any) -> Any:
        """Call a service of the twin."""
        if service not in self._clients:
            self._clients[service] = self.node.create_client(kind, f"{self.twin}/{service}")
        return self.answer(self._clients[service], kind.Request(**fields))

    def answer(self, client: Any, request: Any) -> Any:
        """Answer to a call, which is made again where none comes.

        A twin that has discovered the writer of a new client and not yet its reader drops an answer after 0.1 s
        (`rmw_fastrtps_shared_cpp::__rmw_send_response`), with a RuntimeWarning of rclpy; that is on a busy machine.
        """
        self.until(client.service_is_ready, what=client.srv_name)
        futures: list[Any] = []
        begin = time.monotonic()

        def answered() -> Any:
            if time.monotonic() - begin >= AGAIN * len(futures):
                futures.append(client.call_async(request))
            return next((future.result() for future in futures if future.done()), None)

        return self.until(answered, what=f"answer of {client.srv_name}")

    @property
    def speed(self) -> float:
        """Speed (m/s) of the first carriage in the newest joint states."""
        return float(self.received["joint_states"][-1].velocity[0])

    @property
    def arc_length(self) -> float:
        """Arc length (m) of the first carriage in the newest joint states."""
        return float(self.received["joint_states"][-1].position[0])

    def joint(self, name: str) -> tuple[float, float]:
        """Position and speed of a joint in the newest joint states, which are SI."""
        message = self.received["joint_states"][-1]
        row = list(message.name).index(name)
        return float(message.position[row]), float(message.velocity[row])

    @property
    def applied(self) -> list[AppliedCommand]:
        """Applied commands; their times are those since 1970."""
        return [applied_command_from_message(serialize(message)) for message in self.received["applied_commands"]]

    def task(self, name: str) -> tuple[int, str]:
        """Level and message of one task in the newest diagnostics."""
        found = {status.name.rpartition(": ")[2]: status for status in self.received["/diagnostics"][-1].status}
        return int(found[name].level), found[name].message

    @property
    def diagnostics(self) -> tuple[int, str, dict[str, str]]:
        """Level and message of the worst task in the newest diagnostics except limits, and the values of all tasks."""
        tasks = [status for status in self.received["/diagnostics"][-1].status if not status.name.endswith("limits")]
        worst = max(tasks, key=lambda status: int(status.level))  # the first of them: pace
        values = {key: value for status in tasks for key, value in values_of(status).items()}
        return int(worst.level), worst.message, values

    def next_diagnostics(self) -> tuple[int, str, dict[str, str]]:
        """Wait for the second report from now on, as the first may describe an earlier time."""
        count = len(self.received["/diagnostics"])
        self.until(lambda: len(self.received["/diagnostics"]) >= count + 2, what="/diagnostics")
        return self.diagnostics
