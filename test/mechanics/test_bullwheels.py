"""Bullwheels alone: friction, brakes, bearings, buffers, stiffness of the strands, and rollback."""

import numpy as np
import pytest
from systems import make_limits

from cable_twin.mechanics.parameters import FORCE, FREE, SPEED
from cable_twin.mechanics.solution.bundle.bullwheels import (
    NOTHING,
    ROPE,
    WHEEL,
    end_bullwheels,
    missing_rope,
    missing_travel,
    move_bullwheels,
)
from cable_twin.mechanics.solution.bundle.records import (
    COUNTERWEIGHT,
    FIXED,
    HYDRAULIC,
    Bullwheels,
    bullwheels_at_rest,
)
from cable_twin.mechanics.solution.prediction import coefficients

STEP = 0.01  # s
INERTIA, WRAPPED, ADHESION = 2000.0, 40.0, 1.5  # kg, kg, -


def wheel(on=10e3, off=10e3, *, speed=0.0, **changes):
    """Single bullwheel between strands with the pulls `on` and `off` (N), on a carriage of 5 t."""
    sheaves = Bullwheels(
        rope=np.zeros((1, 2), np.int64),
        inertia=np.array([INERTIA]),
        wrapped=np.array([WRAPPED]),
        adhesion=np.array([ADHESION]),
        resistance=np.zeros(1),
        driven=np.ones(1, np.int64),
        limits=make_limits(1, 0.3, 1.2),
        way=np.array([[-np.inf, np.inf]]),
        brake_force=np.zeros(1),
        rollback=np.array([np.inf]),
        brake_rise_time=np.zeros(1),
        tensioning=np.array([FIXED]),
        direction=np.zeros((1, 2)),
        mass=np.array([5000.0]),
        pull=np.array([20e3]),
        band=np.array([500.0]),
        rate=np.array([0.05]),
        travel=np.array([[-1.0, 1.0]]),
        buffer_stiffness=np.array([1e5]),
        buffer_damping=np.zeros(1),
    )._replace(**{key: np.atleast_1d(np.array(value)) for key, value in changes.items()})
    motion = bullwheels_at_rest(1)
    motion.tension[0], motion.pull[0] = (on, off), on + off
    motion.rim.velocity[:] = motion.rope.velocity[:] = speed
    return sheaves, motion


def step(sheaves, motion, times=1):
    """Take steps between strands of constant pull, with converged Newton increments."""
    c = coefficients(0.7)
    for _ in range(times):
        move_bullwheels(sheaves, motion, c, STEP)
        if motion.by_forces[0] != NOTHING:
            for _ in range(3):
                by_acceleration = (1.0 - c.alpha_m) / ((1.0 - c.alpha_f) * c.beta * STEP**2)
                force, stiffness = missing_rope(sheaves, motion, 0, by_acceleration)
                delta = force / stiffness
                for moving in (motion.rope, motion.rim) if motion.by_forces[0] == WHEEL else (motion.rope,):
                    moving.position[0] += delta
                    moving.velocity[0] += c.gamma / (c.beta * STEP) * delta
                    moving.algorithmic[0] += delta / (c.beta * STEP**2)
                    moving.acceleration[0] += by_acceleration * delta
        end_bullwheels(sheaves, motion, np.zeros(1))


def test_a_free_wheel_speeds_up_by_what_its_strands_pull():
    sheaves, motion = wheel(10e3, 10.5e3)
    step(sheaves, motion, 100)
    rate = 500.0 / (INERTIA + WRAPPED)
    assert motion.rope.velocity[0] == pytest.approx(rate, rel=1e-12)
    assert motion.rim.position[0] == pytest.approx(0.5 * rate, rel=1e-12)
    assert motion.rope.position[0] == pytest.approx(0.5 * rate, rel=1e-12)
    assert motion.traction[0] == pytest.approx(WRAPPED * rate - 500.0)


@pytest.mark.parametrize("mode", [FREE, FORCE])
def test_bearings_hold_and_slow_down(mode):
    sheaves, motion = wheel(resistance=300.0)
    motion.drives.mode[0], motion.drives.force[0] = mode, 299.0
    step(sheaves, motion, 50)
    assert motion.rope.position[0] == 0.0
    motion.drives.force[0] = 0.0
    motion.rim.velocity[:] = motion.rope.velocity[:] = 0.1
    step(sheaves, motion, 200)
    assert motion.rope.velocity[0] == 0.0
    way = 0.5 * 0.1**2 * (INERTIA + WRAPPED) / 300.0
    assert motion.rope.position[0] == pytest.approx(way, rel=0.01)


@pytest.mark.parametrize(("on", "off", "sense"), [(20e3, 10e3, 1), (10e3, 20e3, -1)])
def test_rope_slips_beyond_the_ratio_and_sticks_below(on, off, sense):
    sheaves, motion = wheel(on, off)
    motion.drives.mode[0] = SPEED
    step(sheaves, motion)
    assert motion.slipping[0] == sense
    assert motion.by_forces[0] == ROPE
    pull = off - on + (0.5 * off if sense > 0 else -0.5 * on)  # friction is half of the slacker strand
    assert motion.rope.acceleration[0] == pytest.approx(pull / WRAPPED)
    assert motion.rim.position[0] == 0.0
    limit = (off, 1.49 * off) if sense > 0 else (1.49 * on, on)
    sheaves, motion = wheel(limit[1], limit[0]) if sense > 0 else wheel(on, 1.49 * on)
    motion.drives.mode[0] = SPEED
    step(sheaves, motion)
    assert motion.slipping[0] == 0
    assert motion.by_forces[0] == NOTHING


def test_slipping_rope_holds_again_at_the_speed_of_the_rim():
    sheaves, motion = wheel(20e3, 10e3, speed=1.0)
    motion.drives.mode[0], motion.drives.target[0], motion.slipping[0] = SPEED, 1.0, 1
    motion.rope.velocity[0] = 0.9
    motion.tension[0] = 12e3, 10e3  # now it is drawn on
    step(sheaves, motion, 3)
    assert motion.slipping[0] == 0
    assert motion.rope.velocity[0] == 1.0
    ahead = motion.rim.position[0] - motion.rope.position[0]
    step(sheaves, motion, 10)
    assert motion.rim.position[0] - motion.rope.position[0] == pytest.approx(ahead, abs=1e-15)


def test_brake_rises_stops_and_holds_up_to_its_force():
    sheaves, motion = wheel(speed=1.0, brake_force=4000.0, brake_rise_time=0.5)
    motion.drives.braking[0] = 1
    step(sheaves, motion, 50)
    slowed = 4000.0 * 0.25 / (INERTIA + WRAPPED)
    assert 1.0 - motion.rope.velocity[0] == pytest.approx(slowed, rel=0.05)
    step(sheaves, motion, 200)
    assert motion.rope.velocity[0] == 0.0
    motion.tension[0] = 10e3, 13.9e3
    place = motion.rope.position[0]
    step(sheaves, motion, 20)
    assert motion.rope.position[0] == place
    motion.tension[0] = 10e3, 14.1e3
    step(sheaves, motion, 20)
    assert motion.rope.position[0] > place


def test_cylinder_moves_where_the_pull_has_left_its_band_and_stops_at_its_travel():
    sheaves, motion = wheel(tensioning=HYDRAULIC)
    motion.pull[0] = 19.6e3
    step(sheaves, motion, 50)
    assert motion.carriage.position[0] == 0.0
    motion.pull[0] = 19.4e3
    step(sheaves, motion, 100)
    assert motion.carriage.velocity[0] == pytest.approx(0.05)
    step(sheaves, motion, 10000)
    assert motion.carriage.position[0] == pytest.approx(1.0, abs=2e-3)
    motion.pull[0] = 21e3
    step(sheaves, motion, 100)
    assert motion.carriage.velocity[0] == pytest.approx(-0.05)


@pytest.mark.parametrize("travel", [0.3, 1.2, -1.1])
def test_increment_of_a_counterweight_is_newton_s(travel):
    """One increment solves a linear residual of mass, buffers and strands of a stiffness that is added."""
    sheaves, motion = wheel(tensioning=COUNTERWEIGHT, buffer_damping=0.0)
    c, stiff = coefficients(0.7), 3e5
    by_acceleration = (1.0 - c.alpha_m) / ((1.0 - c.alpha_f) * c.beta * STEP**2)
    motion.carriage.position[0], motion.carriage.acceleration[0], motion.pull[0] = travel, 0.4, 17e3
    by_rate = c.gamma / (c.beta * STEP)
    force, stiffness = missing_travel(sheaves, motion, 0, by_acceleration, by_rate)
    delta = force / (stiffness + stiff)
    motion.carriage.position[0] += delta
    motion.carriage.velocity[0] += c.gamma / (c.beta * STEP) * delta
    motion.carriage.acceleration[0] += by_acceleration * delta
    motion.pull[0] += stiff * delta
    assert abs(delta) > 1e-6
    force, stiffness = missing_travel(sheaves, motion, 0, by_acceleration, by_rate)
    assert force / stiffness == pytest.approx(0.0, abs=1e-12)


def test_way_back_counts_from_the_furthest_place_and_stops_all():
    sheaves, motion = wheel(10e3, 9.5e3, rollback=0.2)
    motion.drives.mode[0], motion.drives.target[0] = SPEED, 0.5
    step(sheaves, motion, 200)
    motion.drives.mode[0], motion.drives.force[0], motion.drives.target[0] = FORCE, 0.0, 0.0
    furthest = 0.0
    while not motion.rolled_back[0]:
        step(sheaves, motion)
        furthest = max(furthest, motion.rim.position[0])
    assert furthest - motion.rim.position[0] == pytest.approx(0.2, abs=0.01)
    assert motion.drives.braking[0] == 1
    assert motion.drives.mode[0] == SPEED
    step(sheaves, motion, 200)
    assert motion.rim.velocity[0] == 0.0


def test_a_lift_that_no_drive_has_turned_may_go_back_neither_way():
    for on, off in ((10e3, 9.5e3), (9.5e3, 10e3)):
        sheaves, motion = wheel(on, off, rollback=0.2)
        motion.drives.mode[0] = FORCE
        step(sheaves, motion, 400)
        assert motion.rolled_back[0] == 1
        assert abs(motion.rim.position[0]) < 0.4
