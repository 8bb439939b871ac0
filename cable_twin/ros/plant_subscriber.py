"""Messages of a plant from its topics: recorded, passed on to the estimator, followed by the drives of the twin."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from cable_twin.basics.printable import printable
from cable_twin.frame.commands import JOINT_COMMANDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.frame.sensors import standard_sensors
from cable_twin.messages import SECOND, Topic
from cable_twin.messages.command_messages import command_from_message
from cable_twin.messages.sensor_messages import PLANT, JointState, measurements_from_message, plant_topics
from cable_twin.ros.endpoints import message_class
from cable_twin.runtime.following import COMMANDS, EmergencyStops, LiveFollowing, pursuit_of, unfollowable
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.simulation import Simulation

SOURCE = "plant"  # of commands
LARGEST = 65_536  # bytes of a message
DEPTH = 100
OTHER_CLOCK = 5.0  # s between the clock of a plant and ours, from which on its encoders are not followed
JOINTS = "sensors/joint_states"


def with_plant_sensors(simulation: Simulation) -> Scenario:
    """Scenario of a twin with the sensors of its plant: those of the scenario, else the usual ones.

    Raises:
        ScenarioError: the scenario is of a kind that cannot be followed; one line.
    """
    scenario = simulation.scenario
    if fault := unfollowable(scenario):
        raise ScenarioError(f"follow: {fault}")
    if scenario.sensors:
        return scenario
    return load_scenario(scenario.resolved(), {"sensors": standard_sensors(scenario, simulation.snapshot)})


class PlantSubscriber:
    """Subscriber to the topics of a plant, which records them, feeds the estimator and commands the twin's drives.

    Attributes:
        topics: topics of the plant, as they are recorded.

    Args:
        node: node of the twin.
        scenario: scenario with the sensors of the plant.
        simulation: running twin.
        loop: frame loop of the twin.
        following: estimator beside the twin.
        stamp_ns: gives the stamp (ns) of a simulated time (s).
        record: called with the topic and the bytes of each message.
    """

    def __init__(
        self,
        node: Node,
        scenario: Scenario,
        simulation: Simulation,
        loop: FrameLoop,
        following: LiveFollowing,
        stamp_ns: Callable[[float], int],
        record: Callable[[str, bytes], None],
    ) -> None:
        self._node, self._simulation, self._loop, self._following = node, simulation, loop, following
        self._stamp_ns, self._record = stamp_ns, record
        self._sensors = scenario.sensors
        spacing = {} if scenario.carriers is None else dict.fromkeys(scenario.drives, scenario.spacing)
        self._pursuit, self._stops = pursuit_of(scenario, spacing), EmergencyStops(scenario)
        self._late = 0.0  # s, by which stamps of the plant are behind our clock
        self._known = plant_topics(scenario)
        self._commands = Topic(f"{PLANT}/{JOINT_COMMANDS}", JointState.__msgtype__)
        self.topics = (*self._known.values(), self._commands)
        quality = QoSProfile(depth=DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
        for name, topic in (*self._known.items(), (COMMANDS, self._commands)):
            node.create_subscription(
                message_class(topic.type), topic.name, partial(self._take, name, topic.name), quality, raw=True
            )

    @property
    def catching_up(self) -> bool:
        """Whether a drive of the twin is brought to the place of the plant at present."""
        return self._pursuit.catching_up

    def doubled(self) -> list[str]:
        """Topics on which several plants publish."""
        return [one.name for one in self._known.values() if self._node.count_publishers(one.name) > 1]

    def _take(self, name: str, full_name: str, data: bytes) -> None:
        if len(data) > LARGEST:
            return
        self._record(full_name, data)
        if full_name in self._following.shut:
            return
        self._following.take(name, data)
        now = self._stamp_ns(self._loop.simulated_time) / SECOND
        try:
            if name == COMMANDS:
                command = command_from_message(JOINT_COMMANDS, data)
                if isinstance(command, Command) and command.kind == "speed":
                    self._pursuit.command(now - self._late, command.values)
                    for joint in command.values:
                        self._drive(now - self._late, joint)
            elif name == JOINTS:
                for one in measurements_from_message(name, data, self._sensors, 0):
                    if self._sensors[one.sensor].kind != "encoder":
                        continue
                    if one.sensor in self._following.left_out:
                        self._pursuit.leave(self._sensors[one.sensor].of)
                    else:
                        self._measure(now, one.time, self._sensors[one.sensor].of, one.values[0])
        except (CommandError, ValueError):  # the estimator tells of it
            return

    def _measure(self, now: float, time: float, joint: str, place: float) -> None:
        """Accept a measured place (m) of a time (s); measurements stamped by another clock are left out."""
        if not abs(place) < float("inf") or abs(now - time) > OTHER_CLOCK:
            return
        self._late = now - time
        self._pursuit.measure(time, joint, place)
        stop = self._stops.measure(time, joint, place)
        if stop is not None and not self._pursuit.stopped and not self._loop.emergency_stopped:
            self._pursuit.stop(stop)
            self._submit(Command("emergency_stop", {}))
        self._drive(time, joint)

    def _drive(self, time: float, joint: str) -> None:
        """Command a drive of the twin the speed by which it follows the plant, if one is due."""
        snapshot = self._simulation.snapshot
        if joint in snapshot.carriages:
            place, own_speed = snapshot.carriages[joint].arc_length, snapshot.carriages[joint].speed
        elif joint in snapshot.drives:
            place, own_speed = snapshot.drives[joint].position, snapshot.drives[joint].speed
        else:
            return
        late = self._stamp_ns(snapshot.time) / SECOND - time
        place -= own_speed * late
        if self._pursuit.moves_again(time, joint, place):
            self._pursuit.release()
            self._submit(Command("release", {}))
        speed = self._pursuit.wanted(time, joint, place)
        if speed is not None:
            self._submit(Command("speed", {joint: speed}))

    def _submit(self, command: Command) -> None:
        """Command the twin as the plant moves."""
        self._loop.submit(command, SOURCE).add_done_callback(self._on_applied)

    def _on_applied(self, future: Any) -> None:
        if not future.cancelled() and (error := future.exception()) is not None:
            self._node.get_logger().warning(
                f"a speed of the plant is refused: {printable(error, 300)}", throttle_duration_sec=5.0
            )
