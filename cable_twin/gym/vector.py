"""Gymnasium vector environment: one ensemble of twins, advanced by threads of one process."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from cable_twin import Ensemble
from cable_twin.frame.records import FloatArray
from cable_twin.gym.environment import RopewayEnv


class RopewayVectorEnv(VectorEnv[FloatArray, FloatArray, FloatArray]):
    """Vector of `RopewayEnv` environments of one scenario, each bit-equal to a single environment.

    An environment whose episode has ended begins the next one in the step after, as in
    `gymnasium.vector.AsyncVectorEnv`.

    Args:
        count: number of environments.
        environment: pattern of all, with scenario, names, spaces, reward, end and start of an episode.
        threads: number of threads; None for one a core.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012

    def __init__(self, count: int, environment: RopewayEnv, *, threads: int | None = None) -> None:
        self.environment, self.num_envs = environment, count
        self.ensemble = Ensemble(environment.simulation.scenario, count, threads=threads, progress=False)
        self.action_names, self.observation_names = environment.action_names, environment.observation_names
        self.observation_units = environment.observation_units
        self.single_action_space = environment.action_space
        self.single_observation_space = environment.observation_space
        self.action_space = batch_space(self.single_action_space, count)
        self.observation_space = batch_space(self.single_observation_space, count)
        self._generators = [np.random.default_rng() for _ in range(count)]
        self._steps_left = np.zeros(count, dtype=np.int64)
        self._over = np.ones(count, dtype=np.bool_)  # the next step begins an episode
        self._before: FloatArray = np.zeros((count, len(self.observation_names)))
        self._begun = False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin an episode in every environment; with a whole number as seed, environment n has seed + n.

        Raises:
            ValueError: a list of seeds has not one for each environment, or `options` have a `reset_mask`; others are
                not used.
        """
        if "reset_mask" in (options or {}):
            raise ValueError("options: given reset_mask; allowed: none, as environments begin anew by themselves")
        seeds = [int(seed) + row for row in range(self.num_envs)] if isinstance(seed, int | np.integer) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise ValueError(f"seed: given {len(seeds)} seeds; allowed: one for each of {self.num_envs} environments")
        for row, own in enumerate(seeds or []):
            if own is not None:
                self._generators[row], _ = seeding.np_random(own)
        self._begin(range(self.num_envs))
        self._begun, self._before = True, self._observe()
        return self._before.copy(), self._times()

    def step(self, actions: FloatArray) -> tuple[FloatArray, FloatArray, Any, Any, dict[str, Any]]:
        """Apply actions (count, n) for one period; environments whose episode has ended begin the next one instead.

        Raises:
            ValueError: actions are not one finite number for each of `action_names` of each environment.
            RuntimeError: no episode has begun.
        """
        if not self._begun:
            raise RuntimeError("step: no episode under way; call reset first")
        one, ensemble = self.environment, self.ensemble
        given = np.asarray(actions, dtype=np.float64)
        if given.shape != self.action_space.shape or not np.all(np.isfinite(given)):
            shown = " ".join(str(actions).split())
            raise ValueError(
                f"actions: given {shown}; allowed: finite numbers ({self.num_envs}, {len(self.action_names)}) for "
                f"{', '.join(self.action_names)}"
            )
        given = np.clip(given, self.action_space.low, self.action_space.high)  # type: ignore[attr-defined]
        anew, going = np.flatnonzero(self._over), np.flatnonzero(~self._over)
        rows = None if going.size == self.num_envs else going.tolist()
        if anew.size:
            self._begin(anew.tolist())
        if going.size:
            for kind, names in one.actions_by_kind:
                for name, column in names.items():
                    ensemble.command(name, members=rows, **{kind: given[going, column]})
            times = ensemble.times
            times[going] += one.period
            ensemble.advance_to(times)
        before, after = self._before, self._observe()
        faults = ensemble.faults
        terminated, rewards = np.zeros(self.num_envs, dtype=np.bool_), np.zeros(self.num_envs)
        if one.judges:
            for row in going.tolist():
                seen = one.named(after[row])
                rewards[row] = one.reward(one.named(before[row]), given[row], seen)
                terminated[row] = bool(one.ended(seen))
        terminated[[row for row in faults if not self._over[row]]] = True
        self._steps_left[going] -= 1
        truncated = (self._steps_left == 0) & ~terminated & ~self._over
        self._over, self._before = terminated | truncated, after
        infos = self._times()
        if faults:
            infos["fault"] = np.array([faults.get(row, None) for row in range(self.num_envs)], dtype=object)
            infos["_fault"] = np.array([row in faults for row in range(self.num_envs)])
        return after.copy(), rewards, terminated, truncated, infos

    def close_extras(self, **_: Any) -> None:
        """End the threads of the ensemble."""
        self.ensemble.close()

    def _begin(self, rows: Any) -> None:
        """Begin an episode in the environments with the given indices."""
        one = self.environment
        for row in rows:
            one.go_to_start(self._generators[row])
            self.ensemble.fork(one.simulation, row)
            self._steps_left[row], self._over[row] = one.steps, False

    def _observe(self) -> FloatArray:
        return self.environment.reader.read(self.ensemble.numbers())

    def _times(self) -> dict[str, Any]:
        return {"time": self.ensemble.times, "_time": np.ones(self.num_envs, dtype=np.bool_)}


def vector_env(
    count: int,
    *arguments: Any,
    processes: bool = False,
    context: str | None = None,
    threads: int | None = None,
    **named: Any,
) -> VectorEnv[Any, Any, Any]:
    """Make a Gymnasium vector of `count` environments, on one ensemble of twins or each in its own process.

    Args:
        count: number of environments.
        arguments: arguments of `RopewayEnv`.
        processes: run each in its own process, for rewards and starts of episodes that take long in Python.
        context: start method of `multiprocessing` for these processes; None for the default of the system.
        threads: number of threads of an ensemble; None for one a core.
        named: keyword arguments of `RopewayEnv`.
    """
    if processes or context is not None:
        return AsyncVectorEnv([partial(RopewayEnv, *arguments, **named)] * count, context=context)
    return RopewayVectorEnv(count, RopewayEnv(*arguments, **named), threads=threads)
