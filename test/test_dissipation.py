"""What the integrator loses by itself, beside the energy that is missing in the end."""

import json
import re

import numpy as np
import pytest

from cable_twin.key_figures import ENERGY_LOST, KeyFigures
from cable_twin.mechanics.solution.dissipation import numerical_loss
from cable_twin.offline import simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT

pytestmark = pytest.mark.skipif(not JIT, reason="minutes without compilation")

ROPE = {"unstrained_length": 300.0, "mass_per_length": 5.0, "axial_stiffness": 5e7, "bending_stiffness": 0.0}
ENDS = {"start": {"position": [0.0, 0.0]}, "end": {"position": [100.0, 0.0]}}


def thrown(speed=10.0, **solver):
    """A slack cable of 300 m between ends 100 m apart, without any damping, thrown aside at a speed (m/s)."""
    simulation = Simulation(load_scenario({"cable": {**ROPE, **ENDS, "elements": 60}, "solver": solver}))
    full = simulation.capture()
    full.state.nodes.velocity[1:-1, 0, 0] = speed * np.sin(np.linspace(0.0, np.pi, 61))[1:-1]
    simulation.restore(full)
    return simulation


def whole_account(simulation, steps):
    """What all steps have lost and moved, J: each is looked at."""
    account = np.zeros(2)
    for step in range(steps):
        before = simulation.capture().state
        simulation.advance_to((step + 1) * simulation.step)
        account += numerical_loss(simulation.system, before, simulation.capture().state)
    return account


@pytest.mark.parametrize("step", [0.005, pytest.param(0.0025, marks=pytest.mark.long)])
def test_it_is_the_energy_that_is_missing(step):
    """To a fifth: the rest is the trapezoidal rule on forces of shocks. One step of 13 stands for all to a third."""
    simulation = thrown(step=step)
    start = simulation.energy().total
    lost, _ = whole_account(simulation, round(5.0 / step))
    missing = start - simulation.energy().total
    assert lost == pytest.approx(missing, rel=0.2)
    sampled = thrown(step=step).advance_to(5.0).solver
    assert sampled.energy_lost == pytest.approx(missing, rel=0.33)


def test_the_trapezoidal_rule_loses_nothing():
    """With a spectral radius of 1 the method is that: the account is 0 to rounding of what has moved."""
    lost, moved = whole_account(thrown(2.0, step=0.0025, spectral_radius=1.0), 200)
    assert abs(lost) < 1e-6 * moved


def figures_of(simulation, duration, command=()):
    figures = KeyFigures(simulation.scenario)
    for name, speed in command:
        simulation.command(name, speed=speed)
    for frame in range(round(duration / 0.1)):
        figures.update(simulation.advance_to(0.1 * (frame + 1)))
    return {figure.name: figure for figure in figures.figures()}


def test_a_slack_cable_on_long_steps_is_told_with_its_cause():
    lost = figures_of(thrown(30.0, step=0.005), 5.0)[ENERGY_LOST]
    assert lost.verdict == "exceeded"
    assert lost.value > 0.01
    assert "tension waves pass 3.2 elements in a step: lower solver.step" in lost.place


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("aerial_tramway", [("cabin", 7.0)]),
        ("single_span", [("cabin", 7.0)]),
        ("chairlift", [("haul_rope", 2.5)]),
        ("gondola", [("haul_rope", 6.0)]),
        ("seed_example", []),
    ],
)
def test_the_shipped_scenarios_keep_their_energy(name, command):
    lost = figures_of(Simulation(load_scenario(name)), 25.0 if command else 2.0, command)[ENERGY_LOST]
    assert lost.verdict == "kept"
    assert lost.place.endswith(" s on")  # nobody is told to change what is good
    assert lost.value < (0.0045 if name == "chairlift" else 0.0025)  # two strands, whose waves meet at the wheels


def test_simulate_warns_of_it(tmp_path, capsys):
    """A carriage that races down a slack cable."""
    car = {"arc_length": 20.0, "bodies": {"car": {"mass": 300.0, "inertia": 50.0, "upper_pivot": [0.0, 0.5]}}}
    path = tmp_path / "slack.yaml"
    content = {"cable": {**ROPE, **ENDS, "elements": 60}, "carriages": {"car": car}, "solver": {"step": 0.005}}
    path.write_text(json.dumps(content))  # which is YAML
    assert simulate.main([str(path), "--duration", "5", "--record", "off"]) == 0
    printed = capsys.readouterr()
    assert re.search(rf"{ENERGY_LOST} .* exceeded ", printed.out)
    assert f"simulate: warning: {ENERGY_LOST}: " in printed.err
    assert "lower solver.step" in printed.err
