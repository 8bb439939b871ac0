"""A plant that is not this program: an aerial tramway in Exudyn, recorded as a bag with the topics of a plant.

`python -m verification.exudyn_plant --log DIR` runs it, for docs/calibrate.md. Rope, carriage and its sliding joint are
Exudyn's (`ANCFCable2D` in equal elements, `ObjectJointSliding2D`), and so is the time integration. The rope hangs
freely over one span, and a mass that slides on a line pulls its lower end. Added here, as forces on Exudyn's bodies
from one step to the next: the haul rope, a spring and damper with a share of its mass, rolling friction by Dahl's law,
and the drag of the cabin. Speeds of the drum are those that this program makes of the commands, as a drive follows
them whatever hangs on it. The rope has no drag, and friction acts on the rope at the two nodes beside the carriage.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time as clock
from collections.abc import Sequence
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

FREE_SPAN: dict[str, Any] = {"towers": {}}
TRUTH = {
    "carriages.cabin.payload.mass": 4200.0,
    "cable.axial_stiffness": 450e6,
    "cable.mass_per_length": 25.8,
    "carriages.cabin.friction.rolling": 0.0065,
    "cable.start.mass": 131e3,
    "cable.damping_time": 0.006,
}
CARRIAGE = "cabin"
ELEMENTS = 36
RATE, JITTER, LOST = 10.0, 0.05, 0.02  # Hz, s, share
QUANTUM, SHARE, TILT = 0.01, 0.002, math.radians(0.3)  # m, of the load or limit, rad: noise of sensors
TRUTH_FILE = "truth.json"  # beside the bag: what the sensors would have measured without noise, and all pitches
SETTLING, ROPE_DAMPING, BODY_DAMPING = 20.0, 1e3, 2e4  # s; N s/m of a node; N s/m and N m s of a body: to find a rest
PRESLIDING = 1e-3  # m, over which rolling friction builds up
MOST_WAITING, SHORT = 100, 1e-3  # messages for the recorder; s
NEWTON = 1e-6  # tolerance, relative and absolute


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
    found["tilt_cabin"] = {"kind": "inclinometer", "of": CARRIAGE, "noise": TILT, **common}
    return found


class Course(NamedTuple):
    """Commands with their times, and the speed of the drum at each step."""

    commands: list[AppliedCommand]
    speed: FloatArray  # m/s, (steps + 1,)


def course_of(scenario: Scenario, script: Path, duration: float) -> Course:
    """Speeds that the drive's controller makes of a script."""
    simulation, steps = Simulation(scenario, samples=2), round(duration / scenario.solver.step)
    waiting = sorted(read_script(script, scenario), key=lambda one: one.time)
    commands, speed = [], np.empty(steps + 1)
    for number in range(steps + 1):
        time = number * scenario.solver.step
        snapshot = simulation.advance_to(time)
        while waiting and waiting[0].time <= time + 1e-9:
            command = waiting.pop(0).command
            simulation.apply(command)
            commands.append(AppliedCommand(time, command, "script"))
        speed[number] = snapshot.columns.reference_speed[0]
    return Course(commands, speed)


class Row(NamedTuple):
    """True values of the plant at one time."""

    time: float  # s
    place: float  # m, arc length
    drive_force: float  # N
    start: tuple[float, float]  # N, force of the support on the rope
    end: tuple[float, float]
    pitches: tuple[float, ...]  # rad, of each body


class HaulRope:
    """Spring and damper from the drum to the carriage, with a share of its mass, one step after the other.

    Args:
        scenario: of the plant.
        mass: of the carriage, kg.
    """

    def __init__(self, scenario: Scenario, mass: float) -> None:
        self._rope, self._mass = scenario.carriages[CARRIAGE].drive.haul_rope, mass
        self._far = self._rope.beyond_track + scenario.cable.unstrained_length
        self.stretch = 0.0
        self._rates: tuple[float, float, float] | None = None  # m/s: of drum, carriage and stretch at the last step
        self._accelerations = 0.0, 0.0  # m/s^2, of drum and carriage

    def hang(self, force: float, place: float) -> None:
        """Stretch by a force (N) at rest."""
        self.stretch = force * (self._far - place) / self._rope.axial_stiffness

    def forces(self, place: float, drum: float, carriage: float, passed: float) -> tuple[float, float]:
        """Forces (N) on the carriage and of the drive, at a place (m) and speeds (m/s) of drum and carriage.

        `passed` is the time (s) since the last call, 0 where a step is tried again.
        """
        rope, length, rate = self._rope, self._far - place, drum - carriage
        before = self._rates or (drum, carriage, rate)
        self.stretch += 0.5 * passed * (rate + before[2])
        if passed > 0.0:
            self._accelerations = (drum - before[0]) / passed, (carriage - before[1]) / passed
        drums, carriages = self._accelerations
        self._rates = drum, carriage, rate
        damping = (
            2.0
            * rope.damping_ratio
            * math.sqrt(rope.axial_stiffness * (self._mass / length + rope.mass_per_length / 3.0))
        )
        pull = rope.axial_stiffness / length * self.stretch + damping * rate
        share = rope.mass_per_length * length / 6.0
        drive = pull + (rope.drive_inertia + 2.0 * share) * drums + share * carriages
        return pull - share * (2.0 * carriages + drums), drive


class Tramway:
    """Aerial tramway in Exudyn.

    Args:
        exudyn: the module.
        simulation: ours at rest, from which the search for Exudyn's own rest begins.
        elements: of the rope.
    """

    def __init__(self, exudyn: Any, simulation: Simulation, elements: int) -> None:
        from exudyn import itemInterface as items  # noqa: PLC0415, N813 - optional

        self._exudyn, self._items, self._scenario = exudyn, items, simulation.scenario
        self._count, self._length = elements, simulation.scenario.cable.unstrained_length / elements
        self._step = self._scenario.solver.step
        self._container = exudyn.SystemContainer()
        self._system = self._container.AddSystem()
        self._nodes, self._cables, self._bodies = [], [], []
        self._mass = self._area = 0.0
        self._add_rope(simulation)
        self._add_ends(simulation)
        self._add_carriage(simulation)
        self._pull = self._system.AddLoad(items.LoadForceVector(markerNumber=self._grip, loadVector=[0, 0, 0]))
        self._drag = self._system.AddLoad(items.LoadForceVector(markerNumber=self._middle, loadVector=[0, 0, 0]))
        self._on_nodes = [
            self._system.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, 0]))
            for marker in self._markers
        ]
        self._dampers = [
            self._damper(node, coordinate, damping)
            for nodes, coordinates, damping in ((self._nodes, 2, ROPE_DAMPING), (self._bodies, 3, BODY_DAMPING))
            for node in nodes
            for coordinate in range(coordinates)
        ]
        self._system.Assemble()
        self._haul = HaulRope(self._scenario, self._mass)
        self._mobilised, self._last, self._time = 0.0, np.zeros(2), 0.0
        self._rolled = self._place()
        self._first = float(simulation.snapshot.columns.drive_force[0])

    def rest(self) -> None:
        """Let Exudyn's own model settle with much damping, its drum where ours is at rest.

        Raises:
            RuntimeError: Exudyn gave up.
        """
        self._haul.hang(self._first, self._place())
        settings = self._settings(SETTLING, round(SETTLING / self._step))
        self._system.SetPreStepUserFunction(lambda system, _end: bool(self._drive(self._begun(system), 0.0)))
        self._system.SolveDynamic(settings, updateInitialValues=True)
        for one in self._dampers:
            self._system.SetObjectParameter(one, "activeConnector", False)

    def run(self, course: Course, on_row: Any) -> None:
        """Integrate from rest over a course; `on_row` gets the true values at each step.

        Raises:
            RuntimeError: Exudyn gave up.
        """
        times = self._step * np.arange(course.speed.size)
        told = 0

        def before_step(system: Any, _end: float) -> bool:
            nonlocal told
            time = self._begun(system)
            row, number = self._drive(time, float(np.interp(time, times, course.speed))), round(time / self._step)
            if number > told:  # at first joints have no forces yet
                told = number
                on_row(row)
            return True

        self._time = 0.0
        steps = course.speed.size
        settings = self._settings(steps * self._step, steps)
        self._system.SetPreStepUserFunction(before_step)
        self._system.SolveDynamic(settings)

    def _begun(self, system: Any) -> float:
        """Time (s) at which the present step begins; Exudyn halves steps where it has to, and tries them again."""
        return float(system.systemData.GetTime(self._exudyn.ConfigurationType.StartOfStep))

    def _settings(self, duration: float, steps: int) -> Any:
        """Settings of Exudyn's time integration, as of the benchmarks."""
        settings = self._exudyn.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps, integration.verboseMode = duration, steps, 0
        integration.generalizedAlpha.spectralRadius = self._scenario.solver.spectral_radius
        integration.generalizedAlpha.computeInitialAccelerations = False
        newton = integration.newton
        newton.relativeTolerance = newton.absoluteTolerance = NEWTON
        newton.useModifiedNewton, newton.modifiedNewtonContractivity = True, 0.7
        newton.maxModifiedNewtonIterations, newton.maxModifiedNewtonRestartIterations = 12, 11
        settings.solution.file.write = False
        settings.parallel.numberOfThreads = 1
        settings.linearSolver.solverType = self._exudyn.LinearSolverType.EigenSparse
        settings.linearSolver.reuseAnalyzedPattern = True
        return settings

    def _drive(self, time: float, drum: float) -> Row:
        """Set the forces of a step, from the present state; returns the true values of now."""
        system, kinds = self._system, self._exudyn.OutputVariableType
        place = self._place()
        tangent = self._slope(place)
        beside = [self._slope(place + way) for way in (-self._length, self._length)]
        hauled = 0.5 * sum(one / float(one @ one) for one in beside)  # beside the bend, which is as long as an element
        speed = float(hauled @ np.array(system.GetMarkerOutput(self._grip, kinds.Velocity))[:2])
        passed, self._time = max(time - self._time, 0.0), time
        on_carriage, drive = self._haul.forces(place, drum, speed, passed)
        pull = on_carriage * hauled
        # the normal force on the rope: weight and inertia of the carriage, across the tangent
        along = tangent / np.linalg.norm(tangent)
        pressed = np.array(system.GetObjectOutput(self._joint, kinds.Force))[:2]
        normal = float(np.linalg.norm(pressed - (pressed @ along) * along))
        friction = self._scenario.carriages[CARRIAGE].friction
        way, self._rolled = place - self._rolled, place
        sign = math.copysign(1.0, way)
        left = (self._mobilised - sign) * math.exp(-abs(way) / PRESLIDING)
        self._mobilised = sign + left
        rub = -friction.rolling * normal * self._mobilised * along
        held = pull + rub
        ahead = 1.5 * held - 0.5 * self._last if passed > 0.0 else held  # for the middle of the step
        self._last = held
        system.SetLoadParameter(self._pull, "loadVector", [*ahead, 0.0])
        wind = np.array(system.GetMarkerOutput(self._middle, kinds.Velocity))[:2]
        drag = -0.5 * self._scenario.air.density * self._area * float(np.linalg.norm(wind)) * wind
        system.SetLoadParameter(self._drag, "loadVector", [*drag, 0.0])
        self._rub_on_rope(place, -rub)
        end = tuple(float(system.GetObjectOutput(one, kinds.Force)) for one in self._fixed)
        first = system.systemData.GetObjectLTGAE(self._hook)[:2]
        hook = system.systemData.GetAECoordinates()[first]
        pitches = tuple(-float(system.GetNodeOutput(node, kinds.Rotation)[2]) for node in self._bodies)
        return Row(time, place, drive, (-float(hook[0]), -float(hook[1])), (-end[0], -end[1]), pitches)

    def _rub_on_rope(self, place: float, force: FloatArray) -> None:
        element = min(int(place / self._length), self._count - 1)
        share = place / self._length - element
        for number in range(max(element - 1, 0), min(element + 3, self._count + 1)):
            part = {element: 1.0 - share, element + 1: share}.get(number, 0.0)
            self._system.SetLoadParameter(self._on_nodes[number], "loadVector", [*(part * force), 0.0])

    def _place(self) -> float:
        """Arc length (m) of the carriage."""
        return float(self._system.GetObjectOutput(self._joint, self._exudyn.OutputVariableType.SlidingCoordinate))

    def _slope(self, place: float) -> FloatArray:
        """Slope r_x (2,) of the rope at an arc length (m)."""
        system, place = self._system, min(max(place, 0.0), self._count * self._length)
        element = min(max(int(place / self._length), 0), self._count - 1)
        x, length = place / self._length - element, self._length
        ends = []
        for number in (element, element + 1):
            moved = np.array(system.GetNodeOutput(self._nodes[number], self._exudyn.OutputVariableType.Coordinates))
            ends.append(moved + np.array([number * length, 0.0, 1.0, 0.0]))
        one, other = ends
        slope = (6.0 * x * x - 6.0 * x) / length * (one[:2] - other[:2])
        slope = slope + (1.0 - 4.0 * x + 3.0 * x * x) * one[2:] + (3.0 * x * x - 2.0 * x) * other[2:]
        return np.asarray(slope, dtype=float)

    def _damper(self, node: Any, coordinate: int, damping: float) -> Any:
        """Damper of one coordinate, for settling."""
        items, system = self._items, self._system
        moving = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        return system.AddObject(
            items.ObjectConnectorCoordinateSpringDamper(markerNumbers=[self._held, moving], damping=damping)
        )

    def _add_rope(self, simulation: Simulation) -> None:
        cable, system, items, length = self._scenario.cable, self._system, self._items, self._length
        places = np.linspace(0.0, cable.unstrained_length, self._count + 1)
        near = np.clip(places[:, None] + np.array([-0.5, 0.5]), 0.0, cable.unstrained_length)
        points = simulation.cable_positions(places)[:, [0, 2]]
        ends = simulation.cable_positions(near.ravel())[:, [0, 2]].reshape(-1, 2, 2)
        slopes = (ends[:, 1] - ends[:, 0]) / (near[:, 1] - near[:, 0])[:, None]
        for index, (point, slope) in enumerate(zip(points, slopes, strict=True)):
            reference = np.array([index * length, 0.0])
            initial = [*(point - reference), *(slope - [1.0, 0.0])]
            node = items.NodePoint2DSlope1(referenceCoordinates=[*reference, 1.0, 0.0], initialCoordinates=initial)
            self._nodes.append(system.AddNode(node))
        self._markers = [system.AddMarker(items.MarkerNodePosition(nodeNumber=node)) for node in self._nodes]
        for index in range(self._count):
            element = items.ObjectANCFCable2D(
                length=length,
                massPerLength=cable.mass_per_length,
                bendingStiffness=cable.bending_stiffness,
                axialStiffness=cable.axial_stiffness,
                bendingDamping=cable.damping_time * cable.bending_stiffness,
                axialDamping=cable.damping_time * cable.axial_stiffness,
                nodeNumbers=self._nodes[index : index + 2],
                useReducedOrderIntegration=1,
            )
            self._cables.append(system.AddObject(element))
            marker = system.AddMarker(items.MarkerBodyMass(bodyNumber=self._cables[-1]))
            weight = [0.0, -self._scenario.gravity, 0.0]
            system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=weight))

    def _add_ends(self, simulation: Simulation) -> None:
        """The fixed end, and a mass on a line that pulls the other one by its weight along it."""
        start, system, items = self._scenario.cable.start, self._system, self._items
        ground = system.AddNode(items.NodePointGround())
        self._held = held = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
        self._fixed = []
        for coordinate in range(2):
            end = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=self._nodes[-1], coordinate=coordinate))
            offset = system.GetNode(self._nodes[-1])["initialCoordinates"][coordinate]
            connector = items.ObjectConnectorCoordinate(markerNumbers=[held, end], offset=offset)
            self._fixed.append(system.AddObject(connector))
        along = np.array(start.direction, dtype=float)[[0, -1]]
        along /= np.linalg.norm(along)
        place = simulation.cable_positions(np.zeros(1))[0, [0, 2]]
        node = system.AddNode(items.NodePoint2D(referenceCoordinates=[*place]))
        system.AddObject(items.ObjectMassPoint2D(mass=start.mass, nodeNumber=node))
        marker = system.AddMarker(items.MarkerNodePosition(nodeNumber=node))
        self._hook = system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[marker, self._markers[0]]))
        weight = start.mass * self._scenario.gravity * along
        system.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=[*weight, 0.0]))
        still = system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=ground))
        moving = system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=node))
        across = np.array([[-along[1], along[0]]])
        line = items.ObjectConnectorCoordinateVector(
            markerNumbers=[still, moving], scalingMarker0=[], scalingMarker1=across, offset=[0.0]
        )
        system.AddObject(line)

    def _add_carriage(self, simulation: Simulation) -> None:
        carriage, system, items = self._scenario.carriages[CARRIAGE], self._system, self._items
        state, above = simulation.snapshot.carriages[CARRIAGE], None
        for name, body in carriage.bodies.items():
            mass, inertia, centre = body.mass, body.inertia, np.zeros(2)
            if carriage.payload is not None and carriage.payload.body == name:
                load, inside = carriage.payload.mass, np.array(carriage.payload.position, dtype=float)[[0, -1]]
                centre = load * inside / (mass + load)
                inertia += mass * centre @ centre + load * (inside - centre) @ (inside - centre)
                mass += load
            place, turn = state.bodies[name], -state.bodies[name].pitch
            axes = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
            at = np.array([place.x, place.z]) + axes @ centre
            node = system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[*at, turn]))
            rigid = system.AddObject(items.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node))
            upper, self._middle, heavy = (
                system.AddMarker(items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[*place, 0.0]))
                for place in (np.array(body.upper_pivot, dtype=float)[[0, -1]] - centre, -centre, np.zeros(2))
            )
            load = [0.0, -mass * self._scenario.gravity, 0.0]
            system.AddLoad(items.LoadForceVector(markerNumber=heavy, loadVector=load))
            self._mass, self._area = self._mass + mass, body.drag_area
            if above is None:
                self._grip = upper
            else:
                system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[above, upper]))
            if body.lower_pivot is not None:
                pivot = np.array(body.lower_pivot, dtype=float)[[0, -1]] - centre
                above = system.AddMarker(items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[*pivot, 0.0]))
            self._bodies.append(node)
        markers = [system.AddMarker(items.MarkerBodyCable2DCoordinates(bodyNumber=one)) for one in self._cables]
        element = min(int(state.arc_length / self._length), self._count - 1)
        data = items.NodeGenericData(initialCoordinates=[element, state.arc_length], numberOfDataCoordinates=2)
        joint = items.ObjectJointSliding2D(
            markerNumbers=[self._grip, markers[element]],
            slidingMarkerNumbers=markers,
            slidingMarkerOffsets=[index * self._length for index in range(self._count)],
            nodeNumber=system.AddNode(data),
            useClassicalFormulation=False,
        )
        self._joint = system.AddObject(joint)


def record(scenario: Scenario, simulation: Simulation, course: Course, rows: list[Row], directory: Path) -> Path:
    """Write a bag with the noisy measurements of a plant, and its true values beside it; returns its directory."""
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
    draws = np.random.default_rng(next(iter(scenario.sensors.values())).seed)
    messages = [
        (applied.time, APPLIED_COMMANDS, applied_command_message(applied, epoch_ns)) for applied in course.commands
    ]
    for row in rows:
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
    columns = list(zip(*rows, strict=True))
    (run.directory / TRUTH_FILE).write_text(json.dumps(dict(zip(Row._fields, columns, strict=True))), encoding="utf-8")
    return run.directory


def main(argv: Sequence[str] | None = None) -> int:
    """Run the plant and record it."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.exudyn_plant", description=__doc__, formatter_class=Filled
    )
    parser.add_argument("--script", type=Path, required=True, help="commands, as of `simulate`, at times alone")
    parser.add_argument("--duration", type=float, default=600.0, help="s; default: 600")
    parser.add_argument("--elements", type=int, default=ELEMENTS, help=f"of the rope; default: {ELEMENTS}")
    parser.add_argument("--seed", type=int, default=1, help="of the noise; default: 1")
    parser.add_argument("--log", type=Path, required=True, help="directory for the bag")
    options = parser.parse_args(argv)
    exudyn = load_exudyn()
    if exudyn is None:
        print("exudyn_plant: Exudyn is not installed; allowed: after pip install '.[bench]'", file=sys.stderr)
        return 2
    base = load_scenario("aerial_tramway", {**FREE_SPAN, **TRUTH})
    simulation = Simulation(base)
    usual = sensors_of(simulation.snapshot, base, options.seed)
    scenario = load_scenario("aerial_tramway", {**FREE_SPAN, **TRUTH, "sensors": usual})
    course = course_of(base, options.script, options.duration)
    plant, rows = Tramway(exudyn, simulation, options.elements), []
    every = round(1.0 / RATE / base.solver.step)
    began = clock.process_time()
    with run_progress(Console(stderr=True), 0.0, options.duration) as show:

        def take(row: Row) -> None:
            if round(row.time / base.solver.step) % every == 0:
                rows.append(row)
                show(row.time)

        plant.rest()
        plant.run(course, take)
    print(f"Exudyn: {options.duration:g} s in {clock.process_time() - began:.0f} s of a core, {len(usual)} sensors")
    print(f"bag: {record(scenario, Simulation(scenario), course, rows, options.log)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
