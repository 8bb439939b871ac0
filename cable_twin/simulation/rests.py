"""Static equilibria of one line under many loads, in one memory: payloads, wind, tensioning change in place."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import numpy as np

from cable_twin.mechanics.language.declared import Kept, clone, write
from cable_twin.scenario import Scenario
from cable_twin.simulation.engine import Engine
from cable_twin.simulation.same_model import OtherModelError
from cable_twin.simulation.twin import SAMPLES, EquilibriumError, Simulation

SAID = ("name", "description", "limits", "sensors")  # sections on which no rest depends
LOADS: Mapping[str, frozenset[str]] = {  # keys that change in place, by the section or list of sections that has them
    "air": frozenset({"wind"}),
    "payload": frozenset({"mass", "capacity", "from_start", "from_end", "leaving", "on_cable"}),
    "carriers": frozenset({"loaded"}),
    "sheaves": frozenset({"counterweight", "hydraulics"}),
}


class Rests(Simulation):
    """Finder of static equilibria of a line under many loads; each search starts from the first scenario's equilibrium.

    For a scenario that differs only in payloads, wind and tensioning devices nothing is rebuilt: an equilibrium costs
    its iterations. Each search begins at the same state, so that no result depends on earlier ones.

    Args:
        scenario: scenario of the first equilibrium.
        samples: points (at least 2) at which snapshots hold the cable.

    Raises:
        EquilibriumError: the scenario has no static equilibrium.
    """

    def __init__(self, scenario: Scenario, *, samples: int = SAMPLES) -> None:
        engine = Engine(scenario)
        self._fresh = Kept(*engine.states), clone(engine.moving)
        self._set_up(scenario, engine, samples, True)
        self._first = scenario
        self._find_start(None)
        self._found = Kept(*engine.states), clone(engine.moving)
        engine.loop.keeps_slopes = True
        self.under(scenario)  # with the derivatives of the loop, which are not to depend on what comes first

    def under(self, scenario: Scenario) -> Simulation:
        """Simulation at the static equilibrium of a scenario, valid until the next call.

        It is this simulation where only loads differ and the rope stays on its towers, else a new one.

        Args:
            scenario: scenario such as another load of the same line.

        Raises:
            EquilibriumError: the scenario has no static equilibrium.
        """
        if differ_in_loads(scenario, self._first):
            engine = self._engine
            for kept, present in zip(self._fresh, (engine.states[0], engine.moving), strict=True):
                write(kept, present)
            with suppress(EquilibriumError, OtherModelError):
                engine.take_loads(scenario)
                self.scenario = scenario
                self._find_start(None, self._found)
                if np.abs(self.snapshot.columns.support_force).max(axis=1).all():
                    return self
        return Simulation(scenario, samples=self._observer.samples, on_demand=True)


def differ_in_loads(one: Scenario, other: Scenario) -> bool:
    """Whether two scenarios are equal but for payloads, a steady wind and tensioning devices of bullwheels."""
    if one.air.gusts or one.air.turbulence is not None or one.air.profile is not None:
        return False
    names = [name for name in type(one).model_fields if name not in SAID]
    return all(_equal(getattr(one, name), getattr(other, name), name) for name in names)


def _equal(one: Any, other: Any, name: str) -> bool:
    """Whether two values of a scenario's key `name` are equal, apart from loads in them."""
    if one is other or one == other:
        return True
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return list(one) == list(other) and all(_equal(one[key], other[key], name) for key in one)
    if type(one) is not type(other) or not hasattr(type(one), "model_fields"):
        return False
    left_out = LOADS.get(name, frozenset())
    keys = [key for key in type(one).model_fields if key not in left_out]
    return all(_equal(getattr(one, key), getattr(other, key), key) for key in keys)
