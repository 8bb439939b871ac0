"""Command `plant`: a virtual plant with sensors for a twin to follow, live under `/plant/`, or as a bag without ROS."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NoReturn

from rich.console import Console

from cable_twin.basics.limited_yaml import read_mapping
from cable_twin.ensemble.estimate.followers import unfollowable
from cable_twin.frame.sensors import standard_sensors
from cable_twin.messages import TopicNames
from cable_twin.messages.sensor_messages import PLANT, plant_names
from cable_twin.offline.script import ScriptedCommand, ScriptError, check_script, read_script
from cable_twin.offline.scripted_run import simulate
from cable_twin.offline.simulate import run_progress
from cable_twin.offline.simulate_options import DEFAULT_SCENARIO, DURATION, UNUSABLE, add_changes
from cable_twin.recording.run import start_run
from cable_twin.scenario import Scenario, ScenarioError, load_scenario, scenario_lines
from cable_twin.simulation import EquilibriumError, Simulation
from cable_twin.terminal.bars import start_shown
from cable_twin.terminal.command_line import OneLineParser, number, split_ros_arguments, tell, whole_number

DONE, FAILED = 0, 1  # exit codes, beside UNUSABLE
FRAME_RATE = 50.0  # Hz
NODE = "virtual_plant"  # name of the node, beside that of a twin
EPILOG = """\
Parameters and mesh of the plant are those of SCENARIO with the values of --set. Its sensors are those of --sensors, a
YAML file as the section `sensors` of a scenario; else those of the scenario; else the usual ones: encoders of 1 cm,
forces of drives, load cells of 0.2 %, inclinometers of 0.3 degrees for pitch and, in space, roll, ten times a second,
up to 50 ms late, 2 % lost.

With --log the bag has them under /plant/, with all else that a run has, such as the true values, for comparison:
`follow` uses none of that but the commands.

exit codes: 0 done, 1 the run failed or could not be recorded, 2 wrong scenario, sensors, script or option, 130 ended by
Ctrl-C

examples:
  plant aerial_tramway --set carriages.cabin.payload.mass=4200 \
        --script trip.yaml --log plants
  plant aerial_tramway --set cable.elements.target=7 --sensors own.yaml \
        --log plants
  plant aerial_tramway      live, with ROS 2; it takes /plant/joint_commands
  plant aerial_tramway --ros-args -p record:=false      parameters of `sim`
"""


def parser() -> OneLineParser:
    """Parser of the options of `plant`."""
    result = OneLineParser(
        "plant", "Run a virtual plant with sensors, which a twin can follow.", EPILOG, failure=UNUSABLE
    )
    result.add_scenario(
        f"name of a shipped scenario, or path of a YAML file; default: {DEFAULT_SCENARIO}", scenario_lines
    )
    add_changes(result)
    result.add_argument("--sensors", type=Path, metavar="FILE", help="sensors by name, as in a scenario")
    result.add_argument(
        "--seed",
        type=whole_number(0, 10**18 - 1),
        default=0,
        metavar="N",
        help="seed of the noise of the usual sensors; default: 0",
    )
    result.add_argument("--script", type=Path, metavar="FILE", help="commands over time, as for `simulate`")
    result.add_argument(
        "--duration",
        type=number(0.0, math.inf, "s"),
        metavar="S",
        help=f"simulated time of --log; default: {DURATION:g} s after the last command",
    )
    result.add_argument(
        "--log",
        type=Path,
        metavar="DIR",
        help="write a bag in a new directory within this one, without ROS, as fast as possible",
    )
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Run a virtual plant, live or into a bag; returns the exit code that the help lists."""
    arguments = parser()
    own, for_ros = split_ros_arguments(sys.argv[1:] if argv is None else argv)
    options = arguments.parse_args(own)
    source = arguments.given_scenario(options) or DEFAULT_SCENARIO
    console = Console(stderr=True)
    if options.log is None and (options.script is not None or options.duration is not None):
        arguments.error("--script, --duration: given without --log; allowed: with --log DIR")
    if options.log is not None and for_ros:
        arguments.error("--ros-args: given with --log; allowed: without, for a live plant")
    try:
        with start_shown("plant", console):
            simulation = plant_of(source, dict(options.set), options.sensors, options.seed)
        script = [] if options.script is None else read_script(options.script, simulation.scenario)
        if faults := check_script(simulation.scenario, script):
            raise ScriptError("\n".join(faults))
    except (ScenarioError, ScriptError, EquilibriumError) as error:
        tell("plant", error)
        return UNUSABLE
    if fault := unfollowable(simulation.scenario):
        tell("plant", f"note: no twin can follow this plant: {fault}")
    if options.log is None:
        go_live(source, dict(options.set), simulation.scenario, for_ros[1:])
    return _record(simulation, script, options, console)


def go_live(source: str, values: dict[str, Any], scenario: Scenario, for_ros: Sequence[str]) -> NoReturn:
    """Replace this process by the command `sim` with the sensors and topics of a virtual plant.

    Args:
        source: name or path of the scenario.
        values: changes of the scenario by dotted key.
        scenario: scenario with sensors.
        for_ros: remappings and parameters of the node, which come before those of a virtual plant.
    """
    sensors = {name: one.model_dump(mode="json", exclude_defaults=True) for name, one in scenario.sensors.items()}
    changes = [f"{key}={json.dumps(value)}" for key, value in {**values, "sensors": sensors}.items()]
    arguments = [part for change in changes for part in ("--set", change)]
    remapped = {"__node": NODE, "~/joint_commands": f"{PLANT}/joint_commands"}
    remapped |= {f"~/{own}": name for own, name in plant_names(scenario).items()}
    rules = [part for own, name in remapped.items() for part in ("-r", f"{own}:={name}")]
    print(f"plant: sensors are under {PLANT}/, the true values under /{NODE}/", flush=True)
    program = [sys.executable, "-m", "cable_twin.ros.sim", source, *arguments, "--ros-args", *for_ros, *rules]
    os.execv(sys.executable, program)


def plant_of(source: Any, values: dict[str, Any], sensors: Path | None = None, seed: int = 0) -> Simulation:
    """Simulation of a virtual plant at rest, with its sensors.

    Args:
        source: scenario, as for `load_scenario`.
        values: changes of the scenario by dotted key.
        sensors: file with the sensors by name; None for those of the scenario, or the standard ones.
        seed: of the noise of the standard sensors.

    Raises:
        ScenarioError: the scenario, a value or a sensor is invalid.
        EquilibriumError: there is no equilibrium.
    """
    if sensors is not None:
        values = {**values, "sensors": _read_sensors(sensors)}
    simulation = Simulation(load_scenario(source, values))
    return simulation if simulation.scenario.sensors else with_usual_sensors(simulation, seed)


def with_usual_sensors(simulation: Simulation, seed: int = 0) -> Simulation:
    """Simulation at rest of the scenario of a given simulation, with the standard sensors added."""
    scenario: Scenario = simulation.scenario
    usual = standard_sensors(scenario, simulation.snapshot, seed)
    return Simulation(load_scenario(scenario.resolved(), {"sensors": usual}))


def _read_sensors(path: Path) -> dict[str, Any]:
    """Read a YAML file of sensors by name, in the form of the section `sensors` of a scenario."""
    content = read_mapping(path, ScriptError, "sensors", ["sensors by name, as in `sensors` of a scenario"])
    sensors = content["sensors"] if [*content] == ["sensors"] else content
    if not isinstance(sensors, dict) or not sensors:
        raise ScriptError(f"{path}: given no sensors; allowed: sensors by name, as in `sensors` of a scenario")
    return sensors


def _record(
    simulation: Simulation, script: Sequence[ScriptedCommand], options: argparse.Namespace, console: Console
) -> int:
    """Run a virtual plant with a progress bar and write its bag; returns the exit code."""
    scenario = simulation.scenario
    last = max((one.time for one in script), default=0.0)
    duration = last + DURATION if options.duration is None else options.duration
    frame_steps = max(round(1.0 / (FRAME_RATE * simulation.step)), 1)
    try:
        run = start_run(
            simulation,
            record_directory=options.log.expanduser(),
            frame_period=frame_steps * simulation.step,
            rerun="none",
            names=TopicNames(remapped=plant_names(scenario)),
        )
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
        tell("plant", f"--log {options.log}: {getattr(error, 'strerror', None) or error}")
        return FAILED
    epoch_ns = time.time_ns()
    run.begin(epoch_ns)
    try:
        with run_progress(console, simulation.time, duration) as show:
            outcome = simulate(
                simulation,
                script,
                duration=duration,
                frame_steps=frame_steps,
                epoch_ns=epoch_ns,
                run=run,
                on_frame=show,
            )
    finally:
        run.close()
    lines = [f"refused: {line}" for line in outcome.refused] + ([outcome.fault] if outcome.fault else [])
    lines += run.recorder.faults
    for line in lines:
        tell("plant", line)
    print(f"{scenario.name}: {outcome.time:.2f} s in {outcome.wall_time:.2f} s, {len(scenario.sensors)} sensors")
    print(f"bag: {run.directory}")
    return FAILED if lines else DONE


if __name__ == "__main__":
    sys.exit(main())
