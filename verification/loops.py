"""Cases of closed loops of rope over bullwheels: statics, adhesion, longitudinal modes, tensioning, balances."""

from __future__ import annotations

from typing import Any

from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

BODY = {"chair": {"mass": 500.0, "inertia": 200.0, "upper_pivot": [0.0, 2.5]}}


def loop(
    *,
    length: float = 208.5,
    top: tuple[float, ...] = (200.0, 60.0),
    rope: dict[str, Any] | None = None,
    drive: dict[str, Any] | None = None,
    back: dict[str, Any] | None = None,
    limits: dict[str, float] | None = None,
    **rest: Any,
) -> Simulation:
    """Two strands of `length` (m) from the origin to `top` and back, without towers; `rest` is of the scenario.

    The bullwheel `drive` is at the top, and its drive is `haul_rope`; `back` is what the other one, `return`, has.
    """
    bottom = [0.0] * len(top)
    strand = {
        "unstrained_length": length,
        "mass_per_length": 6.0,
        "axial_stiffness": 60e6,
        "bending_stiffness": 0.0,
        "elements": 40,
        "damping_time": 0.0,
        **(rope or {}),
    }
    return Simulation(
        load_scenario(
            {
                "ropes": {
                    "up": {**strand, "start": {"position": bottom}, "end": {"position": list(top)}},
                    "down": {**strand, "start": {"position": list(top)}, "end": {"position": bottom}},
                },
                "sheaves": {
                    "drive": {
                        "radius": 2.0,
                        "joins": ["up.end", "down.start"],
                        "inertia": 40e3,
                        "drive": {"name": "haul_rope", "limits": limits or {}},
                        **(drive or {}),
                    },
                    "return": {"radius": 2.0, "joins": ["down.end", "up.start"], "inertia": 8e3, **(back or {})},
                },
                **rest,
            }
        )
    )
