"""Model of a scenario in Exudyn: equal mesh, elements, rigid bodies, and start at rest.

Exudyn's `ANCFCable2D` is the same element as ours: cubic in the position, strain |r_x| - 1, material curvature. It is
planar in x and y, where ours is in x and z, and turns the other way round. Every carriage hangs from the cable by an
`ObjectJointSliding2D`, every further body from the one before it by a `RevoluteJoint2D`.
"""

from __future__ import annotations

import contextlib
import io
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation


@dataclass(frozen=True, slots=True)
class Setting:
    """Settings of Exudyn's solver that matter here.

    Its modified Newton method keeps a Jacobian for some iterations while the residual contracts.
    """

    name: str
    classical_joint: bool  # its default: the contact force is unknown and has no component along the cable
    contractivity: float  # -, largest ratio of two residuals with one Jacobian
    kept_iterations: int  # with one Jacobian
    tolerance: float = 1e-6  # of the residual, absolute and relative to its first value
    modified: bool = True  # or a new Jacobian in each iteration, as Exudyn comes


DEFAULT_JOINT = Setting("Exudyn, default joint", True, 0.5, 8)  # Newton as Exudyn has it by default
ACCURATE = Setting("Exudyn, accurate joint", False, 0.7, 12)  # a tenth faster with this joint


def load_exudyn() -> Any:
    """Exudyn in its variant without range checks, or None where it is not installed."""
    sys.exudynFast = True  # type: ignore[attr-defined]  # its own switch, read on the first import
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            import exudyn  # noqa: PLC0415 - optional
    except ImportError:
        return None
    exudyn.config.printToConsole = False
    return exudyn


class ExudynModel:
    """Planar scenario in Exudyn, for a single run.

    Args:
        exudyn: the module, as `load_exudyn` gives it.
        simulation: ours at its start, from which the static equilibrium is taken.
        setting: how it is solved.
    """

    AXES: Sequence[int] = (0, 2)  # of ours

    def __init__(self, exudyn: Any, simulation: Simulation, setting: Setting) -> None:
        from exudyn import itemInterface as items  # noqa: PLC0415, N813 - optional

        self._exudyn, self._items, self._setting = exudyn, items, setting
        self._scenario: Scenario = simulation.scenario
        self._container = exudyn.SystemContainer()
        self._system = self._container.AddSystem()
        self._ground = self._system.AddObject(items.ObjectGround())
        self._nodes: list[Any] = []
        cables = self._add_cable(simulation)
        self._joints = {name: self._add_carriage(name, simulation, cables) for name in self._scenario.carriages}
        self._system.Assemble()

    def run(self, duration: float) -> None:
        """Integrate from the start for `duration` (s).

        Raises:
            RuntimeError: Exudyn gave up.
        """
        settings, setting, solver = self._exudyn.SimulationSettings(), self._setting, self._scenario.solver
        settings.timeIntegration.endTime = duration
        settings.timeIntegration.numberOfSteps = round(duration / solver.step)
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.generalizedAlpha.spectralRadius = solver.spectral_radius
        settings.timeIntegration.generalizedAlpha.computeInitialAccelerations = True  # as ours
        newton = settings.timeIntegration.newton
        newton.relativeTolerance = newton.absoluteTolerance = setting.tolerance
        newton.useModifiedNewton = setting.modified
        newton.modifiedNewtonContractivity = setting.contractivity
        newton.maxModifiedNewtonIterations = setting.kept_iterations
        newton.maxModifiedNewtonRestartIterations = max(7, setting.kept_iterations - 1)
        settings.solution.file.write = False
        settings.parallel.numberOfThreads = 1
        settings.linearSolver.solverType = self._exudyn.LinearSolverType.EigenSparse
        settings.linearSolver.reuseAnalyzedPattern = True
        self._system.SolveDynamic(settings)

    @property
    def iterations(self) -> int:
        """Newton iterations of the run."""
        return self._system.sys["dynamicSolver"].it.newtonStepsCount

    def positions(self) -> dict[str, FloatArray]:
        """Present position (3,) in m of each joint, in the axes of this package."""
        output = self._exudyn.OutputVariableType.Position
        places = {name: self._system.GetObjectOutput(joint, output) for name, joint in self._joints.items()}
        return {name: np.array([x, 0.0, y]) for name, (x, y, _) in places.items()}

    def _add_cable(self, simulation: Simulation) -> list[Any]:
        """Nodes, elements, gravity, point loads at nodes and pinned ends; returns the elements."""
        cable, system, items, dim = self._scenario.cable, self._system, self._items, len(self.AXES)
        node_kind = items.NodePoint2DSlope1 if dim == 2 else items.NodePointSlope1
        element_kind = items.ObjectANCFCable2D if dim == 2 else items.ObjectANCFCable
        length, straight = cable.unstrained_length / cable.elements, np.eye(dim)[0]
        down = -self._scenario.gravity * np.eye(3)[dim - 1]
        ground = system.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
        )
        for index, (position, slope) in enumerate(zip(*nodal_shape(simulation, self.AXES), strict=True)):
            reference = index * length * straight
            initial = [*(position - reference), *(slope - straight)]
            node = node_kind(referenceCoordinates=[*reference, *straight], initialCoordinates=initial)
            self._nodes.append(system.AddNode(node))
        elements = []
        for pair in pairwise(self._nodes):
            element = system.AddObject(
                element_kind(
                    length=length,
                    massPerLength=cable.mass_per_length,
                    bendingStiffness=cable.bending_stiffness,
                    axialStiffness=cable.axial_stiffness,
                    bendingDamping=cable.damping_time * cable.bending_stiffness,
                    axialDamping=cable.damping_time * cable.axial_stiffness,
                    nodeNumbers=list(pair),
                    useReducedOrderIntegration=1,  # 4 Gauss points, as ours; its default has 5 and is slower
                )
            )
            elements.append(element)
            marker = system.AddMarker(items.MarkerBodyMass(bodyNumber=element))
            system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=down.tolist()))
        for load in cable.loads:
            marker = system.AddMarker(items.MarkerNodePosition(nodeNumber=self._nodes[round(load.arc_length / length)]))
            force = [*load.force, 0.0][:3]
            system.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=force))
        for node in (self._nodes[0], self._nodes[-1]):
            for coordinate in range(dim):
                held = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
                offset = system.GetNode(node)["initialCoordinates"][coordinate]
                system.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[ground, held], offset=offset))
        return elements

    def _add_carriage(self, name: str, simulation: Simulation, cables: list[Any]) -> Any:
        """Bodies and joints of one carriage; returns its sliding joint."""
        cable, carriage, system, items = self._scenario.cable, self._scenario.carriages[name], self._system, self._items
        length = cable.unstrained_length / cable.elements
        state = simulation.snapshot.carriages[name]
        first, above = None, None
        for body_name, body in carriage.bodies.items():
            place = state.bodies[body_name]
            node = system.AddNode(items.NodeRigidBody2D(referenceCoordinates=[place.x, place.z, -place.pitch]))
            rigid = system.AddObject(items.ObjectRigidBody2D(mass=body.mass, inertia=body.inertia, nodeNumber=node))
            upper = system.AddMarker(items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[*body.upper_pivot, 0]))
            centre = system.AddMarker(items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[0, 0, 0]))
            weight = [0, -body.mass * self._scenario.gravity, 0]
            system.AddLoad(items.LoadForceVector(markerNumber=centre, loadVector=weight))
            if above is not None:
                system.AddObject(items.ObjectJointRevolute2D(markerNumbers=[above, upper]))
            if first is None:
                first = upper
            if body.lower_pivot is not None:
                above = system.AddMarker(
                    items.MarkerBodyPosition(bodyNumber=rigid, localPosition=[*body.lower_pivot, 0])
                )
        markers = [system.AddMarker(items.MarkerBodyCable2DCoordinates(bodyNumber=item)) for item in cables]
        element = min(int(carriage.arc_length / length), cable.elements - 1)
        data = system.AddNode(
            items.NodeGenericData(initialCoordinates=[element, carriage.arc_length], numberOfDataCoordinates=2)
        )
        return system.AddObject(
            items.ObjectJointSliding2D(
                markerNumbers=[first, markers[element]],
                slidingMarkerNumbers=markers,
                slidingMarkerOffsets=[index * length for index in range(cable.elements)],
                nodeNumber=data,
                useClassicalFormulation=self._setting.classical_joint,
            )
        )


class SpatialModel(ExudynModel):
    """Spatial scenario in Exudyn for a single run, by `ANCFCable` and `ObjectJointSliding`.

    The joint leaves all turns free, where ours keeps the heading along the rope; a vehicle whose three moments of
    inertia are alike moves alike.
    """

    AXES = (0, 1, 2)

    def shape(self) -> FloatArray:
        """Present positions (nodes, 3) in m of the nodes."""
        output = self._exudyn.OutputVariableType.Position
        return np.array([self._system.GetNodeOutput(node, output) for node in self._nodes])

    def positions(self) -> dict[str, FloatArray]:
        """Present position (3,) in m of the upper pivot of each carriage."""
        output = self._exudyn.OutputVariableType.Position
        return {
            name: np.array(self._system.GetObjectOutputBody(body, output, localPosition=pivot))
            for name, (body, pivot) in self._joints.items()
        }

    def _add_carriage(self, name: str, simulation: Simulation, cables: list[Any]) -> Any:
        """The body of one carriage and its joint; returns the body and its upper pivot."""
        cable, carriage, system, items = self._scenario.cable, self._scenario.carriages[name], self._system, self._items
        ((body_name, body),) = carriage.bodies.items()
        length = cable.unstrained_length / cable.elements
        place = simulation.snapshot.carriages[name].bodies[body_name].position
        node = system.AddNode(items.NodeRigidBodyRxyz(referenceCoordinates=[*place, 0, 0, 0]))
        inertia = [body.inertia, body.inertia, body.inertia, 0, 0, 0]
        rigid = system.AddObject(items.ObjectRigidBody(mass=body.mass, inertia=inertia, nodeNumber=node))
        pivot = [body.upper_pivot[0], 0, body.upper_pivot[-1]]
        upper = system.AddMarker(items.MarkerBodyRigid(bodyNumber=rigid, localPosition=pivot))
        centre = system.AddMarker(items.MarkerBodyMass(bodyNumber=rigid))
        system.AddLoad(items.LoadMassProportional(markerNumber=centre, loadVector=[0, 0, -self._scenario.gravity]))
        markers = [system.AddMarker(items.MarkerBodyBeamShape(bodyNumber=item)) for item in cables]
        element = min(int(carriage.arc_length / length), cable.elements - 1)
        data = system.AddNode(
            items.NodeGenericData(initialCoordinates=[element, carriage.arc_length], numberOfDataCoordinates=2)
        )
        system.AddObject(
            items.ObjectJointSliding(
                markerNumbers=[upper, markers[element]],
                slidingMarkerNumbers=markers,
                slidingMarkerOffsets=[index * length for index in range(cable.elements)],
                nodeNumber=data,
                constrainRotations=[0, 0, 0],
            )
        )
        return rigid, pivot


def nodal_shape(simulation: Simulation, axes: Sequence[int]) -> tuple[FloatArray, FloatArray]:
    """Present nodes of the cable: `axes` of places (nodes, 2) in m and of slopes r_x, exact for cubic elements."""
    cable = simulation.scenario.cable
    length = cable.unstrained_length / cable.elements
    points = simulation.cable_positions(np.linspace(0.0, cable.unstrained_length, 3 * cable.elements + 1))[:, axes]
    nodes = points[::3]
    ahead = np.array([-11.0, 18.0, -9.0, 2.0]) / (2.0 * length)  # one-sided third-order difference over a third
    slopes = sum(weight * points[k : points.shape[0] - 3 + k : 3] for k, weight in enumerate(ahead))
    last = -sum(weight * points[-1 - k] for k, weight in enumerate(ahead))
    return nodes, np.vstack([slopes, last])
