"""True values of what a twin estimates, from the log of a simulated plant; for comparison."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.ensemble.estimate.correction import Correction
from cable_twin.ensemble.estimate.followers import AnyFollower
from cable_twin.ensemble.estimate.line_statics import counterweight_keys
from cable_twin.ensemble.estimate.quantities import hidden_quantities
from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import Layout, Snapshot
from cable_twin.messages import ESTIMATE
from cable_twin.offline.thinned_series import SAME, Series
from cable_twin.recording.log_reader import Log, read_snapshots
from cable_twin.scenario import Scenario, load_scenario
from cable_twin.scenario.builders.system import tower_friction


class Truth(NamedTuple):
    """True values of an estimated quantity over time, and the one at the time of the last estimate."""

    times: FloatArray  # (n,) s
    values: FloatArray  # (n,)
    last: float


def true_values(log: Log, follower: AnyFollower, last: Correction, twin: Scenario) -> dict[str, Truth]:
    """True values of estimated quantities, by name; none where the log has no frames of the plant.

    Args:
        log: Of the plant; one with estimates was recorded by another twin.
        follower: The filter of the twin.
        last: Its last correction.
        twin: Scenario of the twin.

    Raises:
        LogError: A message is unreadable.
    """
    if not log.scenario or next(iter(log.messages([ESTIMATE])), None) is not None:
        return {}
    plant, names = load_scenario(log.scenario), {*last.slow, *last.hidden}
    series: dict[str, Series] = {}
    present: dict[str, float] = {}
    layout: Layout | None = None
    for item in read_snapshots(log):
        if not isinstance(item, Snapshot):
            continue
        if item.time > last.time + SAME:
            break
        if layout is None:
            layout = item.layout
            places = {name: at for name, at in _places(plant, layout).items() if name in names}
            numbers = {name: at for name, at in places.items() if at.size == 1}
            ones = np.concatenate([np.zeros(0, np.intp), *numbers.values()])
            vectors = {name: at for name, at in places.items() if name not in numbers}
            threes = np.array([*vectors.values()], np.intp).reshape(-1, 3)
        values = np.append(item.numbers[ones], np.linalg.norm(item.numbers[threes], axis=1))
        for name, value in zip((*numbers, *vectors), values.tolist(), strict=True):
            if not math.isnan(value):  # not in the log at this time
                series.setdefault(name, Series()).append(item.time, value)
                present[name] = value
    if layout is None:
        return {}
    lasted, constant = np.array([0.0, last.time]), _constant(log, follower, plant, twin)
    found = {name: Truth(lasted, np.full(2, value), value) for name, value in constant if name in names}
    return found | {name: Truth(*one.line(), present[name]) for name, one in series.items()}


def _places(plant: Scenario, layout: Layout) -> dict[str, NDArray[np.intp]]:
    """Indices in a frame of a plant of the number, or of the vector whose length is meant, by the estimate's name."""
    found = {one.name: one.places for one in hidden_quantities(plant, layout)}
    found |= {
        f"{name}/payload": layout.places.payload[[row]].astype(np.intp) for name, row in layout.vehicle_rows.items()
    }
    return found | {f"wind/{axis}": layout.places.wind[[row]].astype(np.intp) for row, axis in enumerate("xy")}


def _constant(log: Log, follower: AnyFollower, plant: Scenario, twin: Scenario) -> Iterator[tuple[str, float]]:
    """Names and true values of estimated quantities that a plant's scenario has: friction, ice, counterweights."""
    for one in follower.slow:
        value: Any = log.scenario
        for part in one.key.split("."):
            value = value.get(part) if isinstance(value, dict) else None
        if isinstance(value, int | float):
            yield one.name, float(value)
    own, of_twin = ({name: tower_friction(tower) for name, tower in one.towers.items()} for one in (plant, twin))
    shares = {round(own[name] / of_twin[name], 9) for name in own if of_twin.get(name)}
    rolling = {plant.carriers.friction.rolling} if plant.carriers is not None else set()
    ices = {one.ice for one in plant.cables.values()}
    if plant.carriers is not None:
        yield from ((f"{name}/counterweight", mass) for name, (_, mass) in counterweight_keys(plant).items())
    for name, values in (("towers/friction", shares), ("carriers/rolling", rolling), ("ropes/ice", ices)):
        if len(values) == 1:
            yield name, float(*values)
