"""Small scenarios in space with one tower, one line bent in plan and one straight."""

BENT = {
    "name": "bent",
    "cable": {
        "unstrained_length": 200.3,
        "mass_per_length": 5.0,
        "axial_stiffness": 2e7,
        "bending_stiffness": 10.0,
        "diameter": 0.03,
        "elements": {"target": 8.0, "at_towers": 1.0, "growth": 2.0},
        "start": {"position": [0.0, 0.0, 0.0]},
        "end": {"position": [200.0, 0.0, 0.0]},
    },
    "towers": {"tower": {"position": [100.0, 4.0, 2.0], "stiffness": 1e6}},
    "solver": {"step": 0.005},
}
STRAIGHT = {
    **BENT,
    "name": "straight",
    "space": 3,
    "cable": {**BENT["cable"], "start": {"position": [0.0, 0.0]}, "end": {"position": [200.0, 0.0]}},
    "towers": {"tower": {"position": [100.0, 2.0], "stiffness": 1e6}},
}
