"""Power of a carriage's drive: its integral is the energy that the system gains, and it keeps within its limit."""

import numpy as np
import pytest

from cable_twin.frame.plotted_signals import SIGNALS
from cable_twin.key_figures import KeyFigures
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

STEP = 0.01  # s
CONSERVATIVE = {
    "carriages.cabin.friction.rolling": 0.0,
    "cable.damping_time": 0.0,
    "cable.elements": 12,
    "air.density": 0.0,
    "solver.spectral_radius": 1.0,
    "solver.step": STEP,
}
HAUL_ROPE = {
    "axial_stiffness": 9e7,
    "mass_per_length": 7.0,
    "damping_ratio": 0.0,
    "drive_inertia": 3e4,
    "pretension": 6e4,
}


def powers(simulation, duration):
    """Power (steps + 1,) in W of the cabin's drive at every step, as plots and CSV files have it."""
    found = []
    for frame in range(round(duration / STEP) + 1):
        snapshot = simulation.advance_to(frame * STEP)
        found.append(float(SIGNALS["drive_power"].values(snapshot.layout, snapshot.columns)[0]))
    return np.array(found)


@pytest.mark.parametrize(
    ("changes", "left_out"),
    [
        ({}, 3e-5),
        ({"cable.joint": "paper", "solver.spectral_radius": 0.9}, 3e-5),
        ({"carriages.cabin.drive.haul_rope": HAUL_ROPE}, 8e-4),  # what that rope's energy gains by getting shorter
    ],
    ids=["node", "paper", "haul rope"],
)
def test_the_work_of_a_drive_is_the_energy_that_the_system_gains(changes, left_out):
    """The strain of the rope, 0.26 %, is a part of the way of a drive on the carriage."""
    simulation = Simulation(load_scenario("single_span", CONSERVATIVE | changes))
    before = simulation.energy().total
    simulation.command("cabin", speed=3.0)
    power = powers(simulation, 12.0)
    work = STEP * (power.sum() - 0.5 * (power[0] + power[-1]))
    assert work == pytest.approx(simulation.energy().total - before, rel=left_out)


def test_the_power_of_a_drive_on_the_carriage_keeps_to_its_limit():
    limits = {"carriages.cabin.drive.limits.power": 60e3, "solver.step": 0.5 * STEP}
    simulation = Simulation(load_scenario("single_span", CONSERVATIVE | limits))
    simulation.command("cabin", speed=6.0)
    figures = KeyFigures(simulation.scenario)
    for frame in range(800):
        figures.update(simulation.advance_to(2 * frame * STEP))
    (highest,) = [one for one in figures.figures() if one.id.quantity == "drive_power" and one.value > 0.0]
    assert highest.value == pytest.approx(60e3, rel=1e-3)
    assert highest.value <= 60e3
