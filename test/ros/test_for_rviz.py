"""Data for RViz, read as by RViz: markers, tree of frames, description of the vehicles, layout."""

from __future__ import annotations

import math
import re
from collections import Counter
from functools import partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from bags import rerun_command
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation
from small_tramway import IN_SPACE, TRAMWAY

from cable_twin.messages import (
    MARKERS,
    ROBOT_DESCRIPTION,
    TF,
    TF_STATIC,
    FrameNames,
    MessageEncoder,
    decode,
    serialize,
    topics,
)
from cable_twin.messages.topics import String
from cable_twin.recording.log_writer import McapLog, run_metadata
from cable_twin.ros.markers import LIFETIME, REPEAT, Marker, Markers
from cable_twin.ros.rviz import RvizTopics, robot_description, static_transforms
from cable_twin.scenario import in_space, load_scenario
from cable_twin.simulation import Simulation

ROOT = Path(__file__).resolve().parents[2]
STAMP = 1_700_000_000_500_000_000
TYPES = {MARKERS: "visualization_msgs/msg/MarkerArray", TF: "tf2_msgs/msg/TFMessage"}
FRAME_ID, PREFIX = "valley", "south/"
WINDY = {**IN_SPACE, "air": {"wind": [2.0, 12.0, 0.0]}}


def test_a_cabin_in_the_wind_is_shown_with_its_roll():
    """Roll in poses, `/tf` and markers alike, and whole inertia in the description."""
    changes = {"carriages.cabin.bodies.cabin.inertia_tensor": [120.0, 150.0, 90.0, 0.0, 5.0, 0.0]}
    simulation = Simulation(load_scenario(WINDY, changes))
    encoder = MessageEncoder(simulation.layout, STAMP)
    encoder.offer(MARKERS, partial(Markers, simulation.scenario, simulation.layout, frame_id="map"))
    snapshot = simulation.advance_to(3.0)
    names = ["carriages/cabin/cabin/pose", TF, MARKERS]
    pose, tf, markers = (data for _, data in encoder.frame(snapshot, names))
    cabin = snapshot.carriages["cabin"].bodies["cabin"]
    assert math.degrees(cabin.roll) > 2.0  # blown to the left
    assert cabin.position[1] > 0.05
    found = {one.child_frame_id: one.transform for one in decode(tf, TYPES[TF]).transforms}
    box = markers_of({MARKERS: markers})["bodies", 0].pose
    body = decode(pose, "geometry_msgs/msg/PoseStamped").pose
    for turn in (found["cabin/cabin"].rotation, box.orientation, body.orientation):
        np.testing.assert_array_equal(numbers(turn), cabin.orientation)
        roll = Rotation.from_quat(numbers(turn)).as_euler("ZYX")[2]
        assert roll == pytest.approx(cabin.roll, abs=1e-12)
    for place in (found["cabin/cabin"].translation, box.position, body.position):
        np.testing.assert_array_equal(xyz(place), cabin.position)
    robot = ElementTree.fromstring(robot_description(simulation.scenario))
    (inertia,) = [link.find("inertial/inertia") for link in robot.findall("link") if link.get("name") == "cabin/cabin"]
    assert {axes: float(value) for axes, value in inertia.attrib.items()} == {
        **{"ixx": 120.0, "iyy": 150.0, "izz": 90.0, "ixy": 0.0, "ixz": 5.0, "iyz": 0.0}
    }


@pytest.fixture(scope="module", params=["tramway", "chairlift", "windy"])
def shown(request):
    """Scenario after some motion, and an encoder laid out at its start."""
    simulation = Simulation(load_scenario({"tramway": TRAMWAY, "windy": WINDY}.get(request.param, "chairlift")))
    encoder = MessageEncoder(simulation.layout, STAMP)
    encoder.offer(MARKERS, partial(Markers, simulation.scenario, simulation.layout, frame_id="map"))
    first = dict(encoder.frame(simulation.snapshot, [MARKERS, TF]))
    simulation.command("haul_rope" if request.param == "chairlift" else "cabin", speed=2.0)
    snapshot = simulation.advance_to(8.0)
    return simulation, snapshot, first, dict(encoder.frame(snapshot, [MARKERS, TF]))


def markers_of(messages):
    return {(marker.ns, marker.id): marker for marker in decode(messages[MARKERS], TYPES[MARKERS]).markers}


def numbers(*values):
    """All numbers of vectors, points, quaternions and colours in a message."""
    return [getattr(value, name) for value in values for name in "xyzwrgba" if hasattr(value, name)]


def xyz(value):
    return np.array([value.x, value.y, value.z])


def test_rviz_takes_every_marker(shown):
    """Checks of rviz_default_plugins' marker display, which does not draw a marker that fails one."""
    for messages in shown[2:]:
        array = decode(messages[MARKERS], TYPES[MARKERS]).markers
        assert not [key for key, count in Counter((marker.ns, marker.id) for marker in array).items() if count > 1]
        for marker in array:
            called = f"{marker.ns} {marker.id}"
            values = numbers(marker.pose.position, marker.pose.orientation, marker.scale, marker.color)
            assert np.isfinite([*values, *numbers(*marker.points, *marker.colors)]).all(), called
            assert math.hypot(*numbers(marker.pose.orientation)) == pytest.approx(1.0, abs=1e-6), called
            assert marker.action == Marker.ADD
            assert marker.header.frame_id == "map"
            assert marker.color.a > 0.0
            assert len(marker.colors) in (0, len(marker.points)), called
            scale = numbers(marker.scale)
            if marker.type == Marker.CUBE:
                assert min(scale) > 0.0, called
            elif marker.type == Marker.LINE_STRIP:
                assert scale[0] > 0.0, called
                assert len(marker.points) >= 2, called
            elif marker.type == Marker.TRIANGLE_LIST:
                assert min(scale) > 0.0, called
                assert marker.points, called
                assert len(marker.points) % 3 == 0, called
            elif marker.type == Marker.ARROW:
                start, end = map(xyz, marker.points)
                assert min(scale[:2]) > 0.0, called
                assert np.linalg.norm(end - start) > 0.0, called
            else:
                assert marker.type == Marker.TEXT_VIEW_FACING
                assert marker.text, called
                assert scale[2] > 0.0, called


def test_markers_are_the_same_things_in_each_message_and_end_with_the_twin(shown):
    _, _, first, last = shown
    before, after = markers_of(first), markers_of(last)
    assert list(before) == list(after)
    assert {name for name, _ in after} == {
        *("rope", "ground", "supports", "names", "bodies", "outlines", "vehicle_forces", "support_forces"),
        *(("wheels",) if shown[0].scenario.sheaves else ()),
        *(("tension_colors",) if shown[0].scenario.ropes else ()),
    }
    for key, marker in after.items():
        assert marker.type == before[key].type
        assert marker.lifetime.sec == LIFETIME > 2.0 * REPEAT  # shown on while the twin is paused
        assert marker.lifetime.nanosec == 0
    moved = {ns for ns, _ in after if any(b != a for b, a in zip(places(before, ns), places(after, ns), strict=True))}
    assert moved >= {"rope", "bodies", "outlines", "vehicle_forces", "support_forces"}
    assert not moved & {"ground", "supports", "names"}


def places(markers, namespace):
    return [numbers(marker.pose.position, *marker.points) for (ns, _), marker in markers.items() if ns == namespace]


def test_the_rope_has_its_samples_and_a_kink_at_each_joint(shown):
    _, snapshot, _, last = shown
    layout, c = snapshot.layout, snapshot.columns
    for number, part in enumerate(layout.ropes.values()):
        points = np.array([numbers(point) for point in markers_of(last)["rope", number].points])
        assert (np.diff(points[:, 0]) * (1.0 if number == 0 else -1.0) >= 0.0).all()
        wanted = {tuple(place) for place in c.rope_position[part]}
        on_rope = (c.attached == 1.0) & (c.arc_length <= layout.arc_lengths[part.stop - 1])
        on_rope &= (c.vehicle_rope == number) | (len(layout.ropes) == 1)
        wanted |= {tuple(place) for place in c.joint_position[on_rope]}
        assert {tuple(point) for point in points} == wanted


def test_the_colour_of_the_rope_goes_with_tension(shown):
    _, snapshot, _, last = shown
    rope = markers_of(last)["rope", 0]
    at = {tuple(numbers(point)): color for point, color in zip(rope.points, rope.colors, strict=True)}
    blues = [at[tuple(place)].b for place in snapshot.cable.positions]
    reds = [at[tuple(place)].r for place in snapshot.cable.positions]
    low, high = np.argmin(snapshot.cable.tensions), np.argmax(snapshot.cable.tensions)
    assert reds[high] > reds[low]
    assert blues[low] > blues[high]
    known = {}
    for tension, color in zip(snapshot.cable.tensions, zip(reds, blues, strict=True), strict=True):
        assert known.setdefault(tension, color) == color


def test_bodies_are_where_their_poses_are(shown):
    simulation, snapshot, _, last = shown
    markers = markers_of(last)
    bodies = [body for vehicle in simulation.scenario.vehicles.values() for body in vehicle.bodies.values()]
    for row, body in enumerate(bodies):
        kinds = ["outlines", *(["bodies"] if body.size is not None else [])]
        for namespace in kinds:
            pose = markers[namespace, row].pose
            np.testing.assert_array_equal(xyz(pose.position), snapshot.bodies.position[row])
            np.testing.assert_array_equal(numbers(pose.orientation), snapshot.bodies.orientation[row])
        if body.size is not None:
            scale = markers["bodies", row].scale
            assert (scale.x, scale.z) == body.size
            assert 0.0 < scale.y <= min(body.size)


@pytest.mark.parametrize("kind", ["vehicle", "support"])
def test_arrows_are_forces_to_one_scale(shown, kind):
    _, snapshot, _, last = shown
    forces = snapshot.columns.contact_force if kind == "vehicle" else snapshot.columns.support_force
    markers = markers_of(last)
    arrows = np.array(
        [np.subtract(*map(xyz, reversed(markers[f"{kind}_forces", row].points))) for row in range(len(forces))]
    )
    (scale, *_), *_ = np.linalg.lstsq(forces.reshape(-1, 1), arrows.reshape(-1), rcond=None)
    span = np.ptp(snapshot.cable.positions[:, 0])
    np.testing.assert_allclose(arrows, scale * forces, atol=2e-4 * span)
    assert np.linalg.norm(arrows, axis=1).max() < 0.3 * span


def test_rclpy_reads_the_same_markers(shown):
    """Identical bytes from the typesupport of rclpy."""
    serialization = pytest.importorskip("rclpy.serialization")
    pytest.importorskip("visualization_msgs.msg")
    message = serialization.deserialize_message(shown[3][MARKERS], import_module("visualization_msgs.msg").MarkerArray)
    ours = decode(shown[3][MARKERS], TYPES[MARKERS]).markers
    assert len(message.markers) == len(ours)
    for theirs, own in zip(message.markers, ours, strict=True):
        assert (theirs.ns, theirs.id, theirs.type, theirs.text) == (own.ns, own.id, own.type, own.text)
        assert numbers(theirs.pose.position, *theirs.points) == numbers(own.pose.position, *own.points)
        assert theirs.lifetime.sec == own.lifetime.sec


def frames(simulation, messages, **names):
    """Transforms of `/tf` and `/tf_static` by child: parent, position, rotation."""
    still = static_transforms(simulation.scenario, STAMP, **names)
    found = {}
    for data in (messages[TF], still):
        for one in decode(data, TYPES[TF]).transforms:
            assert one.child_frame_id not in found, "two parents"
            turn = one.transform.rotation
            assert math.hypot(*numbers(turn)) == pytest.approx(1.0, abs=1e-9)
            assert np.isfinite(numbers(one.transform.translation, turn)).all()
            assert one.header.stamp.sec > 0
            found[one.child_frame_id] = (
                one.header.frame_id,
                xyz(one.transform.translation),
                Rotation.from_quat(numbers(turn)).as_matrix(),
            )
    return found


def placed(found, frame, root="map"):
    """Position and rotation of a frame in the root frame; fails for an unconnected one."""
    if frame == root:
        return np.zeros(3), np.eye(3)
    parent, place, turn = found[frame]
    above, turned = placed(found, parent, root)
    return above + turned @ place, turned @ turn


def test_frames_are_one_tree_with_supports_and_pins(shown):
    simulation, snapshot, _, last = shown
    found = frames(simulation, last)
    for frame in found:
        placed(found, frame)
    assert not any(frame.startswith("/") or not frame for frame in found)
    scenario = simulation.scenario
    for rope, cable in scenario.cables.items():
        for frame, end in zip(scenario.end_names(rope), (cable.start, cable.end), strict=True):
            x, y, z = in_space(end.position)
            np.testing.assert_array_equal(placed(found, frame)[0], (x, y + cable.lateral, z))
    for name, tower in scenario.towers.items():
        x, y, z = in_space(tower.position)
        lateral = scenario.ropes[tower.rope].lateral if tower.rope else 0.0
        np.testing.assert_array_equal(placed(found, name)[0], (x, y + lateral, z))
    for row, (name, bodies) in enumerate(simulation.layout.vehicles.items()):  # the first pin is at the joint
        place = placed(found, f"{name}/{bodies[0]}/pivot")[0]
        np.testing.assert_allclose(place, snapshot.columns.joint_position[row], atol=gap(snapshot, row))


def gap(snapshot, row):
    """Allowed distance (m) of a vehicle from its joint, larger in a station."""
    return 1e-6 if snapshot.columns.attached[row] == 1.0 else 0.01


def joint_places(robot):
    """Joints by child link: element, parent link, origin (3,)."""
    return {
        joint.find("child").get("link"): (
            joint,
            joint.find("parent").get("link"),
            np.array([float(part) for part in joint.find("origin").get("xyz").split()]),
        )
        for joint in robot.findall("joint")
    }


def test_the_description_is_one_tree_whose_links_are_frames(shown):
    simulation, _, _, last = shown
    robot = ElementTree.fromstring(robot_description(simulation.scenario))
    links = [link.get("name") for link in robot.findall("link")]
    joints = joint_places(robot)
    assert len(set(links)) == len(links)
    assert len(joints) == len(robot.findall("joint")), "a link below two joints"
    assert [link for link in links if link not in joints] == ["map"]
    assert {parent for _, parent, _ in joints.values()} <= set(links)
    assert set(links) - {"map"} <= set(frames(simulation, last))


def test_joints_are_those_of_joint_states(shown):
    simulation, *_ = shown
    robot = ElementTree.fromstring(robot_description(simulation.scenario))
    moving = [joint.get("name") for joint in robot.findall("joint") if joint.get("type") != "fixed"]
    layout = simulation.layout
    bodies = [f"{vehicle}_{body}" for vehicle, names in layout.vehicles.items() for body in names]
    assert sorted(moving) == sorted([*layout.vehicles, *layout.drives, *bodies])
    assert not any("/" in name for name in moving)
    for joint in robot.findall("joint"):
        if joint.get("type") == "prismatic":
            limit = {key: float(value) for key, value in joint.find("limit").attrib.items()}
            assert limit["lower"] <= limit["upper"]
            assert min(limit["velocity"], limit["effort"]) >= 0.0
            axis = [float(part) for part in joint.find("axis").get("xyz").split()]
            assert math.hypot(*axis) == pytest.approx(1.0, abs=1e-8)


def test_the_chain_of_the_description_is_where_tf_says(shown):
    """Chain from the joint on the rope down, with the angles of `joint_states`."""
    simulation, snapshot, _, last = shown
    robot = ElementTree.fromstring(robot_description(simulation.scenario))
    joints, found = joint_places(robot), frames(simulation, last)

    def reached(link):
        if link in simulation.layout.vehicles:
            return placed(found, link)
        joint, parent, origin = joints[link]
        above, turned = reached(parent)
        if joint.get("type") == "continuous":
            vehicle, body = link.split("/")[:2]
            states = snapshot.carriages[vehicle].bodies
            before = [*states].index(body) - 1
            angle = states[body].pitch - (states[[*states][before]].pitch if before >= 0 else 0.0)
            turn = Rotation.from_euler("y", angle).as_matrix()
            if simulation.layout.space:  # a joint of a URDF has one angle: the rest is in `/tf` alone
                own = Rotation.from_quat(states[body].orientation)
                above_it = states[[*states][before]].orientation if before >= 0 else (0.0, 0.0, 0.0, 1.0)
                turn = (Rotation.from_quat(above_it).inv() * own).as_matrix()
        else:
            turn = np.eye(3)
        return above + turned @ origin, turned @ turn

    checked = 0
    for body in simulation.layout.bodies:
        place, turn = reached(body)
        there, turned = placed(found, body)
        vehicle = simulation.layout.vehicle_rows[body.partition("/")[0]]
        np.testing.assert_allclose(place, there, atol=gap(snapshot, vehicle))
        np.testing.assert_allclose(turn, turned, atol=1e-9)
        checked += 1
    assert checked > 0


@pytest.mark.parametrize("prefix", ["", PREFIX])
def test_every_message_is_in_a_frame_of_the_tree(shown, prefix):
    """Coordinate frames of all messages, also of forces on vehicles and supports."""
    simulation, snapshot, *_ = shown
    encoder = MessageEncoder(simulation.layout, STAMP, frames=FrameNames(FRAME_ID, prefix))
    encoded = dict(encoder.frame(snapshot, [*encoder.topics]))
    found = frames(simulation, encoded, frame_id=FRAME_ID, prefix=prefix)
    types = {topic.name: topic.type for topic in topics(simulation.layout, clock=True, tf=True)}
    messages = [decode(data, types[name]) for name, data in encoded.items() if not name.startswith("/")]
    used = {message.header.frame_id for message in messages if not hasattr(message, "status")}  # diagnostics have none
    assert len(used) > 3
    for frame in used:
        placed(found, frame, FRAME_ID)


def test_joint_states_move_the_chain_of_the_description(shown):
    """Names and angles as needed by a robot_state_publisher."""
    simulation, snapshot, *_ = shown
    ((_, data),) = MessageEncoder(simulation.layout, STAMP).frame(snapshot, ["joint_states"])
    states = decode(data, "sensor_msgs/msg/JointState")
    robot = ElementTree.fromstring(robot_description(simulation.scenario))
    moving = {joint.get("name") for joint in robot.findall("joint") if joint.get("type") != "fixed"}
    assert set(states.name) == moving
    given = dict(zip(states.name, states.position, strict=True))
    for vehicle, bodies in simulation.layout.vehicles.items():
        pitch = 0.0
        for body in bodies:
            pitch += given[f"{vehicle}_{body}"]
            assert pitch == pytest.approx(snapshot.carriages[vehicle].bodies[body].pitch, abs=1e-12)


def test_frames_have_the_names_that_they_are_given(shown):
    simulation, *_ = shown
    names = {"frame_id": FRAME_ID, "prefix": PREFIX}
    robot = ElementTree.fromstring(robot_description(simulation.scenario, **names))
    links = [link.get("name") for link in robot.findall("link")]
    assert links[0] == FRAME_ID
    assert all(link.startswith(PREFIX) for link in links[1:])
    for one in decode(static_transforms(simulation.scenario, STAMP, **names), TYPES[TF]).transforms:
        assert one.child_frame_id.startswith(PREFIX)
        assert one.header.frame_id == FRAME_ID or one.header.frame_id in links
    joints = {joint.get("name") for joint in robot.findall("joint")}
    assert not any(name.startswith(PREFIX) for name in joints)  # joint_states has none either


def test_markers_are_made_while_somebody_shows_them_and_sent_again_where_none_come(shown):
    simulation, _, _, _ = shown
    sent, listening, again, subscribers = [], [], [], [0]
    rviz = RvizTopics(simulation, FrameNames())
    endpoints = SimpleNamespace(senders={MARKERS: sent.append, "cable": None}, listeners=lambda topic: subscribers[0])
    senders = rviz.counted_senders(endpoints)
    assert senders.keys() == {MARKERS, "cable"}
    loop = SimpleNamespace(call=lambda function: function())
    output = SimpleNamespace(listen=lambda *given: listening.append(given), send_again=again.append)
    senders[MARKERS](b"1")
    rviz.check_listeners(loop, output)
    assert (sent, listening, again) == ([b"1"], [(MARKERS, False)], [])
    subscribers[0] = 1
    rviz.check_listeners(loop, output)  # none since the last look: a twin that is paused, say
    assert (listening[-1], again) == ((MARKERS, True), [MARKERS])
    senders[MARKERS](b"2")
    rviz.check_listeners(loop, output)  # one has come since
    assert again == [MARKERS]


MESSAGES = {  # of RViz's displays
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/RobotModel": "std_msgs/msg/String",
    "rviz_default_plugins/Path": "nav_msgs/msg/Path",
    "rviz_default_plugins/PointCloud2": "sensor_msgs/msg/PointCloud2",
    "rviz_default_plugins/TF": None,  # which has topics of its own
}


def test_the_layout_for_rviz_shows_topics_of_the_twin_with_a_quality_that_they_offer(shown):
    simulation, _, _, last = shown
    layout = YAML(typ="safe").load((ROOT / "rviz" / "cable_twin.rviz").read_text(encoding="utf-8"))
    manager = layout["Visualization Manager"]
    table = {topic.name: topic for topic in topics(simulation.layout, tf=True, markers=True, robot=True)}
    assert manager["Global Options"]["Fixed Frame"] == "map"
    assert {panel["Class"].partition("/")[0] for panel in layout["Panels"]} == {"rviz_common"}
    displays = {display["Name"]: display for display in manager["Displays"]}
    assert [name for name, display in displays.items() if display["Enabled"]] == ["Twin"]
    assert set(displays["Twin"]["Namespaces"]) == {name for name, _ in markers_of(last)} | {"wheels", "tension_colors"}
    for display in displays.values():
        message = MESSAGES[display["Class"]]
        if message is None:
            continue
        asked = display["Description Topic" if display["Class"].endswith("RobotModel") else "Topic"]
        topic = table[asked["Value"].removeprefix("/cable_twin/")]
        assert topic.type == message
        assert topic.reliability == "reliable" or asked["Reliability Policy"] == "Best Effort"
        latched = asked["Durability Policy"] == "Transient Local"
        assert latched == (topic.durability == "transient_local"), "a late RViz sees it, and subscribes at all"
    cloud = displays["Tension"]["Channel Name"]
    assert cloud in ("x", "y", "z", "arc_length", "tension")
    assert table[ROBOT_DESCRIPTION].durability == table[TF_STATIC].durability == "transient_local"


def test_reruns_own_loader_shows_rope_and_vehicles_of_a_bag(shown, tmp_path):
    """`rerun TIME_0.mcap`: one tree of frames, vehicles as boxes of their description."""
    pytest.importorskip("rerun")
    simulation, snapshot, *_ = shown
    table = topics(simulation.layout, tf=True, robot=True)
    log = McapLog(tmp_path / "run", table, run_metadata({"name": "shown"}, simulation.layout, frame_period=0.01))
    log.begin(STAMP)
    log.write(ROBOT_DESCRIPTION, STAMP, serialize(String(robot_description(simulation.scenario))))
    log.write(TF_STATIC, STAMP, static_transforms(simulation.scenario, STAMP))
    encoder = MessageEncoder(simulation.layout, STAMP)
    for moment in (simulation.snapshot, snapshot):
        for topic, data in encoder.frame(moment, ["cable", TF]):
            log.write(topic, encoder.stamp_ns(moment), data)
    log.close()
    loaded = tmp_path / "run.rrd"
    rerun_command("mcap", "convert", log.path, "-o", loaded)
    shown_by_rerun = rerun_command("rrd", "print", "-v", loaded)
    assert "cable@Points3D:positions" in shown_by_rerun
    assert "@Transform3D:parent_frame" in shown_by_rerun
    boxed = set(re.findall(r"/visual_geometries/(\S+)/visual_\d+@Boxes3D:half_sizes", shown_by_rerun))
    assert {name.replace("\\/", "/") for name in boxed} == set(simulation.layout.bodies)
