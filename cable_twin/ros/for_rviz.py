"""Topics for RViz beside the state topics: markers, static frames, vehicles as a URDF."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

from cable_twin.frame.snapshot import Columns
from cable_twin.messages import MARKERS, ROBOT_DESCRIPTION, TF_STATIC, FrameNames, serialize
from cable_twin.messages.frame import Filled
from cable_twin.messages.topics import String
from cable_twin.ros.description import robot_description, still_transforms
from cable_twin.ros.endpoints import Endpoints
from cable_twin.ros.markers import Markers
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.output import Output
from cable_twin.simulation import Simulation


class ForRviz:
    """Topics for RViz, as far as their message packages are installed.

    Attributes:
        present: options of `topics`; `/tf` is in logs also where its messages are not installed.
        makers: of messages that are due with frames, by name of the topic.
    """

    def __init__(self, simulation: Simulation, frames: FrameNames) -> None:
        """Prepare the RViz topics of a simulation, with the names of its frames."""
        self._scenario = simulation.scenario
        self._names = {"frame_id": frames.frame_id, "prefix": frames.frame_prefix}
        markers = find_spec("visualization_msgs") is not None
        self.present = {"tf": True, "markers": markers, "robot": True}
        make = partial(Markers, self._scenario, simulation.layout, frame_id=self._names["frame_id"])
        self.makers: dict[str, Callable[[Columns], Filled]] = {MARKERS: make} if markers else {}
        self._listeners: Callable[[], int] = int  # none
        self._sent = self._seen = 0  # markers that were sent, in all and until the last look

    def watching(self, endpoints: Endpoints) -> dict[str, Callable[[bytes], None]]:
        """Senders of topics by name, with sent markers counted."""
        if MARKERS not in self.makers:
            return dict(endpoints.senders)
        self._listeners, send = partial(endpoints.listeners, MARKERS), endpoints.senders[MARKERS]

        def sending(data: bytes) -> None:
            self._sent += 1
            send(data)

        return {**endpoints.senders, MARKERS: sending}

    def look(self, loop: FrameLoop, output: Output) -> None:
        """Build markers only while subscribed, and send the present ones where none were sent since the last call.

        They are a fifth of what a frame without logs costs; the twin may be paused, or slow.
        """
        listening = self._listeners() > 0
        output.listen(MARKERS, listening)
        if listening and self._sent == self._seen:
            loop.call(partial(output.send_again, MARKERS))
        self._seen = self._sent

    def once(self) -> list[tuple[str, bytes]]:
        """Messages sent once, latched for late subscribers."""
        described = serialize(String(robot_description(self._scenario, **self._names)))
        still = still_transforms(self._scenario, time.time_ns(), **self._names)
        return [(ROBOT_DESCRIPTION, described), (TF_STATIC, still)]


__all__ = ["ForRviz"]
