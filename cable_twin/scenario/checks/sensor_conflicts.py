"""Consistency checks of sensors."""

from __future__ import annotations

from collections.abc import Iterator

from cable_twin.scenario.checks.fault import Fault, name_faults, refuse, show
from cable_twin.scenario.schema import Scenario


def sensor_faults(scenario: Scenario) -> Iterator[Fault]:
    """Faults of sensors: unknown objects, two of one kind on one object, or keys of another kind."""
    vehicles = _vehicles(scenario)
    ends = [end for rope in scenario.cables for end in scenario.end_names(rope)]
    bodies = [f"{name}/{body}" for name, own in vehicles.items() for body in own]
    known = {
        "encoder": [*scenario.drives, *vehicles],
        "load_cell": [*ends, *scenario.towers],
        "inclinometer": [*vehicles, *bodies],
        "imu": [*vehicles, *bodies],
    }
    taken: dict[tuple[str, str], str] = {}
    for name, sensor in scenario.sensors.items():
        path = ("sensors", name)
        yield from name_faults(path)
        if sensor.kind not in known or not isinstance(sensor.of, str):
            continue  # a fault of its own
        if sensor.of not in known[sensor.kind]:
            allowed = ", ".join(known[sensor.kind][:8]) or "nothing in this scenario"
            more = ", ..." if len(known[sensor.kind]) > 8 else ""
            yield Fault((*path, "of"), f"given {show(sensor.of)}; allowed for {sensor.kind}: {allowed}{more}")
        first = taken.setdefault((sensor.kind, sensor.of), name)
        if first != name:
            yield refuse(
                (*path, "of"), sensor.of, f"one {sensor.kind} for each", detail=f", which '{first}' measures already"
            )
        if sensor.kind != "imu":
            for key in ("rate_noise", "rate_bias"):
                if getattr(sensor, key) != 0.0:
                    yield refuse((*path, key), getattr(sensor, key), "0, only an imu has it")


def _vehicles(scenario: Scenario) -> dict[str, list[str]]:
    """Body names of all vehicles, also for a scenario with other faults."""
    found = {name: [*vehicle.bodies] for name, vehicle in scenario.carriages.items()}
    carriers = scenario.carriers
    if carriers is None or not isinstance(carriers.count, int):
        return found
    order = carriers.order or tuple(carriers.kinds)
    for number in range(carriers.count):
        kind = carriers.kinds.get(order[number % len(order)]) if order else None
        found[f"{carriers.name}_{number + 1}"] = [*(carriers.bodies if kind is None else kind.bodies)]
    return found


__all__ = ["sensor_faults"]
