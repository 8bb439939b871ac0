"""A bundle of one gives the bits of one rope: kernels with and without couplings, `cable` and `ropes`."""

import numpy as np
import pytest

from cable_twin.mechanics.language.declared import arrays_of, clone
from cable_twin.mechanics.solution.bundle.assembly import Assembly, Rope, no_couplings
from cable_twin.mechanics.solution.generalized_alpha import advance
from cable_twin.mechanics.solution.stepping import Outcome
from cable_twin.mechanics.state import allocate_workspace
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT

ELEMENTS = 24 if JIT else 6
STEPS = 200 if JIT else 5


def one_rope(dim, **changes):
    """Rope with a driven carriage hanging from it, in wind."""
    return load_scenario("seed_example", {"cable.elements": ELEMENTS, "space": dim, **changes})


def advanced(rope, couplings):
    """State and outcome after a number of steps."""
    ropes = Assembly([rope], couplings)
    return rope.state, Outcome(*advance(*ropes.arguments, STEPS))


def as_among_several(system):
    """Parameters with nothing but the elastic model known to the compiler, as those of several ropes."""
    return system._replace(
        number=0,
        moving_cable=system.moving_cable._replace(moving=False),
        buffers=system.buffers._replace(present=False),
    )


@pytest.mark.parametrize("dim", [2, 3])
def test_kernels_for_couplings_give_the_bits_of_those_without(dim):
    """What is absent known and unknown to the compiler: every array of the state after 200 steps."""
    simulation = Simulation(one_rope(dim))
    system, start = simulation.system, simulation.capture().state
    start.nodes.velocity[1:-1, 0, -1] = 0.3
    ropes = [Rope(one, clone(start), allocate_workspace(one)) for one in (system, as_among_several(system))]
    known, outcome = advanced(ropes[0], None)
    told, other = advanced(ropes[1], no_couplings(1, dim))
    assert outcome == other
    assert outcome.converged
    for (name, one), two in zip(arrays_of(known).items(), arrays_of(told).values(), strict=True):
        np.testing.assert_array_equal(one, two, err_msg=name)
    assert not np.array_equal(known.nodes.position, start.nodes.position)


@pytest.mark.parametrize("dim", [2, 3])
def test_one_of_several_ropes_gives_the_bits_of_a_cable(dim):
    """The same scenario with `cable` and with `ropes` of one name: all numbers of its snapshots."""
    alone = one_rope(dim)
    written = {key: value for key, value in alone.resolved().items() if key != "cable"}
    among = load_scenario({**written, "ropes": {"only": alone.resolved()["cable"]}})
    cable, ropes = Simulation(alone), Simulation(among)
    np.testing.assert_array_equal(ropes.snapshot.numbers, cable.snapshot.numbers)
    until = STEPS * cable.step
    np.testing.assert_array_equal(ropes.advance_to(until).numbers, cable.advance_to(until).numbers)
    ropes.emergency_stop()
    cable.emergency_stop()
    np.testing.assert_array_equal(ropes.advance_to(2.0 * until).numbers, cable.advance_to(2.0 * until).numbers)


def test_what_kernels_take_is_packed_once():
    """Simulations advanced in turn pack no arguments anew, which would take milliseconds each time."""
    many = [Simulation(one_rope(2)) for _ in range(4)]
    before = [one._engine.arguments(1) for one in many]
    for one in many:
        one.advance_to(one.step)
    for one, arguments in zip(many, before, strict=True):
        assert all(new is old for new, old in zip(one._engine.arguments(1), arguments, strict=True))
        if JIT:
            assert not any(hasattr(argument, "_fields") for argument in arguments)
