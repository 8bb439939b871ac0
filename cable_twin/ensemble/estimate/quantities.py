"""Slow quantities of a plant that a twin estimates, with what is known of them before, and the sensors it reads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.sensors import body_of
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario
from cable_twin.scenario.schema import Sensor

# error of the model in what a sensor reads, a standard deviation beside its noise, assumed
PLACE_ERROR, FORCE_ERROR, LOAD_ERROR, ANGLE_ERROR = 4e-3, 0.25, 1e-4, 4e-4  # m, of the noise, of the load, rad
# the same of what is hidden, at one moment: shares of forces, and pitch of a first and of a further body, rad
TOWER_ERROR = 6e-4  # as LOAD_ERROR
HIDDEN_FORCE_ERRORS = {"lowest": 8e-4, "highest": 2e-4, "counterweight": 8e-4, "end": 2e-4, "tower": 2e-3}
HIDDEN_PITCH_ERRORS = 4e-3, 2e-3
# error of the model that lasts as long as a swing, as a standard deviation of samples that were independent
FAST_PLACE, FAST_FORCE, FAST_LOAD, FAST_TOWER, FAST_ANGLE = 8e-3, 3.0, 1.6e-3, 5e-3, 4e-3  # units as above
QUANTISED = 12**-0.5  # standard deviation of rounding, in quanta
NOISE = 1e-12  # least standard deviation, of a sensor without any


class Slow(NamedTuple):
    """Slow quantity: key of the scenario, unit, prior, and how fast it changes."""

    name: str
    key: str
    unit: str
    mean: float
    deviation: float
    low: float
    high: float
    plan: float  # value of the scenario
    tolerance: float  # by which the plant may differ from that without an alarm
    walk: float = 0.0  # standard deviation in a second


class Reading(NamedTuple):
    """Quantity that a sensor measures, by its place in the numbers of a frame."""

    name: str
    unit: str
    places: NDArray[np.intp]  # of the number, or of the components of a vector whose length is read
    deviation: float  # of a sample: its noise and the fast error of the model
    error: float  # slow error of the model

    def of(self, numbers: FloatArray) -> FloatArray:
        """Values (members,) of the sensor in rows (members, n) of numbers."""
        found: FloatArray = numbers[:, self.places]
        return found[:, 0] if self.places.size == 1 else np.linalg.norm(found, axis=1)


def slow_quantities(scenario: Scenario) -> tuple[Slow, ...]:
    """Quantities that are estimated in a scenario: payloads, rolling friction, wind, counterweights."""
    found = []
    for name, carriage in scenario.carriages.items():
        if carriage.payload is not None and carriage.payload.capacity > 0.0:
            most = carriage.payload.capacity
            key = f"carriages.{name}.payload.mass"
            plan = carriage.payload.mass
            found.append(Slow(f"{name}/payload", key, "kg", 0.5 * most, 0.3 * most, 0.0, most, plan, 0.05 * most))
        if (rolling := carriage.friction.rolling) > 0.0:
            key = f"carriages.{name}.friction.rolling"
            found.append(
                Slow(
                    f"{name}/rolling", key, "-", rolling, 0.4 * rolling, 0.05 * rolling, 4.0 * rolling, rolling, rolling
                )
            )
    for axis, speed in zip("xy" if scenario.dim == 3 else "x", scenario.air.wind, strict=False):
        found.append(Slow(f"wind/{axis}", f"air.wind.{axis}", "m/s", speed, 5.0, -40.0, 40.0, speed, 40.0, 0.1))
    for end in ("start", "end"):
        support = getattr(scenario.cable, end)
        if support.support == "counterweight":
            mass = support.mass
            found.append(
                Slow(
                    name=f"{end}/counterweight",
                    key=f"cable.{end}.mass",
                    unit="kg",
                    mean=mass,
                    deviation=5e-3 * mass,
                    low=0.9 * mass,
                    high=1.1 * mass,
                    plan=mass,
                    tolerance=0.01 * mass,
                )
            )
    return tuple(found)


def readings(sensors: Mapping[str, Sensor], layout: Layout, scale: Mapping[str, float]) -> dict[str, Reading]:
    """Readings of sensors by name; inertial ones are left out.

    Args:
        sensors: of the scenario.
        layout: of its frames.
        scale: load at rest (N) by support.
    """
    found, places = {}, layout.places
    for name, sensor in sensors.items():
        noise = max(float(np.hypot(sensor.noise, QUANTISED * sensor.quantum)), NOISE)
        if sensor.kind in ("encoder", "drive_force"):
            place = sensor.kind == "encoder"
            driven = sensor.of in layout.drive_rows
            of_drive = places.drive_position if place else places.moving_cable_force
            of_vehicle = places.arc_length if place else places.drive_force
            row = (layout.drive_rows if driven else layout.vehicle_rows)[sensor.of]
            column = (of_drive if driven else of_vehicle)[row]
            error = PLACE_ERROR if place else FORCE_ERROR * noise
            total = float(np.hypot(noise, FAST_PLACE if place else FAST_FORCE * noise))
            found[name] = Reading(name, "m" if place else "N", np.atleast_1d(column).astype(np.intp), total, error)
        elif sensor.kind == "load_cell":
            columns = places.support_force[layout.support_rows[sensor.of]].astype(np.intp)
            load, tower = scale[sensor.of], sensor.of not in layout.end_samples
            total = float(np.hypot(noise, (FAST_TOWER if tower else FAST_LOAD) * load))
            found[name] = Reading(name, "N", columns, total, (TOWER_ERROR if tower else LOAD_ERROR) * load)
        elif sensor.kind == "inclinometer":
            column = places.body_angles[layout.bodies.index(body_of(sensor, layout)), 1]
            found[name] = Reading(
                name, "rad", np.atleast_1d(column).astype(np.intp), float(np.hypot(noise, FAST_ANGLE)), ANGLE_ERROR
            )
    return found


class Hidden(NamedTuple):
    """Quantity that no sensor need measure."""

    name: str
    unit: str
    places: NDArray[np.intp]  # in the numbers of a frame: of it, or of the components of a vector whose length it is
    share: float  # error of the model, of the value
    error: float  # error of the model beside that


def hidden_quantities(scenario: Scenario, layout: Layout) -> tuple[Hidden, ...]:
    """Hidden quantities of a scenario: extreme tensions, forces of ends and towers, pitch of bodies."""
    places, found = layout.places, []
    for row, rope in enumerate(layout.ropes):
        for which, column in (("lowest", places.lowest_tension), ("highest", places.highest_tension)):
            place = np.atleast_1d(column[row, 0]).astype(np.intp)
            found.append(Hidden(f"{rope}/{which} tension", "N", place, HIDDEN_FORCE_ERRORS[which], 0.0))
    for row, name in enumerate(layout.supports):
        end = getattr(scenario.cable, name, None) if name in ("start", "end") else None
        kind = "tower" if end is None else "counterweight" if end.support == "counterweight" else "end"
        vector = places.support_force[row].astype(np.intp)
        found.append(Hidden(f"{name}/force", "N", vector, HIDDEN_FORCE_ERRORS[kind], 0.0))
    for row, name in enumerate(layout.bodies):
        place = np.atleast_1d(places.body_angles[row, 1]).astype(np.intp)
        found.append(Hidden(f"{name}/pitch", "rad", place, 0.0, HIDDEN_PITCH_ERRORS[row not in layout.first_body]))
    return tuple(found)


def weights_of(points: FloatArray, wanted: FloatArray) -> FloatArray:
    """Weights (members, members) that carry the states of points over to other ones, to first order.

    Args:
        points: (2 n + 1, n) slow quantities: the middle, then one above and one below it along each.
        wanted: (2 n + 1, n) likewise, after an update.
    """
    members, count = points.shape
    weights = np.zeros((members, members))
    weights[:, 0] = 1.0
    for number in range(count):
        above, below = 1 + 2 * number, 2 + 2 * number
        share = (wanted[:, number] - points[0, number]) / (points[above, number] - points[below, number])
        weights[:, above] += share
        weights[:, below] -= share
    return weights


def stencil(mean: FloatArray, deviation: FloatArray, quantities: Sequence[Slow]) -> FloatArray:
    """Points (2 n + 1, n): the mean within bounds, and a deviation above and below it along each quantity."""
    low, high = (np.array([getattr(one, side) for one in quantities]) for side in ("low", "high"))
    middle = np.clip(mean, low, high)
    points = np.tile(middle, (2 * middle.size + 1, 1))
    for number in range(middle.size):
        points[1 + 2 * number, number] = min(middle[number] + deviation[number], high[number])
        points[2 + 2 * number, number] = max(middle[number] - deviation[number], low[number])
    return points
