"""An aerial tramway in Exudyn: its rope, bodies and time integration, with a joint that slides along the rope.

The rope is made of Exudyn's `ANCFCable2D` and hangs freely over one span; a mass that slides on a line pulls its lower
end. Carriage, hanger and cabin are `ObjectRigidBody2D` on revolute joints. Elements are short where the carriage goes,
as it rides over each node: between two nodes a cubic element is too stiff for the bend below a wheel, and holds it too
high.

Two constraints are renewed before each step: the carriage stays on the rope, and the haul rope goes where the carriage
goes. Both are linear in the coordinates (`ObjectConnectorCoordinateVector`), with normal and direction of where the
carriage will be at the end of the step. An error of that place changes neither to first order, as the rope has no slope
across its normal. Exudyn's own joint, `ObjectJointSliding2D`, is not used: in its accurate formulation one term of the
Jacobian has the place of the carriage where it should have its distance from the rope, so that Newton's method fails
some 100 m from the origin, and in its default one the force on the rope is ahead of the carriage by the way of a step.

The haul rope is a coordinate w (m) with mass, spring and damper of its own. From one step to the next there are, as
forces: rolling friction by Dahl's law, which acts on the rope at the two nodes beside the carriage, and the drag of the
cabin. The rope has no drag, and no damping of bending: what that takes in the bend below a carriage grows as elements
become shorter, and in this program it is part of rolling friction.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.simulation import Simulation

CARRIAGE = "cabin"
SETTLING, SETTLING_STEP = 20.0, 0.05  # s
ROPE_DAMPING, BODY_DAMPING = 50.0, 5e3  # N s/m of a metre; N s/m and N m s of a body: to find a rest, about critical
PRESLIDING = 1e-3  # m, over which rolling friction builds up
TOLERANCE = 1e-4  # N and m, of Newton's method: rounding of a place of 1 km is 1e-5 N in an element of 1 m
BESIDE = 2.0  # m: from where on a rope does not feel the bend below a carriage any more
BENT = 6  # elements on each side of the carriage, in whose slopes the bend below it shows
PROJECTIONS = 4  # steps of Newton's method to the place on the rope that is nearest to a point


class Row(NamedTuple):
    """True values of the plant at one time."""

    time: float  # s
    place: float  # m, arc length
    drive_force: float  # N
    start: tuple[float, float]  # N, force of the support on the rope
    end: tuple[float, float]
    pitches: tuple[float, ...]  # rad, of each body
    tensions: tuple[float, float]  # N, the lowest and the highest at a node, beside the bend at the carriage


class Drum(NamedTuple):
    """Motion of the drum at one time."""

    way: float  # m, hauled since the beginning
    speed: float  # m/s
    acceleration: float  # m/s^2


STANDING = Drum(0.0, 0.0, 0.0)


class Rope:
    """Shape of a rope of cubic elements.

    Args:
        places: (nodes,) m, arc lengths of nodes.
    """

    def __init__(self, places: FloatArray) -> None:
        self.places = places

    def element(self, place: float) -> int:
        """Element that holds an arc length (m)."""
        found = int(np.searchsorted(self.places, place, side="right")) - 1
        return min(max(found, 0), self.places.size - 2)

    def shapes(self, element: int, place: float, order: int = 0) -> FloatArray:
        """Shape functions (4,) of an element, or their derivative (1/m), at an arc length (m)."""
        length = float(self.places[element + 1] - self.places[element])
        x = (place - float(self.places[element])) / length
        if order == 0:
            return np.array(
                [
                    1.0 - 3.0 * x * x + 2.0 * x**3,
                    length * (x - 2.0 * x * x + x**3),
                    3.0 * x * x - 2.0 * x**3,
                    length * (x**3 - x * x),
                ]
            )
        steep = 6.0 * (x * x - x) / length
        return np.array([steep, 1.0 - 4.0 * x + 3.0 * x * x, -steep, 3.0 * x * x - 2.0 * x])

    def at(self, nodes: FloatArray, place: float, order: int = 0) -> FloatArray:
        """Point (m), or slope, (2,) at an arc length (m), of nodes (nodes, 4) with place and slope."""
        place = min(max(place, float(self.places[0])), float(self.places[-1]))
        element = self.element(place)
        return self.shapes(element, place, order) @ nodes[element : element + 2].reshape(4, 2)

    def nearest(self, nodes: FloatArray, point: FloatArray, place: float) -> float:
        """Arc length (m) nearest to a point (2,) m, from a `place` near it."""
        for _ in range(PROJECTIONS):
            slope = self.at(nodes, place, 1)
            place += float((point - self.at(nodes, place)) @ slope / (slope @ slope))
        return place


class Moment(NamedTuple):
    """State of rope and carriage at one time."""

    nodes: FloatArray  # (nodes, 4): place in m and slope
    body: FloatArray  # (3,): place in m and angle in rad of the running carriage
    hauled: float  # m, way of the haul rope at the carriage


class Tramway:
    """Aerial tramway in Exudyn.

    Args:
        exudyn: the module.
        simulation: ours at rest, from which the search for Exudyn's own rest begins.
        places: (nodes,) m, arc lengths of the nodes of the rope.
        step: s.
    """

    def __init__(self, exudyn: Any, simulation: Simulation, places: FloatArray, step: float) -> None:
        from exudyn import itemInterface as items  # noqa: PLC0415, N813 - optional

        self._exudyn, self._items, self._scenario = exudyn, items, simulation.scenario
        self._carriage = self._scenario.carriages[CARRIAGE]
        self._rope, self._step = Rope(places), step
        self._container = exudyn.SystemContainer()
        self._system = self._container.AddSystem()
        self._nodes, self._cables, self._bodies = [], [], []
        self._mass = self._area = 0.0
        self._add_rope(simulation)
        self._add_ends(simulation)
        self._add_carriage(simulation)
        self._add_joint()
        self._add_haul_rope()
        self._drag = self._load(self._middle)
        self._rub, self._on_nodes = self._load(self._grip), [self._load(marker) for marker in self._markers]
        widths = np.gradient(places)
        rope = [(node, 2, ROPE_DAMPING * float(width)) for node, width in zip(self._nodes, widths, strict=True)]
        self._dampers = [
            self._damper(node, coordinate, damping)
            for node, coordinates, damping in (*rope, *((body, 3, BODY_DAMPING) for body in self._bodies))
            for coordinate in range(coordinates)
        ]
        self._system.Assemble()
        self._reference = np.column_stack([places, np.zeros_like(places), np.ones_like(places), np.zeros_like(places)])
        self._rows = [self._system.GetNodeODE2Index(node) for node in (self._nodes[0], self._bodies[0], self._hauled)]
        self._place = self._rolled = float(simulation.snapshot.carriages[CARRIAGE].arc_length)
        self._joined, self._rubbed, self._mobilised, self._rolling = 0, 0, 0.0, 0.0
        self._first = float(simulation.snapshot.columns.drive_force[0])

    def rest(self) -> None:
        """Let Exudyn's own model settle with much damping and without friction, its drum where ours is at rest.

        Raises:
            RuntimeError: Exudyn gave up.
        """
        self._stretch = self._first / self._stiffness(self._place)
        settings = self._settings(SETTLING, SETTLING_STEP)

        def before_step(system: Any, _end: float) -> bool:
            self._renew(system, SETTLING_STEP, STANDING)
            return True

        self._system.SetPreStepUserFunction(before_step)
        self._system.SolveDynamic(settings, updateInitialValues=True)
        for one in self._dampers:
            self._system.SetObjectParameter(one, "activeConnector", False)
        self._rolled, self._rolling = self._place, self._carriage.friction.rolling

    def run(self, drum: Callable[[float], Drum], duration: float, period: float, on_row: Callable[[Row], None]) -> None:
        """Integrate from rest over a duration (s); `on_row` gets the true values after each period (s).

        Raises:
            RuntimeError: Exudyn gave up.
        """
        told, every = 0, round(period / self._step)

        def before_step(system: Any, end: float) -> bool:
            nonlocal told
            begun = float(system.systemData.GetTime(self._exudyn.ConfigurationType.StartOfStep))
            self._renew(system, end - begun, drum(end))
            number = round(begun / self._step)
            if number > told and number % every == 0:  # at first joints have no forces yet
                told = number
                on_row(self._row(begun, drum(begun)))
            return True

        self._system.SetPreStepUserFunction(before_step)
        self._system.SolveDynamic(self._settings(duration + self._step, self._step))

    def _settings(self, duration: float, step: float) -> Any:
        """Settings of Exudyn's time integration, as of the benchmarks."""
        settings = self._exudyn.SimulationSettings()
        integration = settings.timeIntegration
        integration.endTime, integration.numberOfSteps, integration.verboseMode = duration, round(duration / step), 0
        integration.generalizedAlpha.spectralRadius = self._scenario.solver.spectral_radius
        integration.generalizedAlpha.computeInitialAccelerations = False
        integration.reuseConstantMassMatrix = False  # that of the haul rope changes with its length
        newton = integration.newton
        newton.relativeTolerance = newton.absoluteTolerance = TOLERANCE
        newton.useModifiedNewton = True
        settings.solution.file.write = False
        settings.parallel.numberOfThreads = 1
        settings.linearSolver.solverType = self._exudyn.LinearSolverType.EigenSparse
        return settings

    def _now(self, system: Any) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Coordinates, their rates and accelerations of everything, in Exudyn's order."""
        data = system.systemData
        return data.GetODE2Coordinates(), data.GetODE2Coordinates_t(), data.GetODE2Coordinates_tt()

    def _moment(self, coordinates: FloatArray) -> Moment:
        rope, body, hauled = self._rows
        nodes = coordinates[rope : rope + self._reference.size].reshape(-1, 4) + self._reference
        return Moment(nodes, coordinates[body : body + 3] + self._body_reference, float(coordinates[hauled]))

    def _pin(self, body: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Place (2,) m of the pin on the rope, and its Jacobian (2, 3) by place and angle of the running carriage."""
        cos, sin = math.cos(body[2]), math.sin(body[2])
        arm = np.array([[cos, -sin], [sin, cos]]) @ self._arm
        return body[:2] + arm, np.array([[1.0, 0.0, -arm[1]], [0.0, 1.0, arm[0]]])

    def _renew(self, system: Any, passing: float, drum: Drum) -> None:
        """Set constraints and forces of a step of length `passing` (s), at whose end the drum moves so."""
        pressed = float(system.GetObjectOutput(self._joints[self._joined], self._exudyn.OutputVariableType.Force))
        places, rates, _ = self._now(system)
        now = self._moment(places)
        ahead = self._moment(places + passing * rates)
        before, _ = self._pin(now.body)
        pin, by_body = self._pin(ahead.body)
        self._place = self._rope.nearest(now.nodes, before, self._place)
        place = self._rope.nearest(ahead.nodes, pin, self._place)
        slope = self._rope.at(ahead.nodes, place, 1)
        along = slope / np.linalg.norm(slope)
        left = pin - by_body @ ahead.body  # of the pin, linear in the coordinates of the body
        self._hold(system, place, np.array([-along[1], along[0]]), by_body, left)
        sides = [self._rope.at(ahead.nodes, place + way, 1) for way in (-BESIDE, BESIDE)]
        hauled = 0.5 * sum(one / float(one @ one) for one in sides)
        offset = now.hauled - hauled @ before + hauled @ left
        self._set(self._haul, scalingMarker0=[hauled @ by_body], offset=[offset])
        self._pull(place, drum)
        self._resist(system, place, along, abs(pressed))

    def _hold(self, system: Any, place: float, normal: FloatArray, by_body: FloatArray, left: FloatArray) -> None:
        """Hold the carriage on the rope, at an arc length (m) and with a normal (2,)."""
        element = self._rope.element(place)
        if element != self._joined:
            self._set(self._joints[self._joined], activeConnector=False)
        self._joined = element
        on_rope = np.outer(self._rope.shapes(element, place), normal).reshape(1, 8)
        self._set(
            self._joints[element],
            scalingMarker0=[normal @ by_body],
            scalingMarker1=on_rope,
            offset=[normal @ left],
            activeConnector=True,
        )

    def _stiffness(self, place: float) -> float:
        return self._carriage.drive.haul_rope.axial_stiffness / self._haul_length(place)

    def _haul_length(self, place: float) -> float:
        return self._carriage.drive.haul_rope.beyond_track + self._scenario.cable.unstrained_length - place

    def _haul_damping(self, place: float) -> float:
        """Damping (N s/m) of the haul rope, as of ours."""
        rope, length = self._carriage.drive.haul_rope, self._haul_length(place)
        mass = self._mass / length + rope.mass_per_length / 3.0
        return 2.0 * rope.damping_ratio * math.sqrt(rope.axial_stiffness * mass)

    def _pull(self, place: float, drum: Drum) -> None:
        """Set mass, spring and damper of the haul rope between the drum and an arc length (m)."""
        damping = self._haul_damping(place)
        share = self._carriage.drive.haul_rope.mass_per_length * self._haul_length(place) / 6.0
        self._set(self._haul_mass, mass=2.0 * share)
        self._set(self._spring, stiffness=self._stiffness(place), damping=damping, offset=self._stretch + drum.way)
        self._system.SetLoadParameter(self._on_haul, "load", damping * drum.speed - share * drum.acceleration)

    def _resist(self, system: Any, place: float, along: FloatArray, normal: float) -> None:
        """Set rolling friction and drag of a step, at whose end the carriage is at an arc length (m).

        `along` is the direction of the rope there, `normal` the force (N) of the carriage across it.
        """
        self._mobilised = self._dahl(self._place - self._rolled)
        self._rolled = self._place
        force = -self._rolling * normal * self._dahl(place - self._place) * along
        self._system.SetLoadParameter(self._rub, "loadVector", [*force, 0.0])
        element = self._rope.element(place)
        ends = self._rope.places[element : element + 2]
        share = (place - float(ends[0])) / float(ends[1] - ends[0])
        for node in {self._rubbed, self._rubbed + 1} - {element, element + 1}:
            self._system.SetLoadParameter(self._on_nodes[node], "loadVector", [0.0, 0.0, 0.0])
        for node, part in ((element, 1.0 - share), (element + 1, share)):
            self._system.SetLoadParameter(self._on_nodes[node], "loadVector", [*(-part * force), 0.0])
        self._rubbed = element
        wind = np.array(system.GetMarkerOutput(self._middle, self._exudyn.OutputVariableType.Velocity))[:2]
        drag = -0.5 * self._scenario.air.density * self._area * float(np.linalg.norm(wind)) * wind
        self._system.SetLoadParameter(self._drag, "loadVector", [*drag, 0.0])

    def _dahl(self, way: float) -> float:
        """Share -1..1 of rolling friction that is mobilised after a way (m) from where it was last."""
        sign = math.copysign(1.0, way)
        return sign + (self._mobilised - sign) * math.exp(-abs(way) / PRESLIDING)

    def _row(self, time: float, drum: Drum) -> Row:
        system, kinds = self._system, self._exudyn.OutputVariableType
        places, rates, accelerations = self._now(system)
        rope, index = self._carriage.drive.haul_rope, self._rows[2]
        pull = self._stiffness(self._place) * (self._stretch + drum.way - float(places[index]))
        pull += self._haul_damping(self._place) * (drum.speed - float(rates[index]))
        share = rope.mass_per_length * self._haul_length(self._place) / 6.0
        drive = pull + (rope.drive_inertia + 2.0 * share) * drum.acceleration + share * float(accelerations[index])
        end = tuple(float(system.GetObjectOutput(one, kinds.Force)) for one in self._fixed)
        first = system.systemData.GetObjectLTGAE(self._hook)[:2]
        hook = system.systemData.GetAECoordinates()[first]
        pitches = tuple(-float(system.GetNodeOutput(node, kinds.Rotation)[2]) for node in self._bodies)
        strain = np.linalg.norm(self._moment(places).nodes[:, 2:], axis=1) - 1.0
        tension = (
            self._scenario.cable.axial_stiffness
            * strain[np.abs(np.arange(strain.size) - self._rope.element(self._place)) > BENT]
        )
        return Row(
            time=time,
            place=self._place,
            drive_force=drive,
            start=(-float(hook[0]), -float(hook[1])),
            end=(-end[0], -end[1]),
            pitches=pitches,
            tensions=(float(tension.min()), float(tension.max())),
        )

    def _set(self, item: Any, **values: Any) -> None:
        for name, value in values.items():
            self._system.SetObjectParameter(item, name, np.array(value) if isinstance(value, list) else value)

    def _load(self, marker: Any) -> Any:
        """Force at a marker, for now of 0 N."""
        return self._system.AddLoad(self._items.LoadForceVector(markerNumber=marker, loadVector=[0, 0, 0]))

    def _damper(self, node: Any, coordinate: int, damping: float) -> Any:
        """Damper of one coordinate, for settling."""
        items, system = self._items, self._system
        moving = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
        return system.AddObject(
            items.ObjectConnectorCoordinateSpringDamper(markerNumbers=[self._held, moving], damping=damping)
        )

    def _add_rope(self, simulation: Simulation) -> None:
        cable, system, items, places = self._scenario.cable, self._system, self._items, self._rope.places
        near = np.clip(places[:, None] + np.array([-0.5, 0.5]), 0.0, cable.unstrained_length)
        points = simulation.cable_positions(places)[:, [0, 2]]
        ends = simulation.cable_positions(near.ravel())[:, [0, 2]].reshape(-1, 2, 2)
        slopes = (ends[:, 1] - ends[:, 0]) / (near[:, 1] - near[:, 0])[:, None]
        for place, point, slope in zip(places, points, slopes, strict=True):
            reference = np.array([place, 0.0])
            initial = [*(point - reference), *(slope - [1.0, 0.0])]
            node = items.NodePoint2DSlope1(referenceCoordinates=[*reference, 1.0, 0.0], initialCoordinates=initial)
            self._nodes.append(system.AddNode(node))
        self._markers = [system.AddMarker(items.MarkerNodePosition(nodeNumber=node)) for node in self._nodes]
        for index, length in enumerate(np.diff(places)):
            element = items.ObjectANCFCable2D(
                length=float(length),
                massPerLength=cable.mass_per_length,
                bendingStiffness=cable.bending_stiffness,
                axialStiffness=cable.axial_stiffness,
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
            markerNumbers=[still, moving],
            scalingMarker0=[],
            scalingMarker1=across,
            offset=across @ np.array(start.position, dtype=float)[[0, -1]],
        )
        system.AddObject(line)

    def _add_carriage(self, simulation: Simulation) -> None:
        carriage, system, items = self._carriage, self._system, self._items
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
            arm = np.array(body.upper_pivot, dtype=float)[[0, -1]] - centre
            upper, self._middle = (
                system.AddMarker(items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[*place, 0.0]))
                for place in (arm, np.zeros(2))
            )
            load = [0.0, -mass * self._scenario.gravity, 0.0]
            system.AddLoad(items.LoadForceVector(markerNumber=self._middle, loadVector=load))
            self._mass, self._area = self._mass + mass, body.drag_area
            if above is None:
                self._grip, self._arm, self._body_reference = upper, arm, np.array([*at, turn])
            else:
                system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[above, upper]))
            if body.lower_pivot is not None:
                pivot = np.array(body.lower_pivot, dtype=float)[[0, -1]] - centre
                above = system.AddMarker(items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[*pivot, 0.0]))
            self._bodies.append(node)

    def _add_joint(self) -> None:
        """One constraint for each element, of which that below the carriage is active."""
        system, items = self._system, self._items
        self._running = system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=self._bodies[0]))
        self._joints = []
        for cable in self._cables:
            element = system.AddMarker(items.MarkerObjectODE2Coordinates(objectNumber=cable))
            joint = items.ObjectConnectorCoordinateVector(
                markerNumbers=[self._running, element],
                scalingMarker0=np.zeros((1, 3)),
                scalingMarker1=np.zeros((1, 8)),
                offset=[0.0],
                activeConnector=False,
            )
            self._joints.append(system.AddObject(joint))

    def _add_haul_rope(self) -> None:
        """Mass and spring of the haul rope on a coordinate of its own, which goes where the carriage goes."""
        system, items = self._system, self._items
        self._hauled = system.AddNode(items.Node1D())
        self._haul_mass = system.AddObject(items.ObjectMass1D(mass=1.0, nodeNumber=self._hauled))
        way = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=self._hauled, coordinate=0))
        self._spring = system.AddObject(items.ObjectConnectorCoordinateSpringDamper(markerNumbers=[self._held, way]))
        self._on_haul = system.AddLoad(items.LoadCoordinate(markerNumber=way, load=0.0))
        haul = items.ObjectConnectorCoordinateVector(
            markerNumbers=[self._running, system.AddMarker(items.MarkerNodeCoordinates(nodeNumber=self._hauled))],
            scalingMarker0=np.zeros((1, 3)),
            scalingMarker1=np.ones((1, 1)),
            offset=[0.0],
        )
        self._haul = system.AddObject(haul)
