"""Sharp kinks as a user meets them: what is refused, where vehicles hang, and that nothing depends on the step."""

import re

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import brentq
from test_scenario_faults import faults_of

from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.solution.catenary import EquilibriumError
from cable_twin.offline.simulate import main as simulate
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, SolverError
from cable_twin.terminal.command_line import faults_reported

SHARP = {"cable.kinks": "sharp"}


@pytest.mark.parametrize(
    ("name", "changes", "beside"),
    [
        ("seed_example", {"solver.integrator": "runge_kutta"}, "integrator runge_kutta"),
        ("seed_example", {"cable.elastic_model": "element_frame"}, "elastic_model element_frame"),
        ("seed_example", {"cable.initial_shape": "straight"}, "initial_shape straight, which has no tension"),
        ("bicable", {"ropes.track_up.kinks": "sharp"}, "'cabin_1', which is clamped to another rope"),
    ],
)
def test_where_no_joint_can_yield_they_are_refused(name, changes, beside):
    rope = "ropes.track_up" if name == "bicable" else "cable"
    faults = faults_of(name, changes | ({} if name == "bicable" else SHARP))
    assert any(f"{rope}.kinks: given 'sharp': beside {beside}; allowed: rounded" in fault for fault in faults)


@pytest.mark.parametrize("name", ["aerial_tramway", "chairlift", "windy_tramway"])
def test_the_rope_that_is_shown_passes_through_the_pivots(name):
    """Under way, in a plane, on a loop and in space: the joint of each vehicle is where its first body hangs."""
    changes = SHARP if name == "windy_tramway" else {}
    simulation = Simulation(load_scenario(name, changes))
    simulation.command("haul_rope" if name == "chairlift" else "cabin", speed=2.5)
    snapshot = simulation.advance_to(8.0)
    system, state, seen = simulation.system, simulation.state, 0
    columns, dim = snapshot.columns, len(simulation.system.cable.gravity)
    axes = [0, 2] if dim == 2 else [0, 1, 2]
    for row in np.flatnonzero(next(iter(simulation.parts.values())).riding):
        first = int(system.carriages.body_offset[row])
        place = float(state.joints.position[row])
        shown = simulation.cable_positions(np.array([place]))[0]
        assert_allclose(shown[axes], columns.joint_position[row, axes], atol=1e-12)
        arm = _turned(state.bodies.position[first], system.carriages.upper_pivot[first])
        assert_allclose(shown[axes], state.bodies.position[first, :dim] + arm, atol=2e-6)
        seen += 1
    assert seen


def _turned(body, arm):
    """An arm (dim,) in the axes of a body, in those of the world."""
    if arm.size == 2:
        c, s = np.cos(body[2]), np.sin(body[2])
        return np.array([c * arm[0] + s * arm[1], -s * arm[0] + c * arm[1]])
    x, y, z, w = body[3:]
    return arm + 2.0 * np.cross([x, y, z], np.cross([x, y, z], arm) + w * arm)


def loaded_rope(kinks, place, slope=0.0, force=14e3, bending_stiffness=7.5e3, **changes):
    """A weightless rope of 16 elements of 5 m up a slope (rad), a load of `force` (N) held on it at a place (elements).

    At its upper end a counterweight pulls along the slope with 240 kN.
    """
    length, count, tension, up = 80.0, 16, 240e3, np.array([np.cos(slope), np.sin(slope)])
    scenario = {
        "gravity": 10.0,
        "cable.unstrained_length": length,
        "cable.mass_per_length": 1e-6,
        "cable.axial_stiffness": 97e6,
        "cable.bending_stiffness": bending_stiffness,
        "cable.elements": count,
        "cable.kinks": kinks,
        "cable.initial_shape": "equilibrium",
        "cable.start": {"position": [0.0, 0.0], "support": "pinned"},
        "cable.end": {
            "position": (length * (1.0 + tension / 97e6) * up).tolist(),
            "support": "counterweight",
            "direction": up.tolist(),
            "mass": tension / 10.0,
        },
        "carriages": {
            "load": {
                "arc_length": place * length / count,
                "drive": {"mode": "speed"},
                "bodies": {"body": {"mass": force / 10.0, "inertia": 1.0, "upper_pivot": [0.0, 0.0]}},
            }
        },
    }
    return Simulation(load_scenario("single_span", scenario | changes))


@pytest.mark.parametrize("slope", [0.0, 0.3, 0.6, 0.9])
def test_a_load_rides_over_no_waves_on_a_rope_that_climbs(slope):
    """A load of 14 kN held on a weightless rope at 240 kN: how far across the rope it hangs, on an element of 5 m."""
    tension, force, length, count = 240e3, 14e3, 80.0, 16
    axes = np.array([[np.cos(slope), np.sin(slope)], [-np.sin(slope), np.cos(slope)]])
    spread = {}
    for kinks in ("rounded", "sharp"):
        ways = []
        for place in (8.0, 8.125, 8.25, 8.375, 8.5):
            simulation = loaded_rope(kinks, place, slope)
            hangs = axes @ simulation.state.bodies.position[0, :2]
            across, x = force * np.cos(slope), place * length / count
            below = tension - force * np.sin(slope)  # the counterweight is above
            string = across / (below / x + tension / (length - x))
            ways.append((hangs[1] + string) * tension / (across * length / count))
        spread[kinks] = 0.5 * np.ptp(ways)
    assert spread["rounded"] > 0.008
    assert spread["sharp"] < 0.0015


@pytest.mark.filterwarnings("ignore:cable.kinks")  # beyond what starts are quiet about
@pytest.mark.parametrize(("force", "lacks", "left"), [(14e3, 4e-4, 2e-5), (42e3, 5e-3, 1.6e-3)])
def test_a_kink_takes_as_much_rope_as_that_of_a_string(force, lacks, left):
    """Travel of the counterweight, which rounded kinks miss by more than `lacks` (m), sharp ones by less than `left`.

    The closed form has two straight parts, which stretch; the load bends them by 0.06 and by 0.18 rad.
    """
    tension, length, stiffness = 240e3, 80.0, 97e6
    for place in (8.0, 8.125, 8.25, 8.5):
        x = place * 5.0

        def ends(slope, x=x):
            """Horizontal way of both parts of the string, the load lower than the start by this slope."""
            slopes = np.array([slope, force / tension - slope])
            cosine = 1.0 / np.hypot(1.0, slopes)
            ways = np.array([x, length - x]) * (1.0 + tension / cosine / stiffness) * cosine
            return ways, ways @ (slopes * [1.0, -1.0])

        slope = brentq(lambda value: ends(value)[1], 0.0, force / tension)
        exact = ends(slope)[0].sum() - length * (1.0 + tension / stiffness)
        off = {}
        for kinks in ("rounded", "sharp"):
            simulation = loaded_rope(kinks, place, force=force, bending_stiffness=1.0)
            off[kinks] = simulation.advance_to(0.0).columns.support_travel[1] - exact
        assert off["rounded"] > lacks
        assert abs(off["sharp"]) < left


def test_a_rope_without_tension_is_refused_in_a_line():
    """Without gravity as long as its span: there is nothing that a kink could be worked out by."""
    changes = {
        "gravity": 0.0,
        "cable.unstrained_length": 100.0,
        "cable.end.position": [100.0, 0.0],
        "cable.bending_stiffness": 0.0,
        "cable.kinks": "sharp",
    }
    with pytest.raises(
        EquilibriumError, match=r"cable.kinks: given 'sharp' where the rope rests with .* N; allowed: rounded"
    ):
        Simulation(load_scenario("single_span", changes))


def test_a_start_does_not_depend_on_the_step():
    """The cabin that its haul rope pulls away from the station: 3 s in steps of 5 and of 2.5 ms, to 2 mm of 660."""
    places = []
    for step in (0.005, 0.0025):
        simulation = Simulation(load_scenario("aerial_tramway", {"solver.step": step}))
        simulation.command("cabin", speed=7.0)
        places.append(simulation.advance_to(3.0).carriages["cabin"].arc_length)
    assert places[0] > 12.5
    assert places[0] == pytest.approx(places[1], abs=2e-3)


@pytest.mark.filterwarnings("ignore:cable.kinks")  # beyond what starts are quiet about
@pytest.mark.parametrize("step", [0.002, 0.01])
def test_a_heavy_load_that_rolls_gains_no_energy(step):
    """28 kN, EA F² / T³ = 5.5, on a rope without damping at 240 kN, 40 m in 4 s: no waves along the rope grow."""
    body = {"mass": 2800.0, "inertia": 100.0, "upper_pivot": [0.0, 0.6]}
    load = {"arc_length": 20.0, "speed": 10.0, "drive": {"mode": "free"}, "bodies": {"body": body}}
    rope = {"cable.mass_per_length": 9.4, "cable.damping_time": 0.0}
    simulation = loaded_rope("sharp", 4.0, **rope, **{"solver.step": step, "carriages": {"load": load}})
    energies = [simulation.advance_to(0.1 * frame) and simulation.energy().total for frame in range(1, 41)]
    moved = 0.5 * 2800.0 * 10.0**2
    assert max(energies) - energies[0] < 1e-4 * moved
    assert energies[0] - min(energies) < 5e-4 * moved  # which the solver takes


@pytest.mark.filterwarnings("ignore:cable.kinks")  # beyond what starts are quiet about
def test_a_tension_that_changes_is_followed():
    """The cabin of `single_span` from a station to the middle, where the rope has 1.3 MN, not 1.0 MN as at rest.

    On 50 elements its joint is as high as on 400, to 15 mm; with rounded kinks it is more than 0.1 m higher.
    """
    heights = {}
    for kinks, elements in (("sharp", 50), ("rounded", 50), ("sharp", 400)):
        simulation = Simulation(load_scenario("single_span", {"cable.elements": elements, "cable.kinks": kinks}))
        rest = simulation.advance_to(0.0)
        simulation.command("cabin", speed=7.0)
        seen = [simulation.advance_to(4.0 * frame) for frame in range(5, 18)]
        heights[kinks, elements] = np.array([snapshot.columns.joint_position[0, 2] for snapshot in seen])
    assert seen[-1].columns.rope_tension.mean() > 1.25 * rest.columns.rope_tension.mean()
    fine = heights["sharp", 400]
    assert np.abs(heights["sharp", 50] - fine).max() < 0.015
    assert (heights["rounded", 50] - fine).max() > 0.1


def test_a_longer_mesh_hangs_as_low_as_a_fine_one():
    """The cabin of `aerial_tramway` 60 m from the station, on 104 and on 1040 elements; rounded, it is 40 mm higher."""
    heights = {}
    for kinks, elements in (("sharp", 104), ("rounded", 104), ("sharp", 1040)):
        changes = {"cable.elements": elements, "cable.kinks": kinks, "carriages.cabin.arc_length": 60.0}
        heights[kinks, elements] = Simulation(load_scenario("aerial_tramway", changes)).state.bodies.position[0, 1]
    fine = heights["sharp", 1040]
    assert heights["sharp", 104] == pytest.approx(fine, abs=0.008)
    assert heights["rounded", 104] - fine > 0.03


def light_rope(length, mass, place=10.0, **more):
    """A body that hangs on a rope of 2 kg/m and EA of 10 MN over 100 m."""
    cable = {
        "unstrained_length": length,
        "mass_per_length": 2.0,
        "axial_stiffness": 1e7,
        "bending_stiffness": 10.0,
        "elements": 40,
        "kinks": "sharp",
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [100.0, 0.0]},
    }
    body = {"body": {"mass": mass, "inertia": 100.0, "upper_pivot": [0.0, 1.5], "drag_area": 4.0}}
    one = {"arc_length": place, "bodies": body, **more.pop("joint", {"joint": "fixed"})}
    return load_scenario({"cable": cable, "carriages": {"one": one}, "solver": {"step": 0.005}, **more})


FIXED, HELD = {"joint": "fixed"}, {"joint": "sliding", "drive": {"mode": "speed"}}
BEYOND = (
    r"cable\.kinks: given 'sharp' where 'one' may bend the rope by EA F\^2 / T\^3 = \d\d.*; measured up to 3: "
    r".*; allowed: rounded with shorter elements, a tighter rope, or less weight"
)


@pytest.mark.parametrize("space", [2, 3])
@pytest.mark.parametrize("joint", [FIXED, HELD])
def test_beyond_what_is_measured_a_start_warns_before_the_solver_fails(joint, space):
    """600 kg on a rope that is 1 m too long: from rest, without any wind, a step finds no end after some seconds."""
    scenario = light_rope(101.0, 600.0, joint=joint, space=space)
    with pytest.warns(UserWarning, match=BEYOND):
        simulation = Simulation(scenario)
    with pytest.raises(SolverError):
        simulation.advance_to(5.0)


@pytest.mark.parametrize(("length", "mass", "place"), [(99.7, 600.0, 40.0), (99.95, 200.0, 40.0), (100.2, 50.0, 40.0)])
def test_a_fixed_joint_below_that_hangs_and_swings_as_one_that_is_held(recwarn, length, mass, place):
    """EA F² / T³ of 2.4 to 2.8: nothing is said; in a gust both are in one place, and lose no energy."""
    twins = [Simulation(light_rope(length, mass, place, joint=joint)) for joint in (FIXED, HELD)]
    assert not [one for one in recwarn if "kinks" in str(one.message)]
    figures = KeyFigures(twins[0].scenario)
    for twin in twins:
        twin.wind(25.0)
    for time in np.arange(0.05, 6.0, 0.05):
        fixed, held = (twin.advance_to(time).columns for twin in twins)
        figures.update(twins[0].snapshot)
        assert_allclose(fixed.body_position, held.body_position, atol=1e-8)
    assert np.abs(fixed.body_angles).max() > 0.01
    (lost,) = [one.value for one in figures.figures() if one.name.startswith("energy lost")]
    assert lost < 1e-3


def test_a_strand_says_which_chair_is_beyond_what_is_measured(recwarn):
    """A chairlift with a third of its counterweight; empty chairs may be full, wherever they are now."""
    changes = {f"ropes.{rope}.elements": 100 for rope in ("up", "down")}
    changes |= {"sheaves.return.counterweight.mass": 12e3, "sheaves.return.counterweight.travel": [-40.0, 40.0]}
    Simulation(load_scenario("chairlift", changes))
    said = [str(one.message) for one in recwarn if "kinks" in str(one.message)]
    assert len(said) == 2
    assert said[0].startswith("ropes.up.kinks: given 'sharp' where 'chair_")


@pytest.mark.parametrize("name", ["aerial_tramway", "chairlift", "gondola", "windy_tramway"])
def test_what_is_shipped_is_within_what_is_measured(recwarn, name):
    Simulation(load_scenario(name))
    assert not [one for one in recwarn if "kinks" in str(one.message)]


def test_simulate_says_it_in_a_line_before_it_fails(tmp_path, capfd, monkeypatch):
    """As it is installed: no traceback, and no place in the code of the program."""
    file = tmp_path / "light.yaml"
    file.write_text(light_rope(101.0, 600.0).to_yaml(), encoding="utf-8")
    monkeypatch.setattr("sys.argv", ["simulate", str(file), "--duration", "5", "--record", "off"])
    assert faults_reported("simulate")(simulate)() == 1
    said = capfd.readouterr().err.splitlines()
    (number,) = [row for row, line in enumerate(said) if "given 'sharp'" in line]
    assert said[number].startswith(
        "simulate: warning: cable.kinks: given 'sharp' where 'one' may bend the rope by EA F^2"
    )
    assert any(re.match(r"simulate: step \d+ .* failed", line) for line in said[number + 1 :])
