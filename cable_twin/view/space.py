"""3D view of a run: ground as a strip, towers with arms, rope, vehicles as solids, and the wind as an arrow."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Columns, Layout
from cable_twin.geometry.bodies import Solid
from cable_twin.view.batch import QUIET, entity_path, pixels, rows_without_gaps, send
from cable_twin.view.labels import NEAR, apart, label_sizes, shared_names
from cable_twin.view.track import BODY_COLORS, CARRIAGE_COLORS, GROUND, NAME_GAP, WHEEL

SPACE = "space"
CLOSE_UPS = f"{SPACE}/close_ups"
OVERVIEW_WIND, NEAR_WIND = f"{SPACE}/wind", f"{SPACE}/wind_at_vehicles"
STRIP = 0.04  # width of the ground to either side over the span of the track; assumed
ARM = 1.2  # distance of the rope from the middle of the mast over the width of the widest vehicle; assumed
NARROW = 0.004  # smallest length of an arm over the span of the track
WIND, RIBS = 0x2FA0C8FF, 0xA8977EFF
BELOW = 0.03  # depth of the target below the middle of the track over its span, as there is ground below it
EYE = (-0.2, -0.55, 0.2)  # position of the eye from the middle of the track over its span
CLOSE_UP_EYE = (-4.0, -1.2, 0.6)  # position of the eye from a vehicle over the height of the vehicle
DISTANCES = (
    0.7,
    0.8,
    0.9,
    1.0,
    1.15,
    1.3,
    1.5,
    2.0,
)  # factors of `EYE`, of which the first that shows all is taken
FIELD = np.radians(55.0)  # field of view of rerun, from the lower to the upper edge
FASTEST = 40.0  # m/s, wind with the longest arrow


@dataclass(frozen=True)
class InSpace:
    """Additional scene data for the 3D view: solids of bodies, and towers.

    Attributes:
        solids: vehicle -> body -> its triangles.
        towers: name -> place (3,) m.
        between: whether masts are in the middle, between ropes to the left and to the right.
    """

    solids: Mapping[str, Mapping[str, Solid]]
    towers: Mapping[str, FloatArray]
    between: bool = False


class Eye(NamedTuple):
    """Position and target of the eye in a 3D view."""

    position: FloatArray  # (3,) m
    target: FloatArray  # (3,) m


class Lens(NamedTuple):
    """Pinhole camera that projects points onto a view, in pixels."""

    eye: Eye
    right: FloatArray  # (3,), axes of the picture and into it
    up: FloatArray
    ahead: FloatArray
    focal: float  # pixels

    @classmethod
    def of(cls, eye: Eye, height: float) -> Lens:
        """Return the camera of a view with a height in pixels."""
        ahead = (eye.target - eye.position) / np.linalg.norm(eye.target - eye.position)
        right = np.cross(ahead, [0.0, 0.0, 1.0])
        right /= np.linalg.norm(right)
        return cls(eye, right, np.cross(right, ahead), ahead, 0.5 * height / np.tan(0.5 * FIELD))

    def seen(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return pixels (n, 2) right and down from the middle, and depths (n,) in m, of points (n, 3) in m."""
        away = points - self.eye.position
        depth = away @ self.ahead
        across = np.stack([away @ self.right, -(away @ self.up)], axis=1)
        return across * (self.focal / depth)[:, None], depth


class _Alike(NamedTuple):
    """Bodies with equal solids, drawn as one entity."""

    path: str
    rows: list[int]  # numbers of the bodies
    solid: Solid
    color: int


class Space:
    """Drawing of a run in the 3D view of rerun.

    Args:
        layout: layout of the frames.
        look: additional scene data.
        carriers: names of the vehicles that are drawn together.
        followed: names of the vehicles with a close-up.

    Attributes:
        overview: eye of the view of the whole.
        close_ups: entity of each close-up -> its eye.
    """

    def __init__(self, layout: Layout, look: InSpace, carriers: Collection[str], followed: Collection[str]) -> None:
        self._look = look
        self._alike = _groups(layout, look, carriers)
        self._followed = {
            entity_path(CLOSE_UPS, name): row for row, name in enumerate(layout.vehicles) if name in followed
        }
        self._end_samples = layout.end_samples
        self._ropes = list(layout.ropes)
        self._reach = 1.0  # m, height of the tallest body
        self._span = 1.0  # m, of the track
        self._sky = np.zeros(3)  # m, place of the arrow of the wind above the track
        self.overview = Eye(np.zeros(3), np.zeros(3))
        self.close_ups: dict[str, Eye] = {}

    def begin(
        self,
        stream: rr.RecordingStream,
        c: Columns,
        ground: FloatArray,
        wheels: Mapping[str, FloatArray],
        size: tuple[float, float],
    ) -> None:
        """Log static entities of the 3D view.

        Args:
            stream: stream of the recording.
            c: columns of a first frame.
            ground: profile of the ground, (n, 2) m, x and z.
            wheels: name -> (n, 3) m, rim of each bullwheel.
            size: width and height in pixels of the view of the whole.
        """
        stream.log(SPACE, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        rope = c.rope_position[~np.isnan(c.rope_position).any(axis=1)]
        points = np.vstack([rope, *self._look.towers.values()]) if len(rope) else np.zeros((2, 3))
        low, high = points.min(axis=0), points.max(axis=0)
        self._span = float(max(high - low)) or 1.0
        side = STRIP * self._span
        _draw_ground(stream, ground, low[1] - side, high[1] + side)
        middle = 0.5 * (low + high) - [0.0, 0.0, BELOW * self._span]
        self._sky = np.array([middle[0], middle[1], high[2] + 0.05 * self._span])
        ends = {name: c.rope_position[sample] for name, sample in self._end_samples.items()}
        known = {name: top for name, top in ends.items() if not np.isnan(top).any()}
        places = self._draw_supports(stream, known, ground)
        names = shared_names(places, wheels, self._ropes, NEAR * self._span)
        self.overview, tops = _seen_whole(middle, self._span, points, names, size)
        labels = rr.Points3D(tops, colors=[QUIET], radii=[0.0], labels=list(names), show_labels=True)
        stream.log(f"{SPACE}/names", labels, static=True)
        if wheels:
            rims = rr.LineStrips3D(list(wheels.values()), colors=[WHEEL], radii=pixels(3.0))
            stream.log(f"{SPACE}/wheels", rims, static=True)
        for group in self._alike:
            mesh = rr.Mesh3D(
                vertex_positions=group.solid.vertices,
                vertex_normals=group.solid.normals,
                triangle_indices=group.solid.triangles,
                albedo_factor=group.color,
            )
            stream.log(group.path, mesh, static=True)
        for path, row in self._followed.items():
            color = CARRIAGE_COLORS[row % len(CARRIAGE_COLORS)]
            stream.log(path, rr.Points3D.from_fields(colors=[color], radii=pixels(5.0)), static=True)
        for path in (OVERVIEW_WIND, NEAR_WIND):
            stream.log(path, rr.Arrows3D.from_fields(colors=[WIND], radii=pixels(3.0)), static=True)
        self._reach = max((_height(group.solid) for group in self._alike), default=1.0)
        self.close_ups = {}
        for path, row in self._followed.items():
            place = c.joint_position[row]
            if not np.isnan(place).any():
                target = place - [0.0, 0.0, self._reach]
                self.close_ups[path] = Eye(target + np.array(CLOSE_UP_EYE) * self._reach, target)

    def _draw_supports(
        self,
        stream: rr.RecordingStream,
        ends: Mapping[str, FloatArray],
        ground: FloatArray,
    ) -> dict[str, FloatArray]:
        """Log stations as masts, and towers as masts beside the rope with an arm above.

        Args:
            stream: stream of the recording.
            ends: name -> place (3,) m of each end of a rope.
            ground: profile of the ground, (n, 2) m, x and z.

        Returns:
            Name -> foot (3,) m of each mast.
        """
        arm = max(
            ARM * max((float(np.ptp(g.solid.vertices[:, 1])) for g in self._alike), default=0.0), NARROW * self._span
        )
        strips: list[FloatArray] = []
        places: dict[str, FloatArray] = {}
        for name, top in (*ends.items(), *self._look.towers.items()):
            foot = float(np.interp(top[0], ground[:, 0], ground[:, 1]))
            beside = top if name in ends else top - [0.0, arm, 0.0]
            if self._look.between:
                beside = np.array([top[0], 0.0, top[2]])
            strips.append(np.array([top, beside, [beside[0], beside[1], foot]]))
            places[name] = np.array([beside[0], beside[1], foot])
        stream.log(f"{SPACE}/supports", rr.LineStrips3D(strips, colors=[QUIET], radii=pixels(2.5)), static=True)
        return places

    def send(self, stream: rr.RecordingStream, c: Columns, rows: NDArray[np.intp]) -> None:
        """Send the poses of vehicles in selected frames of a batch, and the wind."""
        times = c.time[rows, 0]
        for group in self._alike:
            places, turns = c.body_position[rows][:, group.rows], c.body_orientation[rows][:, group.rows]
            known = rows_without_gaps(places, turns)
            if not known.any():
                continue
            poses = rr.InstancePoses3D.columns(
                translations=places[known].reshape(-1, 3), quaternions=turns[known].reshape(-1, 4)
            )
            send(stream, group.path, times[known], poses, len(group.rows))
        for path, row in self._followed.items():
            joints = c.joint_position[rows, row]
            known = rows_without_gaps(joints)
            if known.any():
                send(stream, path, times[known], rr.Points3D.columns(positions=joints[known]))
        self._send_wind(stream, times, c.wind[rows], c.joint_position[rows][:, list(self._followed.values())])

    def _send_wind(self, stream: rr.RecordingStream, times: FloatArray, wind: FloatArray, joints: FloatArray) -> None:
        """Send the wind (frames, 3) in m/s as arrows: above the track, and at joints (frames, vehicles, 3) in m."""
        over = rr.Arrows3D.columns(
            vectors=wind * (0.7 * self._span / FASTEST), origins=np.broadcast_to(self._sky, wind.shape)
        )
        send(stream, OVERVIEW_WIND, times, over)
        known = rows_without_gaps(joints)
        count = joints.shape[1]
        if not count or not known.any():
            return
        vectors = np.repeat(wind[known][:, None] * (3.0 * self._reach / FASTEST), count, axis=1)
        heights = np.array([0.0, 0.0, -self._reach])
        near = rr.Arrows3D.columns(
            vectors=vectors.reshape(-1, 3), origins=(joints[known] + heights - 1.5 * vectors).reshape(-1, 3)
        )
        send(stream, NEAR_WIND, times[known], near, count)


def _seen_whole(
    middle: FloatArray, span: float, points: FloatArray, names: Mapping[str, FloatArray], size: tuple[float, float]
) -> tuple[Eye, FloatArray]:
    """Return the nearest position of the eye that shows everything, and name positions (n, 3) m without overlap.

    Args:
        middle: target of the eye (3,) m.
        span: span of the track (m).
        points: points to be visible (n, 3) m.
        names: name -> point (3,) m below which it stands.
        size: width and height of the view in pixels.
    """
    label = label_sizes(list(names))
    feet = np.array(list(names.values())).reshape(-1, 3)
    room = np.array(size) - 2.0 * NAME_GAP
    for nearer in DISTANCES:
        eye = Eye(middle + np.array(EYE) * (span * nearer), middle)
        for _ in range(4):  # moved sideways until all is in the middle
            lens = Lens.of(eye, size[1])
            seen, depth = lens.seen(feet)
            moved = apart(np.add(seen, (0.0, NAME_GAP)), label + NAME_GAP)
            corners = np.vstack([lens.seen(points)[0], moved - label * (0.5, 0.0), moved + label * (0.5, 1.0)])
            first, last = corners.min(axis=0), corners.max(axis=0)
            across, down = (first + last) / 2.0 * (np.linalg.norm(eye.target - eye.position) / lens.focal)
            shift = across * lens.right - down * lens.up
            eye = Eye(eye.position + shift, eye.target + shift)
        if (last - first < room).all():
            break
    return eye, feet - lens.up * ((moved - seen)[:, 1] * depth / lens.focal)[:, None]


def _groups(layout: Layout, look: InSpace, carriers: Collection[str]) -> list[_Alike]:
    """Groups of bodies that are drawn as one entity: each body of a carriage, and equal bodies of all carriers."""
    groups: dict[object, _Alike] = {}
    for (vehicle, bodies), (first, _) in zip(layout.vehicles.items(), pairwise(layout.first_body), strict=True):
        for number, body in enumerate(bodies):
            solid = look.solids[vehicle][body]
            color = BODY_COLORS[number % len(BODY_COLORS)]
            path = entity_path(entity_path(f"{SPACE}/carriages", vehicle), body)
            alike: object = path
            if vehicle in carriers:
                path, alike = f"{SPACE}/carriers/{len(groups)}", (solid.vertices.tobytes(), color)
            groups.setdefault(alike, _Alike(path, [], solid, color)).rows.append(first + number)
    return list(groups.values())


def _height(solid: Solid) -> float:
    return float(np.ptp(solid.vertices[:, 2]))


def _draw_ground(stream: rr.RecordingStream, ground: FloatArray, right: float, left: float) -> None:
    """Log the profile (n, 2), x and z in m, as a strip between two places across the track (m)."""
    edges = [np.column_stack([ground[:, 0], np.full(len(ground), y), ground[:, 1]]) for y in (right, left)]
    number = np.arange(len(ground) - 1)
    last = number + len(ground)
    triangles = np.vstack([np.column_stack([number, number + 1, last]), np.column_stack([number + 1, last + 1, last])])
    mesh = rr.Mesh3D(vertex_positions=np.vstack(edges), triangle_indices=triangles, albedo_factor=GROUND)
    stream.log(f"{SPACE}/ground", mesh, static=True)
    ribs = rr.LineStrips3D([*edges, *np.stack(edges, axis=1)], colors=[RIBS], radii=pixels(0.7))
    stream.log(f"{SPACE}/ground/ribs", ribs, static=True)
