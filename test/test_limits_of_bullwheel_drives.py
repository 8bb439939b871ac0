"""Limits of force, power and deceleration of bullwheel drives, of lifts with and without clamps, in plane and space."""

import numpy as np
import pytest

from cable_twin.frame.layout import Layout, of_bullwheel
from cable_twin.messages import JOINT_REFERENCES, MessageEncoder, decode
from cable_twin.scenario import load_scenario, most_by_drive
from cable_twin.simulation import Simulation

LIMITS = "drives.haul_rope.limits"
AT_ONCE = {f"{LIMITS}.acceleration": 1000.0, f"{LIMITS}.emergency_deceleration": 1000.0, f"{LIMITS}.jerk": None}
LIFTS = ["chairlift", "gondola", "jig_back", "bicable"]


def frames(simulation, end, step=0.1):
    """Speeds (m/s) and drive forces (N) of the haul rope's drive, every `step` (s) until `end` (s)."""
    rows = []
    while simulation.time < end - 1e-9:
        simulation.advance_to(min(simulation.time + step, end))
        columns = simulation.snapshot.columns
        rows.append((columns.drive_speed[0], columns.moving_cable_force[0]))
    return np.array(rows).T


@pytest.mark.parametrize("lift", LIFTS)
def test_a_drive_at_its_force_limit_moves_the_rope_as_a_command_of_that_force(lift):
    held = float(Simulation(load_scenario(lift)).snapshot.columns.moving_cable_force[0])
    most = 1.3 * held + 3000.0
    limited = Simulation(load_scenario(lift, {f"{LIMITS}.force": most} | AT_ONCE))
    given = Simulation(load_scenario(lift))
    limited.command("haul_rope", speed=2.0)
    given.command("haul_rope", force=most)
    (speeds, forces), (expected, _) = frames(limited, 2.0), frames(given, 2.0)
    np.testing.assert_allclose(forces, most, rtol=1e-12)
    # the force of the first step is given before it, that of the limit within it
    np.testing.assert_allclose(speeds, expected, atol=0.02 * np.abs(expected).max())
    used = limited.layout.force_used(limited.snapshot.columns)
    assert used.item() == pytest.approx(1.0, rel=1e-12)


@pytest.mark.parametrize("lift", ["chairlift", "jig_back"])
def test_power_is_the_limit_while_the_drive_would_take_more_and_never_above(lift):
    most = 40e3 if lift == "chairlift" else 60e3
    twin = Simulation(
        load_scenario(lift, {f"{LIMITS}.power": most, f"{LIMITS}.jerk": None, f"{LIMITS}.acceleration": 0.5})
    )
    twin.command("haul_rope", speed=2.5)
    speeds, forces = frames(twin, 8.0)
    power = speeds * forces
    assert power.max() <= most * (1.0 + 1e-12)
    assert np.count_nonzero(power > 0.999 * most) > 5
    limit = twin.layout.drive_limits[0], most / twin.snapshot.columns.drive_speed[0]
    assert min(limit) == limit[1]


def test_a_drive_that_cannot_hold_its_load_is_stopped_by_the_watch_on_rollback():
    twin = Simulation(load_scenario("gondola", {f"{LIMITS}.force": 6e3, "sheaves.drive.rollback": 0.3}))
    twin.command("haul_rope", speed=1.0)
    while not twin.emergency_stopped:
        assert twin.time < 60.0
        twin.advance_to(twin.time + 0.1)
    assert -0.6 < float(twin.snapshot.columns.drive_position[0]) <= -0.3


def test_a_service_stop_has_its_own_deceleration():
    given = {
        f"{LIMITS}.deceleration": 0.1,
        f"{LIMITS}.jerk": None,
        f"{LIMITS}.acceleration": 0.4,
    }
    twin = Simulation(load_scenario("chairlift", given))
    twin.command("haul_rope", speed=1.0)
    twin.advance_to(6.0)
    assert float(twin.snapshot.columns.drive_speed[0]) == 1.0
    twin.command("haul_rope", speed=0.0)
    twin.advance_to(8.0)
    assert float(twin.snapshot.columns.drive_speed[0]) == pytest.approx(0.8, abs=1e-9)


def test_a_run_with_limits_goes_on_from_a_captured_state_with_the_same_bits():
    twin = Simulation(load_scenario("jig_back", {f"{LIMITS}.force": 20e3, f"{LIMITS}.power": 30e3}))
    twin.command("haul_rope", speed=4.0)
    twin.advance_to(4.0)
    kept = twin.capture()
    ends = []
    for _ in range(2):
        twin.restore(kept)
        twin.advance_to(6.0)
        ends.append(np.array(twin.snapshot.columns.moving_cable_force).tobytes() + twin.state.nodes.position.tobytes())
    assert ends[0] == ends[1]


def test_the_limit_of_commands_is_the_lower_one_of_drive_and_friction():
    free, own = load_scenario("chairlift"), load_scenario("chairlift", {f"{LIMITS}.force": 20e3})
    assert most_by_drive(own, "haul_rope") == 20e3 < most_by_drive(free, "haul_rope")
    assert Layout.of(own, 2).drive_limits.tolist() == [20e3]


@pytest.mark.parametrize(("lift", "mass"), [("chairlift", 16e3), ("gondola", 25e3)])
def test_the_share_of_the_limit_in_use_goes_by_the_present_tensions(lift, mass):
    """Of a rope with little tension, which slips below what may be commanded: slack strand times (e^(mu alpha) - 1)."""
    changes = {"sheaves.drive.friction": 0.12, "sheaves.return.counterweight.mass": mass}
    twin, sheave = Simulation(load_scenario(lift, changes)), "drive"
    wheel = twin.scenario.sheaves[sheave]
    for _ in range(2):
        columns = twin.snapshot.columns
        slack = columns.sheave_tension[twin.layout.sheaves.index(sheave)].min()
        slips = slack * (np.exp(wheel.friction * wheel.wrap) - 1.0)
        share = abs(columns.moving_cable_force[0]) / slips
        assert twin.layout.force_used(columns).item() == pytest.approx(share, rel=1e-12)
        ((_, data),) = MessageEncoder(twin.layout).frame(twin.snapshot, [JOINT_REFERENCES])
        message = decode(data, "sensor_msgs/msg/JointState")
        row = message.name.index("haul_rope/limit")
        assert (message.position[row], message.effort[row]) == pytest.approx((share, slips), rel=1e-12)
        twin.command("haul_rope", speed=2.0)
        twin.advance_to(2.0)


def test_many_frames_have_the_bits_of_each():
    """At rest, limited by power, by force and by slip, with a slack strand, and of a drive without limit of power."""
    force, speed = np.array([5e3, -2e4, 3e4, 1e3, 0.0]), np.array([0.0, -4.0, 0.1, 2.0, 6.0])
    tensions = np.array([[5e4, 5e4, 5e4, 8e2, 5e4], [6e4, 3e4, 3e4, 0.0, 6e4]])
    for power in (4e4, np.inf):
        limits = 3.5e4, power, 1.2
        share, limit = of_bullwheel(limits, force, speed, tensions, np.minimum, np.maximum)
        each = [of_bullwheel(limits, *one) for one in zip(force, speed, tensions.T.tolist(), strict=True)]
        assert [*zip(share.tolist(), limit.tolist(), strict=True)] == each
        assert limit.tolist()[2:4] == [3.5e4, 1.2]
        assert limit[1] == min(power / 4.0, 3.5e4)
