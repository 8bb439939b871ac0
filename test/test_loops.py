"""Closed loops of rope over bullwheels as scenarios, reproducible to the last bit."""

from dataclasses import replace

import numpy as np
import pytest

from cable_twin.frame.records import CommandError
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.snapshot_file import SnapshotError
from verification.long_runs import chairlift_hour
from verification.loops import BODY, loop, rope_of, spacing_error, wheels

FULL_UP = {
    "name": "chair",
    "count": 4,
    "first": 60.0,
    "spacing": 100.0,
    "bodies": BODY,
    "payload": {"capacity": 800.0, "leaving": {"return": 800.0, "drive": 0.0}},
}


def lift(**sheave):
    """Small lift, full up and empty down; `sheave` changes the driven bullwheel."""
    return loop(
        length=209.5,
        rope={"elements": 30, "bending_stiffness": 3e3, "damping_time": 0.01},
        drive={"resistance": 400.0, **sheave},
        back={"counterweight": {"direction": [-0.958, -0.287], "mass": 12000.0}},
        limits={"acceleration": 0.5, "emergency_deceleration": 1.2},
        carriers=FULL_UP,
    )


def bits(simulation):
    """All state arrays as bytes."""
    full = simulation.capture()
    motion = b"".join(array.tobytes() for array in full.between.values())
    return motion + b"".join(state.nodes.position.tobytes() for state in full.states)


def drive(simulation, until, *, period):
    """Start, stop in emergency, and drive back, in frames of `period` (s)."""
    events = [
        (2.0, lambda: simulation.command("haul_rope", speed=1.5)),
        (6.0, simulation.emergency_stop),
        (9.0, lambda: simulation.emergency_stop(False)),
        (9.0, lambda: simulation.command("haul_rope", force=-3000.0)),
    ]
    for time, event in [one for one in events if simulation.time <= one[0] < until]:
        go(simulation, time, period)
        event()
    go(simulation, until, period)


def go(simulation, until, period):
    """Simulate until a time (s) in frames of `period` (s)."""
    while simulation.time < until - 1e-9:
        simulation.advance_to(min(simulation.time + period, until))


def test_frames_snapshots_and_resets_change_no_bit(tmp_path):
    one, other = lift(), lift()
    start = bits(one)
    drive(one, 12.0, period=0.37)
    drive(other, 4.5, period=1.0)  # while it speeds up
    full = other.capture()
    other.save(tmp_path / "lift.snapshot")
    drive(other, 12.0, period=1.0)
    assert bits(other) == bits(one)
    other.restore(full)
    drive(other, 12.0, period=0.1)
    assert bits(other) == bits(one)
    loaded = Simulation.load(tmp_path / "lift.snapshot")
    drive(loaded, 12.0, period=2.0)
    assert bits(loaded) == bits(one)
    other.reset()
    assert bits(other) == start
    assert other.snapshot.drives["haul_rope"].speed == 0.0


def test_halved_steps_go_where_whole_ones_go():
    """Step too long for the tolerance, halved: second order, so hardly any difference."""
    ends = []
    for iterations in (12, 2):
        data = lift().scenario.resolved()
        data["solver"] |= {"max_iterations": iterations, "max_halvings": 10, "step": 0.2}
        simulation = Simulation(load_scenario(data), samples=2)
        simulation.command("haul_rope", speed=1.5)
        halved = 0
        while simulation.time < 2.95:
            halved += simulation.advance_to(simulation.time + 0.2).solver.halvings
        assert (halved > 0) == (iterations == 2)
        ends.append(wheels(simulation).rope.position[1])
    assert ends[0] == pytest.approx(ends[1], abs=5e-4)


def test_a_brake_on_a_bullwheel_stops_the_lift_and_holds_it():
    simulation = lift(brake={"force": 25e3, "rise_time": 0.5})
    simulation.command("haul_rope", speed=2.0)
    simulation.advance_to(8.0)
    simulation.emergency_stop()
    simulation.advance_to(8.1)
    assert simulation.snapshot.drives["haul_rope"].force == 0.0
    simulation.advance_to(14.0)
    place = simulation.snapshot.drives["haul_rope"].position
    assert simulation.snapshot.drives["haul_rope"].speed == 0.0
    simulation.advance_to(20.0)
    assert simulation.snapshot.drives["haul_rope"].position == place
    simulation.emergency_stop(False)
    simulation.command("haul_rope", speed=1.0)
    simulation.advance_to(26.0)
    assert simulation.snapshot.drives["haul_rope"].speed == pytest.approx(1.0)


def test_a_lost_drive_lets_the_full_strand_turn_the_lift_back():
    """Acceleration by unbalanced weight and inertia, without rollback monitoring."""
    simulation = lift()
    holds = simulation.snapshot.drives["haul_rope"].force
    assert holds > 2000.0
    simulation.command("haul_rope", force=0.0)
    simulation.advance_to(4.0)
    motion = wheels(simulation)
    chairs, rope = 2 * 1300.0 + 2 * 500.0, 2 * 210.0 * 6.0
    inertia = 40e3 / 4.0 + 8e3 / 4.0 + chairs + rope
    expected = -0.5 * (holds - 400.0 / 2.0) / inertia * 4.0**2
    assert motion.rim.position[0] == pytest.approx(expected, rel=0.1)
    assert not simulation.emergency_stopped


@pytest.mark.parametrize("brake", [{"force": 25e3}, pytest.param(None, marks=pytest.mark.long)])
def test_going_back_is_noticed_and_stopped(brake):
    """From 1.5 m/s: stop half a metre after the reversal plus the stopping distance, always at one step."""
    places = []
    for period in (0.05, 0.7):
        simulation = lift(rollback=0.5, brake=brake)
        simulation.command("haul_rope", speed=1.5)
        go(simulation, 6.0, period)
        simulation.command("haul_rope", force=0.0)
        go(simulation, 40.0, period)
        motion = wheels(simulation)
        assert simulation.emergency_stopped
        assert motion.rolled_back.tolist() == [1, 0]
        assert motion.rim.velocity[0] == 0.0
        assert 0.5 < motion.furthest[0] - motion.rim.position[0] < 1.0
        places.append(bits(simulation))
        with pytest.raises(CommandError, match="emergency stop is in force"):
            simulation.command("haul_rope", speed=1.0)
        simulation.emergency_stop(False)
        simulation.command("haul_rope", speed=1.0)
        go(simulation, 46.0, period)
        assert simulation.snapshot.drives["haul_rope"].speed == pytest.approx(1.0)
        assert not simulation.emergency_stopped
    assert places[0] == places[1]


def test_commands_to_go_back_are_no_rollback():
    simulation = lift(rollback=0.5)
    for until, speed in ((5.0, 1.0), (17.0, -1.0), (25.0, 0.0)):
        simulation.command("haul_rope", speed=speed)
        simulation.advance_to(until)
    assert not simulation.emergency_stopped
    assert simulation.snapshot.drives["haul_rope"].position < -1.0


@pytest.mark.parametrize("inertia", [1.0, 100.0])
def test_a_light_bullwheel_rings_no_more_than_a_heavy_one(inertia):
    """Wheel far lighter than the rope passed by a wave in a step: stable, no halved step."""
    simulation = loop(back={"inertia": inertia}, limits={"acceleration": 0.3, "jerk": 0.3})
    simulation.command("haul_rope", speed=1.5)
    halved = 0
    for second in range(1, 31):
        halved += simulation.advance_to(float(second)).solver.halvings
    assert halved == 0
    assert wheels(simulation).rope.velocity[1] == pytest.approx(1.5, abs=0.02)


def test_the_first_minute_of_the_shipped_gondola():
    """Rope and spacing conserved, carriers full up and empty down, no halved step."""
    simulation = Simulation(load_scenario("gondola"), samples=2, on_demand=True)
    rope, halved = rope_of(simulation), 0
    simulation.command("haul_rope", speed=6.0)
    for second in range(1, 61):
        halved += simulation.advance_to(float(second)).solver.halvings
    assert halved == 0
    assert rope_of(simulation) == pytest.approx(rope, abs=1e-9 * rope)
    assert spacing_error(simulation) < 1e-9 * rope
    up, down = (set(part.state.payload[part.riding].tolist()) for part in simulation._parts)
    assert up == {750.0}
    assert down == {0.0}
    columns = simulation.snapshot.columns
    power = columns.sheave_force[0] * columns.sheave_speed[0]
    assert 50e3 < power < 1e6
    assert np.isfinite(simulation.energy().total)


@pytest.mark.parametrize("space", [2, 3])
def test_a_rope_that_slips_in_a_storm_goes_on(space):
    """Strand three times as stiff as estimated, which made increments oscillate and grow at any step."""
    limits = {"drives.haul_rope.limits.acceleration": 0.3627, "drives.haul_rope.limits.speed": 8.0}
    simulation = Simulation(load_scenario("gondola", {"space": space, "carriers.count": 21, **limits}), on_demand=True)
    simulation.command("haul_rope", speed=4.43)
    simulation.wind(-8.2, 17.6)
    simulation.advance_to(1.0)
    simulation.wind(83.9, -15.1)
    halved, slipped = 0, False
    for time in np.arange(1.1, 2.8, 0.1):
        halved += simulation.advance_to(time).solver.halvings
        slipped = slipped or bool(wheels(simulation).slipping[0])
    assert slipped
    assert halved <= 5


@pytest.mark.parametrize("count", [1, 120, 200])
def test_a_lift_of_any_number_of_carriers_starts_at_rest(count):
    """Far more or less weight than the ropes were cut for, so that the tensioned bullwheel travels first."""
    travel = {"sheaves.return.counterweight.travel": [-8.0, 8.0]}
    simulation = Simulation(load_scenario("chairlift", {"carriers.count": count, **travel}), on_demand=True)
    at_rest = simulation.snapshot.columns.sheave_tension.copy()
    simulation.advance_to(2.0)
    columns = simulation.snapshot.columns
    assert np.abs(columns.sheave_tension - at_rest).max() < 1e-4 * at_rest.max()
    assert np.abs(columns.body_velocity).max() < 1e-3  # m/s


def test_a_state_of_another_number_of_bullwheels_is_refused():
    simulation = lift()
    full = simulation.capture()
    between = {name: array[:1] if "rim" in name else array for name, array in full.between.items()}
    with pytest.raises(SnapshotError, match="rim"):
        simulation.restore(replace(full, foreign=between))


@pytest.mark.long
def test_an_hour_of_the_shipped_chairlift():
    """Starts, stops, reversals and emergency stops: no failed or halved step, no lost rope."""
    cells = [cell.strip() for cell in chairlift_hour(1.0, lambda completed: None).split("|")]
    assert cells[3:6] == ["360000", "0", "0"]
    assert max(float(cell.split()[0]) for cell in cells[7:9]) < 1e-6  # m
