"""Table of the quantities of key figures, with their limits."""

from __future__ import annotations

from typing import NamedTuple

from cable_twin.scenario import Scenario
from cable_twin.scenario.sections.limits import Bound, LimitRow, limit_row

TRACK_ROPE_SAFETY_FACTOR, HAUL_ROPE_SAFETY_FACTOR = 3.15, 4.5  # -
TENSION_PER_TRANSVERSE_LOAD = 10.0  # -, of carriages that roll on a rope
# keys whose usual limit depends on the rope or the vehicle; null in a scenario is the usual limit, 0 no limit
BY_KIND = ("rope_safety_factor", "tension_per_transverse_load")
# words for the detail in names that do not read on without one
ANY = {"vehicle_separation": "vehicles", "clamp_force": "a", "strand_tension": "a rope"}


class Quantity(NamedTuple):
    """Row of the table: a quantity with its unit, and the key of `limits` that holds its limit.

    Attributes:
        quantity: first part of a figure's id.
        name: printed name; {} stands for a detail such as the span. Of several statistics, the statistic follows.
        meaning: in plain words; for a quantity with a limit, the description of the limit.
        unit: SI unit, "-" for a plain number.
        statistics: statistics with figures.
        limit: key of `limits` for the first statistic; empty where no limit can be given.
    """

    quantity: str
    name: str
    meaning: str
    unit: str
    statistics: tuple[str, ...]
    limit: str = ""

    @property
    def in_general(self) -> str:
        """Printed name for figures of any detail."""
        return self.name.format(ANY.get(self.quantity, ""))

    @property
    def limit_row(self) -> LimitRow | None:
        """Bound, default, source and clause of the limit; None without one."""
        return limit_row(self.limit) if self.limit else None


HIGHEST, LOWEST = ("highest",), ("lowest",)
BOTH = HIGHEST + LOWEST


def bound_of(statistic: str) -> Bound:
    """Bound of key figures by their limit: "at least" for the lowest of a run, "at most" for other statistics."""
    return "at least" if statistic == "lowest" else "at most"


def _limited(name: str, limit: str, statistics: tuple[str, ...]) -> Quantity:
    """Quantity with a limit of the scenario, identified by the key of the limit."""
    row = limit_row(limit)
    return Quantity(limit, name, row.meaning, row.unit, statistics, limit)


_ROWS = (
    Quantity("rope_tension", "rope tension", "tension of a rope", "N", BOTH),
    _limited("rope safety factor", "rope_safety_factor", LOWEST),
    _limited("dynamic amplification, tension over that at the start", "dynamic_amplification", HIGHEST),
    _limited("sag below the chord{}", "sag", HIGHEST),
    _limited("rope clearance over the terrain", "rope_clearance", LOWEST),
    _limited("support load", "support_load", BOTH),
    Quantity("load_along_track", "load along the track", "force of a rope at rest on a support along x", "N", BOTH),
    Quantity("load_downwards", "load downwards", "force of a rope at rest on a support downwards", "N", BOTH),
    _limited("deropement margin, load over that at rest", "deropement_margin", LOWEST),
    _limited("load of a roller, lowest", "roller_load", LOWEST),
    Quantity(
        "lateral_force", "lateral rope force", "force of the rope on the groove of a tower, sideways", "N", HIGHEST
    ),
    Quantity("lateral_ratio", "lateral over normal force", "lateral over normal force in a groove", "-", HIGHEST),
    Quantity("derailed", "derailed", "1 for a tower whose grooves the rope has left", "-", HIGHEST),
    Quantity("counterweight_travel", "counterweight travel", "travel of a counterweight as it falls", "m", BOTH),
    Quantity("hydraulics_travel", "hydraulics travel", "travel of a hydraulic tensioner as it pulls", "m", BOTH),
    Quantity("hydraulics_pull", "hydraulics pull", "pull of both strands on a hydraulic tensioner", "N", BOTH),
    Quantity("speed", "speed", "speed of a vehicle or a drive, in either direction", "m/s", HIGHEST),
    Quantity("drive_speed", "drive speed", "speed of the haul rope at its drive, in either direction", "m/s", HIGHEST),
    Quantity("drive_force", "drive force", "force of a drive, in either direction", "N", HIGHEST),
    Quantity("drive_power", "drive power", "power of a drive, negative as it brakes", "W", BOTH),
    Quantity("brake_force", "brake force", "force of the brakes of a carriage in an emergency stop", "N", HIGHEST),
    _limited("stopping distance", "stopping_distance", HIGHEST),
    _limited("stopping time", "stopping_time", HIGHEST),
    Quantity(
        "mean_deceleration",
        "mean deceleration of the stop",
        "speed at the command to stop, squared, over twice the stopping distance: of the longest stop, of several the "
        "highest and the lowest too",
        "m/s^2",
        ("mean", "highest", "lowest"),
    ),
    Quantity("restart_delay", "delay of a restart", "time from standstill to the next command to move", "s", LOWEST),
    Quantity(
        "passenger_stopping_distance",
        "passenger's stopping distance",
        "travel of the load of a vehicle after a command to stop, swing included",
        "m",
        HIGHEST,
    ),
    Quantity(
        "end_stop_speed", "speed into an end stop", "speed of a carriage that runs into an end stop", "m/s", HIGHEST
    ),
    _limited("vehicle acceleration", "acceleration", HIGHEST),
    _limited("swing along the track", "swing", HIGHEST),
    _limited("swing across the track", "lateral_swing", HIGHEST),
    _limited("clearance to towers", "tower_clearance", LOWEST),
    Quantity("contact_force", "contact force", "force of the rope on a vehicle", "N", HIGHEST),
    Quantity("haul_force", "haul force", "force of a haul rope on a vehicle", "N", HIGHEST),
    _limited("tension over transverse load", "tension_per_transverse_load", LOWEST),
    _limited("clearance over the terrain", "vehicle_clearance", LOWEST),
    _limited("clearance between {}, least", "vehicle_separation", LOWEST),
    Quantity("buffer_force", "buffer force, highest", "force between the buffers of two vehicles", "N", HIGHEST),
    Quantity(
        "clamp_force", "pull of {} clamp along the track, highest", "force of a haul rope on a clamp", "N", HIGHEST
    ),
    Quantity("connector_force", "pull, highest", "pull of a connector between ropes", "N", HIGHEST),
    Quantity("connector_slack", "slack, longest in all", "time that a connector is slack", "s", HIGHEST),
    Quantity(
        "pantograph_force",
        "contact force",
        "force of a pantograph on its rope",
        "N",
        ("mean", "standard deviation", "highest", "lowest"),
    ),
    Quantity("contact_loss", "loss of contact, share of the time", "share of time without contact", "%", ("mean",)),
    Quantity("carried_load", "load of carriers, highest", "mass of carriers and payload on a rope", "kg", HIGHEST),
    Quantity("strand_tension", "tension of '{}'", "tension of a strand at a bullwheel", "N", BOTH),
    Quantity(
        "adhesion_used",
        "adhesion used of available",
        "logarithm of the ratio of tensions at a bullwheel over friction times wrap",
        "-",
        HIGHEST,
    ),
    Quantity("rope_slip", "slip of the rope", "distance that the rope has slipped on a bullwheel", "m", HIGHEST),
    Quantity("rollback", "rollback device triggered", "1 where a rollback device has stopped the lift", "-", HIGHEST),
    Quantity("drive_torque", "drive torque, highest", "torque of the drive of a bullwheel", "N m", HIGHEST),
    Quantity("wind", "wind", "speed of the wind as set, without gusts and turbulence", "m/s", HIGHEST),
    _limited("energy lost or gained by the solver", "energy_lost", HIGHEST),
    # of `rules/derived.py`: from other figures and the dimensions of a scenario, for rules
    Quantity("swing_tangent", "inclination along the track, tangent", "tangent of the swing", "-", HIGHEST),
    Quantity("lateral_swing_tangent", "inclination across the track, tangent", "tangent of the roll", "-", HIGHEST),
    Quantity(
        "calculated_safety_factor",
        "safety factor on the calculated breaking force",
        "sum of the breaking forces of all wires over the highest tension",
        "-",
        LOWEST,
    ),
    Quantity(
        "tested_safety_factor",
        "safety factor on the tested breaking force",
        "breaking force of a sample in a test over the highest tension",
        "-",
        LOWEST,
    ),
    Quantity(
        "tension_over_load",
        "least tension over highest load across the rope",
        "lowest tension of a rope over the highest force of a vehicle on it",
        "-",
        LOWEST,
    ),
    Quantity("moving_clearance", "clearance of what moves", "least height of vehicles and moving ropes", "m", LOWEST),
    Quantity("load_ratio", "smallest over largest load", "smallest over largest load of a tower", "-", LOWEST),
    Quantity(
        "rope_deflection", "deflection angle of the rope", "load of a tower over the tension of its rope", "rad", LOWEST
    ),
    Quantity("roller_pressure", "load of a roller over metal area", "as the mean of all rollers", "Pa", HIGHEST),
    Quantity("wheel_pressure", "load of a wheel over metal area", "as the mean of all wheels", "Pa", HIGHEST),
    Quantity(
        "wheel_load_ratio", "load of a wheel over least tension", "as the mean of all wheels, of its rope", "-", HIGHEST
    ),
    Quantity("radius_ratio", "radius over rope diameter", "of a saddle", "-", LOWEST),
    Quantity("diameter_ratio", "diameter over rope diameter", "of a bullwheel", "-", LOWEST),
    Quantity("wire_ratio", "diameter over that of the thickest wire", "of a bullwheel", "-", LOWEST),
    Quantity("saddle_acceleration", "highest speed squared over radius", "of a saddle", "m/s^2", HIGHEST),
    Quantity("carrier_interval", "interval of carriers", "spacing over the highest speed of the rope", "s", LOWEST),
    Quantity("boarding_speed", "speed below which a vehicle boards", "payload.station_speed", "m/s", HIGHEST),
    Quantity(
        "brake_hold", "brake on the track rope over pull of the weight", "on the steepest chord, loaded", "-", LOWEST
    ),
    Quantity("grip_slip_safety", "slip force of the grip over its pull", "highest pull of the run", "-", LOWEST),
    Quantity("mass_per_person", "payload per person", "capacity over persons", "kg", LOWEST),
    Quantity("saddle_friction", "friction along the rope", "of a tower", "-", LOWEST),
    Quantity("wind_pressure", "dynamic pressure of the wind", "half the density times speed squared", "Pa", HIGHEST),
    Quantity("slope", "slope of the chords", "rise over horizontal distance", "-", ("mean", "highest")),
    Quantity("drive_acceleration", "acceleration of the drive", "its limit", "m/s^2", LOWEST),
    Quantity("drive_deceleration", "deceleration of the drive", "its limit for a service stop", "m/s^2", LOWEST),
)
QUANTITIES = {row.quantity: row for row in _ROWS}


def usual_limit(scenario: Scenario, key: str, *, clamped: bool = False) -> float | None:
    """Usual limit for a key of `limits` that a scenario does not give; for some keys by kind of rope or vehicle."""
    if key == "rope_safety_factor":
        return HAUL_ROPE_SAFETY_FACTOR if scenario.drives or scenario.strand else TRACK_ROPE_SAFETY_FACTOR
    if key == "tension_per_transverse_load":
        return None if clamped else TENSION_PER_TRANSVERSE_LOAD
    return limit_row(key).default


def limit_of(
    scenario: Scenario, quantity: str, *, clamped: bool = False, hauls: bool = False
) -> tuple[float | None, str]:
    """Limit of a quantity and its source, from the scenario, else the usual limit; None without a limit.

    Args:
        scenario: scenario of one rope with its vehicles, for their quantities.
        quantity: row of the table, with a limit.
        clamped: True for vehicles clamped to the rope.
        hauls: True for the haul rope in the drive of a carriage.
    """
    key = QUANTITIES[quantity].limit
    if key == "rope_safety_factor" and (hauls or scenario.hauls):  # the factor of a track rope is not enough for it
        key = "haul_rope_safety_factor"
    given, usual = getattr(scenario.limits, key), usual_limit(scenario, key, clamped=clamped)
    limit = (usual if given is None else given or None) if key in BY_KIND else given
    return limit, limit_row(key).text if limit == usual else f"scenario: limits.{key}"
