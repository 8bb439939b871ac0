"""Payload, wind, brakes and clearance of a simulation: accepted and refused commands, and replay."""

from math import inf, nan

import numpy as np
import pytest
from strands import one_strand
from test_simulation import same

from cable_twin.frame.records import Command, CommandError
from cable_twin.scenario import load_scenario
from cable_twin.scenario.builders.outlines import body_outline
from cable_twin.simulation import EquilibriumError, Simulation

CABIN = {"mass": 200.0, "inertia": 150.0, "upper_pivot": [0.0, 2.0], "drag_area": 3.0, "size": [2.0, 3.0]}
ROPE = {"axial_stiffness": 5e5, "mass_per_length": 0.5, "drive_inertia": 300.0, "pretension": 5e3}
DRIVE = {
    "mode": "speed",
    "limits": {"acceleration": 2.0, "speed": 5.0},
    "haul_rope": ROPE,
    "emergency_brake": {"force": 900.0, "rise_time": 0.2},
    "track_rope_brake": {"force": 500.0, "rise_time": 0.1},
    "emergency_stop": ["emergency_brake", "track_rope_brake"],
}


def scenario(*, alone=False, **changes):
    """Cabin of 200 kg in the lower station of a 60 m rope rising by 10 m; with a trolley unless alone."""
    trolley = {"arc_length": 30.0, "drive": {"mode": "speed"}, "bodies": {"trolley": CABIN}}
    return load_scenario(
        {
            "cable": {
                "unstrained_length": 60.9,
                "mass_per_length": 1.0,
                "axial_stiffness": 5e6,
                "bending_stiffness": 20.0,
                "elements": 8,
                "diameter": 0.02,
                "start": {"position": [0.0, 0.0]},
                "end": {"position": [60.0, 10.0]},
            },
            "carriages": {
                "cabin": {
                    "arc_length": 2.0,
                    "drive": DRIVE,
                    "payload": {"capacity": 400.0, "position": [0.2, -0.5], "station_distance": 4.0},
                    "bodies": {"cabin": CABIN},
                },
                **({} if alone else {"trolley": trolley}),
            },
            "solver": {"step": 0.01},
        },
        changes,
    )


def ride(pauses=()):
    """Loaded, driven and braked run in wind, paused by `pauses` (s)."""
    simulation = Simulation(scenario(), samples=5)
    script = [
        (0.1, Command("payload", {"cabin": 120.0})),
        (0.2, Command("speed", {"cabin": 3.0})),
        (0.4, Command("wind", {"x": 9.0, "z": -1.0})),
        (1.0, Command("emergency_stop", {})),
    ]
    for time in sorted({*pauses, *(time for time, _ in script), 2.0}):
        simulation.advance_to(time)
        for when, command in script:
            if when == time:
                simulation.apply(command)
    return simulation


def test_loads_winds_and_brakes_repeat_to_the_last_bit_whatever_the_pacing():
    one, other = ride(), ride((0.15, 0.7, 0.71, 1.3))
    assert same(one.snapshot, other.snapshot)
    assert np.isfinite(one.snapshot.columns.body_position).all()
    cabin = one.snapshot.carriages["cabin"]
    assert cabin.payload == 120.0
    assert cabin.haul_rope is not None
    assert one.snapshot.carriages["trolley"].haul_rope is None


def test_reset_takes_payload_wind_and_brakes_back():
    simulation = ride()
    start = Simulation(scenario(), samples=5).snapshot
    simulation.reset()
    assert same(simulation.snapshot, start, but_time=True)
    assert simulation.system.carriages.mass[0] == 200.0
    assert not simulation.state.wind.any()
    assert not simulation.state.drives.braking.any()


def test_a_brake_is_not_applied_twice_and_lets_go():
    simulation = ride()
    since = simulation.state.drives.braking_time[0]
    simulation.emergency_stop()
    assert simulation.state.drives.braking_time[0] == since == pytest.approx(1.0)
    simulation.emergency_stop(False)
    simulation.command("cabin", speed=1.0)
    assert simulation.advance_to(4.0).carriages["cabin"].speed == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(
    ("name", "mass", "message"),
    [
        ("cabin", -1.0, "payload of 'cabin': given -1 kg; allowed: 0 to 400 kg"),
        ("cabin", 401.0, "payload of 'cabin': given 401 kg; allowed: 0 to 400 kg"),
        ("cabin", nan, "allowed: 0 to 400 kg"),
        ("trolley", 10.0, "payload of 'trolley': given 10 kg; allowed: none"),
        ("gondola", 10.0, "payload: given for carriage 'gondola'; allowed: cabin"),
    ],
)
def test_payloads_refused(name, mass, message):
    simulation = Simulation(scenario(), samples=5)
    before = simulation.snapshot
    with pytest.raises(CommandError, match=message):
        simulation.payload(name, mass)
    assert simulation.snapshot is before


def test_payload_only_changes_while_it_stands_in_a_station():
    simulation = Simulation(scenario(), samples=5)
    simulation.command("cabin", speed=2.0)
    simulation.advance_to(0.5)
    with pytest.raises(CommandError, match=r"given at a speed of .* m/s; allowed: up to 0.05 m/s"):
        simulation.payload("cabin", 10.0)
    simulation.advance_to(2.5)
    with pytest.raises(CommandError, match=r"of 60.9 m; allowed: within 4 m of an end of the track"):
        simulation.payload("cabin", 10.0)
    simulation.emergency_stop()
    simulation.reset()
    simulation.emergency_stop()
    simulation.payload("cabin", 10.0)  # also while the emergency stop is in force


@pytest.mark.parametrize("wind", [(inf, 0.0), (0.0, nan), (101.0, 0.0)])
def test_winds_refused(wind):
    simulation = Simulation(scenario(), samples=5)
    with pytest.raises(CommandError, match=r"m/s; allowed: -100 to 100 m/s"):
        simulation.wind(*wind)
    with pytest.raises(CommandError, match="wind: given x; allowed: x, z or x, y, z, m/s"):
        simulation.apply(Command("wind", {"x": 1.0}))


def test_a_haul_rope_that_would_have_to_push_is_named():
    with pytest.raises(EquilibriumError, match=r"carriages.cabin.drive.haul_rope: given one that would have to push"):
        Simulation(scenario(**{"carriages.cabin.drive.haul_rope": {**ROPE, "pretension": 0.0, "station": "start"}}))


def test_clearance_needs_a_terrain():
    with pytest.raises(ValueError, match="given a scenario without terrain"):
        Simulation(scenario(), samples=5).clearance()
    found = Simulation(scenario(terrain=[[0.0, -10.0], [60.0, -2.0]]), samples=5).clearance()
    assert 0.0 < found.rope.height < 12.0
    assert found.vehicles["cabin"].height == pytest.approx(10.0 - 3.5, abs=0.6)


def test_clearance_is_that_of_vehicles_on_the_cable():
    simulation = Simulation(load_scenario(one_strand("gondola")), samples=5)
    on_the_cable = {name for name, state in simulation.snapshot.carriages.items() if state.attached}
    assert simulation.clearance().vehicles.keys() == on_the_cable
    assert len(on_the_cable) < len(simulation.carriages)


def test_outline_with_a_size_is_that_box():
    body = scenario().carriages["cabin"].bodies["cabin"]
    outline = body_outline(body)
    assert outline.min(axis=0).tolist() == [-1.0, -1.5]
    assert outline.max(axis=0).tolist() == [1.0, 2.0]
