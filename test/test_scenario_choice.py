"""Scenario on the command line, as argument and as option, alike in `sim` and `simulate`; and the list."""

from __future__ import annotations

import pytest
from twin_process import run_module

from cable_twin.offline import simulate, simulate_options
from cable_twin.ros import sim
from cable_twin.scenario import load_scenario, scenario_names

PARSERS = {"sim": sim.parser, "simulate": simulate_options.parser}


@pytest.mark.parametrize("command", PARSERS)
def test_both_forms_name_it_and_together_they_are_refused(command, capsys):
    parser = PARSERS[command]()
    for arguments, scenario in (
        ([], None),
        (["chairlift"], "chairlift"),
        (["--scenario", "chairlift"], "chairlift"),
    ):
        assert parser.given_scenario(parser.parse_args(arguments)) == scenario
    with pytest.raises(SystemExit) as ended:
        parser.given_scenario(parser.parse_args(["chairlift", "--scenario", "gondola"]))
    assert ended.value.code == (1 if command == "sim" else 2)
    (line,) = capsys.readouterr().err.splitlines()
    assert "SCENARIO: given 'chairlift' and --scenario 'gondola'; allowed: one of both" in line


def test_sim_hands_either_form_to_the_node():
    expected = ["--ros-args", "-p", 'scenario:="1e3"', "-r", "__ns:=/b"]
    for form in (["1e3"], ["--scenario", "1e3"]):
        assert sim.ros_arguments([*form, "--ros-args", "-r", "__ns:=/b"]) == expected


def test_simulate_runs_either_form(capsys):
    for form in (["seed_example"], ["--scenario", "seed_example"]):
        assert simulate.main([*form, "--duration", "0.02", "--record", "off"]) == 0
        assert "seed_example: 0.02 s in " in capsys.readouterr().out


@pytest.mark.parametrize("command", ["ros.sim", "offline.simulate"])
def test_list_has_a_line_for_each_scenario(tmp_path, command):
    result = run_module(command, "--list", directory=tmp_path)
    assert (result.returncode, result.stderr) == (0, "")
    lines = dict(line.split(maxsplit=1) for line in result.stdout.splitlines())
    assert lines == {name: load_scenario(name).description for name in scenario_names()}
    assert not list(tmp_path.iterdir())
