"""Bicable lifts, whose carriers slide on track ropes, clamped to a loop: stations, loads, files, faults."""

import numpy as np
import pytest
from recorded_run import snapshots_of
from test_scenario_faults import faults_of

from cable_twin.frame.records import CommandError
from cable_twin.key_figures import KeyFigures
from cable_twin.offline.simulate import main
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.bicable import FULL, LENGTH, lift

SPEED = 4.0  # m/s


def running(speed=SPEED, **changes):
    simulation = Simulation(load_scenario(lift(**changes)), samples=5)
    simulation.command("motor", speed=speed)
    return simulation


@pytest.mark.long
@pytest.mark.parametrize("speed", [SPEED, -SPEED])
def test_riders_come_on_and_off_at_both_ends_smoothly(speed):
    """Lap in either direction without halved steps or jerks; loads change in stations only."""
    simulation = running(speed)
    scenario, came, left, highest = simulation.scenario, set(), set(), 0.0
    places, before = [], simulation.snapshot.columns
    end = 1.05 * scenario.loop_length / abs(speed) + abs(speed)
    for frame in range(1, int(end / 0.1)):
        snapshot = simulation.advance_to(0.1 * frame)
        assert snapshot.solver.halvings == 0, snapshot.time
        assert snapshot.solver.constraint_residual < 1e-9
        now = snapshot.columns
        on, was = now.attached == 1.0, before.attached == 1.0
        upward = now.vehicle_rope == 0.0
        came |= {(bool(upward[row]), int(now.arc_length[row] > 0.5 * LENGTH)) for row in np.flatnonzero(on & ~was)}
        gone = np.flatnonzero(was & ~on)
        left |= {(bool(before.vehicle_rope[row] == 0.0), int(before.arc_length[row] > 0.5 * LENGTH)) for row in gone}
        np.testing.assert_array_equal(now.payload[on & was], before.payload[on & was])
        expected = np.where(upward, FULL, 0.0) if speed > 0.0 else np.where(upward, 0.0, FULL)
        fresh = on & ~was
        np.testing.assert_array_equal(now.payload[fresh], expected[fresh])
        places.append(np.where(on[:, None], now.joint_position, np.nan))
        before = now
        swing = np.abs(now.body_angles[:, 1]).max()
        highest = max(highest, float(swing))
    assert highest < 0.15  # rad
    jerky = np.linalg.norm(np.diff(places, 2, axis=0), axis=2) / 0.1**2
    assert np.nanmax(jerky) < 5.0  # m/s^2, of ropes and hangers without any damping
    start, finish = (0, 1) if speed > 0.0 else (1, 0)
    assert came == {(True, start), (False, start)}
    assert left == {(True, finish), (False, finish)}


def test_rails_carry_what_comes_on():
    """Pull of the clamp of an entering carrier: from zero to m g sin off the station rails."""
    simulation = running()
    before = simulation.snapshot.columns.attached
    for frame in range(1, 2000):
        columns = simulation.advance_to(0.02 * frame).columns
        fresh = np.flatnonzero((columns.attached == 1.0) & (before == 0.0) & (columns.vehicle_rope == 0.0))
        if fresh.size:
            break
        before = columns.attached
    row = int(fresh[0])
    weight = 9.81 * (FULL + 800.0)
    assert abs(columns.haul_force[row]) < 0.02 * weight
    assert np.linalg.norm(columns.contact_force[row]) < 0.02 * weight
    later = simulation.advance_to(simulation.time + 20.0 / SPEED).columns
    assert later.haul_force[row] > 0.15 * weight


def test_no_frame_has_what_rails_or_stations_carry_on_the_ropes():
    """Forces of carriers that come on and go off, step by step, and the power of their clamps.

    The frame of the step in which one came on had its whole weight on the track rope, that in which one went off the
    last force of its clamp; the power was that of the rails' share as well, 38 kW for 0.1 kW.
    """
    simulation = Simulation(load_scenario("bicable"))
    simulation.command("haul_rope", speed=6.0)
    before = simulation.advance_to(24.2).columns.attached == 1.0
    came = left = False
    for step in range(1, 251):
        c = simulation.advance_to(24.2 + 0.01 * step).columns
        on = c.attached == 1.0
        assert not c.haul_pull[~on].any()
        assert not c.contact_force[~on, 0].any()
        assert (np.linalg.norm(c.contact_force[on & ~before], axis=1) < 500.0).all()
        np.testing.assert_allclose(c.drive_power[on], c.drive_force[on] * c.speed[on], rtol=0.01)
        came, left, before = came or bool((on & ~before).any()), left or bool((before & ~on).any()), on
    assert came
    assert left


@pytest.mark.parametrize("first", [8.0, 143.5])
def test_there_is_a_rest_with_riders_on_rails(first):
    simulation = Simulation(load_scenario("bicable", {"carriers.first": first}), samples=5)
    columns, wheels = simulation.snapshot.columns, list(simulation.snapshot.layout.sheaves)
    on, off = columns.sheave_tension[wheels.index("return")]
    assert on == pytest.approx(off, rel=1e-6)
    before = columns.arc_length
    held = simulation.advance_to(1.0).columns  # nothing moves it: its drive holds still
    np.testing.assert_allclose(held.arc_length, before, rtol=0.0, atol=1e-3)


def test_state_goes_on_with_the_same_bits_while_some_are_in_stations(tmp_path):
    simulation = running()
    simulation.advance_to(9.0)
    while (simulation.snapshot.columns.attached == 1.0).all():
        simulation.advance_to(simulation.time + 0.1)
    simulation.save(tmp_path / "state.npz")
    full = simulation.capture()
    again = Simulation.load(tmp_path / "state.npz", samples=5)
    end = simulation.time + 12.0
    expected = simulation.advance_to(end).numbers.tobytes()
    assert again.advance_to(end).numbers.tobytes() == expected
    simulation.restore(full)
    assert simulation.advance_to(end).numbers.tobytes() == expected
    rest = Simulation(simulation.scenario, samples=5).snapshot.columns
    simulation.reset()
    columns = simulation.snapshot.columns
    for name in ("joint_position", "haul_pull", "attached", "payload", "vehicle_rope", "sheave_position"):
        np.testing.assert_array_equal(getattr(columns, name), getattr(rest, name))


def test_riders_share_one_figure_of_their_clamps():
    simulation = running()
    figures = KeyFigures(simulation.scenario)
    figures.update(simulation.advance_to(0.5))
    (figure,) = (one for one in figures.figures() if one.name.endswith("pull of the clamp along the track, highest"))
    assert figure.name == "cabin: pull of the clamp along the track, highest"
    assert figure.place.startswith("cabin_")
    assert figure.value == pytest.approx(np.abs(simulation.snapshot.columns.haul_force).max(), rel=0.05)


def test_haul_ropes_have_a_safety_factor_of_their_own_and_limits_name_their_keys():
    figures = KeyFigures(load_scenario("bicable"))
    figures.update(Simulation(load_scenario("bicable"), samples=5).snapshot)
    found = {one.name: one for one in figures.figures()}
    assert {rope: found[f"{rope}: rope safety factor"].limit for rope in ("track_up", "haul_up", "haul_down")} == {
        "track_up": 3.0,
        "haul_up": 4.5,
        "haul_down": 4.5,
    }
    travels = {found[f"{end}: counterweight travel, lowest"].source for end in ("track_up/start", "track_down/end")}
    assert travels == {"scenario: ropes.track_up.start.travel", "scenario: ropes.track_down.end.travel"}
    loads = {name for name in found if "load of carriers" in name}  # haul ropes carry none
    assert loads == {f"{rope}: load of carriers, highest" for rope in ("track_up", "track_down")}


def test_what_carriers_carry_is_no_command():
    simulation = running()
    with pytest.raises(
        CommandError, match=r"payload: given for carrier 'cabin_1', which carriers\.payload loads in stations; allowed"
    ):
        simulation.payload("cabin_1", 0.0)
    with pytest.raises(CommandError, match="payload: given for drive 'motor'; allowed: none in this scenario"):
        simulation.payload("motor", 0.0)
    with pytest.raises(CommandError, match="payload: given for carriage 'cabin_99'; allowed: none in this scenario"):
        simulation.payload("cabin_99", 0.0)


TRACKS = {"haul_up": "track_up", "haul_down": "track_down"}


@pytest.mark.parametrize(
    ("keys", "value", "said"),
    [
        ("tracks", {**TRACKS, "rail": "track_up"}, "tracks.rail: given a track for 'rail': no strand of a loop"),
        ("tracks", {**TRACKS, "haul_up": "rail"}, "tracks.haul_up: given 'rail'; allowed: a rope that is no strand"),
        ("tracks", {**TRACKS, "haul_up": "haul_down"}, "tracks.haul_up: given 'haul_down'; allowed: a rope that is no"),
        ("tracks", {"haul_up": "track_up"}, "tracks: given no track for haul_down; allowed: a track for each strand"),
        (
            "tracks",
            {"haul_up": "track_up", "haul_down": "track_up"},
            "tracks.haul_down: given 'track_up': it is the track of",
        ),
        ("tracks", {"haul_up": "track_down", "haul_down": "track_up"}, "it runs against the direction of 'haul_up'"),
        ("clamp_offset", [0.0, -40.0], "'haul_up' is 39.5 m away from a clamp; allowed: a distance of up to 5 m"),
    ],
)
def test_tracks_are_checked(keys, value, said):
    data = lift()
    data["carriers"][keys] = value
    faults = faults_of(data)
    assert any(said in fault for fault in faults), faults


def test_what_only_a_track_needs_is_a_fault_without_one():
    data = lift()
    data["carriers"] |= {"tracks": {}, "friction": {"rolling": 0.005}}
    faults = faults_of(data)
    assert any("carriers.clamp_offset: given [" in fault and "m: without a track" in fault for fault in faults)
    assert any(
        "friction: given a mapping: without a track; allowed: rolling and viscous of 0, or with `tracks`" in fault
        for fault in faults
    )


def test_riders_are_read_from_a_log_on_the_track_on_which_they_are(tmp_path, capsys):
    """Any order of the ropes in the file, and a complete view of the log."""
    data = lift(count=5)
    data["ropes"] = dict(reversed(data["ropes"].items()))
    path = tmp_path / "lift.yaml"
    path.write_text(load_scenario(data, {"carriers.first": 8.0}).to_yaml(), encoding="utf-8")
    arguments = ["--duration", "0.5", "--output", str(tmp_path / "logs")]
    assert main([str(path), *arguments]) == 0
    printed = capsys.readouterr()
    assert "stopped" not in printed.out + printed.err
    (run,) = (tmp_path / "logs").iterdir()
    read = snapshots_of(run)[-1].columns
    simulation = Simulation(load_scenario(path))
    now = simulation.advance_to(float(read.time[0])).columns
    np.testing.assert_array_equal(read.vehicle_rope, now.vehicle_rope)
    np.testing.assert_allclose(read.arc_length, now.arc_length, rtol=0, atol=1e-6)
    assert set(now.vehicle_rope) == {2.0, 3.0}


def test_cabins_pass_slack_carriers_without_a_jerk():
    """Their nodes take those of the carriers as they pass: tensions are those of a finer mesh with another joint."""
    scenario = lift(hangers=True)
    fine = scenario | {
        "ropes": {name: rope | {"joint": "paper", "elements": 160} for name, rope in scenario["ropes"].items()}
    }
    tensions, taken = [], 0
    for data in (scenario, fine):
        simulation = Simulation(load_scenario(data), samples=5)
        simulation.command("motor", speed=SPEED)
        part, found = simulation.parts["track_up"], []
        joined = part.system.cable.node_joined
        for frame in range(200):
            found.append(simulation.advance_to(0.1 * (frame + 1)).columns.highest_tension[0, 0])
            taken += int((part.state.node_load[joined] >= 0).sum())
        tensions.append(np.array(found))
    assert taken > 0
    np.testing.assert_allclose(tensions[0], tensions[1], rtol=5e-3)
    jerks = [np.abs(np.diff(found, 2)).max() for found in tensions]
    assert jerks[0] < 2.0 * jerks[1]


def test_rollers_find_their_places_from_far_away():
    """With ice on an empty lift, the return bullwheel rests 0.2 m away, and is searched for from a metre away."""
    ice = {f"ropes.{rope}.ice": 3.0 if rope.startswith("track") else 2.0 for rope in load_scenario("bicable").ropes}
    simulation = Simulation(
        load_scenario("bicable", {**ice, "carriers.payload.leaving": {"return": 0.0, "drive": 0.0}})
    )
    before = simulation.snapshot.columns.joint_position.copy()
    np.testing.assert_allclose(simulation.advance_to(0.5).columns.joint_position, before, rtol=0.0, atol=1e-6)
