"""Allocation of the extremes of one rope of a scenario."""

from __future__ import annotations

from math import inf, nan

import numpy as np

from cable_twin.geometry.ground import ground_of
from cable_twin.key_figures.extremes import highest, lowest
from cable_twin.key_figures.rope_measures import PLACES, DriveExtremes, Memory
from cable_twin.scenario import Grading, Scenario


def allocate(scenario: Scenario) -> Memory:
    """Memory of the extremes of one rope, empty before the first frame."""
    cable, vehicles, supports = scenario.cable, len(scenario.vehicles), 2 + len(scenario.towers)
    elements = cable.elements
    end_element = elements.at_towers if isinstance(elements, Grading) else cable.unstrained_length / elements
    clamped = [vehicle.joint == "clamped" for vehicle in scenario.vehicles.values()]
    rollers = [tower.contacts if tower.kind == "sheaves" else 0 for tower in scenario.towers.values()]
    tops = [(tower.position[0], tower.position[-1]) for tower in scenario.towers.values()]
    return Memory(
        length=float(cable.unstrained_length),
        corners=np.array([(nan, nan), *tops, (nan, nan)], dtype=np.float64),
        rails=np.where(clamped, end_element, -inf),
        ground=ground_of(scenario) if scenario.dim == 2 else ground_of(scenario)._replace(terrain=np.empty((0, 2))),
        tension=highest(),
        slackest=lowest(),
        sag=highest(supports - 1),
        highest_load=highest(supports),
        lowest_load=lowest(supports),
        margin=lowest(supports),
        rollers=np.array([0, 0, *rollers], dtype=np.float64),
        roller_load=lowest(supports),
        farthest=highest(supports),
        nearest=lowest(supports),
        drives=drive_extremes(len(scenario.drives)),
        vehicle_drives=drive_extremes(vehicles),
        swing=highest(vehicles),
        acceleration=highest(vehicles),
        contact_force=highest(vehicles),
        haul_force=highest(vehicles),
        tension_ratio=lowest(vehicles),
        clearance=lowest(1 + vehicles),
        next_look=np.full(1, -inf),
        passed_times=np.full(PLACES, nan),
        passed=np.full((PLACES, vehicles, 4), nan),
        passed_last=np.zeros(1, dtype=np.int64),
    )


def drive_extremes(count: int) -> DriveExtremes:
    """Extremes of `count` drives, empty before the first frame."""
    return DriveExtremes(highest(count), highest(count), highest(count), lowest(count))


__all__ = ["allocate", "drive_extremes"]
