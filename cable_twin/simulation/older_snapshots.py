"""Arrays of snapshot files of older formats, brought up to this one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from cable_twin.mechanics.language.lanes import WIDTH
from cable_twin.mechanics.state import WindField, first_phases

PARTS = ("state", "start")  # of ropes beside the first: state2, start2 and on
VERSION_1 = {  # what its fields are now, one by one or by their columns
    "nodal_coordinates": "nodes.position",
    "nodal_velocities": "nodes.velocity",
    "nodal_accelerations": "nodes.acceleration",
    "nodal_algorithmic": "nodes.algorithmic",
    "body_coordinates": "bodies.position",
    "body_velocities": "bodies.velocity",
    "body_accelerations": "bodies.acceleration",
    "body_algorithmic": "bodies.algorithmic",
    "sliding_coordinate": "joints.position",
    "sliding_velocity": "joints.velocity",
    "sliding_acceleration": "joints.algorithmic",
    "hauled_acceleration": "joints.acceleration",
    "sliding_element": "joint_element",
    "support_arc_length": "contact_arc_length",
    "support_deflection": "contact_deflection",
    "support_origin": "contact_origin",
    "sheave": ("sheaves.position", "sheaves.velocity", "sheaves.acceleration", "sheaves.algorithmic"),
    "reference": ("reference.position", "reference.velocity", "reference.acceleration"),
    "rope": ("rope.position", "rope.velocity", "rope.acceleration"),
}


def brought_up(arrays: Mapping[str, Any], version: int) -> dict[str, Any]:
    """The arrays of a file of an older `version`, by PART/FIELD, with the names and fields of this one."""
    arrays = _from_version_1(arrays) if version == 1 else dict(arrays)
    if version < 3:  # what is hauled was counted by its arc length
        joints = {key: array for key, array in arrays.items() if "/joints." in key}
        arrays |= {key.replace("joints", "hauled"): array for key, array in joints.items()}
    if version < 4:
        arrays |= _planar_moments(arrays)
    if version < 6:
        arrays |= _never_met(arrays)
    if version < 5:
        arrays |= _in_grooves(arrays) | _even_wind(arrays)
    if version < 6:
        arrays |= _one_speed(arrays) | _unclamped(arrays)
    if version < 7:
        arrays |= _whole_rope(arrays)
    return arrays


def _from_version_1(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """The arrays of both states under the names of this version; in version 1, motions were columns of one array."""
    renamed = {}
    for key, array in arrays.items():
        part, _, field = key.partition("/")
        now = VERSION_1.get(field, field)
        if isinstance(now, str):
            renamed[f"{part}/{now}"] = array
        else:
            for name, column in zip(now, np.atleast_2d(array).T, strict=True):
                renamed[f"{part}/{name}"] = np.ascontiguousarray(column)
    return renamed


def _planar_moments(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 4 added: the moments of joints that hold a body, of which there are none in a plane."""
    return {f"{part}/moments": np.zeros((len(arrays[f"{part}/multipliers"]), 1)) for part in PARTS}


def _even_wind(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 5 added: the wind where it acts, which was the same everywhere."""
    found: dict[str, Any] = {}
    for part in PARTS:
        wind = arrays[f"{part}/wind"]
        elements, bodies = len(arrays[f"{part}/nodes.position"]) - 1, len(arrays[f"{part}/multipliers"])
        field = WindField(
            time=np.zeros(1),
            way=np.zeros(1),
            gust=np.zeros(6),
            points=np.zeros((1, 3)),
            along_rope=np.tile(wind[:, None], -(-elements // WIDTH) * WIDTH),
            at_bodies=np.tile(wind, (bodies, 1)),
            shedding_phase=first_phases(bodies),
            shedding_force=np.zeros((bodies, wind.size)),
        )
        found |= {f"{part}/wind_field.{name}": array for name, array in field._asdict().items()}
    return found


def _one_speed(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 6 added: the rope goes by at each end by itself, and there may be more or less of it on the mesh."""
    found = {key: np.repeat(array, 2) for key, array in arrays.items() if "/rope." in key and array.size == 1}
    parts = {key.partition("/")[0] for key in arrays if key.endswith("/rope_target")}
    return found | {f"{part}/{name}": np.zeros(1) for part in parts for name in ("surplus", "loop_start")}


def _never_met(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 6 added: what vehicles push each other with, which never met."""
    carriages = {key.partition("/")[0]: len(array) for key, array in arrays.items() if key.endswith("/drive_force")}
    return {f"{part}/{name}": np.zeros((count, 4)) for part, count in carriages.items() for name in ("push", "touch")}


def _in_grooves(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 5 added: what grooves bear, and that none has lost its rope."""
    loads = {part: arrays[f"{part}/tower_load"] for part in PARTS}
    lateral = {f"{part}/tower_lateral": np.zeros_like(load) for part, load in loads.items()}
    return lateral | {f"{part}/derailment": np.zeros(load.shape, dtype=np.int64) for part, load in loads.items()}


def _unclamped(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 6 added: clamps to another rope, of which there are none."""
    found: dict[str, Any] = {}
    for key, array in arrays.items():
        part, _, field = key.rpartition("/")
        if field == "attached":
            wide = arrays[f"{part}/multipliers"].shape[1]
            found |= {f"{part}/clamp_holds": np.zeros_like(array), f"{part}/clamp_force": np.zeros((array.size, wide))}
        elif field == "contact_force":  # of pantographs, beside which clamps are
            wide = arrays["state/wind"].size
            found |= {f"{part}/clamp_rope": np.zeros(0, np.int64), f"{part}/clamp_place": np.zeros(0)}
            found |= {f"{part}/clamp_slack": np.zeros((0, wide))}
    return found


def _whole_rope(arrays: Mapping[str, Any]) -> dict[str, Any]:
    """What version 7 added: the rope that sharp kinks take, and how slack it is, which each step works out anew."""
    nodes = {key.rpartition("/")[0]: len(array) for key, array in arrays.items() if key.endswith("nodes.position")}
    taken = {f"{part}/kink_length": np.zeros(count - 1) for part, count in nodes.items()}
    return taken | {f"{part}/slackness": np.ones(1) for part in nodes}


__all__ = ["PARTS", "brought_up"]
