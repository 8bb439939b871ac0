"""Wind without effect on any rope or body: refused by every interface, with advice."""

import pytest
from test_scenario_faults import faults_of

from cable_twin.frame.records import Command, CommandError
from cable_twin.offline import line, simulate
from cable_twin.scenario import Scenario, ScenarioError, load_scenario, scenario_names, wind_unfelt
from cable_twin.simulation import Simulation
from cable_twin.simulation.command_handlers import check_gust, check_wind

REASON = "nothing feels the wind: no rope has a diameter (m) and no body a drag_area (m^2)"
CALM_LIFT = {"ropes.up.diameter": None, "ropes.down.diameter": None, "carriers.bodies.chair.drag_area": 0.0}
SMOOTH = [  # of one rope and of several, in a plane and in space
    ("seed_example", {}),
    ("seed_example", {"space": 3}),
    ("chairlift", CALM_LIFT),
    ("chairlift", {**CALM_LIFT, "space": 3}),
]


@pytest.mark.parametrize(("name", "changes"), SMOOTH)
@pytest.mark.parametrize("key", ["air.wind", "air.gusts"])
def test_a_scenario_says_so(name, changes, key):
    value = [3.0, 0.0] if key == "air.wind" else [{"time": 1.0, "amplitude": [3.0, 0.0]}]
    load_scenario(name, {**changes, "air.wind": [0.0, 0.0]})
    (fault,) = faults_of(name, {**changes, key: value})
    assert f"{key}: given" in fault
    assert REASON in fault


@pytest.mark.parametrize(("name", "changes"), SMOOTH)
def test_a_command_says_so(name, changes):
    scenario = load_scenario(name, changes)
    for kind, check in (("wind", check_wind), ("gust", check_gust), ("operating_gust", check_gust)):
        check(Command(kind, {"x": 0.0, "z": 0.0}), scenario)
        with pytest.raises(CommandError, match=kind.replace("_", " ") + ": given x 0, z -2 m/s: nothing feels the"):
            check(Command(kind, {"x": 0.0, "z": -2.0}), scenario)


@pytest.mark.parametrize(
    "felt",
    [
        {"cable.diameter": 0.003},
        {"carriages.carriage.bodies.rb2.drag_area": [0.0, 0.0, 0.1]},
        {"space": 3, "carriages.carriage.bodies.rb2.shedding": {"strouhal": 0.2, "width": 0.1, "area": 0.1}},
    ],
)
def test_one_part_that_feels_it_is_enough_and_air(felt):
    blown = {**felt, "air.wind": [3.0, 0.0]}
    assert wind_unfelt(load_scenario("seed_example", blown)) == ""
    with pytest.raises(ScenarioError, match=r"nothing feels the wind: air\.density is 0"):
        load_scenario("seed_example", {**blown, "air.density": 0.0})


@pytest.mark.parametrize("name", [name for name in scenario_names() if name not in ("seed_example", "pantograph")])
def test_the_shipped_ropeways_feel_it_and_the_reference_models_do_not(name):
    """Examples of the paper and of EN 50318 without air."""
    scenario = load_scenario(name)
    assert wind_unfelt(scenario) == ""
    cables: list[Scenario] = [scenario.of_rope(rope) for rope in scenario.cables]
    assert all(one.cable.diameter for one in cables)


@pytest.mark.parametrize(
    "arguments",
    [
        (simulate, "--sweep", "wind.x=0:60:20"),
        (simulate, "--set", "air.wind=[27.4, 0]"),
        (line, "--set", "air.wind=[27.4, 0]"),
    ],
)
def test_commands_refuse_it_before_they_run(capsys, arguments):
    module, *options = arguments
    assert module.main(["seed_example", *options]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    (fault,) = printed.err.splitlines()
    assert REASON in fault


def test_scripts_and_python_refuse_it(tmp_path, capsys):
    (tmp_path / "script.yaml").write_text("- {time: 0.01, wind: 0}\n- {time: 0.02, gust: 3}\n")
    arguments = ["seed_example", "--script", str(tmp_path / "script.yaml"), "--duration", "0.1", "--record", "off"]
    assert simulate.main(arguments) == 2
    fault = capsys.readouterr().err.splitlines()[-1]  # after what a first start says
    assert fault.startswith(f"simulate: {tmp_path / 'script.yaml'}:2: gust: given x 3")
    assert REASON in fault
    simulation = Simulation(load_scenario("seed_example"))
    with pytest.raises(CommandError, match="nothing feels the wind"):
        simulation.wind(3.0)
    simulation.wind(0.0)
