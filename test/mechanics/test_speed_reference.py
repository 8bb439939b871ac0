from math import sqrt

import numpy as np
import pytest
from systems import make_limits, make_system

from cable_twin.mechanics.drives.speed_reference import advance_reference, braking_speed
from cable_twin.mechanics.parameters import SPEED
from cable_twin.mechanics.state import allocate_state

LENGTH, STROKE, STEP = 50.0, 0.5, 0.01


def drive(start=25.0, acceleration=0.5, **limits):
    """Driven carriage at an arc length of 50 m, with limits by the names of a scenario."""
    system = make_system(
        chains=(1,),
        cable={"element_count": 2, "element_length": 0.5 * LENGTH},
        carriages={"stop_stroke": np.array([STROKE]), "limits": make_limits(1, acceleration, **limits)},
    )
    state = allocate_state(system)
    state.drives.mode[:] = SPEED
    state.reference.position[0] = start
    return system, state


def run(system, state, duration, target=None, step=STEP):
    """Reference motion (steps + 1, 3) at every step."""
    if target is not None:
        state.drives.target[0] = target
    path = [np.array(state.reference)[:, 0]]
    for _ in range(round(duration / step)):
        advance_reference(system.carriages, system.cable, state, 0, step)
        path.append(np.array(state.reference)[:, 0])
    return np.array(path)


@pytest.mark.parametrize("step", [0.01, 0.013, 0.5])
def test_trapezoid_is_exact_whatever_the_step(step):
    acceleration, speed = 0.7, 2.0
    system, state = drive(5.0, acceleration=acceleration)
    path = run(system, state, 6.0, speed, step)
    time = step * np.arange(len(path))
    ramp = np.minimum(time, speed / acceleration)
    np.testing.assert_allclose(path[:, 0], 5.0 + 0.5 * acceleration * ramp**2 + speed * (time - ramp), atol=1e-12)
    np.testing.assert_allclose(path[:, 1], acceleration * ramp, atol=1e-12)


@pytest.mark.parametrize("jerk", [0.05, 0.3, 4.0])
@pytest.mark.parametrize("target", [1.5, -1.5])
def test_jerk_limit_holds_and_the_target_is_not_passed(jerk, target):
    acceleration = 0.5
    system, state = drive(25.0, acceleration=acceleration, jerk=jerk)
    path = run(system, state, 16.0, target)
    assert np.abs(path[:, 2]).max() <= acceleration
    assert np.abs(np.diff(path[:, 2])).max() <= jerk * STEP * (1.0 + 1e-6)
    assert np.all(np.abs(path[:, 1]) <= abs(target))
    assert path[-1, 1] == target
    full = acceleration**2 / jerk <= abs(target)
    duration = abs(target) / acceleration + acceleration / jerk if full else 2.0 * sqrt(abs(target) / jerk)
    if duration < 16.0:
        assert STEP * np.argmax(path[:, 1] == target) == pytest.approx(duration, abs=STEP)


@pytest.mark.parametrize("step", [0.01, 0.005, 0.0025, 0.37])
@pytest.mark.parametrize(("acceleration", "peak"), [(0.3, 0.3), (2.0, sqrt(0.2 * 3.0))])
def test_jerk_limited_motion_is_the_closed_form_whatever_the_step(step, acceleration, peak):
    """Cubic pieces up to 3 m/s: the acceleration grows to its peak, may stay there, and falls."""
    jerk, speed = 0.2, 3.0
    system, state = drive(5.0, acceleration=acceleration, jerk=jerk)
    path = run(system, state, 15.0, speed, step)
    time = step * np.arange(len(path))
    growing, ramping = peak / jerk, speed / peak + peak / jerk  # s
    jumps = (0.0, 1.0), (growing, -1.0), (ramping - growing, -1.0), (ramping, 1.0)
    since = [(np.maximum(time - at, 0.0), sign * jerk) for at, sign in jumps]
    np.testing.assert_allclose(path[:, 2], sum(jump * t for t, jump in since), atol=1e-9)
    np.testing.assert_allclose(path[:, 1], sum(jump * t**2 / 2.0 for t, jump in since), atol=1e-9)
    np.testing.assert_allclose(path[:, 0], 5.0 + sum(jump * t**3 / 6.0 for t, jump in since), atol=1e-9)


@pytest.mark.parametrize("jerk", [{}, {"jerk": 0.4}])
def test_commands_on_the_way_give_the_same_motion_whatever_the_step(jerk):
    """New targets while the acceleration is on, a reversal with its own deceleration, and an emergency stop."""
    ends = []
    for step in (0.01, 0.1, 0.5):
        system, state = drive(25.0, acceleration=0.7, deceleration=0.45, emergency_deceleration=1.3, **jerk)
        for target, duration in ((1.5, 2.0), (0.4, 1.0), (2.0, 1.5), (-1.0, 4.0), (0.0, 0.5), (-1.7, 3.0)):
            run(system, state, duration, target, step)
        state.drives.braking[0] = True
        run(system, state, 0.5, 0.0, step)
        ends.append(np.array(state.reference)[:, 0])
        run(system, state, 3.0, 0.0, step)
        ends[-1] = np.append(ends[-1], np.array(state.reference)[:, 0])
    np.testing.assert_allclose(ends, [ends[0]] * len(ends), atol=1e-12)
    assert ends[0][4:].tolist() == [0.0, 0.0]


@pytest.mark.parametrize("jerk", [None, 0.3])
@pytest.mark.parametrize(("target", "end"), [(6.0, LENGTH - STROKE), (-6.0, STROKE)])
def test_brakes_in_time_for_the_ends_of_the_track(jerk, target, end):
    system, state = drive(25.0, acceleration=0.8, **({} if jerk is None else {"jerk": jerk}))
    path = run(system, state, 60.0, target)
    # the step in which it starts to brake is not cut at that moment: micrometres
    assert path[:, 0].min() >= STROKE - 1e-5
    assert path[:, 0].max() <= LENGTH - STROKE + 1e-5
    assert path[-1, 0] == pytest.approx(end, abs=1e-3)
    assert path[-1, 1] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(np.diff(path[:, 1])).max() / STEP <= 0.8 * (1.0 + 1e-9)


@pytest.mark.parametrize("step", [0.01, 0.013])
def test_deceleration_before_the_end_is_even(step):
    """Rounding must not disturb the acceleration of single steps, as the drive force follows from it."""
    system, state = drive(30.0, acceleration=0.7)
    path = run(system, state, 12.0, 3.0, step)
    braking = np.flatnonzero(path[:, 2] < 0.0)
    assert len(braking) * step == pytest.approx(3.0 / 0.7, abs=3 * step)
    assert np.array_equal(braking, np.arange(braking[0], braking[-1] + 1))
    np.testing.assert_allclose(path[braking[2:-2], 2], -0.7, rtol=1e-9)


def test_braking_speed_stops_within_the_distance():
    deceleration, duration, distance, speed = 0.8, 0.1, 3.0, 1.0
    after = braking_speed(distance, speed, deceleration, duration)
    way = 0.5 * (speed + after) * duration + 0.5 * after**2 / deceleration
    assert way == pytest.approx(distance, rel=1e-12)
    assert braking_speed(0.0, speed, deceleration, duration) == 0.0


def test_emergency_deceleration_replaces_both_limits():
    system, state = drive(10.0, jerk=0.2, emergency_deceleration=2.0)
    run(system, state, 10.0, 3.0)
    assert state.reference.velocity[0] == 3.0
    at = state.reference.position[0]
    state.drives.braking[0] = True
    path = run(system, state, 2.0, 0.0)
    assert path[-1, 1] == 0.0
    assert path[-1, 0] - at == pytest.approx(3.0**2 / (2.0 * 2.0), abs=1e-12)


@pytest.mark.parametrize("speed", [0.05, 0.3, 1.0, 4.0])
def test_a_release_of_an_emergency_stop_at_low_speed_does_not_reverse(speed):
    """The jerk limit cannot end the deceleration of the emergency stop before standstill."""
    system, state = drive(10.0, jerk=0.2, emergency_deceleration=1.2)
    state.reference.velocity[0], state.reference.acceleration[0] = speed, -1.2
    path = run(system, state, 40.0, 0.0)
    assert path[:, 1].min() >= 0.0
    assert path[-1, 1:].tolist() == [0.0, 0.0]
