"""Air drag on bodies, quadratic in the wind relative to their centres: q |w_b| w_b, and no moment.

w_b = w - ċ with the uniform wind w, and q = density drag_area / 2. That of the rope is `rope.drag`.
"""

from __future__ import annotations

from math import sqrt

from cable_twin.mechanics.language.compilation import kernel


@kernel
def drag_bodies(body_drag, wind, body_velocities, rate_factor, force, tangent):
    """Drag on every body (N), and minus its derivative by the place (N/m), which acts like a mass."""
    for body in range(body_drag.size):
        q = body_drag[body]
        if q > 0.0:
            x = wind[0] - body_velocities[body, 0]
            z = wind[wind.size - 1] - body_velocities[body, 1]
            speed = sqrt(x * x + z * z)
            force[body, 0], force[body, 1] = q * speed * x, q * speed * z
            steep = rate_factor * q / speed if speed > 0.0 else 0.0
            tangent[body, 0] = steep * (speed * speed + x * x)
            tangent[body, 1] = steep * x * z
            tangent[body, 2] = steep * (speed * speed + z * z)
