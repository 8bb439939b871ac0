"""A scenario in space as a model of Exudyn: `ANCFCable` and `ObjectJointSliding`, its elements with three coordinates.

Axes are the same as ours. The joint leaves all turns free, where ours keeps the heading along the rope; a vehicle whose
three moments of inertia are the same moves alike.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from benchmarks.exudyn_model import ExudynModel, nodal_shape
from cable_twin.frame.records import FloatArray
from cable_twin.simulation import Simulation


class SpatialModel(ExudynModel):
    """One scenario in space in Exudyn, to be run once; point loads of the scenario set in at its start.

    Takes what `ExudynModel` does; the loads have to be at nodes.
    """

    def shape(self) -> FloatArray:
        """Nodes (nodes, 3) in m now."""
        output = self._exudyn.OutputVariableType.Position
        return np.array([self._system.GetNodeOutput(node, output) for node in self._nodes])

    def positions(self) -> dict[str, FloatArray]:
        """Upper pivot (3,) in m of each carriage now."""
        output = self._exudyn.OutputVariableType.Position
        return {
            name: np.array(self._system.GetObjectOutputBody(body, output, localPosition=pivot))
            for name, (body, pivot) in self._joints.items()
        }

    def _add_cable(self, simulation: Simulation) -> list[Any]:
        """Nodes, elements, gravity, loads and pinned ends; returns the elements."""
        cable, system, items = self._scenario.cable, self._system, self._items
        length = cable.unstrained_length / cable.elements
        positions, slopes = nodal_shape(simulation, axes=[0, 1, 2])
        straight = np.array([1.0, 0.0, 0.0])
        self._nodes = []
        for index, (position, slope) in enumerate(zip(positions, slopes, strict=True)):
            reference = np.array([index * length, 0.0, 0.0])
            initial = [*(position - reference), *(slope - straight)]
            self._nodes.append(
                system.AddNode(
                    items.NodePointSlope1(referenceCoordinates=[*reference, *straight], initialCoordinates=initial)
                )
            )
        elements = []
        for pair in pairwise(self._nodes):
            element = system.AddObject(
                items.ObjectANCFCable(
                    length=length,
                    massPerLength=cable.mass_per_length,
                    bendingStiffness=cable.bending_stiffness,
                    axialStiffness=cable.axial_stiffness,
                    bendingDamping=cable.damping_time * cable.bending_stiffness,
                    axialDamping=cable.damping_time * cable.axial_stiffness,
                    nodeNumbers=list(pair),
                    useReducedOrderIntegration=1,  # 4 Gauss points, as ours
                )
            )
            elements.append(element)
            marker = system.AddMarker(items.MarkerBodyMass(bodyNumber=element))
            system.AddLoad(items.LoadMassProportional(markerNumber=marker, loadVector=[0, 0, -self._scenario.gravity]))
        for load in cable.loads:
            marker = system.AddMarker(items.MarkerNodePosition(nodeNumber=self._nodes[round(load.arc_length / length)]))
            system.AddLoad(items.LoadForceVector(markerNumber=marker, loadVector=list(load.force)))
        ground = system.AddMarker(
            items.MarkerNodeCoordinate(nodeNumber=system.AddNode(items.NodePointGround()), coordinate=0)
        )
        for node in (self._nodes[0], self._nodes[-1]):
            for coordinate in range(3):
                held = system.AddMarker(items.MarkerNodeCoordinate(nodeNumber=node, coordinate=coordinate))
                offset = system.GetNode(node)["initialCoordinates"][coordinate]
                system.AddObject(items.ObjectConnectorCoordinate(markerNumbers=[ground, held], offset=offset))
        return elements

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
