"""View of the track in its plane: ground, supports and masts, and vehicles."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.geometry.ground import default_ground
from cable_twin.view.batch import QUIET, entity_path, pixels, planar, plane, rows_without_gaps, send
from cable_twin.view.labels import NEAR, apart, label_sizes, shared_names

WHEEL = 0x9A6EE0FF
GROUND = 0x84735DFF
NAME_GAP = 3.0  # pixels between names, and from the ground
MARGIN = 6.0  # pixels around the scene
SMALLEST = 10.0  # largest factor by which a scene shrinks to leave room for labels
LEGENDS_BESIDE = (0.0, 0.5, 1.0)  # tried shares of the legend to the left of the scene; the best is taken
BAR, BAR_INDENT, BAR_HEIGHT = 210.0, 40.0, 10.0  # pixels of the bar of tension colours, with half a number at its ends
LABELS = 8  # largest number of vehicles with their names beside them
CLOSE_UPS = 6  # largest number of vehicles with a close-up
CARRIAGE_COLORS = (0xD05AA0FF, 0x2F8FE3FF, 0x2FA06AFF, 0xD9730DFF, 0x9A6EE0FF, 0xE0525AFF)
BODY_COLORS = (0xC77C00FF, 0x2F8FE3FF, 0x2FA06AFF, 0xE0525AFF, 0x9A6EE0FF)
CARRIERS = "track/carriers"
NAMES = "track/vehicle_names"
LIFT = 8.0  # pixels from a joint to the label with the name
LINES_TYPE = rr.components.LineStrip2DBatch([]).as_arrow_array().type


class Scene(NamedTuple):
    """Initial scene of the track's plane: points of cable, vehicles, supports and ground."""

    cable: FloatArray  # (n, 2) m, x and z
    vehicles: list[FloatArray]  # of each (m, 2) m, its joint and then its bodies
    supports: Mapping[str, FloatArray]  # (2,) m
    ground: FloatArray  # (k, 2) m


def scene_of(
    cable: FloatArray,
    vehicles: list[FloatArray],
    end_samples: Mapping[str, int],
    support_positions: Mapping[str, FloatArray],
    ground: FloatArray | None,
) -> Scene:
    """Return the scene around a cable (n, 2) m, NaN allowed, with named cable ends given by sample index."""
    cable = cable[~np.isnan(cable).any(axis=1)]
    if len(cable) < 2:  # unknown
        cable = np.vstack([(0.0, 0.0), (1.0, 0.0), *support_positions.values()])
    ends = {name: cable[min(index, len(cable) - 1)] for name, index in end_samples.items()}
    known = [points for points in vehicles if len(points)]
    ground = default_ground(cable, known) if ground is None else ground
    return Scene(cable, known, {**ends, **support_positions}, ground)


def extent(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner (2,) m of a scene."""
    points = np.vstack([scene.cable, *scene.vehicles, scene.ground])
    return points.min(axis=0), points.max(axis=0)


class Framed(NamedTuple):
    """Scene with its labels, framed for the view of the whole track."""

    pixel: float  # m, size of a pixel of the smallest screen
    names: Mapping[str, FloatArray]  # (2,) m, middle of the upper side of each label of supports
    legend: tuple[float, float, float]  # m: x and z of the left end of the colour bar, and its width
    taken: FloatArray  # (n, 4) pixels of these labels: middle and lower side, upwards; width and height
    low: FloatArray  # (2,) m, lower left corner of the view
    high: FloatArray  # (2,) m, upper right corner


def framed(
    scene: Scene,
    size: tuple[float, float],
    wheels: Mapping[str, FloatArray],
    ropes: Collection[str],
    legend: tuple[float, float],
    above: float,
) -> Framed:
    """Return label positions and view range, with room for everything and no label covering another.

    Args:
        scene: shown scene.
        size: width and height of the view in pixels.
        wheels: name -> (n, 3) m, rim of each bullwheel.
        ropes: names of the ropes.
        legend: width and height in pixels of the labels of the colours, at the upper left below their bar.
        above: pixels kept free above the rope for names of vehicles.
    """
    low, high = extent(scene)
    feet = {name: np.array([x, np.interp(x, *scene.ground.T)]) for name, (x, _) in scene.supports.items()}
    together = shared_names(feet, wheels, ropes, NEAR * float(max(high - low)))
    label = label_sizes(list(together))
    places = plane(np.array(list(together.values())).reshape(-1, 2))
    corners, rope = plane(np.array([low, high])), plane(np.vstack([scene.cable, *scene.vehicles]))
    left, top = corners.min(axis=0)
    wide, deep = max(legend[0], BAR), legend[1] + BAR_HEIGHT
    tried = []
    for beside in LEGENDS_BESIDE:
        pixel = least = float(max(np.ptp(corners, axis=0) / size)) or 1.0
        for _ in range(50):  # the scene shrinks until the labels have room around it
            names = apart(places / pixel + (0.0, NAME_GAP), label + NAME_GAP)
            edge = left / pixel - beside * (wide + 2.0 * MARGIN)
            below = rope[rope[:, 0] < (edge + wide + 2.0 * MARGIN) * pixel, 1]
            bar = min(below.min(initial=np.inf) / pixel - above - deep, top / pixel)
            half = label * (0.5, 0.0)
            feet_of_names = names + (0.0, 1.0) * label
            boxes: list[ArrayLike] = [
                corners / pixel,
                names - half,
                feet_of_names + half,
                [(edge, bar), (edge + wide, bar + deep)],
            ]
            points: FloatArray = np.vstack(boxes)
            first, last = points.min(axis=0) - MARGIN, points.max(axis=0) + MARGIN
            first[1] = min(first[1], rope[:, 1].min() / pixel - above)
            share = float(max((last - first) / size))
            if share < 1.001 or pixel > SMALLEST * least:
                break
            pixel *= share
        shown = np.sort(plane(np.array([first, last])) * pixel, axis=0)
        start = edge + (wide - BAR) / 2.0 + BAR_INDENT
        tried.append(
            Framed(
                pixel,
                dict(zip(together, plane(names) * pixel, strict=True)),
                (start * pixel, -bar * pixel, (BAR - 2.0 * BAR_INDENT) * pixel),
                np.vstack(
                    [
                        np.hstack([names[:, :1], -feet_of_names[:, 1:], label]),
                        (edge + 0.5 * wide, -(bar + deep), wide, deep),
                    ]
                ),
                shown[0],
                shown[1],
            )
        )
    return min(tried, key=lambda one: one.pixel)


def draw_scene(
    stream: rr.RecordingStream, scene: Scene, names: Mapping[str, FloatArray], wheels: Mapping[str, FloatArray]
) -> None:
    """Log ground, supports and their masts, rims (n, 3) m of bullwheels, and names at places (2,) m."""
    ground, supports = scene.ground, scene.supports
    stream.log("track/ground", rr.LineStrips2D([plane(ground)], colors=[GROUND], radii=pixels(1.5)), static=True)
    masts = [[(x, z), (x, float(np.interp(x, ground[:, 0], ground[:, 1])))] for x, z in supports.values()]
    stream.log(
        "track/supports",
        rr.LineStrips2D([plane(np.array(mast)) for mast in masts], colors=[QUIET], radii=pixels(2.0)),
        rr.Points2D([plane(where) for where in supports.values()], colors=[QUIET], radii=pixels(5.0)),
        static=True,
    )
    if wheels:
        rims = rr.LineStrips2D([plane(planar(rim)) for rim in wheels.values()], colors=[WHEEL], radii=pixels(2.5))
        stream.log("track/wheels", rims, static=True)
    places = [plane(place) for place in names.values()]
    labels = rr.Points2D(places, colors=[QUIET], radii=[0.0], labels=list(names), show_labels=True)
    stream.log("track/names", labels, static=True)


class Outlines:
    """Outlines of bodies, all placed at once; bodies with equal outlines are grouped.

    Args:
        lines: (n, 2) m, outline of each body in its axes, in rerun's plane.

    Attributes:
        bodies: number of the body of each placed line.
        lengths: number of points of each placed line.
    """

    def __init__(self, lines: Sequence[FloatArray]) -> None:
        groups: dict[bytes, list[int]] = {}
        for body, line in enumerate(lines):
            groups.setdefault(line.tobytes(), []).append(body)
        self._groups = [(bodies, lines[bodies[0]].astype(np.float32)) for bodies in groups.values()]
        self.bodies = [body for bodies, _ in self._groups for body in bodies]
        self.lengths = [len(lines[body]) for body in self.bodies]

    def placed(self, positions: FloatArray, pitches: FloatArray) -> NDArray[np.float32]:
        """Return the outline points (frames, points, 2) in m of bodies at given positions and pitch angles.

        Positions (frames, bodies, 2) are in m, pitch angles (frames, bodies) in rad.
        """
        frames = len(positions)
        points = np.empty((frames, sum(self.lengths), 2), dtype=np.float32)
        first = 0
        for bodies, line in self._groups:
            count = len(bodies) * len(line)
            part = points[:, first : first + count].reshape(frames, len(bodies), len(line), 2)  # a view
            angles = pitches[:, bodies, None]
            cos, sin = np.cos(angles).astype(np.float32), np.sin(angles).astype(np.float32)
            place = positions[:, bodies, None].astype(np.float32)
            part[..., 0] = place[..., 0] + cos * line[:, 0] - sin * line[:, 1]
            part[..., 1] = place[..., 1] + sin * line[:, 0] + cos * line[:, 1]
            first += count
        return points


class Vehicles:
    """Drawing of all vehicles of a layout: carriages as entities of their own, carriers of one kind in one entity.

    Args:
        layout: layout of the frames.
        outlines: vehicle -> body -> outline (n, 2) m in the body's axes, in rerun's plane; a body without one is a dot.
        carriers: names of the vehicles that are drawn together.

    Attributes:
        close_ups: entity of each close-up -> reach (m) of the vehicle from its joint.
        boxes: entities that stand for vehicles in the view of the whole track only.
        followed: names of the vehicles with a close-up.
    """

    def __init__(
        self, layout: Layout, outlines: Mapping[str, Mapping[str, FloatArray]], carriers: Collection[str]
    ) -> None:
        self._names = [*layout.vehicles]
        self._spans = [range(first, last) for first, last in pairwise(layout.first_body)]
        self._body_names = [body for bodies in layout.vehicles.values() for body in bodies]
        self._lines = [outlines.get(name, {}).get(body) for name, bodies in layout.vehicles.items() for body in bodies]
        self._alone = [index for index, name in enumerate(self._names) if name not in carriers]
        self._together = [index for index, name in enumerate(self._names) if name in carriers]
        rows = [row for index in self._together for row in self._spans[index]]
        self._dots = [row for row in rows if self._lines[row] is None]
        self._joined_rows = [row for row in rows if self._lines[row] is not None]
        self._joined = Outlines([line for row in self._joined_rows if (line := self._lines[row]) is not None])
        spread = np.linspace(0, len(self._together), min(CLOSE_UPS, len(self._together)), endpoint=False, dtype=int)
        self._followed = {
            entity_path("track/close_ups", self._names[index]): index
            for index in (self._together[int(place)] for place in spread)
        }
        self._labelled = 0 < len(self._names) <= LABELS
        self._label_sizes = label_sizes(self._names)
        self._pixel, self._taken = 1.0, np.empty((0, 4))  # m; see `begin`
        self.followed = [self._names[index] for index in (*self._alone, *self._followed.values())][:CLOSE_UPS]
        self.close_ups: dict[str, float] = {}
        self.boxes = [
            entity_path(entity_path("track/carriages", self._names[index]), "(box)")
            for index in self._alone
            if self._spans[index]
        ]

    def points(self, c: Columns) -> list[FloatArray]:
        """Return the points (n, 2) m, x and z, of each vehicle in a frame: joint, then bodies; without NaN."""
        outlines = Outlines([np.zeros((1, 2)) if line is None else line for line in self._lines])
        bodies, pitches = plane(planar(c.body_position))[None], c.body_angles[None, :, 1]
        points = plane(outlines.placed(bodies, pitches)[0])
        owners = np.repeat(outlines.bodies, outlines.lengths)
        groups = [
            np.vstack([joint, points[(owners >= span.start) & (owners < span.stop)]])
            for joint, span in zip(planar(c.joint_position), self._spans, strict=True)
        ]
        return [group[~np.isnan(group).any(axis=1)] for group in groups]

    def begin(self, stream: rr.RecordingStream, c: Columns, pixel: float, taken: FloatArray) -> None:
        """Log static data of the vehicles in a first frame.

        Args:
            stream: stream of the recording.
            c: columns of that frame.
            pixel: size (m) of a pixel of the smallest screen.
            taken: (n, 4) pixels of other labels, see `apart`.
        """
        self._pixel, self._taken = pixel, taken
        if self._labelled:
            colors = _colors(CARRIAGE_COLORS, range(len(self._names)))
            names = rr.Points2D.from_fields(colors=colors, radii=[0.0], labels=self._names, show_labels=True)
            stream.log(NAMES, names, static=True)
        reaches = [_reach(points) for points in self.points(c)]
        self.close_ups = {}
        for index in self._alone:
            color = CARRIAGE_COLORS[index % len(CARRIAGE_COLORS)]
            path = entity_path("track/carriages", self._names[index])
            dot = rr.Points2D([(0.0, 0.0)], colors=[color], radii=pixels(4.5), draw_order=40.0)
            stream.log(path, dot, static=True)
            if (box := entity_path(path, "(box)")) in self.boxes:  # hung from a short line; large enough to be seen
                sides = np.array([(0, 0), (0, 1), (1, 1), (1, 3), (-1, 3), (-1, 1), (0, 1)]) * (4.0 * pixel)
                stream.log(box, rr.LineStrips2D([sides], colors=[color], radii=pixels(1.5)), static=True)
            for number, row in enumerate(self._spans[index]):
                tint = BODY_COLORS[number % len(BODY_COLORS)]
                line = self._lines[row]
                shape = (
                    rr.Points2D([(0.0, 0.0)], colors=[tint], radii=pixels(3.0))
                    if line is None
                    else rr.LineStrips2D([line], colors=[tint], radii=pixels(2.0))
                )
                stream.log(entity_path(path, self._body_names[row]), shape, static=True)
            self.close_ups[path] = reaches[index]
        if self._together:
            numbers = {row: number for span in self._spans for number, row in enumerate(span)}
            stream.log(
                CARRIERS,
                rr.LineStrips2D.from_fields(
                    colors=_colors(BODY_COLORS, [numbers[self._joined_rows[body]] for body in self._joined.bodies]),
                    radii=pixels(2.0),
                ),
                rr.Points2D.from_fields(
                    colors=_colors(CARRIAGE_COLORS, range(len(self._together))),
                    radii=pixels(3.5),
                    draw_order=40.0,
                ),
                static=True,
            )
            self.close_ups |= {path: reaches[index] for path, index in self._followed.items()}

    def send(self, stream: rr.RecordingStream, c: Columns, rows: NDArray[np.intp]) -> None:
        """Send the poses of vehicles in selected frames of a batch to a rerun recording."""
        times = c.time[rows, 0]
        joints = plane(planar(c.joint_position[rows]))
        bodies = plane(planar(c.body_position[rows]))
        pitches = c.body_angles[rows, :, 1]
        for index in self._alone:
            path = entity_path("track/carriages", self._names[index])
            _send_pose(stream, path, times, joints[:, index])
            for row in self._spans[index]:
                child = entity_path(path, self._body_names[row])
                _send_pose(stream, child, times, bodies[:, row] - joints[:, index], pitches[:, row])
        for path, index in self._followed.items():
            _send_pose(stream, path, times, joints[:, index])
        if self._labelled:
            self._send_names(stream, times, joints)
        if self._together:
            dots = np.concatenate([joints[:, self._together], bodies[:, self._dots]], axis=1)
            lines = self._joined.placed(bodies[:, self._joined_rows], pitches[:, self._joined_rows])
            self._send_joined(stream, times, dots, lines)

    @property
    def headroom(self) -> float:
        """Height (pixels) of vehicle names above a rope."""
        return LIFT + float(self._label_sizes[0, 1]) if self._labelled else 0.0

    def _send_names(self, stream: rr.RecordingStream, times: FloatArray, joints: FloatArray) -> None:
        """Send vehicle names above the joints (frames, vehicles, 2) in m, stacked without overlap."""
        known = rows_without_gaps(joints)
        if not known.any():
            return
        upwards = joints[known] / self._pixel * (1.0, -1.0) + (0.0, LIFT)
        feet = apart(upwards, self._label_sizes, self._taken)
        tops = (feet + (0.0, 1.0) * self._label_sizes) * (1.0, -1.0) * self._pixel
        places = rr.Points2D.columns(positions=tops.reshape(-1, 2).astype(np.float32))
        send(stream, NAMES, times[known], places, len(self._names))

    def _send_joined(
        self, stream: rr.RecordingStream, times: FloatArray, dots: FloatArray, points: NDArray[np.float32]
    ) -> None:
        """Send dots (frames, dots, 2) and outlines (frames, points, 2) in m of all carriers together."""
        known = rows_without_gaps(dots, points)
        frames = int(known.sum())
        if not frames:
            return
        offsets = np.concatenate(([0], np.cumsum(np.tile(self._joined.lengths, frames)))).astype(np.int32)
        flat = rr.components.Position2DBatch(points[known].reshape(-1, 2)).as_arrow_array()
        lines = rr.LineStrips2D.columns(strips=pa.ListArray.from_arrays(offsets, flat, type=LINES_TYPE))
        places = rr.Points2D.columns(positions=dots[known].reshape(-1, 2).astype(np.float32))
        columns = [column.partition([len(self._joined.lengths)] * frames) for column in lines]
        columns += [column.partition([dots.shape[1]] * frames) for column in places]
        send(stream, CARRIERS, times[known], columns)


def _colors(table: Sequence[int], numbers: Iterable[int]) -> NDArray[np.uint32]:
    """Return colours of a table by index as an array, as rerun takes three or four plain integers for one colour."""
    return np.array([table[number % len(table)] for number in numbers], dtype=np.uint32)


def _reach(points: FloatArray) -> float:
    """Return the largest distance (m) of points (n, 2) from the first one, at least a minimum above zero."""
    return max(float(np.hypot(*(points - points[:1]).T).max(initial=0.0)), 1e-3)


def _send_pose(
    stream: rr.RecordingStream,
    path: str,
    times: FloatArray,
    places: FloatArray,
    angles: FloatArray | None = None,
) -> None:
    """Send the poses of an entity: places (frames, 2) in m and angles (frames,) in rad."""
    known = rows_without_gaps(places) if angles is None else rows_without_gaps(places, angles)
    if not known.any():
        return
    translations = np.zeros((int(known.sum()), 3))
    translations[:, :2] = places[known]
    if angles is None:
        columns = rr.Transform3D.columns(translation=translations)
    else:
        half = angles[known] / 2.0
        quaternions = np.stack([np.zeros_like(half), np.zeros_like(half), np.sin(half), np.cos(half)], axis=1)
        columns = rr.Transform3D.columns(translation=translations, quaternion=quaternions)
    send(stream, path, times[known], columns)
