"""Scenarios: YAML files, checked for all errors at once, and built into the constants of the mechanics."""

from cable_twin.scenario.builders.system import build_payloads, build_system, masts, tower_axes
from cable_twin.scenario.builders.vehicles import vehicle_buffer
from cable_twin.scenario.checks.air import wind_unfelt
from cable_twin.scenario.command_limits import (
    CommandLimits,
    command_fault,
    command_limits,
    limits_of,
    most_by_drive,
    places_of,
    unknown_name,
)
from cable_twin.scenario.files import (
    ScenarioError,
    config_directory,
    load_scenario,
    parse_scenario,
    scenario_file,
    scenario_lines,
    scenario_names,
)
from cable_twin.scenario.overrides import Written, assignment, full_key, scenario_keys, value_at
from cable_twin.scenario.schema import Scenario
from cable_twin.scenario.sections.line import Grading
from cable_twin.scenario.sections.quantities import in_space

__all__ = [
    "CommandLimits",
    "Grading",
    "Scenario",
    "ScenarioError",
    "Written",
    "assignment",
    "build_payloads",
    "build_system",
    "command_fault",
    "command_limits",
    "config_directory",
    "full_key",
    "in_space",
    "limits_of",
    "load_scenario",
    "masts",
    "most_by_drive",
    "parse_scenario",
    "places_of",
    "scenario_file",
    "scenario_keys",
    "scenario_lines",
    "scenario_names",
    "tower_axes",
    "unknown_name",
    "value_at",
    "vehicle_buffer",
    "wind_unfelt",
]
