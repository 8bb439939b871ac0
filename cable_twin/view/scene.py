"""Static scene of the view: ground, supports, masts, and its extent."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike

from cable_twin.frame.records import FloatArray
from cable_twin.geometry.ground import default_ground
from cable_twin.view.geometry import QUIET, pixels, planar, plane
from cable_twin.view.labels import apart, label_sizes
from cable_twin.view.place_names import NEAR, gathered

WHEEL = 0x9A6EE0FF
GROUND = 0x84735DFF
NAME_GAP = 3.0  # pixels between names, and from the ground
MARGIN = 6.0  # pixels around all
SMALLEST = 10.0  # times that a scene may shrink to leave room for labels
LEGENDS_BESIDE = (0.0, 0.5, 1.0)  # how much of the legend may be to the left of the scene; the best is taken
BAR, BAR_INDENT, BAR_HEIGHT = 210.0, 40.0, 10.0  # pixels of tension colours: half a number reaches beyond their ends


class Scene(NamedTuple):
    """Initial scene: cable, vehicles, supports, ground."""

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
    """Return the scene around a cable (n, 2) m, gaps (NaN) allowed, with its end samples by name."""
    cable = cable[~np.isnan(cable).any(axis=1)]
    if len(cable) < 2:  # not known yet
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

    pixel: float  # m, of the smallest screen
    names: Mapping[str, FloatArray]  # (2,) m, the middle of the upper side of each label of supports
    legend: tuple[float, float, float]  # m: x and z where the bar of colours begins, and its width
    taken: FloatArray  # (n, 4) pixels of all these: middle and lower side, upwards; width and height
    low: FloatArray  # (2,) m, corners of what is shown
    high: FloatArray


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
        scene: What is shown.
        size: Pixels of its view, width and height.
        wheels: Name -> (n, 3) m, rims of bullwheels.
        ropes: Their names.
        legend: Pixels of the labels of the colours, which stand at the upper left, below their bar.
        above: Pixels that are kept free above the rope, for names of vehicles.
    """
    low, high = extent(scene)
    feet = {name: np.array([x, np.interp(x, *scene.ground.T)]) for name, (x, _) in scene.supports.items()}
    together = gathered(feet, wheels, ropes, NEAR * float(max(high - low)))
    label = label_sizes(list(together))
    places = plane(np.array(list(together.values())).reshape(-1, 2))
    corners, rope = plane(np.array([low, high])), plane(np.vstack([scene.cable, *scene.vehicles]))
    left, top = corners.min(axis=0)
    wide, deep = max(legend[0], BAR), legend[1] + BAR_HEIGHT
    tried = []
    for beside in LEGENDS_BESIDE:
        pixel = least = float(max(np.ptp(corners, axis=0) / size)) or 1.0
        for _ in range(50):  # the scene shrinks until what has the size of letters has room around it
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
