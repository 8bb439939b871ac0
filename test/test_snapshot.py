"""Snapshots as columns and by name: equal numbers, those of the state, in space."""

import numpy as np
import pytest
import test_loads
from small_tramway import TRAMWAY
from test_moving_cable_twin import short_lift

from cable_twin.frame.layout import CABLE, Layout
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification import JIT
from verification.supports import tramway

VECTORS = ("joint_position", "contact_force", "body_position", "body_velocity", "support_force", "rope_position")
TURNS = ("body_angular_velocity", "body_angles")


def two_bodies():
    """Example of the paper, sliding."""
    return Simulation(load_scenario("seed_example", {"cable.elements": 24 if JIT else 4}), samples=7)


def loaded_cabin():
    """Cabin with haul rope, eccentric payload and wind, and a second carriage."""
    simulation = Simulation(test_loads.scenario(), samples=5)
    simulation.payload("cabin", 120.0)
    simulation.command("cabin", speed=3.0)
    simulation.wind(9.0, -1.0)
    return simulation


def over_a_tower():
    """Rope over a tower with a counterweight."""
    simulation = tramway(cabin={"arc_length": 480.0}, cable__elements=100 if JIT else 20)
    simulation.command("cabin", speed=5.0)
    return simulation


def moving_line():
    """Moving cable with carriers on the cable and in stations."""
    simulation = short_lift()
    simulation.command("haul_rope", speed=2.0)
    return simulation


RUNS = [two_bodies, loaded_cabin, over_a_tower, moving_line]


@pytest.fixture(scope="module", params=RUNS, ids=lambda run: run.__name__)
def simulation(request):
    """Simulation under way."""
    simulation = request.param()
    simulation.advance_to(2.0 if JIT else 0.02)
    return simulation


def entry(value):
    """Number of a column, None for NaN."""
    return np.nan if value is None else value


def test_names_are_those_of_the_scenario(simulation):
    snapshot, scenario = simulation.snapshot, simulation.scenario
    assert list(snapshot.carriages) == list(scenario.vehicles) == list(snapshot.vehicles.names)
    assert list(snapshot.supports) == ["start", "end", *scenario.towers] == list(simulation.supports)
    assert list(snapshot.drives) == list(scenario.drives)
    assert list(snapshot.ropes) == [CABLE]
    bodies = [f"{name}/{body}" for name, vehicle in scenario.vehicles.items() for body in vehicle.bodies]
    assert list(snapshot.bodies.names) == list(snapshot.layout.bodies) == bodies
    for name, vehicle in scenario.vehicles.items():
        carriage = snapshot.carriages[name]
        assert list(carriage.bodies) == list(vehicle.bodies)
        assert len(carriage.bodies) == len(vehicle.bodies)
        assert "nobody" not in carriage.bodies
        with pytest.raises(KeyError, match="nobody"):
            carriage.bodies["nobody"]
    assert simulation.layout is snapshot.layout
    assert repr(snapshot.drives).startswith("{")


def test_what_has_a_name_has_the_numbers_of_its_row(simulation):
    snapshot = simulation.snapshot
    columns = snapshot.columns
    assert snapshot.time == columns.time[0] == simulation.time
    row = 0
    for index, carriage in enumerate(snapshot.carriages.values()):
        for column in ("arc_length", "speed", "drive_force", "attached", "payload"):
            assert getattr(carriage, column) == getattr(columns, column)[index]
        np.testing.assert_array_equal(carriage.position, columns.joint_position[index])
        np.testing.assert_array_equal(carriage.contact_force, columns.contact_force[index])
        for part in ("travel", "speed", "force"):
            value = None if carriage.haul_rope is None else getattr(carriage.haul_rope, part)
            np.testing.assert_array_equal(getattr(columns, f"haul_{part}")[index], entry(value))
        for body in carriage.bodies.values():
            for part in ("position", "orientation", "velocity", "angular_velocity", "angles"):
                np.testing.assert_array_equal(getattr(body, part), getattr(columns, f"body_{part}")[row])
                np.testing.assert_array_equal(getattr(snapshot.bodies, part)[row], getattr(body, part))
            assert [body.x, 0.0, body.z] == body.position.tolist()
            assert [body.roll, body.pitch, body.yaw] == body.angles.tolist()
            row += 1
    assert row == len(columns.body_position)
    for index, (name, support) in enumerate(snapshot.supports.items()):
        np.testing.assert_array_equal(support.force, columns.support_force[index])
        np.testing.assert_array_equal(columns.support_travel[index], entry(support.travel))
        assert (support.tower is not None) == (name in simulation.scenario.towers)
        for part, column in (("normal_load", "load"), ("lowest_load", "lowest_load"), ("rest_load", "rest_load")):
            value = None if support.tower is None else getattr(support.tower, part)
            np.testing.assert_array_equal(getattr(columns, f"tower_{column}")[index], entry(value))
        if support.tower is not None:
            assert support.tower.lifted_off == (support.tower.normal_load == 0.0)
    for index, drive in enumerate(snapshot.drives.values()):
        drives = columns.drive_position, columns.drive_speed, columns.moving_cable_force
        assert [drive.position, drive.speed, drive.force] == [column[index] for column in drives]
    np.testing.assert_array_equal(snapshot.cable.arc_lengths, snapshot.layout.arc_lengths)
    np.testing.assert_array_equal(snapshot.cable.positions, columns.rope_position)
    np.testing.assert_array_equal(snapshot.cable.tensions, columns.rope_tension)
    np.testing.assert_array_equal(snapshot.ropes[CABLE].positions, columns.rope_position)
    vehicles = snapshot.vehicles
    for part in ("arc_length", "speed", "drive_force", "contact_force", "attached", "payload"):
        np.testing.assert_array_equal(getattr(vehicles, part), getattr(columns, part))
    np.testing.assert_array_equal(vehicles.position, columns.joint_position)


def test_columns_are_those_of_the_state(simulation):
    """Other calculation than in the kernel: equal to the last bit, sums to 1e-12."""
    columns, state, system = simulation.snapshot.columns, simulation.state, simulation.system
    first = system.carriages.body_offset[:-1]
    for column, array in (
        (columns.arc_length, state.joints.position),
        (columns.speed, state.joints.velocity),
        (columns.drive_force, state.drives.force),
        (columns.attached, state.attached),
        (columns.payload, state.payload),
        (columns.body_angles[:, 1], state.bodies.position[:, 2]),
        (columns.body_angular_velocity[:, 1], state.bodies.velocity[:, 2]),
        (columns.joint_position, simulation.cable_positions(state.joints.position)),
        (columns.rope_position, simulation.cable_positions(simulation.layout.arc_lengths)),
        (columns.rope_tension, simulation.cable_tension(simulation.layout.arc_lengths)),
        (columns.tower_load[2:], state.tower_load[:, 0]),
        (columns.tower_lowest_load[2:], state.tower_load[:, 1]),
        (columns.drive_position, state.rope.position[:1].repeat(len(simulation.drives))),
        (columns.drive_speed, state.rope.velocity[:1].repeat(len(simulation.drives))),
    ):
        np.testing.assert_array_equal(column, array)
    on_joint = np.nan_to_num(columns.haul_pull) + columns.contact_force
    np.testing.assert_allclose(on_joint[:, [0, 2]], state.multipliers[first], rtol=1e-12, atol=1e-9)
    # a body turned by its pitch about the place where it would be without payload
    pitch, spin = state.bodies.position[:, 2], state.bodies.velocity[:, 2]
    x, z = system.carriages.centre_offset.T
    arm = np.stack([np.cos(pitch) * x + np.sin(pitch) * z, -np.sin(pitch) * x + np.cos(pitch) * z], axis=1)
    moving = spin[:, None] * np.stack([arm[:, 1], -arm[:, 0]], axis=1)
    centres, velocities = state.bodies.position[:, :2] - arm, state.bodies.velocity[:, :2] - moving
    np.testing.assert_allclose(columns.body_position[:, [0, 2]], centres, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(columns.body_velocity[:, [0, 2]], velocities, rtol=0.0, atol=1e-12)


def test_everything_is_in_space(simulation):
    """Planar system: y is 0, and rotation about y only."""
    columns = simulation.snapshot.columns
    for name in VECTORS:
        assert getattr(columns, name).shape[-1] == 3
        assert not getattr(columns, name)[:, 1].any()
    for name in TURNS:
        assert not getattr(columns, name)[:, [0, 2]].any()
    half = 0.5 * columns.body_angles[:, 1]
    expected = np.stack([0.0 * half, np.sin(half), 0.0 * half, np.cos(half)], axis=1)
    np.testing.assert_allclose(columns.body_orientation, expected, rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(columns.body_orientation, axis=1), 1.0, rtol=1e-15)
    # as a rotation, x to -z by a positive pitch
    for (x, y, z, w), pitch in zip(columns.body_orientation, columns.body_angles[:, 1], strict=True):
        turned = [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)]
        np.testing.assert_allclose(turned, [np.cos(pitch), 0.0, -np.sin(pitch)], rtol=0.0, atol=1e-15)
    shapes = simulation.mode_shapes(2, np.linspace(0.0, simulation.system.cable.unstrained_length, 9))
    assert shapes.shape == (2, 9, 3)
    assert not shapes[..., 1].any()
    assert np.all(np.abs(shapes).max(axis=(1, 2)) > 0.8)


def test_a_snapshot_stays_as_it_is(simulation):
    """Snapshot and data taken from it, while the simulation continues."""
    snapshot = simulation.snapshot
    name = next(iter(snapshot.carriages))
    taken = snapshot.carriages[name], snapshot.columns, snapshot.cable.positions
    numbers, place = snapshot.numbers.copy(), taken[0].position.copy()
    after = simulation.advance_to(simulation.time + (0.5 if JIT else 0.01))
    assert after is simulation.snapshot
    assert not np.array_equal(after.numbers, numbers, equal_nan=True)
    assert not np.shares_memory(after.numbers, snapshot.numbers)
    np.testing.assert_array_equal(snapshot.numbers, numbers)
    np.testing.assert_array_equal(taken[0].position, place)
    np.testing.assert_array_equal(taken[1].rope_position, taken[2])
    with pytest.raises(AttributeError):
        snapshot.time = 1.0


def test_columns_of_many_frames_are_those_of_each(simulation):
    frames = [simulation.advance_to(simulation.time + 0.01 * frame) for frame in range(4)]
    layout = simulation.layout
    assert all(frame.numbers.shape == (layout.size,) for frame in frames)
    numbers = np.array([frame.numbers for frame in frames])
    batch, square = layout.columns(numbers), layout.columns(numbers.reshape(2, 2, -1))
    for index, frame in enumerate(frames):
        for whole, pairs, own in zip(batch, square, frame.columns, strict=True):
            np.testing.assert_array_equal(whole[index], own)
            np.testing.assert_array_equal(pairs[index // 2, index % 2], own)
            assert np.shares_memory(whole, numbers) or whole.size == 0
    assert sum(column[0].size for column in batch) == layout.size


def test_layout_of_nothing_but_a_rope():
    layout = Layout({}, ("start", "end"), (), np.linspace(0.0, 10.0, 3))
    columns = layout.columns(np.arange(float(layout.size)))
    assert layout.bodies == ()
    assert columns.joint_position.shape == (0, 3)
    assert columns.support_force.shape == (2, 3)
    assert columns.wind[-1] == layout.size - 1
    with pytest.raises(ValueError, match="read-only"):
        layout.arc_lengths[0] = 1.0


def test_a_body_is_where_it_is_without_its_payload():
    """Displayed positions unaffected by a payload; centre of mass by the formula of two masses."""
    simulation = Simulation(test_loads.scenario(), samples=5)
    simulation.advance_to(0.1 if JIT else 0.02)
    before = simulation.snapshot.carriages["cabin"].bodies["cabin"]
    centre = simulation.state.bodies.position[0].copy()
    simulation.payload("cabin", 120.0)
    snapshot = simulation.snapshot
    after = snapshot.carriages["cabin"].bodies["cabin"]
    np.testing.assert_allclose(after.position, before.position, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(after.velocity, before.velocity, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(after.orientation, before.orientation)
    offset = 120.0 / (200.0 + 120.0) * np.array([0.2, -0.5])
    np.testing.assert_allclose(simulation.system.carriages.centre_offset[0], offset)
    assert not simulation.system.carriages.centre_offset[1].any()
    moved = np.hypot(*(simulation.state.bodies.position[0] - centre)[:2])
    assert moved == pytest.approx(float(np.hypot(*offset)), rel=1e-9)
    assert snapshot.columns.payload.tolist() == [120.0, 0.0]


def test_a_rope_that_there_is_not_is_named():
    simulation = two_bodies()
    places = np.array([0.0, 1.0])
    np.testing.assert_array_equal(simulation.cable_positions(places, CABLE), simulation.cable_positions(places))
    np.testing.assert_array_equal(simulation.cable_tension(places, CABLE), simulation.cable_tension(places))
    for ask in (simulation.cable_positions, simulation.cable_tension):
        with pytest.raises(ValueError, match="rope: given 'haul'; allowed: cable"):
            ask(places, "haul")


@pytest.mark.parametrize("beyond", [-5.0, 1e4, float("nan")])
def test_a_place_that_is_not_on_the_rope_is_named(beyond):
    simulation = two_bodies()
    for ask in (simulation.cable_positions, simulation.cable_tension):
        with pytest.raises(ValueError, match=rf"arc length: given {beyond:.9g} m; allowed: 0 to [\d.]+ m, on the rope"):
            ask(np.array([0.0, beyond]))


def test_a_snapshot_cannot_be_written():
    snapshot = two_bodies().snapshot
    for numbers in (snapshot.numbers, snapshot.columns.speed, snapshot.cable.positions, snapshot.bodies.position):
        with pytest.raises(ValueError, match="read-only"):
            numbers[:] = 0.0


def test_a_sample_is_where_a_weight_hangs():
    """Sag is largest there; the samples stay in order, those at the ends where they are."""
    loads = [{"arc_length": place, "force": [0.0, -500.0]} for place in (0.001, 30.3, 30.4)]
    scenario = load_scenario(TRAMWAY, {"cable.loads": [*loads, {"arc_length": 60.1, "force": [0.0, 500.0]}]})
    places = Layout.of(scenario, 200).arc_lengths
    even = np.linspace(0.0, scenario.cable.unstrained_length, 200)
    assert np.flatnonzero(places != even).size == (2 if round(30.3 / even[1]) != round(30.4 / even[1]) else 1)
    assert 30.3 in places
    assert np.all(np.diff(places) > 0.0)
    assert Layout.of(scenario, 2).arc_lengths.tolist() == [0.0, scenario.cable.unstrained_length]
