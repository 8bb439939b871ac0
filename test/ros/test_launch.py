"""Launch files, read with a stand-in for launch that keeps descriptions; `test_colcon.py` runs the real launch."""

from __future__ import annotations

import runpy
import sys
from configparser import ConfigParser
from pathlib import Path
from types import ModuleType

import pytest
from ruamel.yaml import YAML

from cable_twin.frame.snapshot import Layout
from cable_twin.messages import topics
from cable_twin.ros.parameter_table import PARAMETERS
from cable_twin.scenario import load_scenario, scenario_names

ROOT = Path(__file__).resolve().parents[2]
FILES = sorted((ROOT / "launch").glob("*.launch.py"))
SIM = ROOT / "launch" / "sim.launch.py"
MODULES = (
    *("launch", "launch.actions", "launch.conditions", "launch.launch_description_sources", "launch.substitutions"),
    *("launch_ros", "launch_ros.actions", "launch_ros.parameter_descriptions", "launch_ros.substitutions"),
)
KNOWN = {parameter.name: parameter for parameter in PARAMETERS}
GIVEN = {"plant_set": "wind.x=3\ncable.damping_time=0.1"}  # to functions of launch files


class Described:
    """Any class of launch: name, arguments and inner descriptions."""

    def __init__(self, kind, *arguments, **options):
        self.kind, self.arguments, self.options = kind, arguments, options

    def perform(self, context):
        """Value of an argument of the launch."""
        return context[self.arguments[0]]

    def __iter__(self):
        """All descriptions from this one inwards."""
        yield self
        for value in (*self.arguments, *self.options.values()):
            yield from within(value)


def within(value):
    if isinstance(value, Described):
        yield from value
    elif isinstance(value, dict):
        yield from within([*value, *value.values()])
    elif isinstance(value, list | tuple | type({}.items())):
        for item in value:
            yield from within(item)


class Double(ModuleType):
    def __getattr__(self, name):
        if name == "OpaqueFunction":
            return lambda function: Described(name, *function(GIVEN))
        return lambda *arguments, **options: Described(name, *arguments, **options)


@pytest.fixture
def described(monkeypatch):
    """Function that returns all descriptions in a launch file."""
    for name in MODULES:
        monkeypatch.setitem(sys.modules, name, Double(name))
    return lambda path: list(runpy.run_path(str(path))["generate_launch_description"]())


def of_kind(descriptions, kind):
    return [one for one in descriptions if one.kind == kind]


def executables():
    setup = ConfigParser()
    setup.read(ROOT / "setup.cfg")
    commands = setup["options.entry_points"]["console_scripts"].split("\n")
    return {command.split("=")[0].strip() for command in commands if command} | {
        path.name for path in (ROOT / "examples").glob("*.py")
    }


def test_there_are_five():
    names = [f"{name}.launch.py" for name in ("control", "follow", "plant_door", "sim", "two_lifts")]
    assert [path.name for path in FILES] == names


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_argument_is_declared_once_with_a_default_and_what_it_is(described, path):
    descriptions = described(path)
    declared = of_kind(descriptions, "DeclareLaunchArgument")
    names = [one.arguments[0] for one in declared]
    assert len(set(names)) == len(names)
    assert {one.arguments[0] for one in of_kind(descriptions, "LaunchConfiguration")} <= set(names)
    assert all(len(one.options["description"]) > 8 and "default_value" in one.options for one in declared)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_what_is_started_exists(described, path):
    descriptions = described(path)
    for node in of_kind(descriptions, "Node"):
        package, executable = node.options["package"], node.options["executable"]
        assert (package, executable) == ("rviz2", "rviz2") or (package == "cable_twin" and executable in executables())
    for join in of_kind(descriptions, "PathJoinSubstitution"):
        share, *parts = join.arguments[0]
        assert share.arguments == ("cable_twin",)
        assert ROOT.joinpath(*parts).is_file()
    for included in of_kind(descriptions, "IncludeLaunchDescription"):
        taken = {one.arguments[0] for one in of_kind(described(SIM), "DeclareLaunchArgument")}
        assert {name for name, _ in included.options["launch_arguments"]} <= taken


def test_parameters_are_those_of_the_node_with_their_types_and_defaults(described):
    descriptions = described(SIM)
    (twin,) = [node for node in of_kind(descriptions, "Node") if node.options["executable"] == "sim"]
    defaults = {
        one.arguments[0]: one.options["default_value"] for one in of_kind(descriptions, "DeclareLaunchArgument")
    }
    (parameters,) = twin.options["parameters"]
    for name, value in parameters.items():
        assert value.options["value_type"] is type(KNOWN[name].default)
        text = isinstance(KNOWN[name].default, str)
        assert (defaults[name] if text else YAML(typ="safe").load(defaults[name])) == KNOWN[name].default


def test_a_plant_gets_an_option_for_each_line_of_its_changes_and_known_parameters(described):
    (plant,) = of_kind(described(ROOT / "launch" / "follow.launch.py"), "Node")
    scenario, *changes = plant.options["arguments"]
    assert scenario.arguments == ("scenario",)
    assert changes == ["--set", "wind.x=3", "--set", "cable.damping_time=0.1"]
    assert {*plant.options["parameters"][0]} <= {*KNOWN}


def test_scenarios_by_default_are_there_and_have_the_carriage_that_is_driven(described):
    for path in FILES:
        for one in of_kind(described(path), "DeclareLaunchArgument"):
            if "scenario" in one.options["description"] and one.options["default_value"]:
                assert one.options["default_value"] in scenario_names()
    arguments = runpy.run_path(str(ROOT / "launch" / "control.launch.py"))["ARGUMENTS"]
    scenario = load_scenario(arguments["scenario"][0])
    carriage = scenario.carriages[arguments["carriage"][0]]
    assert carriage.arc_length < float(arguments["to"][0]) < scenario.cable.unstrained_length
    assert float(arguments["speed"][0]) <= carriage.drive.limits.speed


def test_the_discovery_range_is_this_machine_unless_somebody_says_another(described):
    (variable,) = of_kind(described(SIM), "EnvironmentVariable")
    assert variable.arguments == ("ROS_AUTOMATIC_DISCOVERY_RANGE",)
    assert variable.options["default_value"] == "LOCALHOST"
    (setting,) = of_kind(described(SIM), "SetEnvironmentVariable")
    assert setting.arguments[0] == "ROS_AUTOMATIC_DISCOVERY_RANGE"


def test_rviz_is_remapped_to_the_topics_of_its_layout(described):
    layout = YAML(typ="safe").load((ROOT / "rviz" / "cable_twin.rviz").read_text(encoding="utf-8"))
    displays = layout["Visualization Manager"]["Displays"]
    shown = {one["Value"] for display in displays for key, one in display.items() if key.endswith("Topic")}
    (rviz,) = [one for one in of_kind(described(SIM), "Node") if "rviz2" in one.options["package"]]
    assert {before for before, _ in rviz.options["remappings"]} == shown
    assert all(before == f"/{after}" for before, after in rviz.options["remappings"])  # below the namespace
    table = topics(Layout.of(load_scenario("seed_example"), 2), markers=True, robot=True)
    assert {name.removeprefix("/cable_twin/") for name in shown} <= {topic.name for topic in table}


def test_two_lifts_share_neither_names_nor_frames_nor_logs(described):
    included = of_kind(described(ROOT / "launch" / "two_lifts.launch.py"), "IncludeLaunchDescription")
    given = [dict(one.options["launch_arguments"]) for one in included]
    assert len(given) == 2
    for name in ("namespace", "frame_prefix", "record_directory"):
        assert len({one[name] for one in given}) == 2
    assert all(one["frame_prefix"] == f"{one['namespace']}/" for one in given)
