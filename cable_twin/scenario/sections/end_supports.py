"""Supports of the ends of a rope: `start` and `end` of `cable` and `ropes`."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cable_twin.scenario.sections.quantities import Place, Section, Vector, quantity


class EndSupport(Section):
    """Support of one end of the cable."""

    position: Place = quantity("m", "place as x, z, in space x, y, z; only the direction of the start where it is free")
    support: Literal["pinned", "clamped", "free", "hydraulic", "counterweight"] = Field(
        default="pinned",
        description="what of the end is held; a hydraulic tensioning device keeps its length, as a pin does",
    )
    direction: Place | None = quantity(
        "-", "direction of the cable in a clamp, towards its end; or in which a counterweight pulls; any length", None
    )
    mass: float | None = quantity("kg", "mass of a counterweight", None, gt=0)
    force: float | None = quantity("N", "pull of a counterweight; its weight where none is given", None, gt=0)
    travel: Vector | None = quantity("m", "least and most travel of a counterweight from `position`", None)
    buffer_stiffness: float | None = quantity(
        "N/m", "stiffness of the buffers at both limits of the travel; null: 5 cm hold the pull", None, gt=0
    )
    buffer_damping: float = quantity(
        "s/m", "damping of these buffers: force = stiffness d (1 + damping d_dot)", 1.0, ge=0
    )
