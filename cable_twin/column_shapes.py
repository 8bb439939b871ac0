"""Shapes of the columns of a frame."""

from __future__ import annotations

from collections.abc import Mapping

SHAPES: Mapping[str, tuple[str | int, ...]] = {  # of the columns, in their order
    "time": (1,),
    "arc_length": ("vehicles",),
    "speed": ("vehicles",),
    "drive_force": ("vehicles",),
    "joint_position": ("vehicles", 3),
    "contact_force": ("vehicles", 3),
    "attached": ("vehicles",),
    "payload": ("vehicles",),
    "haul_travel": ("vehicles",),
    "haul_speed": ("vehicles",),
    "haul_force": ("vehicles",),
    "haul_pull": ("vehicles", 3),
    "body_position": ("bodies", 3),
    "body_orientation": ("bodies", 4),
    "body_velocity": ("bodies", 3),
    "body_angular_velocity": ("bodies", 3),
    "body_angles": ("bodies", 3),
    "support_force": ("supports", 3),
    "support_travel": ("supports",),
    "tower_load": ("supports",),
    "tower_lowest_load": ("supports",),
    "tower_rest_load": ("supports",),
    "tower_lateral": ("supports",),
    "tower_lateral_ratio": ("supports",),
    "tower_derailed": ("supports",),
    "tower_derailed_time": ("supports",),
    "drive_position": ("drives",),
    "drive_speed": ("drives",),
    "moving_cable_force": ("drives",),
    "rope_position": ("samples", 3),
    "rope_tension": ("samples",),
    "wind": (3,),
    "vehicle_rope": ("vehicles",),
    "sheave_position": ("sheaves",),
    "sheave_speed": ("sheaves",),
    "sheave_force": ("sheaves",),
    "sheave_tension": ("sheaves", 2),
    "sheave_travel": ("sheaves",),
    "sheave_slip": ("sheaves",),
    "connector_force": ("connectors",),
    "pantograph_force": ("pantographs",),
    "pantograph_position": ("pantographs", 3),
    "pantograph_speed": ("pantographs",),
}

__all__ = ["SHAPES"]
