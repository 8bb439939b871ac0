"""Jumps of an encoder are told from its quanta, and from bounces and drifts of the twin."""

from __future__ import annotations

import numpy as np
import pytest

from cable_twin.ensemble.estimate.detectors.jumps import HALF, Jumps
from cable_twin.ensemble.estimate.detectors.sensor_faults import Doubts
from cable_twin.ensemble.estimate.quantities import Errors, Reading
from cable_twin.frame.sensors import Measurement

QUANTUM = 0.01  # m
NOISE = QUANTUM / np.sqrt(12.0)
TIMES = 0.1 * np.arange(400)


def told(jump, speed=4.0, apart=None, seed=0):
    """Times and sizes (m) of jumps that are told when an encoder jumps at 20 s, `apart` (m) from its twin otherwise."""
    start = np.random.default_rng(seed).uniform(0.0, 1.0)
    twin = start + speed * TIMES
    place = twin + (0.0 if apart is None else apart) + np.where(TIMES > 20.0, jump, 0.0)
    jumps, found = Jumps(NOISE), []
    for time, one, other in zip(TIMES, QUANTUM * np.round(place / QUANTUM), twin, strict=True):
        if size := jumps.note(float(time), float(one - other)):
            found.append((float(time), size))
    return found


@pytest.mark.parametrize("jump", [0.02, -0.02, 0.5])
@pytest.mark.parametrize("speed", [0.0, 0.37, -6.1])
def test_a_jump_is_told_with_its_size(jump, speed):
    found = told(jump, speed)
    time, size = found[0]
    assert 20.0 < time < 20.1 + 0.1 * HALF
    assert size == pytest.approx(jump, abs=0.011)


def test_five_standard_deviations_are_mostly_told():
    assert sum(bool(told(5.0 * NOISE, speed=3.77, seed=seed)) for seed in range(40)) >= 32


@pytest.mark.parametrize(
    "apart",
    [
        None,
        0.05 * np.sin(2.0 * TIMES),  # a bounce in the haul rope
        0.01 * np.sign(np.sin(2.0 * TIMES)) * np.minimum(np.abs(2.0 * np.sin(2.0 * TIMES)), 1.0),  # after boarding
        0.3 * np.exp(-0.3 * TIMES) * np.cos(1.3 * TIMES),
        np.where(TIMES > 20.0, 0.2 * (TIMES - 20.0), 0.0),  # another speed
        np.where(TIMES > 20.0, 0.6 * (TIMES - 20.0) ** 2, 0.0),  # a stop
    ],
)
@pytest.mark.parametrize("speed", [0.0, 0.37, -6.1])
def test_quanta_bounces_and_drifts_are_no_jumps(apart, speed):
    assert not any(told(0.0, speed, apart, seed) for seed in range(5))


@pytest.mark.parametrize("speed", [0.05, 0.2, -0.4])
def test_lost_samples_of_a_drift_are_no_jump(speed):
    """A twin that is slower than its plant, of which up to three samples in a row, or all of four seconds, are lost."""
    generator = np.random.default_rng(3)
    kept = generator.uniform(size=TIMES.size) > 0.05
    kept[150:153] = False
    kept[(TIMES > 24.0) & (TIMES < 28.0)] = False
    jumps = Jumps(NOISE)
    places = QUANTUM * np.round(speed * TIMES / QUANTUM)
    assert not any(jumps.note(float(time), float(one)) for time, one in zip(TIMES[kept], places[kept], strict=True))


def test_neither_a_restart_nor_a_correction_of_the_twin_is_a_jump():
    jumps = Jumps(NOISE)
    assert not any(jumps.note(time, 0.0) for time in TIMES)
    jumps.forget()
    assert not any(jumps.note(100.0 + time, 2.0) for time in TIMES)
    jumps.shift(0.5)  # of the twin, whose distance from the encoder becomes smaller
    assert not any(jumps.note(140.0 + time, 1.5) for time in TIMES)
    assert any(jumps.note(180.0 + time, 1.45) for time in TIMES)


def test_a_quantum_and_a_bounce_at_once_are_no_jump_where_waves_are_expected():
    """At 7 m/s and ten samples a second, so that all of them are at one place between two quanta."""
    apart = """59.2 58.8 67.4 65.4 63.2 61.2 60.0 59.7 60.2 61.3 52.8 54.6 56.3 57.7 58.5 58.6 57.8 66.6 65.0 63.5 62.4
        61.3 62.1 63.8 65.8 67.6 68.9 69.1 68.4 67.0 55.3 54.0 53.2 53.2 53.8 54.9 56.3 57.8 59.1 59.8 69.0 67.8 66.6
        55.6 55.3 55.5 56.1 57.0 58.1 59.2 60.0 60.5 60.8 61.1 61.5 62.2 63.2 64.2 65.2 66.1"""
    values = 1e-3 * np.array(apart.split(), dtype=float)  # m, of a plant whose counterweight was stuck
    for rough, more, said in ((False, 0.0, True), (True, 0.0, False), (True, 0.03, True)):
        jumps = Jumps(NOISE)
        jumps.rough = rough
        moved = values - np.where(np.arange(values.size) >= HALF, more, 0.0)
        assert any(jumps.note(time, one) for time, one in zip(TIMES.tolist(), moved.tolist(), strict=False)) == said


def test_a_swing_that_the_twin_does_not_have_is_no_jump_but_a_larger_step_is():
    """At 5 m/s, 9 s after a twin began under way in steady motion, beside a cabin that swings on its haul rope."""
    apart = """-10.0 -10.1 -18.6 -15.4 -10.9 -6.1 -2.3 -0.5 -1.1 -4.0 -8.4 -13.1 -17.1 -19.6 -20.4 -19.2 -14.1 -8.4 -3.7
        -1.3 -2.0 4.4 -1.5 -8.1 -14.2 -8.3 -10.0 -9.2 -6.4 -2.4 11.8 14.8 16.1 15.9 14.8 12.6 10.4 8.4 7.5 7.7 8.9 10.5
        12.2 13.1 13.3 13.0 12.7 12.6 3.1 4.1 5.7 7.6 9.9 1.8 2.5 2.0 3.6 3.6 2.2 -0.3"""
    values = 1e-3 * np.array(apart.split(), dtype=float)  # m
    for scale, more, said in ((1.0, 0.0, False), (1.5, 0.0, False), (1.0, 0.03, True)):
        jumps = Jumps(NOISE)
        jumps.rough = True
        moved = scale * values + np.where(np.arange(values.size) >= HALF, more, 0.0)
        assert any(jumps.note(time, one) for time, one in zip(TIMES.tolist(), moved.tolist(), strict=False)) == said


def test_an_encoder_without_noise_may_be_corrected_by_a_little():
    jumps = Jumps(1e-12)
    assert not any(jumps.note(time, 1e-6 * (time > 20.0)) for time in TIMES)
    assert any(jumps.note(100.0 + time, 0.01 * (time > 20.0)) for time in TIMES)


def test_an_encoder_that_jumps_is_left_out_but_not_at_a_tower():
    reading = Reading("encoder", "m", np.zeros(1, dtype=np.intp), NOISE, Errors(0.05, 0.05), 0.2)
    for at_tower in (False, True):
        doubts, alarms = Doubts({"encoder": reading}), []
        for time in TIMES:
            place = 4.0 * time
            measured = [Measurement("encoder", float(time), (place + (0.05 if time > 20.0 else 0.0),))]
            alarms += doubts.of_samples(float(time), measured, np.array([place]), at_tower)
        assert [one.reason for one in alarms] == ["sensor encoder has jumped by 0.05 m and is left out"] * (
            not at_tower
        )
        assert [*doubts.left_out] == ["encoder"] * (not at_tower)


def test_an_encoder_that_has_gone_far_before_its_twin_begins_is_not_of_another_unit():
    reading = Reading("encoder", "m", np.zeros(1, dtype=np.intp), NOISE, Errors(0.05, 0.05), 0.2, offset=800.0)
    for offset, said in ((800.0, []), (0.0, ["encoder"])):
        doubts = Doubts({"encoder": reading._replace(offset=offset)})
        for time in TIMES:
            doubts.of_samples(time, [Measurement("encoder", time, (800.0 + 0.1 * time,))], np.array([0.1 * time]))
        assert [*doubts.left_out] == said


def test_one_sample_near_zero_is_not_of_another_unit():
    reading = Reading("tilt", "rad", np.zeros(1, dtype=np.intp), 1e-3, Errors(1e-3, 1e-3), 1e-3)
    doubts, swing = Doubts({"tilt": reading}), np.array([0.17])
    for time in range(20):
        doubts.of_samples(0.1 * time, [Measurement("tilt", 0.1 * time, (1.7e-4 if time % 6 == 3 else 0.1,))], swing)
    assert not doubts.left_out
    for time in range(20, 26):
        doubts.of_samples(0.1 * time, [Measurement("tilt", 0.1 * time, (1.7e-4,))], swing)
    assert [*doubts.left_out] == ["tilt"]
