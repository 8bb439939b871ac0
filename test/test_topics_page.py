"""docs/topics.md against the code: topics with types and rates, QoS, parameters with defaults and units.

Services, and what a running node really offers, are in test/ros/test_sim_node.py.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from topics_page import table, topics_of_page

from cable_twin.frame.commands import INPUTS
from cable_twin.frame.snapshot import Layout
from cable_twin.messages import Topic, topics
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.ros.parameter_table import PARAMETERS
from cable_twin.scenario import load_scenario

LAYOUT = Layout(
    {"VEHICLE": ("BODY",), "chair_1": ("chair",)},
    ("SUPPORT",),
    ("haul_rope",),
    np.linspace(0.0, 1.0, 3),
    carriers=1,
    hauled=["VEHICLE"],
    space=True,
    grooves={"SUPPORT": (0.0, 0.0, 0.0)},
    sheaves=["NAME"],
    connectors=["NAME"],
    pantographs=["VEHICLE"],
)
KINDS = {"encoder": "cabin", "load_cell": "start", "inclinometer": "cabin", "imu": "cabin"}
SENSORS = load_scenario("aerial_tramway", {"sensors": {kind: {"kind": kind, "of": of} for kind, of in KINDS.items()}})
TABLE = (
    *topics(LAYOUT, clock=True, tf=True, markers=True, robot=True, outlook=True, estimate=True),
    *(
        replace(topic, name=topic.name.replace("cabin", "VEHICLE").replace("start", "SUPPORT"))
        for topic in sensor_topics(SENSORS)
    ),
)
RATES = {
    "joints": "frame",
    "poses": "frame",
    "forces": "frame",
    "clock": "frame",
    "rope": "`rope_rate`",
    "path": "`path_rate`",
    "transforms": "frame",
    "markers": "`marker_rate`",
}


def test_topics_have_their_direction_type_and_rate():
    page = {(row.name, row.direction, row.type): row.rate for row in topics_of_page()}
    code = {
        (topic.name, "in" if topic.name in INPUTS else "out", topic.type.replace("/msg/", "/")): topic.group
        for topic in TABLE
    }
    assert page.keys() == code.keys()
    assert {key: page[key] for key, group in code.items() if group} == {
        key: RATES[group] for key, group in code.items() if group
    }


def test_quality_of_service_that_is_not_the_usual_one_is_said():
    usual = Topic("", "")
    page = {}
    for names, text in table("Quality of service"):
        depth = re.search(r"depth (\d+)", text)
        assert depth
        quality = (
            "best_effort" if "best effort" in text else "reliable",
            "transient_local" if "transient local" in text else "volatile",
            int(depth[1]),
        )
        page |= dict.fromkeys(re.findall(r"`(.+?)`", names), quality)
    code = {topic.name: (topic.reliability, topic.durability, topic.depth) for topic in TABLE}
    assert page == {
        name: quality for name, quality in code.items() if quality != (usual.reliability, usual.durability, usual.depth)
    }


def test_parameters_have_their_defaults_and_units():
    page = {}
    for names, defaults, _ in table("Parameters"):
        named = re.findall(r"`(.+?)`", names)
        given = [text.strip(" `") for text in defaults.split(",")]
        assert len(given) in (1, len(named)), named
        page |= zip(named, given if len(given) > 1 else given * len(named), strict=True)
    assert page.keys() == {parameter.name for parameter in PARAMETERS}
    for parameter in PARAMETERS:
        text = page[parameter.name]
        if isinstance(parameter.default, float):
            number, _, unit = text.partition(" ")
            assert float(number) == parameter.default, parameter.name
            assert unit in ("", parameter.unit), parameter.name
        else:
            written = str(parameter.default)
            written = written.lower() if isinstance(parameter.default, bool) else written
            assert text == (written or "none"), parameter.name
