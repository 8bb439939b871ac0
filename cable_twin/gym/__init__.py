"""Gymnasium environment of the twin, for learning controllers; needs the extra `gym`.

`gymnasium.make("cable_twin.gym:cable_twin/Ropeway-v0", scenario="single_span")` works as well.
"""

import gymnasium

from cable_twin.gym.environment import Observed, RopewayEnv
from cable_twin.gym.vector import RopewayVectorEnv, vector_env

NAME = "cable_twin/Ropeway-v0"

if NAME not in gymnasium.registry:
    gymnasium.register(NAME, entry_point="cable_twin.gym:RopewayEnv")

__all__ = ["NAME", "Observed", "RopewayEnv", "RopewayVectorEnv", "vector_env"]
