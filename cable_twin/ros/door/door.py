"""ROS node of `plant_door`: samples of all connections to plant topics, estimates of the twin to an OPC UA server."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Coroutine, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

import rclpy
from rclpy.node import Node

from cable_twin.messages import (
    DIAGNOSTICS,
    ESTIMATE,
    SECOND,
    Status,
    Topic,
    diagnostics_message,
    stamp_in,
    statuses_of_message,
)
from cable_twin.messages.topics import DiagnosticArray
from cable_twin.ros.door.link import Link
from cable_twin.ros.door.plant_map import PlantMap, Tag
from cable_twin.ros.door.samples import Level, Measured, Sample, TagState
from cable_twin.ros.door.tags_to_messages import Assembly
from cable_twin.ros.endpoints import Endpoints, message_class
from cable_twin.ros.startup import discovery_time

NODE = "plant_door"
LOOKS = 1.0  # s between two looks at ages, other publishers and the diagnostics
MOST_SAMPLES = 100_000  # that wait to be published
LONGEST_END = 5.0  # s in which connections are closed
OK, WARNING, ERROR = 0, 1, 2  # levels of a status


class Door:
    """Gateway between a plant without ROS and its twin: ROS node, publishers, connections, and OPC UA server.

    Args:
        plan: map of the plant.
        directory: directory of the map.

    Attributes:
        node: node of rclpy.
    """

    TURN = 0.02  # s between two calls of `turn`; stamps are those of the measurements

    def __init__(self, plan: PlantMap, directory: Path) -> None:
        self.node: Node = rclpy.create_node(NODE)
        self._plan, self._directory = plan, directory
        self._lines: SimpleQueue[tuple[Level, str]] = SimpleQueue()
        self._samples: SimpleQueue[list[Sample]] = SimpleQueue()
        self._states = {name: TagState(name, tag, self.tell) for name, tag in plan.tags.items()}
        self._assembly = Assembly(plan.tags)
        self._table = {topic.name: topic for topic in self._assembly.topics}
        self._senders: dict[str, Callable[[bytes], None]] = {}
        self._others: set[str] = set()  # topics that somebody else publishes, as was told
        self._held_ns: dict[str, int] = {}
        self._background, self._serving = Background("clients"), Background("server")
        self._links: list[Link] = []
        self._server: Any = None
        self._next_look = 0.0
        self._published = 0
        self._diagnostics = Endpoints(self.node, [Topic(DIAGNOSTICS, DiagnosticArray.__msgtype__)]).senders[DIAGNOSTICS]

    @property
    def faults(self) -> list[BaseException]:
        """Unexpected exceptions (bugs) that ended the threads of connections or of the OPC UA server."""
        return [
            *self._background.faults(),
            *self._serving.faults(),
            *(link.fault for link in self._links if link.fault is not None),
        ]

    def tell(self, level: Level, text: str) -> None:
        """Log a line, from any thread."""
        self._lines.put((level, text))

    def start(self, wait: Callable[[Callable[[], bool], float], object]) -> None:
        """Look for other publishers of the plant's topics, then open all connections and the server.

        Args:
            wait: waits until a condition holds or a time (s) has passed.
        """
        wait(lambda: False, discovery_time(rclpy.get_rmw_implementation_identifier()))
        self._look_at_others()
        for name, section in self._plan.opcua.items():
            from cable_twin.ros.door.opcua_link import OpcUaLink  # noqa: PLC0415 - an extra

            link = OpcUaLink(name, section, self._tags_of(name), self._directory, self._samples.put, self.tell)
            self._links.append(link)
            self._background.start(link.run())
        for name, broker in self._plan.mqtt.items():
            from cable_twin.ros.door.mqtt_link import MqttLink  # noqa: PLC0415 - an extra

            mqtt = MqttLink(name, broker, self._tags_of(name), self._directory, self._samples.put, self.tell)
            self._links.append(mqtt)
            mqtt.start()
        if self._plan.server is not None:
            from cable_twin.ros.door.estimate_server import EstimateServer  # noqa: PLC0415 - an extra

            self._server = EstimateServer(self._plan.server, self._directory, self.tell)
            twin = self._plan.server.twin.rstrip("/")
            kind = message_class(DiagnosticArray.__msgtype__)
            own = partial(self._on_twin, "estimate")
            self.node.create_subscription(kind, f"{twin}/{ESTIMATE}", own, 10, raw=True)
            self.node.create_subscription(kind, DIAGNOSTICS, partial(self._on_twin, DIAGNOSTICS), 10, raw=True)
            self._serving.start(self._server.run())

    def turn(self) -> None:
        """Publish the samples that have arrived; once a second check ages and publishers, and publish diagnostics."""
        now_ns = time.time_ns()
        measured: list[tuple[str, Measured]] = []
        for sample in self._arrived():
            one = self._states[sample.tag].take(sample)
            if one is not None:
                measured.append((sample.tag, one))
            elif self._states[sample.tag].reason:
                self._assembly.drop(sample.tag)
        measured += self._held(now_ns)
        for ready in self._assembly.take(measured):
            send = self._senders.get(ready.topic)
            if send is not None:
                send(ready.data)
                self._published += 1
        if time.monotonic() >= self._next_look:
            self._next_look = time.monotonic() + LOOKS
            self._look(now_ns)
        self._log()

    def close(self) -> None:
        """Close all connections and the server, and destroy the node."""
        for link in self._links:
            link.stop()
        self._background.stop()
        self._serving.stop()
        self._log()
        self.node.destroy_node()

    def _tags_of(self, source: str) -> Mapping[str, Tag]:
        return {name: tag for name, tag in self._plan.tags.items() if tag.source == source}

    def _arrived(self) -> list[Sample]:
        found: list[Sample] = []
        try:
            while len(found) < MOST_SAMPLES:
                found += self._samples.get_nowait()
        except Empty:
            return found
        return found

    def _held(self, now_ns: int) -> list[tuple[str, Measured]]:
        """Last values due to be published again, of tags with `hold`, whose server only sends changed values."""
        found = []
        for link in self._links:
            for name, tag in self._tags_of(link.name).items() if link.connected else ():
                last, state = self._states[name].last, self._states[name]
                if not tag.hold or last is None or state.reason:
                    continue
                newest = max(last.stamp_ns, self._held_ns.get(name, 0))
                if state.confirmed_ns >= link.begun_ns and now_ns - newest >= SECOND / tag.rate:
                    self._held_ns[name] = now_ns
                    found.append((name, Measured(now_ns, last.value)))
        return found

    def _look(self, now_ns: int) -> None:
        for link in self._links:
            for name in self._tags_of(link.name):
                if link.connected and link.since_ns < now_ns and name not in link.refused:
                    self._states[name].check_age(now_ns)
                else:
                    self._states[name].lose(now_ns)
        self._look_at_others()
        self._diagnostics(diagnostics_message(now_ns, *self._statuses()))

    def _look_at_others(self) -> None:
        """Create publishers for topics that no other node publishes, and log which topics other nodes publish."""
        for name, topic in self._table.items():
            mine = name in self._senders
            others = self.node.count_publishers(self.node.resolve_topic_name(name)) - mine
            if others > 0 and name not in self._others:
                self._others.add(name)
                whose = ", ".join(self._publishers(name)) or "somebody else"
                goes_on = "the door, which was there first, goes on" if mine else "left out here while it does"
                self.tell("warning", f"{name} is published by {whose} as well; {goes_on}")
            elif others <= 0 and name in self._others:
                self._others.discard(name)
                self.tell("info", f"{name} is published by this door alone now")
            if not mine and others <= 0:
                self._senders |= Endpoints(self.node, [topic]).senders

    def _publishers(self, name: str) -> list[str]:
        """Full names of the other nodes that publish a topic."""
        own = self.node.get_fully_qualified_name()
        infos = self.node.get_publishers_info_by_topic(self.node.resolve_topic_name(name))
        names = [f"{one.node_namespace.rstrip('/')}/{one.node_name}" for one in infos]
        if name in self._senders and own in names:
            names.remove(own)
        return [f"another {one}" if one == own else one for one in names]

    def _statuses(self) -> list[Status]:
        """Statuses of all connections, of the server and of the topics, for the diagnostics."""
        found = []
        for link in self._links:
            states = [self._states[name] for name in self._tags_of(link.name)]
            out = {state.name: state.reason for state in states if state.reason} | link.refused
            values = link.values()
            taken = sum(state.counts["taken"] for state in states)
            values["samples_taken"] = str(taken)
            values["samples_left_out"] = str(sum(sum(state.counts.values()) for state in states) - taken)
            values |= {f"left_out_{name}": reason for name, reason in out.items()}
            if not link.connected:
                level, text = ERROR, f"no connection: {link.reason}" if link.reason else "not connected yet"
            elif out:
                level, text = WARNING, f"{len(out)} of {len(states)} tags left out"
            else:
                level, text = OK, f"{len(states)} tags"
            found.append(Status(level, f"{NODE}: {link.name}", text, values))
        if self._server is not None:
            level, text = (OK, "listens") if self._server.listens else (ERROR, "does not listen")
            found.append(Status(level, f"{NODE}: server", text, {}))
        values = {
            "messages": str(self._published),
            "topics": str(len(self._table)),
            "left_out": ", ".join(sorted(self._others)),
        }
        found.append(
            Status(
                WARNING if self._others else OK,
                f"{NODE}: topics",
                "published" if not self._others else "with others",
                values,
            )
        )
        return found

    def _on_twin(self, topic: str, data: bytes) -> None:
        """Hand a message of the twin, with estimates or diagnostics, to the OPC UA server."""
        try:
            statuses, stamp_ns = statuses_of_message(data), stamp_in(data)
        except Exception:  # nothing that arrives on a topic ends the door
            return
        if topic == DIAGNOSTICS:
            assert self._plan.server is not None
            prefix = f"{self._plan.server.twin.strip('/')}: "
            statuses = [
                Status(one.level, one.name.removeprefix(prefix), one.message, one.values)
                for one in statuses
                if one.name.startswith(prefix)
            ]
        if statuses:
            self._serving.call(self._server.update, topic, statuses, stamp_ns)

    def _log(self) -> None:
        logger = self.node.get_logger()
        try:
            while True:
                level, text = self._lines.get_nowait()
                if level == "info":  # rclpy knows a call by its line, and allows one level in each
                    logger.info(text)
                elif level == "warning":
                    logger.warning(text)
                else:
                    logger.error(text)
        except Empty:
            return


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
