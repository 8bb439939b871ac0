"""Messages sent to RViz once: the vehicles as a URDF, and the static frames.

Links are named as the frames of `/tf`, joints as in `joint_states`. The frame of a body is at its centre of mass
without payload and a joint of a URDF is at the frame of its child, so each body has one more frame, at the pin from
which it hangs. The way of a vehicle along the rope is a straight joint from the start of the rope to its end in the
URDF; the poses are those of `/tf`. Its limits are those beyond which commands are refused: places before the end stops,
or the travel of a drive, speed and force; an effort of 0 is one that takes no force.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import dist, inf
from xml.etree import ElementTree

from rosbags.typesys.stores import ros2_jazzy

from cable_twin.geometry.bodies import THICK, body_bars, body_box
from cable_twin.messages import header, serialize
from cable_twin.messages.topics import TFMessage
from cable_twin.ros.client.twin_list import UNLIMITED
from cable_twin.scenario import Scenario, command_limits, in_space, limits_of, places_of
from cable_twin.scenario.sections.vehicles import Body, Carriage

Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion
Transform = ros2_jazzy.geometry_msgs__msg__Transform
TransformStamped = ros2_jazzy.geometry_msgs__msg__TransformStamped

MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
COLORS = ("0.78 0.49 0 1", "0.18 0.56 0.89 1")  # of hangers, of boxes
Element = ElementTree.Element
Place = tuple[float, ...]  # x, y, z


def pivot_frame(vehicle: str, body: str) -> str:
    """Name of the frame at the pin from which a body hangs."""
    return f"{vehicle}/{body}/pivot"


def still_places(scenario: Scenario) -> Iterator[tuple[str, str | None, Place]]:
    """Static frames: name, parent frame (None: the fixed frame), place x, y, z (m) in the parent."""
    for rope, cable in scenario.cables.items():
        for name, end in zip(scenario.end_names(rope), (cable.start, cable.end), strict=True):
            yield name, None, scenario.placed(rope, end.position)
    yield from ((name, None, place) for name, place in scenario.tower_places.items())
    yield from ((name, None, scenario.placed(None, scenario.cable.start.position)) for name in scenario.drives)
    for vehicle, carriage in scenario.vehicles.items():
        for name, body in carriage.bodies.items():
            yield pivot_frame(vehicle, name), f"{vehicle}/{name}", in_space(body.upper_pivot)


def still_transforms(scenario: Scenario, stamp_ns: int, *, frame_id: str = "map", prefix: str = "") -> bytes:
    """Encode the static frames as tf2_msgs/TFMessage.

    Args:
        scenario: What runs.
        stamp_ns: ns since 1970.
        frame_id: Of the fixed frame.
        prefix: In front of the names of all other frames.
    """
    transforms = [
        TransformStamped(
            header(stamp_ns, frame_id if seen_from is None else f"{prefix}{seen_from}"),
            f"{prefix}{name}",
            Transform(Vector3(*map(float, place)), Quaternion(0.0, 0.0, 0.0, 1.0)),
        )
        for name, seen_from, place in still_places(scenario)
    ]
    return serialize(TFMessage(transforms))


def robot_description(scenario: Scenario, *, frame_id: str = "map", prefix: str = "") -> str:
    """URDF of all vehicles of a scenario, and of the drive of a moving cable.

    Args:
        scenario: What runs.
        frame_id: Name of the root link.
        prefix: In front of the names of all other links.
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
    """Add a prismatic joint for motion along the rope, drawn straight but with place and speed along the rope."""
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
    speed, effort = (_moved(scenario, vehicle), 0.0) if limits is None else limits
    numbers = {"lower": lower, "upper": upper, "velocity": speed, "effort": effort}
    bounded = {key: min(max(value, -UNLIMITED), UNLIMITED) for key, value in numbers.items()}
    _add(joint, "limit", **{key: f"{value:.9g}" for key, value in bounded.items()})


def _moved(scenario: Scenario, vehicle: Carriage | None) -> float:
    """Speed limit (m/s) of a vehicle without commands: of the fastest drive, 0 of a fixed vehicle."""
    if vehicle is None or vehicle.joint == "fixed":
        return 0.0
    return max((limits.speed for limits in command_limits(scenario).values()), default=inf)


def _chain(robot: Element, vehicle: str, carriage: Carriage, prefix: str) -> None:
    """Add links and joints of the bodies of a vehicle, each below the one before."""
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
        # about y; in a plane the others stand for what it does not have
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


__all__ = ["pivot_frame", "robot_description", "still_places", "still_transforms"]
