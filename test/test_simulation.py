import copy
import pickle
import sys
from math import inf, nan

import numpy as np
import pytest
from twin_process import run_python

from cable_twin.frame.records import Command, CommandError
from cable_twin.mechanics.language.compilation import Kernel
from cable_twin.mechanics.language.declared import arrays_of
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, SolverError
from verification import JIT

ELEMENTS = 24 if JIT else 4


def simulate(**overrides):
    overrides = {key.replace("__", "."): value for key, value in overrides.items()}
    return Simulation(load_scenario("seed_example", {"cable.elements": ELEMENTS, **overrides}), samples=11)


def driven(**limits):
    more = {f"carriages.carriage.drive.limits.{key}": value for key, value in limits.items()}
    return simulate(**{"carriages.carriage.drive.mode": "speed", **more})


def same(one, other, *, but_time=False):
    """Whether two snapshots are equal to the last bit."""
    return one.numbers[int(but_time) :].tobytes() == other.numbers[int(but_time) :].tobytes()


def test_starts_at_rest_in_equilibrium():
    simulation = simulate()
    snapshot = simulation.snapshot
    assert simulation.time == snapshot.time == 0.0
    car = snapshot.carriages["carriage"]
    assert car.arc_length == 3.2
    assert (car.speed, car.drive_force) == (0.0, 0.0)
    total = sum(support.force[2] for support in snapshot.supports.values())
    assert total == pytest.approx((2 * 2.67 + 0.148) * 9.81, rel=1e-9)
    assert sum(support.force[0] for support in snapshot.supports.values()) == pytest.approx(0.0, abs=1e-6)
    np.testing.assert_allclose(car.contact_force, [0.0, 0.0, 2 * 2.67 * 9.81], atol=1e-6)
    assert simulation.energy().kinetic == 0.0


def test_same_commands_at_the_same_times_give_the_same_bits_whatever_the_pacing():
    def run(times):
        simulation = driven(acceleration=2.0)
        pending = {0.02: -0.5, 0.05: 0.25}
        for time in times:
            simulation.advance_to(time)
            if time in pending:
                simulation.command("carriage", speed=pending[time])
        return simulation

    coarse = run([0.02, 0.05, 0.08])
    fine = run([0.001, 0.0102, 0.02, 0.033, 0.034, 0.05, 0.051, 0.0799, 0.08])
    steps = run([0.001 * k if k not in (20, 50) else {20: 0.02, 50: 0.05}[k] for k in range(81)])
    assert same(coarse.snapshot, fine.snapshot)
    assert same(coarse.snapshot, steps.snapshot)
    assert coarse.energy() == fine.energy() == steps.energy()


def test_time_goes_to_the_nearest_step_and_never_back():
    simulation = simulate()
    assert simulation.advance_to(0.0104).time == 0.01
    with pytest.raises(ValueError, match=r"advance_to: given 0\.005 s; allowed: a finite time, from 0\.01 s up to "):
        simulation.advance_to(0.005)
    assert simulation.advance_to(0.0099).time == 0.01  # the same step
    snapshot = simulation.advance_to(0.0101)
    assert snapshot.time == 0.01
    assert snapshot is simulation.snapshot
    for k in range(11, 31):
        assert simulation.advance_to(k * 0.001).time == round(k * 1e6) / 1e9
    assert simulation.snapshot.solver.steps == 1


@pytest.mark.parametrize("time", [nan, inf, -inf, 1e300, "soon", None])
def test_a_time_that_is_none_is_refused(time):
    simulation = simulate()
    with pytest.raises(ValueError, match="allowed: a finite time, from 0 s up to "):
        simulation.advance_to(time)
    assert simulation.time == 0.0


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (Command("speed", {"gondola": 1.0}), "carriage or drive: given 'gondola'; allowed: carriage"),
        (Command("speed", {"carriage": 2.5}), "speed of 'carriage': given 2.5 m/s; allowed: -2 to 2 m/s"),
        (Command("speed", {"carriage": -2.5}), "speed of 'carriage': given -2.5 m/s; allowed: -2 to 2 m/s"),
        (Command("force", {"carriage": 51.0}), "force of 'carriage': given 51 N; allowed: -50 to 50 N"),
        (Command("speed", {"carriage": nan}), "speed of 'carriage': given nan m/s; allowed: a finite number"),
        (Command("force", {"carriage": inf}), "force of 'carriage': given inf N; allowed: a finite number"),
        (Command("speed", {}), "speed: given no name; allowed: a carriage or drive"),
        (Command("speed", {"carriage": "1"}), "speed of 'carriage': given '1'; allowed: a number in m/s"),
        (Command("wind", {"x": "a", "z": 0.0}), "wind of 'x': given 'a'; allowed: a number in m/s"),
        (Command("temperature", {"ropes": None}), "temperature of 'ropes': given None; allowed: a number in degC"),
        ("release", "command: given 'release'; allowed: a `Command` with kind and values"),
    ],
)
def test_refusals_say_what_is_allowed_and_change_nothing(command, message):
    simulation = driven(speed=2.0, force=50.0)
    simulation.command("carriage", speed=-0.5)
    simulation.advance_to(0.01)
    before = [array.copy() for array in arrays_of(simulation.state).values()]
    with pytest.raises(CommandError) as refusal:
        simulation.apply(command)
    assert str(refusal.value) == message
    for array, kept in zip(arrays_of(simulation.state).values(), before, strict=True):
        np.testing.assert_array_equal(array, kept)


def test_a_command_is_refused_whole():
    simulation = driven(speed=2.0)
    with pytest.raises(CommandError):
        simulation.apply(Command("speed", {"carriage": 1.0, "gondola": 1.0}))
    assert simulation.state.drives.target[0] == 0.0


@pytest.mark.parametrize("given", [{}, {"speed": 1.0, "force": 1.0}])
def test_a_command_has_either_speed_or_force(given):
    with pytest.raises(CommandError, match="allowed: either speed"):
        simulate().command("carriage", **given)


def test_a_fixed_carriage_takes_no_command():
    simulation = simulate(carriages__carriage__joint="fixed")
    with pytest.raises(CommandError, match="'carriage' is fixed to the cable and takes no command"):
        simulation.command("carriage", speed=0.1)


def test_a_scenario_without_carriages_names_none():
    scenario = load_scenario("seed_example", {"cable.elements": 4}).resolved()
    simulation = Simulation(load_scenario({**scenario, "carriages": {}}))
    simulation.advance_to(0.01)
    with pytest.raises(CommandError, match="carriage or drive: given 'carriage'; allowed: none in this scenario"):
        simulation.command("carriage", speed=0.1)


def test_commands_say_when_and_by_whom_they_were_applied():
    simulation = driven()
    simulation.advance_to(0.0104)
    command = Command("speed", {"carriage": -0.1})
    applied = simulation.apply(command, source="cable_car")
    assert (applied.time, applied.command, applied.source) == (0.01, command, "cable_car")
    assert simulation.command("carriage", force=1.0).source == "python"


@pytest.mark.parametrize("kind", [np.float32, np.int64])
def test_commands_take_numbers_of_numpy(kind, tmp_path):
    simulation = driven()
    applied = simulation.command("carriage", speed=kind(1))
    assert type(applied.command.values["carriage"]) is float
    simulation.save(tmp_path / "state.npz")


@pytest.mark.parametrize("samples", [0, 1, 2.5])
def test_samples_are_two_or_more(samples):
    with pytest.raises(ValueError, match=f"samples: given {samples}; allowed: a whole number from 2"):
        Simulation(load_scenario("seed_example"), samples=samples)


def test_a_name_is_no_scenario():
    with pytest.raises(TypeError, match="scenario: given 'seed_example'; allowed: a Scenario, as of `load_scenario`"):
        Simulation("seed_example")


def test_a_driven_joint_takes_over_from_the_present_motion():
    simulation = simulate()
    speed = simulation.advance_to(0.1).carriages["carriage"].speed
    at = simulation.snapshot.carriages["carriage"].arc_length
    assert speed < -0.1
    simulation.command("carriage", speed=0.0)
    car = simulation.advance_to(0.15).carriages["carriage"]
    assert car.speed == pytest.approx(speed + 0.5 * 0.05, abs=1e-12)
    assert car.arc_length == pytest.approx(at + speed * 0.05 + 0.5 * 0.5 * 0.05**2, abs=1e-12)


def test_a_force_acts_until_the_next_command():
    simulation = simulate()
    simulation.command("carriage", force=40.0)
    car = simulation.advance_to(0.03).carriages["carriage"]
    assert car.drive_force == 40.0
    assert car.speed > 0.0
    simulation.command("carriage", force=0.0)
    assert simulation.snapshot.carriages["carriage"].drive_force == 0.0


def test_reset_gives_back_the_start_and_time_runs_on():
    simulation, fresh = driven(), driven()
    start = simulation.snapshot
    simulation.command("carriage", speed=-1.0)
    simulation.advance_to(0.05)
    simulation.emergency_stop()
    assert not same(simulation.snapshot, start, but_time=True)
    applied = simulation.reset()
    assert applied.time == simulation.time == 0.05
    assert not simulation.emergency_stopped
    assert same(simulation.snapshot, start, but_time=True)
    for one in (simulation, fresh):
        one.command("carriage", speed=-0.5)
    moved, want = simulation.advance_to(0.08), fresh.advance_to(0.03)
    assert (moved.time, want.time) == (0.08, 0.03)
    assert same(moved, want, but_time=True)


def test_emergency_stop_brakes_and_refuses_until_it_is_released():
    simulation = driven(acceleration=5.0, emergency_deceleration=2.0)
    simulation.command("carriage", speed=-0.2)
    car = simulation.advance_to(0.05).carriages["carriage"]
    assert car.speed == pytest.approx(-0.2)
    simulation.emergency_stop()
    assert simulation.emergency_stopped
    stopped = simulation.advance_to(0.15).carriages["carriage"]
    assert car.arc_length - stopped.arc_length == pytest.approx(0.2**2 / (2.0 * 2.0), abs=1e-12)
    assert stopped.speed == 0.0
    with pytest.raises(CommandError, match="the emergency stop is in force: release it before the next command"):
        simulation.command("carriage", speed=0.1)
    simulation.emergency_stop(active=False)
    assert not simulation.emergency_stopped
    simulation.command("carriage", speed=0.1)
    assert simulation.advance_to(0.18).carriages["carriage"].speed > 0.0


def test_emergency_stop_takes_a_force_drive():
    simulation = simulate(carriages__carriage__drive__limits__emergency_deceleration=20.0)
    simulation.command("carriage", force=10.0)
    simulation.advance_to(0.02)
    simulation.emergency_stop()
    assert simulation.advance_to(0.1).carriages["carriage"].speed == 0.0


def test_emergency_stop_leaves_a_free_carriage_alone():
    simulation, other = simulate(), simulate()
    for one in (simulation, other):
        one.advance_to(0.02)
    simulation.emergency_stop()
    assert same(simulation.advance_to(0.05), other.advance_to(0.05))


def test_supports_bear_a_carriage_on_the_end_element_also_when_its_drive_has_just_changed():
    simulation = simulate(cable__elements=4, carriages__carriage__drive__mode="speed")
    before = simulation.advance_to(0.005)
    simulation.command("carriage", force=30.0)
    for end, support in before.supports.items():
        np.testing.assert_allclose(simulation.snapshot.supports[end].force, support.force, atol=1e-9)


def test_a_failed_step_is_named_and_the_last_good_snapshot_kept():
    simulation = simulate(solver__tolerance=1e-9)
    simulation.advance_to(0.01)
    good = simulation.snapshot
    solver = simulation.system.solver._replace(max_iterations=1, max_halvings=0, tolerance=1e-9)
    simulation.system = simulation.system._replace(solver=solver)
    with pytest.raises(SolverError) as failure:
        simulation.advance_to(0.05)
    text = str(failure.value)
    assert text.startswith("step 11 (to 0.011 s) failed: after 0 halvings of 0.001 s the last Newton increment was ")
    assert ", largest on element " in text
    assert ", an error of 1e-09 m may be left; the simulation keeps its state at 0.01 s" in text
    assert "nan" not in text
    assert same(simulation.snapshot, good)
    assert simulation.time == 0.01
    simulation.system = simulation.system._replace(solver=solver._replace(max_iterations=12))
    assert simulation.advance_to(0.02).time == 0.02


def test_a_scenario_that_cannot_take_a_step_says_so():
    simulation = simulate(solver__max_iterations=1, solver__max_halvings=0, solver__tolerance=1e-12)
    start = simulation.snapshot
    with pytest.raises(SolverError, match=r"step 1 \(to 0\.001 s\) failed"):
        simulation.advance_to(1.0)
    assert same(simulation.snapshot, start)


def test_snapshots_are_finite_and_their_own():
    simulation = driven()
    simulation.command("carriage", speed=-1.0)
    first = simulation.snapshot
    kept = first.numbers.copy()
    for frame in range(1, 6):
        shown = simulation.advance_to(0.01 * frame).numbers
        np.testing.assert_array_equal(np.isfinite(shown), np.isfinite(kept))  # NaN is what there is not
    np.testing.assert_array_equal(first.numbers, kept)
    with pytest.raises(AttributeError):
        first.time = 1.0


def test_reading_changes_nothing():
    one, other = simulate(), simulate()
    for frame in range(1, 4):
        other.advance_to(0.01 * frame)
        other.cable_positions(np.linspace(0.0, 4.02, 7))
        other.cable_tension(np.linspace(0.0, 4.02, 7))
        other.energy()
        other.natural_frequencies(3)
        other.mode_shapes(2, np.linspace(0.0, 4.02, 7))
    assert same(one.advance_to(0.03), other.snapshot)


def test_snapshot_joint_is_where_the_first_body_hangs():
    car = simulate().advance_to(0.05).carriages["carriage"]
    body = car.bodies["rb1"]
    # upper pivot (0, 0.5) in the axes of the body, a positive pitch turns x towards -z
    pivot = [body.x + 0.5 * np.sin(body.pitch), 0.0, body.z + 0.5 * np.cos(body.pitch)]
    np.testing.assert_allclose(pivot, car.position, atol=1e-10)


def test_cable_starts_and_ends_at_its_supports():
    snapshot = simulate().advance_to(0.02)
    np.testing.assert_allclose(snapshot.cable.positions[[0, -1]], [[0.0, 0.0, 0.0], [3.6, 0.0, 0.0]], atol=1e-12)
    assert snapshot.cable.arc_lengths[[0, -1]].tolist() == [0.0, 4.02]
    assert snapshot.cable.tensions.shape == (11,)


@pytest.mark.skipif(not JIT, reason="nothing is compiled")
def test_nothing_is_compiled_once_it_runs():
    """Kernels of a live twin ready at its start, as compilation at a reset would delay frames."""
    simulation = driven()
    before = called_from_python()
    simulation.command("carriage", speed=0.1)
    simulation.advance_to(0.05)
    simulation.command("carriage", force=0.1)
    simulation.emergency_stop()
    simulation.emergency_stop(False)
    simulation.reset()
    simulation.advance_to(0.1)
    assert called_from_python() == before
    assert sum(before.values()) >= 4


def called_from_python():
    """Number of argument type sets of each kernel called from Python."""
    kernels = {
        name: value
        for module, content in list(sys.modules.items())
        if module.startswith("cable_twin.mechanics")
        for name, value in vars(content).items()
        if isinstance(value, Kernel)
    }
    return {name: len(kernel._from_python.overloads) for name, kernel in kernels.items()}


@pytest.mark.skipif(not JIT, reason="there is no machine code to interrupt")
def test_an_interrupt_is_an_exception_wherever_it_comes():
    """No end of the process from an interrupt in numba's unguarded Python code."""
    code = """
import signal
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

simulation = Simulation(load_scenario("single_span"))
simulation.advance_to(0.01)
simulation.cable_tension([100.0])  # loaded, which is numba's own affair
signal.signal(signal.SIGALRM, signal.default_int_handler)
caught = 0
while caught < 200:
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.0003 + 0.00001 * caught)
        for _ in range(1000):
            simulation.advance_to(simulation.time + 0.01)
            simulation.cable_tension([100.0])
    except KeyboardInterrupt:
        caught += 1
print("caught", caught)
"""
    result = run_python("-c", code)
    assert result.returncode == 0, result.stderr
    assert result.stdout == "caught 200\n"


@pytest.mark.parametrize("copied", [copy.copy, copy.deepcopy, lambda one: pickle.loads(pickle.dumps(one))])
def test_a_copy_goes_on_by_itself_with_the_same_bits(copied):
    simulation = driven()
    simulation.command("carriage", speed=1.0)
    simulation.advance_to(0.1)
    other, before = copied(simulation), simulation.snapshot
    assert same(other.snapshot, before)
    after = other.advance_to(0.2)
    assert simulation.snapshot is before
    assert same(simulation.advance_to(0.2), after)


def test_the_state_can_be_read_and_not_written():
    """Read-only view that follows the motion; a copy can be changed and restored."""
    simulation = driven()
    state = simulation.state
    with pytest.raises(ValueError, match="read-only"):
        state.wind[:] = 1.0
    full = simulation.capture()
    full.state.wind[:] = 3.0
    assert state.wind[0] == 0.0
    simulation.restore(full)
    assert state.wind[0] == 3.0
    with pytest.raises(ValueError, match="restore: given None; allowed: a state, as of `capture`"):
        simulation.restore(None)
