"""Check for a slack rope of too few elements with `element_frame`, which takes curvature for strain."""

from __future__ import annotations

import warnings

import numpy as np

from cable_twin.basics.units import with_unit
from cable_twin.frame.records import CableSamples
from cable_twin.mechanics.parameters import ELEMENT_FRAME, System

SHARE = 0.1  # of the tension, which curved elements may add to it: the shape is off by about a tenth of the sag then


def warn_of_frames(system: System, rope: CableSamples) -> None:
    """Warn of elements that turn so far in their chord frame that the false strain is a share of the tension.

    An element that turns by φ = w l / T over its length l, under its weight w, has slopes up to φ/2 aside of its chord,
    which shortens them there by φ²/24 on average: EA φ²/24 beside T.
    """
    cable = system.cable
    tension = float(np.abs(rope.tensions).min())
    weight = cable.mass_per_length * float(np.linalg.norm(cable.gravity))
    if cable.elastic_model != ELEMENT_FRAME or weight == 0.0:
        return
    longest = (24.0 * SHARE * max(tension, 1e-9) ** 3 / cable.axial_stiffness) ** 0.5 / weight
    if float(cable.element_length.max()) > longest:
        warnings.warn(
            f"cable.elastic_model element_frame on a slack rope (least tension {with_unit(tension, 'N', 3)}): "
            "elements of "
            f"{with_unit(float(cable.element_length.max()), 'm', 3)} are too long for its curvature, and its shape "
            "may be "
            f"off by metres; elements up to {with_unit(longest, 'm', 2)}, or elastic_model continuum, prevent that",
            stacklevel=3,
        )


__all__ = ["warn_of_frames"]
