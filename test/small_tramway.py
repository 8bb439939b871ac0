"""Tramway of 120 m for tests: one tower, counterweight, haul rope, brakes, payload and terrain."""

from __future__ import annotations

from typing import Any

TRAMWAY: dict[str, Any] = {
    "name": "small_tramway",
    "cable": {
        "unstrained_length": 121.5,
        "mass_per_length": 2.0,
        "axial_stiffness": 2e7,
        "bending_stiffness": 200.0,
        "elements": 40,
        "damping_time": 0.01,
        "diameter": 0.02,
        "breaking_force": 4e5,
        "start": {"position": [0.0, 0.0]},
        "end": {
            "position": [120.0, 18.0],
            "support": "counterweight",
            "direction": [1.0, 0.1],
            "mass": 5e3,
            "travel": [-1.5, 1.5],
        },
    },
    "towers": {"tower_1": {"position": [60.0, 11.0], "kind": "saddle", "contacts": 5, "length": 4.0, "radius": 20.0}},
    "carriages": {
        "cabin": {
            "arc_length": 2.0,
            "drive": {
                "mode": "speed",
                "limits": {"acceleration": 1.0, "speed": 6.0, "power": 4e4},
                "haul_rope": {
                    "axial_stiffness": 5e5,
                    "mass_per_length": 0.5,
                    "drive_inertia": 300.0,
                    "pretension": 5e3,
                },
                "emergency_brake": {"force": 900.0, "rise_time": 0.2},
                "track_rope_brake": {"force": 500.0, "rise_time": 0.1},
                "emergency_stop": ["emergency_brake", "track_rope_brake"],
            },
            "payload": {"capacity": 400.0, "position": [0.2, -0.5], "station_distance": 4.0},
            "bodies": {
                "cabin": {
                    "mass": 200.0,
                    "inertia": 150.0,
                    "upper_pivot": [0.0, 2.0],
                    "drag_area": 3.0,
                    "size": [2.0, 3.0],
                }
            },
        }
    },
    "terrain": [[0.0, -12.0], [58.0, 2.0], [62.0, 2.0], [120.0, 8.0]],
    "solver": {"step": 0.005},
}

IN_SPACE: dict[str, Any] = {  # the same with its tower beside the straight line
    **TRAMWAY,
    "cable": {
        **TRAMWAY["cable"],
        "start": {"position": [0.0, 0.0, 0.0]},
        "end": {**TRAMWAY["cable"]["end"], "position": [120.0, 0.0, 18.0], "direction": [1.0, 0.0, 0.1]},
    },
    "towers": {"tower_1": {**TRAMWAY["towers"]["tower_1"], "position": [60.0, 0.3, 11.0]}},
}
