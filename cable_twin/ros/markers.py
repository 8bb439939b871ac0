"""Topic `markers`: the twin for RViz and Foxglove, without own message types.

Rope coloured by tension, ground, masts and stations with their names, vehicles, and forces as arrows. Names and numbers
of markers stay unchanged for a whole run, so each message replaces the previous one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import Any

import numpy as np
from rosbags.typesys.stores import ros2_jazzy

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.geometry.bodies import body_box
from cable_twin.geometry.bullwheel_rims import wheel_rims
from cable_twin.geometry.ground import default_ground
from cable_twin.messages.cdr import STAMP, Header, Template, marks
from cable_twin.messages.topics import MarkerArray
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.outlines import body_outline
from cable_twin.view.labels import NEAR, apart, shared_names
from cable_twin.view.tension_colors import RopeColors

Marker = ros2_jazzy.visualization_msgs__msg__Marker
MeshFile = ros2_jazzy.visualization_msgs__msg__MeshFile
CompressedImage = ros2_jazzy.sensor_msgs__msg__CompressedImage
ColorRGBA = ros2_jazzy.std_msgs__msg__ColorRGBA
Duration = ros2_jazzy.builtin_interfaces__msg__Duration
Point = ros2_jazzy.geometry_msgs__msg__Point
Vector3 = ros2_jazzy.geometry_msgs__msg__Vector3
Quaternion = ros2_jazzy.geometry_msgs__msg__Quaternion
Pose = ros2_jazzy.geometry_msgs__msg__Pose

LIFETIME = 3  # s for which a marker is shown after its last message, so that none stays after the end of a twin
REPEAT = 1.0  # s after which markers are repeated, so that a paused twin stays visible
LONGEST = 0.08  # length of the longest arrow at the start, of vehicles and of supports, over the span of the ropes
LETTER = 0.6  # width of a letter over the height of its text
LEAST = 1e-4  # length of an arrow without a force over the span, as one without length has no direction
GROUND, STATIC, BODY = (0.52, 0.45, 0.36, 1.0), (0.45, 0.49, 0.56, 1.0), (0.18, 0.56, 0.89, 1.0)
WHEEL = (0.60, 0.43, 0.88, 1.0)
LINE, FORCE, REACTION = (0.78, 0.49, 0.0, 1.0), (0.88, 0.32, 0.35, 1.0), (0.60, 0.43, 0.88, 1.0)
ORIGIN, UPRIGHT = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)


class Markers:
    """Message of all markers of a twin for RViz, filled from the arrays of values of each frame."""

    def __init__(self, scenario: Scenario, layout: Layout, columns: Columns, frame_id: str) -> None:
        """Prepare the markers for RViz of a scenario.

        Args:
            scenario: running scenario.
            layout: layout of its frames.
            columns: columns of the shown frame; the first frame sets the scale of arrows and colours.
            frame_id: name of the fixed frame.
        """
        self._columns, self._layout = columns, layout
        self._header = Header(STAMP, frame_id)
        self._span = max(float(np.ptp(columns.rope_position[:, axis])) for axis in range(3))
        rope = len(layout.arc_lengths) + len(layout.joints)
        self._rope, self._colors = np.empty((rope, 3)), np.empty((rope, 4))
        self._tension_colors = RopeColors(layout.ropes)
        self._tension_colors.widen(columns.rope_tension)
        bodies = [body for vehicle in scenario.vehicles.values() for body in vehicle.bodies.values()]
        boxes = [body_box(body) for body in bodies]
        self._boxed = [row for row, box in enumerate(boxes) if box is not None]
        self._box_position, self._box_turn = np.empty((len(self._boxed), 3)), np.empty((len(self._boxed), 4))
        self._towers = [scenario.tower_places[name] for name in layout.towers]
        counts = [np.sum(layout.sample_ropes == n) + np.sum(layout.joints[:, 0] == n) for n in range(len(layout.ropes))]
        self._ropes = [slice(last - count, last) for count, last in zip(counts, np.cumsum(counts), strict=True)]
        self._rope_of_points = np.repeat(np.arange(len(counts)), counts)
        width = max(len(name.encode()) for name in layout.ropes) + 40
        # padded, so that a text keeps its length while its numbers change
        self._captions = [f"tension colours {n}".ljust(width) for n in range(len(counts) if len(counts) > 1 else 0)]
        self._arrows = np.empty((len(layout.vehicles) + len(layout.supports), 2, 3))
        self._scales = self._scales_of_forces()
        self._sources = [
            self._rope,
            columns.body_position,
            columns.body_orientation,
            self._box_position,
            self._box_turn,
            self._arrows,
        ]
        places, *rest = self._marks()
        markers: list[Any] = [  # mypy knows another class
            *(
                self._marker("rope", n, Marker.LINE_STRIP, (self._width(scenario), 0, 0), STATIC, points=places[part])
                for n, part in enumerate(self._ropes)
            ),
            *self._static(scenario),
            *self._legend(),
            *(
                self._marker("wheels", row, Marker.LINE_STRIP, (0.001 * self._span, 0, 0), WHEEL, points=rim)
                for row, rim in enumerate(wheel_rims(scenario).values())
            ),
            *self._bodies(scenario, [box for box in boxes if box is not None], rest),
            *self._forces(rest[4]),
        ]
        colors = marks(self._colors.size, "<f4").reshape(-1, 4)
        for marker, part in zip(markers, self._ropes, strict=False):
            marker.colors = [ColorRGBA(*color) for color in colors[part]]
        self._template = Template(MarkerArray(markers), self._sources, singles=[self._colors])

    def fill(self, stamp_ns: int) -> bytes:
        """Encode the message of all markers, with a stamp (ns), from the arrays of values of the newest frame."""
        c = self._columns
        self._fill_rope(c)
        np.take(c.body_position, self._boxed, axis=0, out=self._box_position)
        np.take(c.body_orientation, self._boxed, axis=0, out=self._box_turn)
        self._arrows[:, 0] = self._points_of_action()
        self._arrows[:, 1] = self._arrows[:, 0] + self._scales[:, None] * np.vstack([c.contact_force, c.support_force])
        self._arrows[:, 1, 2] += LEAST * self._span
        message = self._template.fill(stamp_ns)
        for place, caption in zip(self._captions, self._tension_colors.captions("kN", 1e-3), strict=False):
            message = message.replace(place.encode(), caption.encode().ljust(len(place))[: len(place)])
        return message

    def _fill_rope(self, c: Columns) -> None:
        """Fill points and colours of the rope: samples and attached joints, in order along the rope."""
        layout = self._layout
        rope, vehicle = layout.joints.T
        last = np.array([part.stop - 1 for part in layout.ropes.values()])[rope]  # of its own rope
        on_rope = (c.attached[vehicle] == 1.0) & (c.vehicle_rope[vehicle] == rope)
        on_rope &= (c.arc_length[vehicle] >= 0.0) & (c.arc_length[vehicle] <= layout.arc_lengths[last])
        arc_lengths = layout.arc_lengths + layout.rope_offsets[layout.sample_ropes]
        places = np.where(on_rope, c.arc_length[vehicle], layout.arc_lengths[last]) + layout.rope_offsets[rope]
        joints = np.where(on_rope[:, None], c.joint_position[vehicle], c.rope_position[last])
        order = np.argsort(np.concatenate([arc_lengths, places]), kind="stable")
        self._rope[:] = np.vstack([c.rope_position, joints])[order]
        self._tension_colors.widen(c.rope_tension)
        tensions = np.concatenate([c.rope_tension, np.interp(places, arc_lengths, c.rope_tension)])
        self._colors[:] = self._tension_colors.rgba(tensions[order], self._rope_of_points)

    def _points_of_action(self) -> FloatArray:
        """Points of action (vehicles + supports, 3) of forces, in m: joints, ends of ropes, towers."""
        c, layout = self._columns, self._layout
        supports = np.empty((len(layout.supports), 3))
        supports[layout.tower_rows] = np.array(self._towers).reshape(-1, 3)
        for name, sample in layout.end_samples.items():
            supports[layout.support_rows[name]] = c.rope_position[sample]
        return np.vstack([c.joint_position, supports])

    def _scales_of_forces(self) -> FloatArray:
        """Arrow length per force (vehicles + supports,) in m/N, one for all vehicles and one for all supports."""
        c = self._columns
        scales = []
        for forces in (c.contact_force, c.support_force):
            greatest = float(np.nan_to_num(np.linalg.norm(forces, axis=1)).max(initial=0.0)) or 1.0
            scales += [LONGEST * self._span / greatest] * len(forces)
        return np.array(scales)

    def _width(self, scenario: Scenario) -> float:
        """Line width (m) of the rope, at least a visible share of its whole length."""
        return max(scenario.cable.diameter or 0.0, 5e-4 * self._span)

    def _marks(self) -> list[FloatArray]:
        """Placeholder values of the message template: for each source array, an array of the same shape."""
        numbers = marks(sum(source.size for source in self._sources))
        ends = np.cumsum([source.size for source in self._sources])[:-1]
        return [part.reshape(source.shape) for part, source in zip(np.split(numbers, ends), self._sources, strict=True)]

    def _static(self, scenario: Scenario) -> list[Marker]:
        """Markers of ground, masts, stations and their names."""
        c = self._columns
        ground = np.array(scenario.terrain, dtype=np.float64).reshape(-1, 2)
        if not len(ground):
            reached = [np.vstack([joint, c.body_position]) for joint in c.joint_position]
            ground = default_ground(c.rope_position[:, ::2], [points[:, ::2] for points in reached])
        half, mast = 0.02 * self._span, 0.002 * self._span
        ropes = scenario.cables
        ends = [scenario.placed(name, end.position) for name, rope in ropes.items() for end in (rope.start, rope.end)]
        names = [*self._layout.end_samples, *self._layout.towers]
        sides = [y for _, y, _ in (*ends, *self._towers)]
        left, right = ([(x, side, z) for x, z in ground] for side in (min(sides) - half, max(sides) + half))
        corners = [
            (*left[k], *right[k], *left[k + 1], *right[k], *right[k + 1], *left[k + 1]) for k in range(len(ground) - 1)
        ]
        points = np.array(corners).reshape(-1, 3)
        markers = [self._marker("ground", 0, Marker.TRIANGLE_LIST, (1.0, 1.0, 1.0), GROUND, points=points)]
        places: dict[str, tuple[float, float, float]] = {}
        for row, (x, y, z) in enumerate(chain(ends, self._towers)):
            foot = float(np.interp(x, ground[:, 0], ground[:, 1]))
            top, wide = max(z, foot + mast), 3.0 * mast if row < len(ends) else mast
            box = (wide, 2.0 * wide, top - foot)
            markers.append(self._marker("supports", row, Marker.CUBE, box, STATIC, place=(x, y, 0.5 * (top + foot))))
            places[names[row]] = (x, y, top + 6.0 * mast)
        together = shared_names(places, wheel_rims(scenario), self._layout.ropes, NEAR * self._span)
        high = 4.0 * mast
        tops = np.array(list(together.values())).reshape(-1, 3)
        sizes = np.array([(LETTER * high * len(text), 1.2 * high) for text in together]).reshape(-1, 2)
        tops[:, ::2] = apart(tops[:, ::2], sizes)  # stacked, as seen from the side
        for row, (text, place) in enumerate(zip(together, tops, strict=True)):
            name = self._marker("names", row, Marker.TEXT_VIEW_FACING, (0, 0, high), STATIC, place=place)
            name.text = text
            markers.append(name)
        return markers

    def _legend(self) -> list[Marker]:
        """Markers of the colour scale of several ropes: a text for each rope above the start of the track."""
        x, y, _ = self._columns.rope_position.min(axis=0)
        top, high = float(self._columns.rope_position[:, 2].max()), 0.012 * self._span
        markers = []
        for row, caption in enumerate(self._captions):
            place = (x, y, top + high * (2.0 + 1.5 * row))
            text = self._marker("tension_colors", row, Marker.TEXT_VIEW_FACING, (0, 0, high), STATIC, place=place)
            text.text = caption
            markers.append(text)
        return markers

    def _bodies(self, scenario: Scenario, boxes: Sequence[FloatArray], marked: Sequence[FloatArray]) -> list[Marker]:
        """Markers of each body: its outline, and a box where the body has an extent."""
        bodies = [body for vehicle in scenario.vehicles.values() for body in vehicle.bodies.values()]
        markers = []
        for row, (body, place, turn) in enumerate(zip(bodies, marked[0], marked[1], strict=True)):
            line = np.insert(body_outline(body), 1, 0.0, axis=1)
            thick = (0.03 * float(np.ptp(line, axis=0).max()), 0, 0)
            markers.append(self._marker("outlines", row, Marker.LINE_STRIP, thick, LINE, place, turn, line))
        for row, size, place, turn in zip(self._boxed, boxes, marked[2], marked[3], strict=True):
            markers.append(self._marker("bodies", row, Marker.CUBE, size, BODY, place, turn))
        return markers

    def _forces(self, arrows: FloatArray) -> list[Marker]:
        """Markers of forces as arrows: of the rope on vehicles, and of supports on the rope."""
        thick = (0.002 * self._span, 0.005 * self._span, 0.0)  # m, of shaft and head
        count = len(self._layout.vehicles)
        return [
            self._marker("vehicle_forces", row, Marker.ARROW, thick, FORCE, points=arrow)
            if row < count
            else self._marker("support_forces", row - count, Marker.ARROW, thick, REACTION, points=arrow)
            for row, arrow in enumerate(arrows)
        ]

    def _marker(
        self,
        namespace: str,
        number: int,
        kind: int,
        scale: Sequence[float] | FloatArray,
        color: Sequence[float],
        place: Sequence[float] | FloatArray = ORIGIN,
        turn: Sequence[float] | FloatArray = UPRIGHT,
        points: FloatArray | None = None,
    ) -> Marker:
        """Marker at a place (3,) in m with a rotation (4,), with points (n, 3) in m relative to it."""
        return Marker(
            header=self._header,
            ns=namespace,
            id=number,
            type=kind,
            action=Marker.ADD,
            pose=Pose(Point(*map(float, place)), Quaternion(*map(float, turn))),
            scale=Vector3(*map(float, scale)),
            color=ColorRGBA(*color),
            lifetime=Duration(LIFETIME, 0),
            frame_locked=False,
            points=[] if points is None else [Point(*map(float, point)) for point in points],
            colors=[],
            texture_resource="",
            texture=CompressedImage(self._header, "", np.zeros(0, np.uint8)),
            uv_coordinates=[],
            text="",
            mesh_resource="",
            mesh_file=MeshFile("", np.zeros(0, np.uint8)),
            mesh_use_embedded_materials=False,
        )
