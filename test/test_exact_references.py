"""Exact solutions that verification compares with are right themselves, and a few random ropes keep their energy."""

from dataclasses import replace

import numpy as np
import pytest

from verification import JIT
from verification.moving_loads import mass_on_string, moving_mass, off_with_long_steps
from verification.point_loads import Rope, by_quadrature, rest_place, solve, with_tension
from verification.random_loads import drawn, light_rope, run

needs_kernels = pytest.mark.skipif(not JIT, reason="minutes without compilation")
ROPES = {
    "one load": Rope((1000.0, 300.0), 1042.2, 205.0, 4e8, (440.0,), (1.2e5,)),
    "three loads": Rope((300.0, -20.0), 300.2, 60.0, 6e7, (80.0, 95.0, 210.0), (8e3, 2e4, 5e3)),
    "in space": Rope((60.0, 80.0, 10.0), 103.0, 30.0, 1e6, (60.0,), (5e3,)),
}


@pytest.mark.parametrize("rope", ROPES.values(), ids=ROPES)
def test_catenaries_meet_the_end_and_the_slope(rope):
    exact = solve(rope)
    for place in (0.3 * rope.length, rope.length):
        assert exact.position(place) == pytest.approx(by_quadrature(exact, place), abs=1e-8)
    assert exact.position(rope.length) == pytest.approx(rope.end, abs=1e-9)
    # at a load the force vector jumps by its weight
    for place, load in zip(rope.places, rope.loads, strict=True):
        jump = exact.force(place, after=True) - exact.force(place)
        assert jump == pytest.approx([0.0] * (len(rope.end) - 1) + [load])


@pytest.mark.parametrize("rope", ROPES.values(), ids=ROPES)
def test_the_force_along_the_rope_is_the_derivative_of_the_potential(rope):
    exact, step, energies = solve(rope), 0.02, []
    for off in (-step, step):
        moved = replace(rope, places=(rope.places[0] + off, *rope.places[1:]))
        energies.append(solve(moved).potential())
    tensions = exact.tension(rope.places[0]), exact.tension(rope.places[0], after=True)
    stretch = 1.0 + 0.5 * sum(tensions) / rope.stiffness
    assert exact.hold(0) * stretch == pytest.approx(
        (energies[1] - energies[0]) / (2.0 * step), abs=1e-5 * rope.loads[0]
    )


def test_a_load_rests_where_its_potential_is_least():
    rope = with_tension(Rope((200.0, 3.0), 200.0, 40.0, 2e7, (0.4,), (6e3,)), 6e4)
    place = rest_place(rope)
    least, before, after = (solve(replace(rope, places=(place + off,))).potential() for off in (0.0, -0.5, 0.5))
    assert least < min(before, after)
    exact = solve(replace(rope, places=(place,)))
    assert exact.tension(place) == pytest.approx(exact.tension(place, after=True), rel=1e-9)


@needs_kernels
@pytest.mark.parametrize("start", ["rest", "push"])
@pytest.mark.parametrize(
    "system",
    [
        pytest.param(light_rope(100, 10.0), id="light rope"),
        pytest.param(drawn(1), id="driven"),
        pytest.param(drawn(4), id="fixed", marks=pytest.mark.long),  # kernels of several vehicles on one rope in space
    ],
)
def test_a_rope_with_loads_gains_no_energy(system, start):
    found = run(system, start, 4.0)
    assert found.passed, found
    assert (found.kinetic > 1.0) == (start == "push")  # J: a push moves it, and rest is rest
    assert np.isfinite(found.lost)


@needs_kernels
@pytest.mark.parametrize("share", [0.66, 0.68, 0.7])
def test_short_waves_do_not_grow_beside_a_fast_load(share):
    """Over 180 elements at shares of the wave speed at which they resonated with the passing of nodes, by 1.1 each."""
    time, exact, _ = moving_mass(share, 10.0)
    at, place, _ = mass_on_string(share, 10.0, 200)
    assert np.abs(place - np.interp(at, time, exact)).max() < 1e-3 * np.abs(exact).max()


@needs_kernels
def test_a_load_may_pass_an_element_in_a_few_steps():
    """Its node is handed on before it comes so near to the next one that it would stand still."""
    assert off_with_long_steps(6.0) < 2e-3
