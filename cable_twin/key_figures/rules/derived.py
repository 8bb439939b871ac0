"""Key figures for rules, derived from the key figures of a run and from the dimensions of its scenario."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from math import atan, hypot, inf, pi, sin, tan

from cable_twin.key_figures.figure import KeyFigure, Subject, figure, haul_rope_of
from cable_twin.key_figures.rules.subjects import Subjects
from cable_twin.scenario import Scenario
from cable_twin.scenario.builders.system import tower_friction
from cable_twin.scenario.sections.drives import HaulRope
from cable_twin.scenario.sections.line import Cable

SETTING = "as the scenario has it"


class Found:
    """Lookup of the key figures of a run by quantity, subject and statistic."""

    def __init__(self, figures: Iterable[KeyFigure]) -> None:
        self._figures = {one.id: one for one in figures}

    def __call__(self, quantity: str, subject: str, statistic: str) -> KeyFigure | None:
        """Key figure of a quantity, a subject and a statistic; None without one."""
        return self._figures.get((quantity, subject, statistic))  # type: ignore[call-overload, no-any-return]


def derived_figures(
    scenario: Scenario, figures: Iterable[KeyFigure], subjects: Subjects | None = None
) -> list[KeyFigure]:
    """Derive key figures for rules from the key figures of a run and the dimensions of its scenario.

    Args:
        scenario: scenario of the run.
        figures: key figures of the run.
        subjects: subjects of the scenario; None to find them.
    """
    found, subjects = Found(figures), subjects or Subjects(scenario)
    ropes: list[tuple[Subject, Cable | HaulRope]]
    ropes = [(_named(scenario, name), rope) for name, rope in scenario.cables.items()]
    ropes += [(haul_rope_of(scenario, name), rope) for name, rope in scenario.haul_ropes.items()]
    return [
        *(one for subject, rope in ropes for one in _of_rope(subject, rope, found)),
        *(one for tower in scenario.towers for one in _of_tower(scenario, tower, subjects, found)),
        *(one for name in scenario.sheaves for one in _of_bullwheel(scenario, name)),
        *_of_vehicles(scenario, subjects, found),
        *_of_line(scenario, subjects, found),
    ]


def _of(
    source: KeyFigure,
    quantity: str,
    statistic: str,
    value: float,
    subject: Subject | None = None,
    *,
    power: float = 1.0,
    other: KeyFigure | None = None,
) -> KeyFigure:
    """Key figure derived from another one, with the time and place of that figure.

    Its relative uncertainty is that of the source times `power`, by which it follows from the source, and that of the
    `other` figure, to which it is proportional or inverse.
    """
    name = source.name.partition(": ")[0] if ": " in source.name else ""
    one = figure(quantity, subject or Subject(source.id.subject, name), statistic, value, source.time, source.place)
    parts = [(source, power), *([(other, 1.0)] if other is not None else [])]
    known = [
        by * abs(each.uncertainty / each.value) for each, by in parts if each.uncertainty is not None and each.value
    ]
    return replace(one, band=source.band, uncertainty=sum(known) * abs(value) if known else None)


def _setting(quantity: str, subject: Subject, statistic: str, value: float) -> KeyFigure:
    """Key figure that follows from the scenario alone, without a run."""
    return figure(quantity, subject, statistic, value, 0.0, SETTING)


def _named(scenario: Scenario, rope: str) -> Subject:
    return Subject(f"ropes.{rope}", rope if scenario.ropes else "")


def _of_rope(subject: Subject, rope: Cable | HaulRope, found: Found) -> Iterator[KeyFigure]:
    """Safety factors of a rope on its calculated and its tested breaking force."""
    tension = found("rope_tension", subject.key, "highest")
    if tension is None or tension.value <= 0.0:
        return
    forces = {
        "calculated_safety_factor": rope.calculated_breaking_force,
        "tested_safety_factor": rope.tested_breaking_force,
    }
    for quantity, force in forces.items():
        if force is not None:
            yield _of(tension, quantity, "lowest", force / tension.value, subject)


def _of_tower(scenario: Scenario, name: str, subjects: Subjects, found: Found) -> Iterator[KeyFigure]:
    """Key figures of a tower for rules: load ratio, rope deflection, roller pressure, proportions of saddles."""
    tower, subject = scenario.towers[name], Subject(f"towers.{name}", name)
    rope = scenario.rope_of(tower)
    cable, key = scenario.cables[rope], f"ropes.{rope}"
    low, high = (found("support_load", subject.key, which) for which in ("lowest", "highest"))
    most = found("rope_tension", key, "highest")
    if low is not None and high is not None and high.value > 0.0:
        yield _of(low, "load_ratio", "lowest", low.value / high.value, other=high)
    if low is not None and most is not None and most.value > 0.0:
        yield _of(low, "rope_deflection", "lowest", low.value / most.value, other=most)
    if high is not None and tower.kind == "sheaves" and cable.metal_area:
        pressure = high.value / tower.contacts / cable.metal_area
        yield _of(high, "roller_pressure", "highest", pressure)
    if tower.kind == "saddle":
        friction = tower_friction(tower)
        yield _setting("saddle_friction", subject, "lowest", friction)
        if tower.radius and cable.diameter:
            yield _setting("radius_ratio", subject, "lowest", tower.radius / cable.diameter)
        if tower.radius and (speed := _speed(scenario, subjects, found)) is not None:
            yield _of(speed, "saddle_acceleration", "highest", speed.value**2 / tower.radius, subject, power=2.0)


def _of_bullwheel(scenario: Scenario, name: str) -> Iterator[KeyFigure]:
    """Ratios of a bullwheel's diameter to the diameters of its rope and of the thickest wire."""
    wheel, subject = scenario.sheaves[name], Subject(f"sheaves.{name}", name)
    ropes = [scenario.cables[rope] for rope in wheel.ropes if rope in scenario.cables]
    for quantity, sizes in (
        ("diameter_ratio", [one.diameter for one in ropes]),
        ("wire_ratio", [one.largest_wire for one in ropes]),
    ):
        if known := [size for size in sizes if size]:
            yield _setting(quantity, subject, "lowest", 2.0 * wheel.radius / max(known))


def _speed(scenario: Scenario, subjects: Subjects, found: Found) -> KeyFigure | None:
    """Key figure of the highest speed of a run: of its drives, else of its vehicles."""
    keys = [f"drives.{name}" for name in scenario.drives] or [one.subject.key for one in subjects.groups]
    speeds = [one for key in keys if (one := found("speed", key, "highest")) is not None]
    return max(speeds, key=lambda one: one.value, default=None)


def _of_vehicles(scenario: Scenario, subjects: Subjects, found: Found) -> Iterator[KeyFigure]:
    """Key figures of carriages and carriers for rules: inclination, wheel loads, brakes, grips and payload."""
    installation = scenario.limits.installation
    vehicles = subjects.vehicles
    names = list(vehicles)
    for group in subjects.groups:
        subject = group.subject
        for quantity, own in (("swing", "swing_tangent"), ("lateral_swing", "lateral_swing_tangent")):
            angle = found(quantity, subject.key, "highest")
            if angle is not None and angle.value < 0.5 * pi:
                tangent = tan(angle.value)
                by = angle.value * (1.0 + tangent**2) / tangent if tangent else 1.0
                yield _of(angle, own, "highest", tangent, power=by)
        carriage = scenario.carriages.get(subject.name)
        rope = scenario.rope_of(carriage) if carriage is not None else None
        ropes = [rope] if rope else list(scenario.carriers.tracks.values()) if scenario.carriers else []
        rolled = [name for name in ropes if subjects.rope_roles[name] == "track_ropes"]
        yield from _of_wheels(scenario, subject, rolled, found)
        pull = found("clamp_force", subject.key, "highest")
        if pull is not None and pull.value > 0.0 and installation.grip_force:
            yield _of(pull, "grip_slip_safety", "lowest", installation.grip_force / pull.value)
        payloads = [vehicles[names[row]].payload for row in group.rows]
        capacity = min((one.capacity for one in payloads if one is not None), default=None)
        if capacity is not None and installation.persons:
            yield _setting("mass_per_person", subject, "lowest", capacity / installation.persons)
        if carriage is None:
            continue
        if carriage.payload is not None:
            yield _setting("boarding_speed", subject, "highest", carriage.payload.station_speed)
        brake, steepest = carriage.drive.track_rope_brake, _steepest(subjects, ropes)
        if brake is not None and steepest > 0.0:
            mass = sum(body.mass for body in carriage.bodies.values()) + (capacity or 0.0)
            pulled = mass * scenario.gravity * sin(atan(steepest))
            if pulled > 0.0:
                yield _setting("brake_hold", subject, "lowest", brake.force / pulled)


def _of_wheels(scenario: Scenario, subject: Subject, ropes: list[str], found: Found) -> Iterator[KeyFigure]:
    """Key figures of the transverse load on track ropes: tension over load, wheel load over tension, wheel pressure."""
    force, wheels = found("contact_force", subject.key, "highest"), scenario.limits.installation.wheels
    tensions = [one for rope in ropes if (one := found("rope_tension", f"ropes.{rope}", "lowest")) is not None]
    if force is None or force.value <= 0.0 or not ropes:
        return
    least = min(tensions, key=lambda one: one.value, default=None)
    if least is not None and least.value > 0.0:
        yield _of(force, "tension_over_load", "lowest", least.value / force.value, other=least)
        if wheels:
            yield _of(force, "wheel_load_ratio", "highest", force.value / wheels / least.value, other=least)
    areas = [area for rope in ropes if (area := scenario.cables[rope].metal_area)]
    if wheels and areas:
        yield _of(force, "wheel_pressure", "highest", force.value / wheels / min(areas))


def _steepest(subjects: Subjects, ropes: Iterable[str]) -> float:
    """Steepest slope of the chords of ropes, rise over horizontal distance."""
    return max((abs(slope) for rope in ropes for slope in _slopes(subjects, rope)), default=0.0)


def _slopes(subjects: Subjects, rope: str) -> list[float]:
    return [z / across if (across := hypot(x, y)) > 0.0 else inf for x, y, z in subjects.chords[rope]]


def _of_line(scenario: Scenario, subjects: Subjects, found: Found) -> Iterator[KeyFigure]:
    """Key figures of the line for rules: slopes, clearance, wind pressure, carrier interval, settings of drives."""
    line = Subject("line")
    rope = next(iter(scenario.cables))
    chords = subjects.chords[rope]
    across, rise = sum(hypot(x, y) for x, y, _ in chords), sum(z for _, _, z in chords)
    if across > 0.0:
        yield _setting("slope", line, "mean", abs(rise) / across)
        if (steepest := _steepest(subjects, [rope])) < inf:
            yield _setting("slope", line, "highest", steepest)
    moving = [found("vehicle_clearance", group.subject.key, "lowest") for group in subjects.groups]
    ropes = [rope for rope in scenario.cables if subjects.rope_roles[rope] != "track_ropes"]
    moving += [found("rope_clearance", f"ropes.{rope}", "lowest") for rope in ropes]
    if heights := [one for one in moving if one is not None]:
        least = min(heights, key=lambda one: one.value)
        yield _of(least, "moving_clearance", "lowest", least.value, line)
    if (wind := found("wind", "air", "highest")) is not None:
        pressure = 0.5 * scenario.air.density * wind.value**2
        yield _of(wind, "wind_pressure", "highest", pressure, line, power=2.0)
    speed = _speed(scenario, subjects, found)
    if scenario.carriers is not None and speed is not None and speed.value > 0.0:
        carriers = Subject("carriers", scenario.carriers.name)
        yield _of(speed, "carrier_interval", "lowest", subjects.spacing / speed.value, carriers)
    drives = {f"drives.{name}": (name, one.limits) for name, one in scenario.drives.items()}
    drives |= {
        f"carriages.{name}": (name, one.drive.limits)
        for name, one in scenario.carriages.items()
        if not scenario.drives and one.joint == "sliding"
    }
    for key, (name, limits) in drives.items():
        yield _setting("drive_acceleration", Subject(key, name), "lowest", limits.acceleration)
        yield _setting("drive_deceleration", Subject(key, name), "lowest", limits.service_deceleration)
