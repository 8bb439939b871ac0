"""Air drag on bodies, quadratic in the wind relative to their centres: q |w_b| w_b, and no moment.

w_b = w - ċ with the uniform wind w, and q = density drag_area / 2. That of the rope is `rope.drag`.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.compilation import kernel
from cable_twin.mechanics.language.vectors import dot, full, load, scale, store, subtract, symmetric


@kernel
def drag_bodies(body_drag, wind, velocities, like, rate_factor, work):
    """Drag on every body (N), and minus its derivative by the place (N/m), which acts like a mass."""
    blowing = load(wind, like)
    for body in range(body_drag.size):
        q = body_drag[body]
        if q > 0.0:
            relative = subtract(blowing, load(velocities[body], like))
            speed = sqrt(dot(relative, relative))
            store(scale(q * speed, relative), work.body_drag[body])
            steep = rate_factor * q / speed if speed > 0.0 else 0.0
            store(full(1.0, symmetric(steep * speed * speed, steep, relative), 0.0), work.body_drag_tangent[body])
