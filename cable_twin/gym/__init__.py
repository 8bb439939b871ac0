"""Gymnasium environment of the twin, for learning controllers; needs the extra `gym`.

`gymnasium.make("cable_twin.gym:cable_twin/Ropeway-v0", scenario="single_span")` works as well, and `gymnasium.make_vec`
with `num_envs`, which gives an ensemble of twins.
"""

from typing import Any

import gymnasium

from cable_twin.gym.environment import Observed, RopewayEnv
from cable_twin.gym.vector import RopewayVectorEnv, vector_env

NAME = "cable_twin/Ropeway-v0"


def _vector_env(num_envs: int, **named: Any) -> gymnasium.vector.VectorEnv[Any, Any, Any]:
    """Vector environment as `gymnasium.make_vec` asks for it."""
    return vector_env(num_envs, **named)


if NAME not in gymnasium.registry:
    gymnasium.register(NAME, entry_point="cable_twin.gym:RopewayEnv", vector_entry_point=_vector_env)

__all__ = ["NAME", "Observed", "RopewayEnv", "RopewayVectorEnv", "vector_env"]
