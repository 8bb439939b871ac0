"""SROS2 policy with exactly the permissions of a running twin; ROS 2's wheels have no security libraries."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree

import pytest
from bent_line import BENT

from cable_twin.frame.commands import INPUTS
from cable_twin.frame.snapshot import Layout
from cable_twin.messages import topics
from cable_twin.messages.sensor_messages import PLANT, sensor_topics
from cable_twin.scenario import load_scenario, scenario_names

pytest.importorskip("rclpy")
from cable_twin.ros.simulation_services import SERVICES, service_name

POLICY = Path(__file__).resolve().parents[2] / "security" / "cable_twin.policy.xml"
RULES = {"topics": ("publish", "subscribe"), "services": ("reply", "request"), "actions": ("call", "execute")}
TWIN, EMERGENCY = "/cable_twin", "cable_twin_emergency_stop"


def allowed(enclave: str, own_node: str = "") -> dict[str, set[str]]:
    """Full names and patterns by rule ("publish") in sros2's form; of one node, or of all in the enclave."""
    root = ElementTree.parse(POLICY).getroot()
    found: dict[str, set[str]] = {rule: set() for rules in RULES.values() for rule in rules}
    profiles = root.findall(f"enclaves/enclave[@path='{enclave}']/profiles/profile")
    assert {profile.get("node") for profile in profiles} <= {enclave.strip("/"), EMERGENCY}
    for profile in profiles:
        namespace, node = profile.get("ns", ""), profile.get("node", "")
        for part in profile if own_node in ("", node) else ():
            for rule in RULES[part.tag]:
                if part.get(rule) == "ALLOW":
                    names = [(one.text or "").replace("~", f"{namespace.rstrip('/')}/{node}", 1) for one in part]
                    assert len(set(names)) == len(names)
                    assert all(name.startswith("/") for name in names)
                    found[rule] |= set(names)
    return found


def published() -> Iterator[str]:
    """Full names of all topics of all scenarios, with all options on."""
    for one in (*scenario_names(), BENT):
        layout = Layout.of(load_scenario(one), 2)
        table = topics(
            layout, own=layout.carriers[:1], clock=True, tf=True, markers=True, robot=True, outlook=True, estimate=True
        )
        for topic in table:
            if topic.name not in INPUTS:
                yield topic.name if topic.name.startswith("/") else f"{TWIN}/{topic.name}"
    kinds = {"encoder": "cabin", "load_cell": "start", "inclinometer": "cabin", "imu": "cabin"}
    sensors = {kind: {"kind": kind, "of": of} for kind, of in kinds.items()}
    for topic in sensor_topics(load_scenario("aerial_tramway", {"sensors": sensors})):
        yield f"{TWIN}/{topic.name}"


def covered(names: set[str], patterns: set[str]) -> tuple[set[str], set[str]]:
    """Names without a matching pattern, and patterns without a matching name."""
    without = {name for name in names if not any(fnmatchcase(name, pattern) for pattern in patterns)}
    return without, {pattern for pattern in patterns if not any(fnmatchcase(name, pattern) for name in names)}


def test_it_has_the_form_of_sros2():
    """Elements, attributes, values and version by sros2's policy.xsd."""
    root = ElementTree.parse(POLICY).getroot()
    assert (root.tag, root.attrib) == ("policy", {"version": "0.2.0"})
    assert [child.tag for child in root] == ["enclaves"]
    paths = [enclave.get("path") for enclave in root[0]]
    assert paths == ["/cable_twin", "/operator", "/observer", "/plant_door"]
    for profile in root.iter("profile"):
        assert set(profile.attrib) == {"ns", "node"}
        for part in profile:
            assert set(part.attrib) <= set(RULES[part.tag])
            assert set(part.attrib.values()) <= {"ALLOW", "DENY"}
            assert {one.tag for one in part} == {part.tag.rstrip("s")}


def test_the_twin_may_publish_what_its_table_has_and_nothing_else():
    of_every_node = {"/rosout", "/parameter_events"}
    assert covered(set(published()) | of_every_node, allowed(TWIN)["publish"]) == (set(), set())


def test_it_listens_to_commands_and_to_nothing_else():
    inputs = {f"{TWIN}/{name}" for name in INPUTS}
    plant = {"joint_commands", "joint_states", "supports/*/force", "inclinometer/*", "imu/*"}  # those with follow
    own = inputs | {"/clock", "/parameter_events"}  # those with use_sim_time
    assert allowed(TWIN)["subscribe"] == own | {f"{PLANT}/{name}" for name in plant}
    assert allowed("/operator")["publish"] == inputs | {"/rosout", "/parameter_events"}


@pytest.mark.parametrize("own_node", [TWIN.strip("/"), EMERGENCY])
def test_a_running_twin_has_no_endpoint_that_the_policy_does_not_have(running, own_node):
    _, participant = running
    rules = allowed(TWIN, own_node)
    node = participant.node
    participant.until(lambda: (own_node, "/") in node.get_node_names_and_namespaces(), what="the twin")
    services = node.get_service_names_and_types_by_node
    offered = {name for name in rules["reply"] if name.rpartition("/")[2] not in interface_services()}
    participant.until(lambda: offered <= {name for name, _ in services(own_node, "/")}, what="all of its services")
    for rule, ask in (
        ("publish", node.get_publisher_names_and_types_by_node),
        ("subscribe", node.get_subscriber_names_and_types_by_node),
        ("reply", services),
    ):
        names = {name for name, _ in ask(own_node, "/")}
        assert names or rule == "subscribe"
        assert not covered(names, rules[rule])[0], rule


def interface_services() -> set[str]:
    """Services of simulation_interfaces, which has no wheel: names by the table of the twin."""
    return {service_name(kind) for kind in SERVICES}


def test_services_of_simulation_interfaces_are_in_it():
    for names, prefix in ((allowed(TWIN)["reply"], TWIN), (allowed("/operator")["request"], TWIN)):
        assert {f"{prefix}/{name}" for name in interface_services()} <= names
    assert allowed(TWIN)["execute"] == allowed("/operator")["call"] == {f"{TWIN}/simulate_steps"}


def test_an_observer_commands_nothing():
    observer = allowed("/observer")
    assert not observer["request"]
    assert not [name for name in observer["publish"] if name.startswith(TWIN)]
    assert not any(fnmatchcase(f"{TWIN}/{name}", pattern) for name in INPUTS for pattern in observer["publish"])


def test_an_operator_asks_for_services_that_there_are():
    assert allowed("/operator")["request"] < allowed(TWIN)["reply"]
    assert f"{TWIN}/emergency_stop" in allowed("/operator")["request"]
