"""Joints of bodies: each hangs from the body above it, or from its vehicle, whose frame stays upright."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cable_twin.snapshot import Layout


def joint_names(layout: Layout) -> list[str]:
    """Names of the joints of all bodies, as a URDF may have them: VEHICLE_BODY."""
    return [body.replace("/", "_") for body in layout.bodies]


def hung_rows(layout: Layout) -> NDArray[np.intp]:
    """Rows (n,) of the bodies that hang from another one, which is in the row before."""
    return np.array([row for row in range(len(layout.bodies)) if row not in layout.first_body], dtype=np.intp)


__all__ = ["hung_rows", "joint_names"]
