"""Haul rope: condensed Newton step against dense rows from the definition, and statics."""

import numpy as np
import pytest
from systems import changed, difference, disturbed_state, make_system, put
from test_equations_of_motion import ELASTIC, ROUGH, check_newton_step, rows

from cable_twin.mechanics.drives.haul_rope import (
    direct_haul,
    drum_force,
    hang_in_rope,
    haul_direction,
    haul_energies,
    haul_tension,
    leave_place,
    pull_on_carriage,
    rope_force,
    take_up,
)
from cable_twin.mechanics.language.rotations import cross, orientation
from cable_twin.mechanics.on_rope.sliding_joint import joint_position, joint_tangent, joint_velocity, place_joint
from cable_twin.mechanics.parameters import DRUM, END, FORCE, FREE, SPEED, START
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.models import for_kernels


def setup(chains=(2,), *, station=END, sheave=FORCE, cable=ELASTIC, **changes):
    """System in general position with all carriages on haul ropes."""
    count = len(chains)
    ropes = {"axial_stiffness": np.full(count, 3000.0), "station": np.full(count, station, dtype=np.int64)} | changes
    rough = {name: np.full(count, value) for name, value in ROUGH.items()}
    system = make_system(chains=chains, cable=cable, carriages=rough, haul_ropes=ropes)
    state, work = disturbed_state(system)
    state.axis[:], state.drives.mode[:] = DRUM, sheave
    state.drives.force[:] = 40.0
    put(state.drums, 0.0, 0.7, -1.3, 0.5)
    put(state.hauled, 0.0, -0.4, 0.9, 0.2)
    state.hauled.position[:] = state.joints.position + 0.01
    state.drums.position[:] = state.hauled.position + 0.02
    state.friction_origin[:] = state.joints.position - 0.004
    state.friction_deflection[:] = 0.2
    for carriage in range(count):
        place_joint(system.cable, state, carriage)
    leave_place(system, state, work)
    work.haul_place[:] += 0.03  # as if it had been elsewhere at the start of the step
    direct_haul(system, state, work)
    return system, state, work


def haul_rows(system, state):
    """Force of each haul rope on the travel of its carriage, and the rows of the drums."""
    on_w, on_u = [], []
    ropes, carriages = system.haul_ropes, system.carriages
    for k in range(carriages.fixed.size):
        u, u_dot, u_ddot, _ = np.array(state.drums)[:, k]
        w, w_dot, w_ddot, _ = np.array(state.hauled)[:, k]
        way = u if ropes.station[k] == START else system.cable.unstrained_length - u
        length = ropes.beyond_track[k] + way
        stiffness = ropes.axial_stiffness[k] / length
        weight = carriages.mass[carriages.body_offset[k] : carriages.body_offset[k + 1]].sum()
        moving = weight + ropes.mass_per_length[k] * length / 3.0
        damping = 2.0 * ropes.damping_ratio[k] * np.sqrt(stiffness * moving)
        pull = stiffness * (u - w) + damping * (u_dot - w_dot)
        floor = ropes.pretension[k]
        pull = max(pull, -floor) if ropes.station[k] == END else min(pull, floor)
        mass = ropes.mass_per_length[k] * length
        on_w.append(pull - mass * (w_ddot / 3.0 + u_ddot / 6.0))
        if state.drives.mode[k] == SPEED:
            on_u.append(0.0)
        else:
            inertia = (ropes.drive_inertia[k] + mass / 3.0) * u_ddot + mass * w_ddot / 6.0
            on_u.append(inertia + pull - state.drives.force[k])
    return np.array(on_w), np.array(on_u)


def hauled_residual(system, work):
    """Rows of eq. 16 with haul ropes, whose pull acts on the first bodies instead of the cable."""

    def residual(state):
        carriages, (on_w, on_u) = system.carriages, haul_rows(system, state)
        first, pulls = carriages.body_offset[:-1], on_w[:, None] * work.haul_direction
        contact = state.multipliers.copy()
        contact[first] -= pulls
        free = np.full(len(on_w), FREE)
        borne = changed(state, drives_force=np.zeros_like(on_w), drives_mode=free, multipliers=contact)
        bare = rows(system, borne, work)
        bodies = bare[4 * (system.cable.element_count + 1) :][: 3 * carriages.mass.size].reshape(-1, 3)
        gaps = []
        for k, body in enumerate(first):
            axes = np.reshape(orientation(state.bodies.position[body], (0.0, 0.0)), (2, 2))
            turn = cross((1.0,), tuple(axes @ carriages.upper_pivot[body]))
            bodies[body] -= [*pulls[k], pulls[k] @ turn]
            place = np.array(joint_position(system.cable, state, k))
            gaps.append(state.hauled.position[k] - work.haul_origin[k] - work.haul_direction[k] @ place)
        return np.concatenate([bare, on_u, gaps])

    return residual


@pytest.mark.parametrize("sheave", [FREE, FORCE, SPEED], ids=["free", "force", "speed"])
@pytest.mark.parametrize("station", [START, END], ids=["start", "end"])
def test_newton_step(station, sheave):
    """Elastic, viscous and inertial coupling of carriage and drum, stiffness by the rope's length: to 3e-8."""
    system, state, work = setup(station=station, sheave=sheave)
    if sheave == FREE:
        state.drives.force[:] = 0.0
    check_newton_step(system, state, work, 3e-8, hauled_residual(system, work))


@pytest.mark.parametrize("sheave", [FORCE, SPEED], ids=["force", "speed"])
def test_newton_step_of_a_slack_rope(sheave):
    """Push limited by the pretension of the counter rope."""
    system, state, work = setup(sheave=sheave, pretension=np.array([15.0]))
    state.drums.position[:] = state.hauled.position - 0.3
    assert rope_force(system, state, 0)[0] == -15.0
    check_newton_step(system, state, work, 3e-8, hauled_residual(system, work))


def test_newton_step_of_several_carriages():
    system, state, work = setup((1, 2))
    check_newton_step(system, state, work, 3e-8, hauled_residual(system, work))


@pytest.mark.parametrize(("station", "sign"), [(START, 1.0), (END, -1.0)])
def test_a_rope_without_a_counter_rope_only_pulls(station, sign):
    system, state, _ = setup(station=station, pretension=np.zeros(1))
    state.drums.velocity[0] = state.hauled.velocity[0]
    state.drums.position[0] = state.hauled.position[0] + sign * 0.1
    assert rope_force(system, state, 0)[0] == 0.0
    state.drums.position[0] = state.hauled.position[0] - sign * 0.1
    assert sign * rope_force(system, state, 0)[0] < -100.0


@pytest.mark.parametrize("station", [START, END], ids=["start", "end"])
@pytest.mark.parametrize("force", [-300.0, 0.0, 420.0])
def test_a_carriage_hangs_in_its_rope(station, force):
    system, state, _ = setup(station=station)
    state.joints.velocity[:] = 0.0
    assert hang_in_rope(system, state, 0, force)
    assert rope_force(system, state, 0)[0] == pytest.approx(force, abs=1e-9)
    assert pull_on_carriage(system, state, 0) == pytest.approx(force, abs=1e-9)
    assert drum_force(system, state, 0) == pytest.approx(force, abs=1e-9)
    assert not hang_in_rope(system, state, 0, 501.0 if station == START else -501.0)


@pytest.mark.parametrize("station", [START, END])
def test_the_highest_tension_is_at_the_vehicle_or_at_the_drive(station):
    """By the momentum of the rope, between the forces at both ends, and by its weight."""
    system, state, _ = setup(station=station, pretension=np.array([700.0]))
    sign = 1.0 if station == END else -1.0
    scale = np.linalg.norm(haul_direction(system, state, 0))
    at_vehicle = sign * scale * pull_on_carriage(system, state, 0)
    inertia = system.haul_ropes.drive_inertia[0] * state.drums.acceleration[0]
    at_drive = sign * scale * (drum_force(system, state, 0) - inertia)
    rise = state.nodes.position[-1 if station == END else 0, 0, -1] - joint_position(system.cable, state, 0)[-1]
    weight = -system.haul_ropes.mass_per_length[0] * system.cable.gravity[-1] * rise
    found = haul_tension(system, state, 0)
    assert found == pytest.approx(700.0 + max(at_vehicle, at_drive + weight))
    assert (at_drive + weight > at_vehicle) == (station == END)


def test_energy_is_what_the_forces_and_masses_say():
    """Force as the negative derivative of the energy; kinetic energy of a rod between two speeds, and of the drive."""
    system, state, _ = setup(damping_ratio=np.zeros(1))

    def elastic(w):
        return haul_energies(system, changed(state, hauled_position=w))[1]

    slope = difference(lambda w: np.array([elastic(w)]), state.hauled.position.copy(), 1e-4)
    assert -slope[0, 0] == pytest.approx(rope_force(system, state, 0)[0], rel=1e-9)
    length = 0.4 + system.cable.unstrained_length - state.drums.position[0]
    share = np.linspace(0.0, 1.0, 2001)
    speed = (1.0 - share) * state.hauled.velocity[0] + share * 0.7
    rod = 0.5 * 2.0 * length * np.trapezoid(speed**2, share)
    assert haul_energies(system, state)[0] == pytest.approx(rod + 0.5 * 7.0 * 0.7**2, rel=1e-6)


def test_what_the_track_rope_moves_along_itself_is_taken_up_at_the_sheave():
    """Travel reset to the arc length at unchanged force, which depends on the difference only."""
    system, state, _ = setup(damping_ratio=np.zeros(1))
    state.reference.position[:] = state.drums.position
    ahead = state.drums.position - state.hauled.position
    take_up(system, state)
    np.testing.assert_array_equal(state.hauled.position, state.joints.position)
    np.testing.assert_allclose(state.drums.position - state.hauled.position, ahead, atol=1e-14)
    np.testing.assert_array_equal(state.reference.position, state.drums.position)


def tangent(system, state, carriage):
    return joint_tangent(system.cable, state, carriage)


def at_rest(scenario, place, **cable):
    """Simulation of a shipped scenario in still air, whose cabin hangs at a place (m), and the position of that."""
    values = {f"cable.{key}": value for key, value in cable.items()} | {
        "cable.axial_stiffness": 482e9,
        "cable.breaking_force": None,
    }
    air = load_scenario(scenario).air.wind
    simulation = Simulation(
        load_scenario(scenario, {**values, "air.wind": [0.0] * len(air), "carriages.cabin.arc_length": place})
    )
    return simulation, np.array(joint_position(simulation.system.cable, for_kernels(simulation)[0], 0))


@pytest.mark.parametrize("scenario", ["aerial_tramway", "windy_tramway"])
def test_the_way_of_a_vehicle_is_the_rope_that_it_passes(scenario):
    """From rest to rest of a light rope: d·Δp is Δs and what the rope moves along itself; the path is longer."""
    way, end = 0.5, {"start.travel": [-9.0, 9.0], "mass_per_length": 0.01}
    (low, before), (simulation, _), (high, after) = (
        at_rest(scenario, 700.0 + side * way, **end) for side in (-0.5, 0, 0.5)
    )
    pulled = high.snapshot.supports["start"].travel - low.snapshot.supports["start"].travel  # by the counterweight
    state, _ = for_kernels(simulation)
    d, r_x = (np.array(of(simulation.system, state, 0)) for of in (haul_direction, tangent))
    assert d @ (after - before) == pytest.approx(way - 0.5 * pulled, rel=5e-5)  # on the one side alone
    assert np.linalg.norm(after - before) > way * 1.0007
    assert np.linalg.norm(r_x) * np.linalg.norm(d) < 0.999  # the bend is not small


@pytest.mark.parametrize("scenario", ["aerial_tramway", "windy_tramway"])
def test_a_start_in_motion_moves_the_vehicle_as_its_drum(scenario):
    simulation = Simulation(
        load_scenario(scenario, {"carriages.cabin.speed": 7.0, "carriages.cabin.arc_length": 300.0})
    )
    state, _ = for_kernels(simulation)
    d = np.array(haul_direction(simulation.system, state, 0))
    assert d @ np.array(joint_velocity(simulation.system.cable, state, 0)) == pytest.approx(7.0, abs=1e-9)
    forces = [simulation.advance_to(0.01 * step).carriages["cabin"].haul_rope.force for step in range(1, 11)]
    assert np.ptp(forces) < 1e3  # N
