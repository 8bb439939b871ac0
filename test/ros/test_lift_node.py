"""Ski lift as a node: carriers in columns, stamps on the clock, rates."""

from __future__ import annotations

import subprocess
import sys
import time
from collections import Counter
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from twin_process import COMPILING, TwinProcess, environment, gaps, refused_starts, stamps

from cable_twin.messages import SECOND
from cable_twin.offline import replay
from cable_twin.recording.log_reader import read_log
from cable_twin.scenario import config_directory

pytest.importorskip("rclpy")
from geometry_msgs.msg import PoseArray, PoseStamped, WrenchStamped
from nav_msgs.msg import Path as PathMessage
from ros_participant import Participant
from sensor_msgs.msg import JointState, PointCloud2
from std_srvs.srv import SetBool

CHAIRS = 14
FRAME = 10_000_000  # ns
WINDOW = 200  # messages whose age is judged


def write_lift(directory: Path, chairs: int = CHAIRS) -> Path:
    """Write the chairlift with a number of chairs on its loop, and a mesh of low cost."""
    yaml = YAML()
    content = yaml.load((config_directory() / "chairlift.yaml").read_text(encoding="utf-8"))
    content["carriers"].update(count=chairs)
    for rope in content["ropes"].values():
        rope["elements"] = {"target": 8.0, "at_towers": 2.0}
    path = directory / f"lift_{chairs}.yaml"
    with path.open("w", encoding="utf-8") as stream:
        yaml.dump(content, stream)
    return path


@pytest.fixture(scope="module")
def running(tmp_path_factory):
    """Lift under way with a topic of its own for one chair, and all published messages."""
    directory = tmp_path_factory.mktemp("lift")
    arguments = ["--scenario", str(write_lift(directory)), "--carrier-topics", "chair_3, chair_5", "--rope-rate", "20"]
    process = TwinProcess(directory, *arguments, "--log-rope-rate", "5", "--log-pose-rate", "50")
    participant = Participant(process.domain)
    for topic, kind in (
        ("carriers/poses", PoseArray),
        ("carriers/forces", PointCloud2),
        ("sheaves", JointState),
        ("carriages/chair_3/chair/pose", PoseStamped),
        ("carriages/chair_5/contact_force", WrenchStamped),
        ("supports/tower_1_up/force", WrenchStamped),
        ("cable", PointCloud2),
        ("cable_path", PathMessage),
    ):
        participant.subscribe(topic, kind)
    participant.subscribe_standard()
    with participant.stream(name=["haul_rope"], velocity=[2.0]):
        participant.until(lambda: participant.received["carriers/poses"], COMPILING)
        yield process, participant
    participant.close()
    process.kill()


def published(participant: Participant) -> set[str]:
    """Topics published by the node of a lift."""
    node, last = participant.node, "/diagnostics"  # of its topics, so that all are known when this one is

    def found() -> set[str]:
        return {name for name, _ in node.get_publisher_names_and_types_by_node("cable_twin", "/")}

    participant.until(lambda: "cable_twin" in node.get_node_names(), what="the node in the graph")
    participant.until(lambda: last in found(), what=last)
    return found()


def test_the_number_of_publishers_does_not_depend_on_the_number_of_chairs(running, processes, participants, tmp_path):
    few = published(running[1])
    many_chairs = processes("--scenario", str(write_lift(tmp_path, 3 * CHAIRS)), "--record", "false")
    participant = participants(many_chairs.domain)
    participant.subscribe_standard()
    many = published(participant)
    own = {name for name in few if "chair_" in name}
    assert {name.split("/")[3] for name in own} == {"chair_3", "chair_5"}
    assert few - own == many
    assert "/cable_twin/carriers/poses" in many
    assert many_chairs.end() == 0


def common(*topics: list) -> list[tuple]:
    """Messages of several topics with equal stamps."""
    by_stamp = [dict(zip(stamps(messages), messages, strict=True)) for messages in topics]
    shared = sorted(set.intersection(*map(set, by_stamp)))
    return [tuple(one[stamp] for one in by_stamp) for stamp in shared]


def test_carriers_come_in_columns_in_the_order_of_joint_states(running):
    _, participant = running
    topics = ("joint_states", "carriers/poses", "carriers/forces", "carriages/chair_3/chair/pose")
    received = participant.received
    participant.until(lambda: len(common(*(received[topic] for topic in topics))) > 50)
    for joints, poses, forces, own in common(*(received[topic] for topic in topics)):
        assert joints.name[:CHAIRS] == [f"chair_{number}" for number in range(1, CHAIRS + 1)]
        assert len(poses.poses) == forces.width == CHAIRS
        assert poses.poses[2] == own.pose
        pitch = joints.position[joints.name.index("chair_3_chair")]
        assert poses.poses[2].orientation.y == pytest.approx(np.sin(0.5 * pitch), abs=1e-12)
        points = forces.data.view("<f4").reshape(CHAIRS, 6)
        below = np.array([pose.position.z for pose in poses.poses]) - points[:, 2]
        assert np.all((below < -2.0) & (below > -2.7))  # each body hangs 2.6 m below its joint
    force = received["carriages/chair_5/contact_force"][-1].wrench.force
    assert force.z > 3e3


def test_bullwheels_are_told_and_what_is_beside_the_limits_is_refused(running):
    _, participant = running
    received = participant.received
    bad = [("haul_rope", "velocity", np.nan), ("haul_rope", "velocity", np.inf), ("haul_rope", "velocity", 9.0)]
    bad += [("haul_rope", "effort", np.nan), ("haul_rope", "effort", 1e12), ("drive", "velocity", 1.0)]
    before = int(participant.next_diagnostics()[2]["commands_refused"])
    for name, kind, value in bad:
        participant.publisher.publish(JointState(name=[name], **{kind: [value]}))
    participant.until(lambda: int(participant.next_diagnostics()[2]["commands_refused"]) == before + len(bad))
    sheaves = received["sheaves"][-1]
    wheels = [f"{wheel}{row}" for wheel in ("drive", "return") for row in ("", "/on", "/off")]
    assert sheaves.name == [*wheels, "return/carriage"]
    assert np.isfinite([*sheaves.position, *sheaves.velocity, *sheaves.effort]).all()
    found = dict(zip(sheaves.name, zip(sheaves.position, sheaves.velocity, sheaves.effort, strict=True), strict=True))
    assert found["drive/on"][2] > found["drive/off"][2] > found["return/on"][2] > 1e5
    assert -4.0 < found["return/carriage"][0] < 4.0
    assert abs(found["drive/on"][0]) < 1e-3  # no slip
    place, rate = participant.joint("haul_rope")
    assert place == pytest.approx(found["drive"][0], abs=1.0)
    assert rate == pytest.approx(2.0, abs=0.1) or place < 20.0


def test_rates_of_topics_are_those_that_were_asked_for(running):
    _, participant = running
    received = participant.received
    for topic, period in (("cable", 5), ("cable_path", 10), ("carriers/forces", 1)):
        participant.until(lambda topic=topic: len(received[topic]) > 20)
        found = Counter(gaps(received[topic]))
        assert found.most_common(1)[0][0] == period * FRAME, topic
        assert not any(gap % (period * FRAME) for gap in found), topic  # a listener that is held up misses some


def age(participant: Participant, topic: str, kind: type) -> tuple[float, float]:
    """Least and median age (ms) of the next messages on arrival."""
    ages: list[float] = []

    def take(data: bytes) -> None:
        sec, nanosec = np.frombuffer(data, "<u4", 2, 4).tolist()
        ages.append((time.time_ns() - sec * SECOND - nanosec) * 1e-6)

    subscription = participant.node.create_subscription(kind, f"{participant.twin}/{topic}", take, 100, raw=True)
    participant.until(lambda: len(ages) >= WINDOW, what=f"{WINDOW} messages of {topic}")
    participant.node.destroy_subscription(subscription)
    assert min(ages) > -1.0  # ms; none is from the future
    return min(ages), float(np.median(ages))


def test_stamps_are_on_the_clock(processes, participants, tmp_path):
    """Age as shown by `ros2 topic delay`: 2 ms, also after a late start.

    A machine that stalls makes messages old, so the youngest counts; a wrong epoch spoils all of them. How old most are
    is measured by `python -m benchmarks live`.
    """
    process = processes("--scenario", str(write_lift(tmp_path)), "--start-paused", "true")
    participant = participants(process.domain)
    participant.subscribe_standard(paused=True)
    assert not participant.received["joint_states"]
    participant.spin(1.0)
    assert participant.call("pause", SetBool, data=False).success
    participant.until(lambda: participant.received["joint_states"])
    assert stamps(participant.received["joint_states"][:1])[0] > time.time_ns() - 20 * SECOND
    participant.until(lambda: age(participant, "joint_states", JointState)[0] < 2.0, 120.0, what="stamps on the clock")
    _, _, values = participant.next_diagnostics()
    assert abs(float(values["stamps_behind_clock_s"])) < 1.0
    assert "after a pause" not in process.output
    assert participant.call("pause", SetBool, data=True).success
    participant.spin(1.5)
    assert participant.call("pause", SetBool, data=False).success
    participant.until(
        lambda: "after a pause; from now on time stamps are" in process.output, what="a line about the pause"
    )
    _, median = age(participant, "joint_states", JointState)
    assert 1000.0 < median < 60_000.0


def test_all_topics_of_a_frame_have_one_stamp(running):
    _, participant = running
    received = participant.received
    topics = ("joint_states", "carriers/poses", "carriers/forces", "supports/tower_1_up/force")
    participant.until(lambda: all(len(received[topic]) > 100 for topic in topics))
    taken = [set(stamps(received[topic])) for topic in topics]
    assert len(set.intersection(*taken)) > 50
    assert len({stamp % FRAME for stamp in set.union(*taken)}) == 1  # a listener that is held up misses some


def test_logs_hold_topics_as_often_as_asked_for_and_replay(running):
    """Last test of the module: ends the twin."""
    process, participant = running
    assert process.end() == 0, process.output
    log = read_log(process.run_directory)
    assert replay.main([str(process.run_directory)]) == 0
    taken: dict[str, list[int]] = {}
    for topic, stamp_ns, _ in log.messages(["joint_states", "cable", "carriers/poses", "carriers/forces"]):
        taken.setdefault(topic, []).append(stamp_ns)
    periods = {topic: {after - before for before, after in pairwise(given)} for topic, given in taken.items()}
    assert periods == {
        "joint_states": {FRAME},
        "cable": {20 * FRAME},
        "carriers/poses": {2 * FRAME},
        "carriers/forces": {5 * FRAME},
    }
    assert participant.received["carriers/poses"]


def test_topics_of_a_carrier_that_is_not_there_are_refused_before_kernels_are_compiled(tmp_path):
    result = subprocess.run(
        [sys.executable, "-m", "cable_twin.ros.sim", "chairlift", "--carrier-topics", "chair_99"],
        env={**environment(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "kernels"), "NUMBA_DISABLE_JIT": "0"},
        capture_output=True,
        text=True,
        timeout=COMPILING,
        check=False,
    )
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith("sim: parameter 'carrier_topics': given 'chair_99'; allowed: the carriers chair_1 to chair_")
    assert not [*tmp_path.rglob("*.nbc")]


def test_wrong_rates_and_names_are_a_line_each(tmp_path):
    expected = {
        ("--carrier-topics", "chair_1,chair_99"): ["'carrier_topics': given 'chair_99'", "chair_1 to chair_14"],
        ("--log-rope-rate", "30"): [
            "'log_rope_rate': given 30 Hz",
            "whole fractions of the frame rate, as 100, 50 or 20",
        ],
    }
    scenario = ("--scenario", str(write_lift(tmp_path)))
    starts = [(*scenario, *arguments) for arguments in expected]
    for parts, lines in zip(expected.values(), refused_starts(tmp_path, *starts), strict=True):
        assert len(lines) == 1, lines
        line = lines[0]
        assert all(part in line for part in parts)
