"""Non-uniform and unsteady wind: valid sections, equal bits however a run continues, and its log."""

import numpy as np
import pytest
from small_tramway import TRAMWAY
from test_scenario_faults import faults_of

from cable_twin.frame.commands import KINDS
from cable_twin.frame.records import Command, CommandError
from cable_twin.mechanics.language.compilation import as_python
from cable_twin.mechanics.on_rope.wind import share_of_gust
from cable_twin.mechanics.parameters import GUSTS
from cable_twin.offline.simulate import main
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation import Simulation
from cable_twin.simulation.command_handlers import GUST_SHAPES
from verification import JIT

TURBULENT = {"intensity": 0.2, "length_scale": 40.0, "seed": 3, "points": 8}
WINDY = {
    "space": 3,
    "air.wind": [2.0, 9.0, 0.0],
    "air.profile": {"exponent": 0.2},
    "air.turbulence": TURBULENT,
    "air.gusts": [{"time": 0.4, "amplitude": [0.0, 6.0, 0.0], "duration": 1.5}],
    "carriages.cabin.bodies.cabin.drag_area": [2.0, 5.0, 1.0],
    "carriages.cabin.bodies.cabin.shedding": {"width": 2.0, "area": 6.0},
}


def windy(**changes):
    return load_scenario(TRAMWAY, WINDY | changes)


def ride(simulation, *times):
    """Two seconds with wind and gust commands, and snapshots at given times."""
    for time in sorted({*times, 0.8, 1.9}):
        simulation.advance_to(time)
        if time == 0.8:
            simulation.wind(1.0, 0.5, 12.0)
        if time == 1.9:
            simulation.apply(Command("operating_gust", {"x": 0.0, "z": 0.0, "y": 4.0, "duration": 2.0}))
    return simulation.advance_to(2.5)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_the_same_bits_whatever_the_pacing_after_a_reset_and_from_a_file(tmp_path):
    whole = Simulation(windy())
    expected = ride(whole)
    assert ride(Simulation(windy()), 0.105, 0.3, 1.0, 2.0).numbers.tobytes() == expected.numbers.tobytes()
    assert np.abs(whole.state.wind_field.points).max() > 0.5
    halted = Simulation(windy())
    halted.advance_to(0.8)
    halted.wind(1.0, 0.5, 12.0)
    halted.advance_to(1.5)
    halted.save(tmp_path / "state.npz")
    loaded = Simulation.load(tmp_path / "state.npz")
    loaded.advance_to(1.9)
    loaded.apply(Command("operating_gust", {"x": 0.0, "z": 0.0, "y": 4.0, "duration": 2.0}))
    assert loaded.advance_to(2.5).numbers.tobytes() == expected.numbers.tobytes()
    whole.reset()  # the wind begins anew, too
    start = whole.time
    again = whole.advance_to(start + 0.5).carriages["cabin"].bodies["cabin"]
    first = Simulation(windy()).advance_to(0.5).carriages["cabin"].bodies["cabin"]
    np.testing.assert_array_equal(again.position, first.position)


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize("space", [2, 3])
def test_a_log_of_it_replays_to_the_last_bit(tmp_path, replayed, space):
    scenario = windy() if space == 3 else load_scenario(TRAMWAY, {"air.wind": [9.0, 0.0], "air.turbulence": TURBULENT})
    (tmp_path / "windy.yaml").write_text(scenario.to_yaml())
    (tmp_path / "script.yaml").write_text("- {time: 0.3, wind: 11}\n- {time: 0.5, gust: 4, gust_duration: 0.7}\n")
    arguments = ("--script", str(tmp_path / "script.yaml"), "--duration", "1.5", "--record", "bag")
    assert main([str(tmp_path / "windy.yaml"), *arguments, "--output", str(tmp_path / "logs")]) == 0
    (run,) = (tmp_path / "logs").iterdir()
    replayed(run)


def test_turbulence_comes_from_its_seed():
    tables = [build_system(windy(**{"air.turbulence.seed": seed})).air.wind.turbulence for seed in (3, 3, 4)]
    np.testing.assert_array_equal(tables[0], tables[1])
    assert np.abs(tables[0] - tables[2]).max() > 1.0
    assert not build_system(load_scenario(TRAMWAY)).air.varies


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"air.wind": [80.0, 70.0, 0.0]}, "air.wind: given [80.0, 70.0, 0.0] m/s: a speed of 106.3 m/s; allowed: at m"),
        (
            {"space": 2},
            "air.wind: given [2.0, 9.0, 0.0] m/s: three numbers in a plane; allowed: x, z in m/s; x, y, z only",
        ),
        ({"air.gusts": [{"time": 1.0, "amplitude": [0.0, 120.0, 0.0]}]}, "air.gusts.0.amplitude: given [0.0, 120.0,"),
        ({"air.gusts": [{"time": 1.0}]}, "air.gusts.0.amplitude: given nothing: it is needed; allowed: a list"),
        ({"air.gusts": [{"time": -1.0, "amplitude": [1.0, 0.0]}]}, "air.gusts.0.time: given -1.0 s; allowed: a finite"),
        ({"air.turbulence.length_scale": -4.0}, "length_scale: given -4.0 m; allowed: a finite number above 0, in m"),
        ({"air.turbulence.intensity": 2.0}, "intensity: given 2.0; allowed: a finite number at least 0 and at most 1"),
        ({"air.turbulence.spectrum": "white"}, "spectrum: given 'white'; allowed: one of kaimal, von_karman"),
        ({"air.turbulence.points": 0}, "points: given 0; allowed: a whole number at least 1 and at most 200"),
        ({"air.profile.exponent": -0.1}, "exponent: given -0.1; allowed: a finite number above 0 and at most 1"),
        ({"air.profile.reference_height": 0.0}, "reference_height: given 0.0 m; allowed: a finite number above 0, in"),
        (
            {"carriages.cabin.bodies.cabin.drag_area": [1.0, -2.0, 1.0]},
            "drag_area: given [1.0, -2.0, 1.0] m^2; allowed",
        ),
        ({"carriages.cabin.bodies.cabin.drag_area": "much"}, "drag_area: given 'much'; allowed: a finite number at le"),
        ({"carriages.cabin.bodies.cabin.shedding.width": 0.0}, "shedding.width: given 0.0 m; allowed: a finite number"),
    ],
)
def test_a_wind_that_is_none_is_one_line(changes, said):
    faults = faults_of(TRAMWAY, WINDY | changes)
    assert sum(said in fault for fault in faults) == 1, faults


def test_eddies_in_a_plane_are_one_line():
    (fault,) = faults_of(TRAMWAY, {"carriages.cabin.bodies.cabin.shedding": {"width": 2.0, "area": 6.0}})
    assert "carriages.cabin.bodies.cabin.shedding: given a mapping: in a plane, to which its force is perpendi" in fault


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_gusts_that_are_refused():
    simulation = Simulation(load_scenario(TRAMWAY))
    for values, said in (
        ({"x": 120.0, "z": 0.0}, "gust x: given 120 m/s; allowed: -100 to 100 m/s"),
        ({"x": 1.0, "z": 0.0, "y": 2.0}, "gust y: given 2 m/s; allowed: 0 m/s, as the twin moves in the plane"),
        ({"x": 1.0, "z": 0.0, "duration": -1.0}, "gust duration: given -1 s; allowed: more than 0 to 600 s"),
        ({"x": 1.0}, "gust: given x; allowed: x, z or x, y, z, m/s"),
    ):
        with pytest.raises(CommandError, match=said):
            simulation.apply(Command("gust", values))
    simulation.gust(5.0, duration=2.0)
    simulation.advance_to(0.5)
    with pytest.raises(CommandError, match=r"gust: given while another one lasts; allowed: in 1\.5 s"):
        simulation.gust(5.0)
    simulation.advance_to(2.0)
    simulation.gust(5.0)


def test_each_shape_of_a_gust_is_another_one_and_commands_blow_them():
    shares = [
        [as_python(share_of_gust)((5.0, 0.0, 0.0, 0.0, 10.0, shape), time) for time in (2.0, 4.0)]
        for shape in range(len(GUSTS))
    ]
    assert len({tuple(share) for share in shares}) == len(GUSTS)
    assert set(GUST_SHAPES.values()) <= set(GUSTS)
    assert GUST_SHAPES.keys() <= KINDS.keys()
