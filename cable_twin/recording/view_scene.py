"""What stands still: ground, supports and masts, and how large the scene is."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import NamedTuple

import numpy as np
import rerun as rr

from cable_twin.geometry.ground_line import default_ground
from cable_twin.recording.place_names import NEAR, gathered
from cable_twin.recording.view_geometry import QUIET, pixels, planar, plane
from cable_twin.records import FloatArray

WHEEL = 0x9A6EE0FF
GROUND = 0x84735DFF
LETTER, NAME_HEIGHT = 0.009, 0.035  # of a name, in widths of the scene


class Scene(NamedTuple):
    """What is in the picture at the start."""

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
    """Return the scene around a cable (n, 2) m, which may have gaps (NaN), with its ends by name and number."""
    cable = cable[~np.isnan(cable).any(axis=1)]
    if len(cable) < 2:  # not known yet
        cable = np.vstack([(0.0, 0.0), (1.0, 0.0), *support_positions.values()])
    ends = {name: cable[min(index, len(cable) - 1)] for name, index in end_samples.items()}
    known = [points for points in vehicles if len(points)]
    ground = default_ground(cable, known) if ground is None else ground
    return Scene(cable, known, {**ends, **support_positions}, ground)


def extent(scene: Scene) -> tuple[FloatArray, FloatArray]:
    """Return the lower left and the upper right corner (2,) m of all that is in a scene."""
    points = np.vstack([scene.cable, *scene.vehicles, scene.ground])
    return points.min(axis=0), points.max(axis=0)


def draw_scene(
    stream: rr.RecordingStream, scene: Scene, width: float, wheels: Mapping[str, FloatArray], ropes: Collection[str]
) -> float:
    """Log ground, supports and their masts, rims (n, 3) m of bullwheels, and their names below; `ropes` by name.

    Returns how far (m) those go below the ground.
    """
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
    feet_by_name = {name: mast[1] for name, mast in zip(supports, masts, strict=True)}
    together = gathered(feet_by_name, wheels, ropes, NEAR * width)
    feet = np.array(list(together.values())).reshape(-1, 2)
    depths = NAME_HEIGHT * width * (0.5 + name_rows(feet[:, 0] / width, list(together)))
    places = plane(feet - np.column_stack([np.zeros(len(feet)), depths]))
    names = rr.Points2D(places, colors=[QUIET], radii=[0.0], labels=list(together), show_labels=True)
    stream.log("track/names", names, static=True)
    return float(depths.max(initial=0.0)) + NAME_HEIGHT * width


def name_rows(places: FloatArray, names: Sequence[str]) -> FloatArray:
    """Return the row (0, 1, ...) below the ground of each name (n,), at `places` in widths of the scene: none meet."""
    rows = np.zeros(len(names))
    ends: list[float] = []  # of the last name in each row
    for index in np.argsort(places, kind="stable"):
        half = 0.5 * (len(names[index]) + 2) * LETTER
        row = next((row for row, end in enumerate(ends) if end < places[index] - half), len(ends))
        ends[row : row + 1] = [places[index] + half]
        rows[index] = row
    return rows
