"""Slow quantities of a plant that a twin estimates, with their priors, and the sensors that measure them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cable_twin.ensemble.estimate.kalman import Belief
from cable_twin.frame.sensors import ANGLES, Measurement, body_of
from cable_twin.frame.snapshot import Layout
from cable_twin.mechanics.parameters import FloatArray
from cable_twin.scenario import Scenario, wind_unfelt
from cable_twin.scenario.builders.system import tower_friction

# slow error of the model in what a sensor reads, a standard deviation beside its noise, assumed
PLACE_ERROR, FORCE_ERROR, LOAD_ERROR, ANGLE_ERROR = 0.2, 0.15, 6e-5, 4e-4  # m, of the noise, of the load, rad
TOWER_ERROR = 4e-4  # as LOAD_ERROR
# PLACE_ERROR is that of a twin whose drive is not brought to the place of its plant below 0.3 m, see `Pursuit`


class Errors(NamedTuple):
    """Standard deviations of the error of the model in a sensor: between two meshes, and by waves of the plant alone.

    Two meshes differ little. Waves that a plant has and its twin does not, as where it stopped a little earlier, are
    larger, and go along the rope for minutes.
    """

    quiet: float
    stirred: float  # by such waves; a passed tower excites a share of them
    at_tower: float = 0.0  # the same while it is passed, where that is another one

    def scaled(self, scale: float) -> Errors:
        """Standard deviations of the discretisation error times a factor."""
        return Errors(*(scale * one for one in self))

    def variance(self, stirred: float, at_tower: bool) -> float:
        """Variance of the discretisation error at a remaining share of the waves that the plant alone has."""
        extra = self.at_tower if at_tower and self.at_tower else self.stirred
        return self.quiet**2 + (stirred * extra) ** 2


WHEEL_FORCE_ERROR = 1.0  # as FORCE_ERROR, of a bullwheel: waves of the haul rope differ between meshes

# of sensors, as that of independent samples: three times the error, as it lasts as long as a swing
FAST_PLACE, FAST_FORCE, FAST_LOAD = Errors(0.05, 0.05), Errors(0.3, 12.0), Errors(1e-4, 1.2e-3)  # units as above
FAST_WHEEL_FORCE = Errors(2.0, 6.0)
FAST_TOWER, FAST_ANGLE = Errors(2e-4, 1e-2), Errors(4e-4, 3e-3)
# of what is hidden, at one moment: shares of forces, and pitch of bodies in rad
HIDDEN_FORCE_ERRORS = {
    "lowest": Errors(2e-5, 4e-4),
    "highest": Errors(2e-5, 4e-4),
    "counterweight": Errors(2e-5, 4e-4),
    "end": Errors(2e-5, 4e-4),
    "tower": Errors(5e-5, 1.2e-3, 1.5e-2),
}
HIDDEN_PITCH_ERRORS = Errors(3e-4, 1.6e-3, 5e-3)
# with several ropes: haul ropes swing along
STRAND_ERRORS = Errors(1.5e-3, 1.5e-2, 3e-2)
ROLLER_ERRORS = Errors(3e-3, 5e-2, 0.1)
OF_ROPES = 6.0  # times as much as with one rope
PITCH_OF_ROPES = Errors(2e-3, 6e-3, 2e-2)
FAST_ANGLE_OF_ROPES = FAST_ANGLE.scaled(4.0)  # rad, of an inclinometer
# of load cells of a haul rope, as shares of the load: strands swing along, and no node of their mesh follows a clamp
STRAND_ERROR, FAST_STRAND, FAST_ROLLER = 6e-4, Errors(4e-3, 7e-3), Errors(2e-2, 3e-2)
LEAST_FORCE = 3e3  # N, of which these errors are shares at least: a haul rope may lift off
CURVATURE = 0.15  # of the step of a slow quantity, by which it may be wrong, as effects are not linear
OF_SQUARE = 0.5  # the same of wind, whose effect is that of its square
WIND_WALK = 0.2  # m/s after a second, as of gusts of 1 m/s that last 50 s; less would trust the square law too far off
ICE, ICE_TOLERANCE, ICE_WALK = 0.5, 0.3, 5e-3  # kg/m: prior deviation, without an alarm, after a second
ICING = 0.05  # kg/m, standard deviation of ice that comes or falls off within a window
PAYLOAD_TOLERANCE = 0.015  # of the capacity, without an alarm
HELD = 0.1  # of the friction of all towers, standard deviation of what it holds of a tension after earlier motion
BOARDING = 0.01  # of the capacity, by which a payload may change in a second in a station, as WIND_WALK
NEAR = 40.0  # m along the track from a tower, where slow quantities go on by the model, and of a station
SLOW = 0.1  # m/s, below which the twin of a vehicle that stands in a station counts as standing
QUANTISED = 12**-0.5  # standard deviation of rounding, in quanta
NOISE = 1e-12  # least standard deviation, of a sensor without any


class Slow(NamedTuple):
    """Slow quantity of a plant, which is estimated: key of the scenario, unit, prior, and drift."""

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
    curvature: float = CURVATURE  # of a step, by which it may be wrong, as effects are not linear
    also: tuple[str, ...] = ()  # further keys of the scenario with the same value
    change: float = 0.0  # standard deviation of a sudden change; 0 where there is none
    payload_of: str = ""  # carriage whose payload it is, which changes in stations alone
    room: float = 0.0  # of a value of the scenario that is an interval: half of it, about the quantity

    def value_at(self, value: float) -> float | list[float]:
        """Value of the scenario for a value of the quantity."""
        return [value - self.room, value + self.room] if self.room > 0.0 else value


class Reading(NamedTuple):
    """Quantity that a sensor measures: index of the value in the row of a frame, noise, and error of the model."""

    name: str
    unit: str
    places: NDArray[np.intp]  # of the number, or of the components of a vector whose length is read
    noise: float  # of a sample
    fast: Errors  # of the model
    error: float  # slow error of the model
    offset: float = 0.0  # of an encoder: its reading where that of the twin is 0
    waving: bool = False  # whether it feels waves of a haul rope, as forces do with several ropes

    def of(self, numbers: FloatArray) -> FloatArray:
        """Values (members,) that the sensor would read without errors, from frame rows (members, n)."""
        found: FloatArray = numbers[:, self.places]
        return found[:, 0] + self.offset if self.places.size == 1 else np.linalg.norm(found, axis=1)

    def in_frame(self, numbers: FloatArray) -> float:
        """Value that the sensor would read without errors, from the row (n,) of one frame."""
        return float(self.of(numbers[None, :])[0])

    def measured(self, measurement: Measurement) -> float:
        """Scalar value of a measurement by the sensor; for a vector, its length."""
        values = measurement.values
        return values[0] if self.places.size == 1 else float(np.linalg.norm(values))


def slow_quantities(scenario: Scenario) -> tuple[Slow, ...]:
    """Slow quantities of a scenario that are estimated: payloads, rolling friction, felt wind, ice, counterweights."""
    found = []
    for name, carriage in scenario.carriages.items():
        if carriage.payload is not None and carriage.payload.capacity > 0.0:
            most = carriage.payload.capacity
            key = f"carriages.{name}.payload.mass"
            payload = Slow(f"{name}/payload", key, "kg", 0.5 * most, 0.3 * most, 0.0, most, carriage.payload.mass, 0.0)
            tolerance = PAYLOAD_TOLERANCE * most
            found.append(payload._replace(tolerance=tolerance, change=0.3 * most, payload_of=name))
    found += _rolling(scenario)
    axes = "" if wind_unfelt(scenario) else "xy" if scenario.dim == 3 else "x"
    for axis, speed in zip(axes, scenario.air.wind, strict=False):
        key, most = f"air.wind.{axis}", 40.0
        wind = Slow(f"wind/{axis}", key, "m/s", speed, 5.0, -most, most, speed, most, WIND_WALK, OF_SQUARE)
        found.append(wind._replace(change=wind.deviation))
    if len(scenario.cables) == 1:
        ((rope, cable),) = scenario.cables.items()
        key, ice = f"{scenario.rope_key(rope)}.ice", cable.ice
        own = Slow("ice", key, "kg/m", ice, ICE, 0.0, ice + 10.0, ice, ICE_TOLERANCE, ICE_WALK)
        found.append(own._replace(change=ICING))
    for rope, end in product(scenario.cables, ("start", "end")):
        support = scenario.cables[rope].ends[end]
        if support.support == "counterweight":
            mass = support.mass or (support.force or 0.0) / scenario.gravity
            name = dict(zip(("start", "end"), scenario.end_names(rope), strict=True))[end]
            found.append(
                Slow(
                    name=f"{name}/counterweight",
                    key=f"{scenario.rope_key(rope)}.{end}.mass",
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


def _rolling(scenario: Scenario) -> list[Slow]:
    """Rolling friction as slow quantities: of each carriage with one rope, one for all with several ropes."""
    of = {name: one.friction.rolling for name, one in scenario.carriages.items() if one.friction.rolling > 0.0}
    groups = [[name] for name in of] if len(scenario.cables) == 1 else [[*of]] if of else []
    found = []
    for names in groups:
        key, *also = [f"carriages.{name}.friction.rolling" for name in names]
        usual = of[names[0]]
        name = f"{names[0]}/rolling" if len(names) == 1 else "carriages/rolling"
        low, high, tolerance = 0.05 * usual, 4.0 * usual, 0.5 * usual
        rolling = Slow(name, key, "-", usual, 0.4 * usual, low, high, usual, tolerance, change=0.6 * usual)
        found.append(rolling._replace(also=tuple(also)))
    return found


def payload_places(slow: Sequence[Slow], layout: Layout) -> dict[int, int]:
    """Place of each payload among some quantities in the numbers of a frame, by its index among them."""
    rows = {row: layout.vehicle_rows[one.payload_of] for row, one in enumerate(slow) if one.payload_of}
    return {row: int(layout.places.payload[vehicle]) for row, vehicle in rows.items()}


def boards(one: Slow, scenario: Scenario, layout: Layout, numbers: FloatArray, slow: float = SLOW) -> bool:
    """Whether a quantity is the payload of a carriage that stands in a station, by the values (n,) of a frame.

    Args:
        one: quantity.
        scenario: of the twin.
        layout: of the frame.
        numbers: (n,) values of the frame.
        slow: m/s, below which the carriage counts as standing.
    """
    if not one.payload_of:
        return False
    row, places = layout.vehicle_rows[one.payload_of], layout.places
    carriage = scenario.carriages[one.payload_of]
    assert carriage.payload is not None
    length = scenario.cables[scenario.rope_of(carriage)].unstrained_length
    place, speed = float(numbers[places.arc_length[row]]), float(numbers[places.speed[row]])
    near = min(place, length - place) <= (carriage.payload.station_distance or NEAR)
    return near and abs(speed) <= max(carriage.payload.station_speed, slow)


def boarding_walk(one: Slow, scenario: Scenario, layout: Layout, numbers: FloatArray) -> float:
    """Standard deviation of what a payload may change by in a second in a station; 0 elsewhere, as of `boards`."""
    return BOARDING * one.high if boards(one, scenario, layout, numbers) else 0.0


def changes_of(slow: Sequence[Slow], scenario: Scenario, layout: Layout, numbers: FloatArray) -> list[float]:
    """Standard deviations of sudden changes of slow quantities (0 of payloads on the line), as of `boards`."""
    return [0.0 if one.payload_of and not boards(one, scenario, layout, numbers) else one.change for one in slow]


def readings(scenario: Scenario, layout: Layout, scale: Mapping[str, float]) -> dict[str, Reading]:
    """Quantities that the sensors measure, by name; without inertial sensors.

    Args:
        scenario: with the sensors.
        layout: of its frames.
        scale: load at rest (N) by support.
    """
    found, places, alone = {}, layout.places, len(layout.ropes) == 1
    hauled = {name for rope in scenario.strands for name in (*scenario.end_names(rope), *scenario.of_rope(rope).towers)}
    for name, sensor in scenario.sensors.items():
        noise = max(float(np.hypot(sensor.noise, QUANTISED * sensor.quantum)), NOISE)
        if sensor.kind in ("encoder", "drive_force"):
            encoder = sensor.kind == "encoder"
            driven = sensor.of in layout.drive_rows
            of_drive = places.drive_position if encoder else places.moving_cable_force
            of_vehicle = places.arc_length if encoder else places.drive_force
            row = (layout.drive_rows if driven else layout.vehicle_rows)[sensor.of]
            column = (of_drive if driven else of_vehicle)[row]
            force, waves = (WHEEL_FORCE_ERROR, FAST_WHEEL_FORCE) if driven else (FORCE_ERROR, FAST_FORCE)
            error = PLACE_ERROR if encoder else force * noise
            fast = FAST_PLACE if encoder else waves.scaled(noise)
            place, waving = np.atleast_1d(column).astype(np.intp), not (encoder or alone)
            found[name] = Reading(name, "m" if encoder else "N", place, noise, fast, error, waving=waving)
        elif sensor.kind == "load_cell":
            columns = places.support_force[layout.support_rows[sensor.of]].astype(np.intp)
            load, tower = scale[sensor.of], sensor.of not in layout.end_samples
            fast, error = (FAST_TOWER, TOWER_ERROR) if tower else (FAST_LOAD, LOAD_ERROR)
            fast, error = (fast, error) if alone else (fast.scaled(OF_ROPES), OF_ROPES * error)
            if sensor.of in hauled:
                fast, error = (FAST_ROLLER, error) if tower else (FAST_STRAND, STRAND_ERROR)
            found[name] = Reading(name, "N", columns, noise, fast.scaled(load), error * load, waving=not alone)
        elif sensor.kind == "inclinometer":
            column = places.body_angles[layout.bodies.index(body_of(sensor, layout)), ANGLES[sensor.axis]]
            place = np.atleast_1d(column).astype(np.intp)
            fast = FAST_ANGLE if alone else FAST_ANGLE_OF_ROPES
            found[name] = Reading(name, "rad", place, noise, fast, ANGLE_ERROR)
    return found


def friction_errors(scenario: Scenario, readings: Mapping[str, Reading], scale: Mapping[str, float]) -> FloatArray:
    """Standard deviations (sensors,) of the load cells by the friction of towers, which depends on earlier motion.

    Args:
        scenario: with the sensors.
        readings: of the sensors, by name.
        scale: load at rest (N) by support.
    """
    found = np.zeros(len(readings))
    for rope in scenario.cables:
        own, ends = scenario.of_rope(rope), scenario.end_names(rope)
        held = HELD * sum(tower_friction(one) * scale[name] for name, one in own.towers.items())
        strongest = max(scale[end] for end in ends)
        share = {name: 0.5 * scale[name] / strongest for name in own.towers}
        share |= {
            name: float(end.support != "counterweight") for name, end in zip(ends, own.cable.ends.values(), strict=True)
        }
        for row, name in enumerate(readings):
            sensor = scenario.sensors[name]
            if sensor.kind == "load_cell" and sensor.of in share:
                found[row] = held * share[sensor.of]
    return found


class Estimate(NamedTuple):
    """Estimated value with its standard deviation."""

    value: float
    deviation: float
    unit: str


def estimates_of(slow: Sequence[Slow], belief: Belief) -> dict[str, Estimate]:
    """Estimates of slow quantities, the first ones in a belief, by name, within their bounds."""
    deviations = np.sqrt(np.diag(belief.covariance))
    return {
        one.name: Estimate(float(np.clip(mean, one.low, one.high)), float(deviation), one.unit)
        for one, mean, deviation in zip(slow, belief.mean, deviations, strict=False)
    }


class Hidden(NamedTuple):
    """Quantity that is estimated even where no sensor measures it: its place in a frame, and the error of the model."""

    name: str
    unit: str
    places: NDArray[np.intp]  # in the numbers of a frame: of it, or of the components of a vector whose length it is
    errors: Errors  # of the model: shares of a force, or rad

    def of(self, numbers: FloatArray) -> FloatArray:
        """Values (members,) of the quantity in frame rows (members, n)."""
        found: FloatArray = numbers[:, self.places]
        return found[:, 0] if self.places.size == 1 else np.linalg.norm(found, axis=1)

    def error(self, value: float) -> Errors:
        """Errors of the model in the unit of the quantity, where it has a value."""
        return self.errors.scaled(max(abs(value), LEAST_FORCE) if self.unit == "N" else 1.0)


def hidden_quantities(scenario: Scenario, layout: Layout) -> tuple[Hidden, ...]:
    """Quantities estimated without sensors: extreme tensions, forces of ends and towers, angles of bodies."""
    places, found = layout.places, []
    alone = len(scenario.cables) == 1
    share = 1.0 if alone else OF_ROPES
    towers = {rope: scenario.of_rope(rope).towers for rope in scenario.cables}
    ends = {
        name: end
        for rope, cable in scenario.cables.items()
        for name, end in zip(scenario.end_names(rope), cable.ends.values(), strict=True)
    }
    for row, rope in enumerate(layout.ropes):
        for which, column in (("lowest", places.lowest_tension), ("highest", places.highest_tension)):
            place = np.atleast_1d(column[row, 0]).astype(np.intp)
            errors = STRAND_ERRORS if rope in scenario.strands else HIDDEN_FORCE_ERRORS[which].scaled(share)
            found.append(Hidden(f"{rope}/{which} tension", "N", place, errors))
    for row, name in enumerate(layout.supports):
        end = ends.get(name)
        kind = "tower" if end is None else "counterweight" if end.support == "counterweight" else "end"
        vector = places.support_force[row].astype(np.intp)
        rope = next((rope for rope in scenario.cables if name in (*scenario.end_names(rope), *towers[rope])), "")
        beside = ROLLER_ERRORS if kind == "tower" else STRAND_ERRORS
        errors = beside if rope in scenario.strands else HIDDEN_FORCE_ERRORS[kind].scaled(share)
        found.append(Hidden(f"{name}/force", "N", vector, errors))
    for row, name in enumerate(layout.bodies):
        for angle in ("pitch", "roll") if layout.space else ("pitch",):
            place = np.atleast_1d(places.body_angles[row, ANGLES[angle]]).astype(np.intp)
            found.append(Hidden(f"{name}/{angle}", "rad", place, HIDDEN_PITCH_ERRORS if alone else PITCH_OF_ROPES))
    return tuple(found)


def weights_of(points: FloatArray, wanted: FloatArray, shares: FloatArray) -> FloatArray:
    """Weights (members, members) that blend the members' states from stencil points to other points, to first order.

    Args:
        points: (2 n + 1, n) slow quantities: the middle, then one above and one below it along each.
        wanted: (2 n + 1, n) likewise, after an update.
        shares: (m,) of the swings of the m members behind them, which all members get.
    """
    (first, count), size = points.shape, points.shape[0] + shares.size
    weights = np.zeros((size, size))
    weights[:, 0] = 1.0 - shares.sum()
    weights[:, first:] = shares
    for number in range(count):
        above, below = 1 + 2 * number, 2 + 2 * number
        share = (wanted[:, number] - points[0, number]) / (points[above, number] - points[below, number])
        weights[:first, above] += share
        weights[:first, below] -= share
    weights[first:] = weights[0]
    return weights


def weights_along(values: FloatArray, wanted: FloatArray, above: int, below: int) -> FloatArray:
    """Weights (members, members) that move each member along the difference of two of them, to first order.

    Args:
        values: (members,) of a quantity that depends on the states.
        wanted: (members,) its values after the move.
        above: member on one side.
        below: member on the other side.
    """
    weights = np.eye(values.size)
    shares = (wanted - values) / (values[above] - values[below])
    weights[:, above] += shares
    weights[:, below] -= shares
    return weights


def bounds(quantities: Sequence[Slow]) -> tuple[FloatArray, FloatArray]:
    """Least and largest values (n,) of slow quantities."""
    return np.array([one.low for one in quantities]), np.array([one.high for one in quantities])


def stencil(mean: FloatArray, deviation: FloatArray, quantities: Sequence[Slow]) -> FloatArray:
    """Stencil points (2 n + 1, n): the mean within bounds, and a deviation above and below it in each quantity."""
    low, high = bounds(quantities)
    middle = np.clip(mean, low, high)
    points = np.tile(middle, (2 * middle.size + 1, 1))
    for number in range(middle.size):
        points[1 + 2 * number, number] = min(middle[number] + deviation[number], high[number])
        points[2 + 2 * number, number] = max(middle[number] - deviation[number], low[number])
    return points
