"""Gymnasium environment with one twin: actions, observations by name; rewards are left to the user."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from cable_twin.frame.commands import KINDS
from cable_twin.frame.quantities import Reader, by_default, chosen, quantities
from cable_twin.frame.records import Command, FloatArray
from cable_twin.scenario import Scenario, command_limits, load_scenario
from cable_twin.simulation import Simulation, SolverError

ENDS_OF_CABLE = 2  # samples of the cable: the fewest


class Observed(Mapping[str, float]):
    """Observation with access by name: `after["cabin/speed"]`.

    Attributes:
        array: observed numbers (n,), in the order of `RopewayEnv.observation_names`.
    """

    __slots__ = ("_numbers", "array")

    def __init__(self, numbers: Mapping[str, int], array: FloatArray) -> None:
        self._numbers, self.array = numbers, array

    def __getitem__(self, name: str) -> float:
        return float(self.array[self._numbers[name]])

    def __iter__(self) -> Iterator[str]:
        return iter(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)


Reward = Callable[[Observed, FloatArray, Observed], float]


class RopewayEnv(gymnasium.Env[FloatArray, FloatArray]):
    """Gymnasium environment of a ropeway scenario.

    An action is a number for each of `action_names`, a speed (m/s) or a force (N), clipped to the limits of the
    scenario. An observation is a number for each of `observation_names`, in `observation_units`.
    Each episode begins with the same bits; `prepare` may change that. It ends (`terminated`) where `ended` says so, or
    where the solver fails or vehicles meet, of which `info["fault"]` has the line; and after `duration` (`truncated`).

    A subclass may override `reward`, `ended` and `prepare` instead of passing them as arguments.

    Args:
        scenario: name, path, mapping, or loaded scenario.
        overrides: values of the scenario by dotted key.
        command: kind of the actions, "speed" (m/s) or "force" (N); or a mapping of carriages or drives to their kind.
        observations: names, with * for any text, such as ("cabin/*", "end/tension"); None for motion, pitch, and
            force and tensions at the drive of a lift, in space also roll and wind.
        period: simulated time (s) of a step, a whole number of solver steps.
        duration: simulated time (s) of an episode.
        reward: takes the observation before, the action and the observation after; without it rewards are 0.
        ended: takes an observation, returns whether the episode has ended.
        prepare: takes the simulation at its start and the random generator of the environment, before each episode.

    Attributes:
        simulation: the twin.
        action_names: names of the numbers of an action.
        observation_names: names of the numbers of an observation.
        observation_units: units of the numbers of an observation.
        reader: reader of the observed numbers from those of a snapshot.
        period: simulated time (s) of a step.
        steps: number of steps in an episode.

    Raises:
        ScenarioError: the scenario is invalid.
        EquilibriumError: the cable of the scenario has no equilibrium.
        ValueError: an argument does not fit the scenario; the message is one line.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as gymnasium has it

    def __init__(
        self,
        scenario: str | Path | Mapping[str, Any] | Scenario = "single_span",
        *,
        overrides: Mapping[str, Any] | None = None,
        command: str | Mapping[str, str] = "speed",
        observations: str | Sequence[str] | None = None,
        period: float = 0.01,
        duration: float = 120.0,
        reward: Reward | None = None,
        ended: Callable[[Observed], bool] | None = None,
        prepare: Callable[[Simulation, np.random.Generator], None] | None = None,
    ) -> None:
        self._reward, self._ended, self._prepare = reward, ended, prepare
        for name, given in (("reward", reward), ("ended", ended), ("prepare", prepare)):
            if given is not None and not callable(given):
                raise ValueError(f"{name}: given {given!r}; allowed: a function")
        if isinstance(scenario, Scenario):
            scenario = scenario.resolved()
        self.simulation = Simulation(load_scenario(scenario, overrides), samples=ENDS_OF_CABLE, on_demand=True)
        self._start = self.simulation.capture()
        self.period, self._steps_left = _whole_steps(period, self.simulation.step), 0
        if not duration >= self.period or not math.isfinite(duration):
            raise ValueError(f"duration: given {duration:g} s; allowed: at least the period of {self.period:g} s")
        self.steps = math.ceil(round(duration / self.period, 6))
        limits = _limits(self.simulation.scenario, command)
        self.action_names = tuple(limits)
        high = np.array([limit for _, limit in limits.values()])
        self.action_space = spaces.Box(-high, high, dtype=np.float64)
        kinds = [kind for kind, _ in limits.values()]
        self._by_kind = [(kind, [i for i, one in enumerate(kinds) if one == kind]) for kind in dict.fromkeys(kinds)]
        self._highest = high.tolist()
        own, layout = self.simulation.scenario, self.simulation.layout
        patterns = by_default(own, layout) if observations is None else observations
        seen = chosen(quantities(own, layout), patterns, self.simulation.snapshot)
        self.observation_names = tuple(seen)
        self.observation_units = tuple(one.unit for one in seen.values())
        self.reader = Reader(seen.values())
        self._numbers = {name: number for number, name in enumerate(seen)}
        bounds = np.array([(one.low, one.high) for one in seen.values()])
        self.observation_space = spaces.Box(bounds[:, 0], bounds[:, 1], dtype=np.float64)
        self._before = self._observed()

    def named(self, observation: FloatArray) -> Observed:
        """Observation (n,) with access by name."""
        return Observed(self._numbers, observation)

    def reward(self, before: Observed, action: FloatArray, after: Observed) -> float:
        """Reward of a step; to be overridden in a subclass, unless given as an argument."""
        return 0.0 if self._reward is None else self._reward(before, action, after)

    def ended(self, after: Observed) -> bool:
        """Whether the episode has ended; to be overridden in a subclass, unless given as an argument."""
        return self._ended is not None and self._ended(after)

    def prepare(self, simulation: Simulation, generator: np.random.Generator) -> None:
        """Prepare the start of an episode: wind, payload, command, time to settle; may be overridden in a subclass."""
        if self._prepare is not None:
            self._prepare(simulation, generator)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[FloatArray, dict[str, Any]]:
        """Begin an episode; returns its first observation and its simulated time; `options` are not used."""
        super().reset(seed=seed)
        self.go_to_start(self.np_random)
        self._steps_left = self.steps
        self._before = self._observed()
        return self._before.array.copy(), {"time": self.simulation.time}

    def go_to_start(self, generator: np.random.Generator) -> None:
        """Restore the initial state of the simulation, and let `prepare` change it with a random generator."""
        self.simulation.restore(self._start)
        self.prepare(self.simulation, generator)

    @property
    def actions_by_kind(self) -> list[tuple[str, dict[str, int]]]:
        """Kinds of commands, each with the names of its carriages or drives and their columns in an action."""
        return [(kind, {self.action_names[row]: row for row in rows}) for kind, rows in self._by_kind]

    @property
    def judges(self) -> bool:
        """Whether the user has given a reward or an end of episodes, by argument or by an overriding method."""
        own = type(self).reward is not RopewayEnv.reward or type(self).ended is not RopewayEnv.ended
        return own or self._reward is not None or self._ended is not None

    def step(self, action: FloatArray) -> tuple[FloatArray, float, bool, bool, dict[str, Any]]:
        """Apply an action (n,) for one period.

        Raises:
            ValueError: the action is not one finite number for each of `action_names`.
            RuntimeError: no episode has begun.
        """
        if self._steps_left <= 0:
            raise RuntimeError("step: no episode under way; call reset first")
        numbers = np.asarray(action, dtype=np.float64).tolist()
        if not isinstance(numbers, list) or len(numbers) != len(self._highest) or not all(map(_is_finite, numbers)):
            raise ValueError(f"action: given {action}; allowed: finite numbers for {', '.join(self.action_names)}")
        # floats and no arrays, which cost more for a few numbers in thousands of steps a second
        numbers = [min(max(number, -high), high) for number, high in zip(numbers, self._highest, strict=True)]
        simulation, names = self.simulation, self.action_names
        for kind, members in self._by_kind:
            simulation.apply(Command(kind, {names[i]: numbers[i] for i in members}))
        info: dict[str, Any] = {}
        try:
            time = simulation.advance_to(simulation.time + self.period).time
        except SolverError as error:
            info["fault"], time = str(error), simulation.time
        info["time"] = time
        before, after = self._before, self._observed()
        self._before = after
        terminated = "fault" in info or bool(self.ended(after))
        self._steps_left = 0 if terminated else self._steps_left - 1
        truncated = self._steps_left == 0 and not terminated
        return after.array.copy(), float(self.reward(before, np.array(numbers), after)), terminated, truncated, info

    def _observed(self) -> Observed:
        return Observed(self._numbers, self.reader.read(self.simulation.snapshot.numbers))


def _is_finite(value: object) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _whole_steps(period: float, step: float) -> float:
    """Period (s) rounded to whole solver steps; raises ValueError where the given one is not a multiple."""
    count = round(period / step) if math.isfinite(period) else 0
    if count < 1 or abs(count * step - period) > 1e-9:
        raise ValueError(f"period: given {period:g} s; allowed: a whole number of solver steps of {step:g} s")
    return count * step


def _limits(scenario: Scenario, command: str | Mapping[str, str]) -> dict[str, tuple[str, float]]:
    """Kind of command and its limit (m/s or N), by name of carriage or drive."""
    known = command_limits(scenario)
    wanted = dict.fromkeys(known, command) if isinstance(command, str) else dict(command)
    kinds = [name for name, kind in KINDS.items() if kind.drives]
    found: dict[str, tuple[str, float]] = {}
    for name, kind in wanted.items():
        if name not in known:
            raise ValueError(f"command: given '{name}'; allowed: {', '.join(known) or 'none, as nothing is driven'}")
        if kind not in kinds or known[name].of(kind) == 0.0:
            allowed = "speed, for it moves the cable" if known[name].force == 0.0 else " or ".join(kinds)
            raise ValueError(f"command of '{name}': given {kind!r}; allowed: {allowed}")
        limit = known[name].of(kind)
        if limit == math.inf:
            owner = f"drives.{name}" if name in scenario.drives else f"carriages.{name}.drive"
            unit = KINDS[kind].unit
            raise ValueError(
                f"{owner}.limits.{kind}: given null; allowed: a limit in {unit}, to scale actions, as overrides can set"
            )
        found[name] = (kind, limit)
    if not found:
        raise ValueError(f"scenario: given '{scenario.name}'; allowed: one with a driven carriage or drive")
    return found
