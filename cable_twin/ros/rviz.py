"""Topics for RViz beside the state topics: markers, static frames, and vehicles as a URDF.

Links of the URDF are named as the frames of `/tf`, joints as in `joint_states`. The frame of a body is at its centre of
mass without payload and a joint of a URDF is at the frame of its child, so each body has one more frame, at the pin
from which it hangs. A vehicle moves along the rope on a prismatic joint from the start of the rope to its end; the
poses are those of `/tf`. Limits are those beyond which commands are refused: places before the end stops, or the travel
of a drive, speed and force; an effort of 0 means that it takes no force.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from math import dist, inf
from typing import TYPE_CHECKING
from xml.etree import ElementTree

from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.snapshot import Columns
from cable_twin.geometry.bodies import THICK, body_bars, body_box
from cable_twin.messages import MARKERS, ROBOT_DESCRIPTION, TF_STATIC, FrameNames, header, serialize
from cable_twin.messages.frame import Filled
from cable_twin.messages.topics import String, TFMessage
from cable_twin.ros.client.twin_client import UNLIMITED
from cable_twin.ros.markers import Markers
from cable_twin.ros.startup import is_installed
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.output import Output
from cable_twin.scenario import Scenario, command_limits, in_space, limits_of, places_of
from cable_twin.scenario.sections.vehicles import Body, Carriage
from cable_twin.simulation import Simulation

if TYPE_CHECKING:
    from cable_twin.ros.endpoints import Endpoints

Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion
Transform = ros2_jazzy.geometry_msgs__msg__Transform
TransformStamped = ros2_jazzy.geometry_msgs__msg__TransformStamped

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
COLORS = ("0.78 0.49 0 1", "0.18 0.56 0.89 1")  # of hangers, of boxes
Element = ElementTree.Element
Place = tuple[float, ...]  # x, y, z


class RvizTopics:
    """Topics for RViz, as far as their message packages are installed.

    Args:
        simulation: running simulation.
        frames: names of coordinate frames.

    Attributes:
        present: options of `topics`; `/tf` is logged also where its messages are not installed.
        makers: makers of messages that are published with frames, by topic.
    """

    def __init__(self, simulation: Simulation, frames: FrameNames) -> None:
        self._scenario = simulation.scenario
        self._names = {"frame_id": frames.frame_id, "prefix": frames.frame_prefix}
        markers = is_installed("visualization_msgs")
        self.present = {"tf": True, "markers": markers, "robot": True}
        make = partial(Markers, self._scenario, simulation.layout, frame_id=self._names["frame_id"])
        self.makers: dict[str, Callable[[Columns], Filled]] = {MARKERS: make} if markers else {}
        self._listeners: Callable[[], int] = int  # 0
        self._sent = self._sent_before = 0  # messages of markers, in all and until the last check

    def counted_senders(self, endpoints: Endpoints) -> dict[str, Callable[[bytes], None]]:
        """Functions that publish the bytes of a message, by topic name; the one of `markers` counts its messages."""
        if MARKERS not in self.makers:
            return dict(endpoints.senders)
        self._listeners, send = partial(endpoints.listeners, MARKERS), endpoints.senders[MARKERS]

        def count_and_send(data: bytes) -> None:
            self._sent += 1
            send(data)

        return {**endpoints.senders, MARKERS: count_and_send}

    def check_listeners(self, loop: FrameLoop, output: Output) -> None:
        """Build markers only while subscribed, and repeat the present ones if none were sent since the last call.

        Markers are a fifth of the cost of a frame without logs; a paused or slow twin sends none by itself.
        """
        listening = self._listeners() > 0
        output.listen(MARKERS, listening)
        if listening and self._sent == self._sent_before:
            loop.call(partial(output.send_again, MARKERS))
        self._sent_before = self._sent

    def once(self) -> list[tuple[str, bytes]]:
        """Messages sent once, latched for late subscribers: the URDF and the static frames."""
        described = serialize(String(robot_description(self._scenario, **self._names)))
        static = static_transforms(self._scenario, time.time_ns(), **self._names)
        return [(ROBOT_DESCRIPTION, described), (TF_STATIC, static)]


def pivot_frame(vehicle: str, body: str) -> str:
    """Name of the frame at the pin from which a body hangs."""
    return f"{vehicle}/{body}/pivot"


def static_places(scenario: Scenario) -> Iterator[tuple[str, str | None, Place]]:
    """Static frames: name, parent frame (None: the fixed frame), place x, y, z (m) in the parent."""
    for rope, cable in scenario.cables.items():
        for name, end in zip(scenario.end_names(rope), (cable.start, cable.end), strict=True):
            yield name, None, scenario.placed(rope, end.position)
    yield from ((name, None, place) for name, place in scenario.tower_places.items())
    yield from ((name, None, scenario.placed(None, scenario.cable.start.position)) for name in scenario.drives)
    for vehicle, carriage in scenario.vehicles.items():
        for name, body in carriage.bodies.items():
            yield pivot_frame(vehicle, name), f"{vehicle}/{name}", in_space(body.upper_pivot)


def static_transforms(scenario: Scenario, stamp_ns: int, *, frame_id: str = "map", prefix: str = "") -> bytes:
    """Encode the static frames as tf2_msgs/TFMessage.

    Args:
        scenario: running scenario.
        stamp_ns: time stamp, ns since 1970.
        frame_id: name of the fixed frame.
        prefix: prefix of the names of all other frames.
    """
    transforms = [
        TransformStamped(
            header(stamp_ns, frame_id if parent is None else f"{prefix}{parent}"),
            f"{prefix}{name}",
            Transform(Vector3(*map(float, place)), Quaternion(0.0, 0.0, 0.0, 1.0)),
        )
        for name, parent, place in static_places(scenario)
    ]
    return serialize(TFMessage(transforms))


def robot_description(scenario: Scenario, *, frame_id: str = "map", prefix: str = "") -> str:
    """URDF of all vehicles of a scenario, and of the drive of a moving cable.

    Args:
        scenario: running scenario.
        frame_id: name of the root link.
        prefix: prefix of the names of all other links.
    """
    robot = Element("robot", name=scenario.name)
    _add(robot, "link", name=frame_id)
    for name in scenario.drives:
        _add(robot, "link", name=f"{prefix}{name}")
        _rope_joint(robot, scenario, name, frame_id, f"{prefix}{name}")
    for name, vehicle in scenario.vehicles.items():
        _add(robot, "link", name=f"{prefix}{name}")
        _rope_joint(robot, scenario, name, frame_id, f"{prefix}{name}")
        _chain(robot, name, vehicle, prefix)
    ElementTree.indent(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def _rope_joint(robot: Element, scenario: Scenario, name: str, parent: str, child: str) -> None:
    """Add a prismatic joint for motion along the rope, straight between its ends, with limits along the rope."""
    vehicle = scenario.vehicles.get(name)
    rope = None if vehicle is None else vehicle.rope
    cable = scenario.cable if rope is None else scenario.ropes[rope]
    start, end = (scenario.placed(rope, place.position) for place in (cable.start, cable.end))
    length = dist(start, end)
    joint = _joint(robot, name, "prismatic", parent, child, start)
    _add(joint, "axis", xyz=" ".join(f"{(b - a) / length:.9g}" for a, b in zip(start, end, strict=True)))
    on_loop = name not in scenario.drives and name not in scenario.carriages
    lower, upper = (0.0, scenario.loop_length) if on_loop else places_of(scenario, name)
    limits = limits_of(scenario, name)
    speed, effort = (_highest_speed(scenario, vehicle), 0.0) if limits is None else limits
    numbers = {"lower": lower, "upper": upper, "velocity": speed, "effort": effort}
    bounded = {key: min(max(value, -UNLIMITED), UNLIMITED) for key, value in numbers.items()}
    _add(joint, "limit", **{key: f"{value:.9g}" for key, value in bounded.items()})


def _highest_speed(scenario: Scenario, vehicle: Carriage | None) -> float:
    """Speed limit (m/s) of a vehicle without commands: of the fastest drive, 0 of a fixed vehicle."""
    if vehicle is None or vehicle.joint == "fixed":
        return 0.0
    return max((limits.speed for limits in command_limits(scenario).values()), default=inf)


def _chain(robot: Element, vehicle: str, carriage: Carriage, prefix: str) -> None:
    """Add links and joints of the bodies of a vehicle, each hung from the previous one."""
    above, hook = vehicle, in_space((0.0, 0.0))
    for name, body in carriage.bodies.items():
        pivot, centre = pivot_frame(vehicle, name), f"{vehicle}/{name}"
        _add(robot, "link", name=f"{prefix}{pivot}")
        joint = _joint(robot, f"{vehicle}_{name}", "continuous", f"{prefix}{above}", f"{prefix}{pivot}", hook)
        _add(joint, "axis", xyz="0 1 0")
        if body.damping:
            _add(joint, "dynamics", damping=f"{body.damping:.9g}")
        below = tuple(-value for value in in_space(body.upper_pivot))
        _joint(robot, f"{vehicle}_{name}_centre", "fixed", f"{prefix}{pivot}", f"{prefix}{centre}", below)
        link = _add(robot, "link", name=f"{prefix}{centre}")
        inertial = _add(link, "inertial")
        _add(inertial, "mass", value=f"{body.mass:.9g}")
        # in a plane the moment about y stands also for the others, which it does not have
        moments = (*(body.inertia_tensor or 3 * (body.inertia,)), 0.0, 0.0, 0.0)
        _add(inertial, "inertia", **{axes: f"{moment:.9g}" for axes, moment in zip(MOMENTS, moments, strict=False)})
        _shapes(link, body)
        above, hook = centre, in_space(body.lower_pivot or (0.0, 0.0))


def _shapes(link: Element, body: Body) -> None:
    """Add the visuals of a body: a bar from each pin to its centre, and a box where the body has an extent."""
    for bar in body_bars(body):
        (x, z), wide = bar.centre, THICK * bar.length
        _visual(link, f"{wide:.6g} {wide:.6g} {bar.length:.9g}", f"{x:.9g} 0 {z:.9g}", f"0 {bar.pitch:.9g} 0", 0)
    box = body_box(body)
    if box is not None:
        _visual(link, " ".join(f"{side:.9g}" for side in box), "0 0 0", "0 0 0", 1)


def _visual(link: Element, size: str, place: str, turn: str, color: int) -> None:
    visual = _add(link, "visual")
    _add(visual, "origin", xyz=place, rpy=turn)
    _add(_add(visual, "geometry"), "box", size=size)
    material = _add(visual, "material", name=f"color_{color}")
    _add(material, "color", rgba=COLORS[color])


def _joint(robot: Element, name: str, kind: str, parent: str, child: str, place: Place) -> Element:
    joint = _add(robot, "joint", name=name, type=kind)
    _add(joint, "parent", link=parent)
    _add(joint, "child", link=child)
    _add(joint, "origin", xyz=" ".join(f"{value:.9g}" for value in place), rpy="0 0 0")
    return joint


def _add(parent: Element, tag: str, **attributes: str) -> Element:
    return ElementTree.SubElement(parent, tag, attributes)
