"""Joints of bodies: each body is joined to the body above, the first one to its upright vehicle frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.snapshot import Layout


def joint_names(layout: Layout) -> list[str]:
    """Names of the joints of all bodies in a URDF: VEHICLE_BODY."""
    return [body.replace("/", "_") for body in layout.bodies]


def hung_rows(layout: Layout) -> NDArray[np.intp]:
    """Rows (n,) of bodies below another body, which is in the row before."""
    return np.array([row for row in range(len(layout.bodies)) if row not in layout.first_body], dtype=np.intp)


__all__ = ["hung_rows", "joint_names"]
