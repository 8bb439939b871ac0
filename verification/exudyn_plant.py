"""A plant that is not this program: an aerial tramway in Exudyn, recorded as a bag with the topics of a plant.

`python -m verification.exudyn_plant --log DIR` runs `verification.exudyn_tramway`, for docs/follow.md and
docs/calibrate.md. Speeds of the drum are those that this program makes of the commands, as a drive follows them
whatever hangs on it.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time as clock
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console

from benchmarks.exudyn_model import load_exudyn
from cable_twin.frame.records import AppliedCommand, FloatArray
from cable_twin.frame.sensors import Measurement
from cable_twin.messages import APPLIED_COMMANDS, SCENARIO, FrameNames, Topic, TopicNames, nanoseconds, scenario_message
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.messages.sensor_messages import SensorOutput, plant_names, sensor_topics
from cable_twin.messages.topics import JointState, String
from cable_twin.offline.script import read_script
from cable_twin.offline.simulate import run_progress
from cable_twin.recording.run import start_run
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.command_line import Filled
from verification.exudyn_tramway import CARRIAGE, Drum, Row, Tramway

FREE_SPAN: dict[str, Any] = {"towers": {}}
TRUTH = {
    "carriages.cabin.payload.mass": 4200.0,
    "cable.axial_stiffness": 450e6,
    "cable.mass_per_length": 25.8,
    "carriages.cabin.friction.rolling": 0.0065,
    "cable.start.mass": 131e3,
    "cable.damping_time": 0.006,
}
ELEMENT, FAR_ELEMENT, MARGIN = 1.0, 5.0, 10.0  # m, of the rope: where the carriage goes and beyond, and how far beyond
SLOW_SHARE, SLOW_WAY = 0.25, 25.0  # of an element, and m from the start, where the carriage is slow
JUMP = 0.05  # m/s^2, of the drum's acceleration from one step to the next: more than by its jerk
RATE, JITTER, LOST = 10.0, 0.05, 0.02  # Hz, s, share
QUANTUM, SHARE, TILT = 0.01, 0.002, math.radians(0.3)  # m, of the load or limit, rad: noise of sensors
TRUTH_FILE = "truth.json"  # beside the bag: what the sensors would have measured without noise, and all pitches
INCLINOMETER = "tilt_cabin"
MISSING = "Exudyn is not installed; allowed: after pip install '.[bench]'"
MOST_WAITING, SHORT = 100, 1e-3  # messages for the recorder; s


def sensors_of(rest: Any, scenario: Scenario, seed: int) -> dict[str, dict[str, Any]]:
    """Sensors of the plant, as the usual ones of `plant`."""
    common = {"rate": RATE, "jitter": JITTER, "lost": LOST, "seed": seed}
    rows, forces = rest.layout.support_rows, rest.columns.support_force
    limit = scenario.carriages[CARRIAGE].drive.limits.force
    found: dict[str, dict[str, Any]] = {
        "encoder_cabin": {"kind": "encoder", "of": CARRIAGE, "quantum": QUANTUM, **common},
        "force_cabin": {"kind": "drive_force", "of": CARRIAGE, "noise": SHARE * limit, **common},
    }
    for end in ("start", "end"):
        load = float(np.linalg.norm(forces[rows[end]]))
        found[f"load_{end}"] = {"kind": "load_cell", "of": end, "noise": SHARE * load, **common}
    found[INCLINOMETER] = {"kind": "inclinometer", "of": CARRIAGE, "noise": TILT, **common}
    return found


class Course(NamedTuple):
    """Commands with their times, and the motion of the drum at each step."""

    commands: list[AppliedCommand]
    time: FloatArray  # s, (steps + 1,)
    way: FloatArray  # m, hauled
    speed: FloatArray  # m/s
    acceleration: FloatArray  # m/s^2

    def drum(self, time: float) -> Drum:
        """Motion of the drum at a time (s)."""
        return Drum(*(float(np.interp(time, self.time, one)) for one in (self.way, self.speed, self.acceleration)))


def course_of(scenario: Scenario, script: Path, duration: float) -> Course:
    """Motion that the drive's controller makes of a script."""
    step = scenario.solver.step
    simulation, steps = Simulation(scenario, samples=2), round(duration / step)
    waiting = sorted(read_script(script, scenario), key=lambda one: one.time)
    commands, speed = [], np.empty(steps + 1)
    for number in range(steps + 1):
        time = number * step
        snapshot = simulation.advance_to(time)
        while waiting and waiting[0].time <= time + 1e-9:
            command = waiting.pop(0).command
            simulation.apply(command)
            commands.append(AppliedCommand(time, command, "script"))
        speed[number] = snapshot.columns.reference_speed[0]
    way = np.concatenate([[0.0], np.cumsum(0.5 * step * (speed[1:] + speed[:-1]))])
    before = np.diff(speed, prepend=speed[0]) / step
    after = np.append(before[1:], before[-1])
    smooth = np.abs(after - before) < JUMP  # else a new acceleration sets in after this time
    return Course(commands, step * np.arange(steps + 1), way, speed, np.where(smooth, 0.5 * (before + after), before))


def mesh(length: float, place: float, farthest: float, element: float) -> FloatArray:
    """Arc lengths (m) of the nodes of a rope: elements of a length (m) up to the farthest place of the carriage.

    Between two nodes they hold the carriage too high, and pull it along the rope by up to 160 N one way and the other,
    which cancels out where it passes some nodes a second. So one node is where the carriage stands at first, and
    elements are shorter from there on until it is faster.
    """
    short, slow = SLOW_SHARE * element, min(place + SLOW_WAY, farthest + MARGIN)
    before = np.linspace(0.0, place, math.ceil(place / short) + 1)
    starting = place + short * np.arange(1, math.ceil((slow - place) / short) + 1)
    beyond = np.arange(starting[-1] + element, farthest + MARGIN + element, element)
    near = np.concatenate([before, starting, beyond])
    near = near[near < length - 0.5 * element]
    far = np.linspace(near[-1], length, math.ceil((length - near[-1]) / max(FAR_ELEMENT, element)) + 1)
    return np.concatenate([near, far[1:]])


class Plan(NamedTuple):
    """What a plant does, and how it is made."""

    script: Path  # commands, as of `simulate`, at times alone
    duration: float  # s
    element: float = ELEMENT  # m, of the rope where the carriage goes
    values: Mapping[str, float] = TRUTH  # of the plant, by key of the scenario


class Trip(NamedTuple):
    """What a plant has done."""

    values: Mapping[str, float]  # by key of the scenario
    course: Course
    rows: list[Row]


def travel(exudyn: Any, plan: Plan) -> Trip:
    """Run a plant in Exudyn.

    Raises:
        RuntimeError: Exudyn gave up.
    """
    base, rows = load_scenario("aerial_tramway", {**FREE_SPAN, **plan.values}), []
    course = course_of(base, plan.script, plan.duration)
    place = base.carriages[CARRIAGE].arc_length
    nodes = mesh(base.cable.unstrained_length, place, place + float(course.way.max()), plan.element)
    plant = Tramway(exudyn, Simulation(base), nodes, base.solver.step)
    began = clock.process_time()
    with run_progress(Console(stderr=True), 0.0, plan.duration) as show:

        def take(row: Row) -> None:
            rows.append(row)
            show(row.time)

        plant.rest()
        plant.run(course.drum, plan.duration, 1.0 / RATE, take)
    spent = clock.process_time() - began
    print(f"Exudyn: {nodes.size - 1} elements, {plan.duration:g} s in {spent:.0f} s of a core")
    return Trip(plan.values, course, rows)


def record(trip: Trip, directory: Path, seed: int, *, inclinometer: bool = True) -> Path:
    """Write a bag with noisy measurements of a trip, and its true values beside it; returns its directory.

    Raises:
        RuntimeError: something was not recorded.
    """
    bare = load_scenario("aerial_tramway", {**FREE_SPAN, **trip.values})
    usual = sensors_of(Simulation(bare).snapshot, bare, seed)
    if not inclinometer:
        usual.pop(INCLINOMETER)
    scenario = load_scenario("aerial_tramway", {**FREE_SPAN, **trip.values, "sensors": usual})
    simulation = Simulation(scenario)
    topics = [
        Topic(SCENARIO, String.__msgtype__),
        Topic(APPLIED_COMMANDS, JointState.__msgtype__),
        *sensor_topics(scenario),
    ]
    run = start_run(
        simulation,
        topics,
        record_directory=directory,
        frame_period=1.0 / RATE,
        rerun="none",
        names=TopicNames(remapped=plant_names(scenario)),
    )
    output, epoch_ns = SensorOutput(scenario, simulation.layout, FrameNames()), clock.time_ns()
    draws = np.random.default_rng(seed)
    messages = [
        (applied.time, APPLIED_COMMANDS, applied_command_message(applied, epoch_ns)) for applied in trip.course.commands
    ]
    for row in trip.rows:
        for name, sensor in scenario.sensors.items():
            noise, late, lost = sensor.noise * draws.standard_normal(), JITTER * draws.random(), draws.random() < LOST
            if sensor.kind == "encoder":
                values: tuple[float, ...] = round(row.place / QUANTUM) * QUANTUM, 0.0
            elif sensor.kind == "drive_force":
                values = (row.drive_force + noise,)
            elif sensor.kind == "inclinometer":
                values = (row.pitches[-1] + noise,)
            else:
                force = np.array(row.start if sensor.of == "start" else row.end)
                force = force * (1.0 + noise / float(np.linalg.norm(force)))
                values = float(force[0]), 0.0, float(force[1])
            if not lost:
                stamp_ns = epoch_ns + nanoseconds(row.time)
                topic, data = output.message(Measurement(name, row.time, values), stamp_ns)
                messages.append((row.time + late, topic, data))
    run.recorder.begin(epoch_ns, 0.0, scenario_message(scenario.resolved()))
    for time, topic, data in sorted(messages, key=lambda one: one[0]):
        run.recorder.record([(topic, data)], epoch_ns + nanoseconds(time))
        while run.recorder.backlog > MOST_WAITING:  # it drops what it cannot write in time
            clock.sleep(SHORT)
    run.close()
    if run.recorder.dropped or run.recorder.faults:
        raise RuntimeError("; ".join([f"{run.recorder.dropped} messages were not recorded", *run.recorder.faults]))
    columns = list(zip(*trip.rows, strict=True))
    (run.directory / TRUTH_FILE).write_text(json.dumps(dict(zip(Row._fields, columns, strict=True))), encoding="utf-8")
    return run.directory


def main(argv: Sequence[str] | None = None) -> int:
    """Run the plant and record it."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.exudyn_plant", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--script", type=Path, required=True, help="commands, as of `simulate`, at times alone")
    parser.add_argument("--duration", type=float, default=600.0, help="s; default: 600")
    text = f"m, of the rope where the carriage goes; default: {ELEMENT:g}"
    parser.add_argument("--element", type=float, default=ELEMENT, help=text)
    parser.add_argument("--seed", type=int, default=1, help="of the noise; default: 1")
    parser.add_argument("--log", type=Path, required=True, help="directory for the bag")
    options = parser.parse_args(argv)
    exudyn = load_exudyn()
    if exudyn is None:
        print(f"exudyn_plant: {MISSING}", file=sys.stderr)
        return 2
    trip = travel(exudyn, Plan(options.script, options.duration, options.element))
    print(f"bag: {record(trip, options.log, options.seed)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
