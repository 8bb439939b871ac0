"""Static line calculation: an equilibrium at each place, the envelope of all, a finer mesh, profiles for CAD."""

from __future__ import annotations

import csv
import json
import re

import numpy as np
import pytest
from named_figures import named
from rich.console import Console
from ruamel.yaml import YAML
from test_jig_back import QUICK

from cable_twin.offline import line as line_command
from cable_twin.offline import review, simulate, simulate_options
from cable_twin.offline.check import refined
from cable_twin.offline.line import main
from cable_twin.offline.lines.at_rest import calculate, plan_line
from cable_twin.scenario import build_system, load_scenario
from cable_twin.simulation import Simulation

pytest.importorskip("matplotlib")
import matplotlib.pyplot as plt

from cable_twin.offline.lines.plot import (
    _clearance,
    _profile,
    _towers,
    tension_envelope,
    tension_limits,
    write_line_plot,
)

SPAN = {  # a level span, pinned at both ends
    "cable": {
        "unstrained_length": 400.4,
        "mass_per_length": 1e-3,
        "axial_stiffness": 1e8,
        "bending_stiffness": 100.0,
        "elements": 200,
        "start": {"position": [0.0, 0.0]},
        "end": {"position": [400.0, 0.0]},
    },
    "carriages": {
        "car": {"arc_length": 100.0, "bodies": {"car": {"mass": 100.0, "inertia": 1.0, "upper_pivot": [0.0, 0.0]}}}
    },
}


def test_a_vehicle_goes_up_to_another_one_on_its_rope():
    """It cannot pass it, and a line at its places next to the other one is found."""
    size = {"size": [4.0, 2.0], "mass": 100.0, "inertia": 1.0, "upper_pivot": [0.0, 0.0]}
    cars = {name: {"arc_length": at, "bodies": {"car": size}} for name, at in (("car", 100.0), ("other", 250.0))}
    both = load_scenario({**SPAN, "carriages": cars})
    line = plan_line(both, 2, None)
    assert line.places == pytest.approx([0.005 * 400.4, 250.0 - 4.0], abs=1e-4)
    calculate(line)
    assert plan_line(both, 2, "other").places == pytest.approx([104.0, 0.995 * 400.4], abs=1e-4)


def test_a_load_on_a_light_rope_makes_a_triangle():
    """Vertical end forces as of a beam; pull along the track from weight over sag."""
    line = plan_line(load_scenario(SPAN), 9, None)
    done = []
    calculate(line, lambda: done.append(None))
    assert len(done) == len(line.columns) == 9
    weight = 100.0 * 9.81
    cars = np.array([columns.joint_position[0] for columns in line.columns])
    sides = 1.0 - cars[:, 0] / 400.0, cars[:, 0] / 400.0
    for end, share in zip(("start", "end"), sides, strict=True):
        np.testing.assert_allclose(line.rows[f"{end}: load downwards [N]"], weight * share, rtol=0.0, atol=3.0)
    along = line.rows["start: load along the track [N]"]
    pull = weight * cars[:, 0] * (1.0 - cars[:, 0] / 400.0) / -cars[:, 2]
    # two metres from an end, on elements of two metres, the kink is no triangle's
    np.testing.assert_allclose(along[1:-1], pull[1:-1], rtol=5e-3)
    sag = line.rows["sag below the chord [m]"]
    envelope = next(figure for figure in line.figures if figure.name == "sag below the chord")
    assert envelope.value == sag.max()
    assert envelope.time == line.places[sag.argmax()] == pytest.approx(200.2)


def test_loads_across_the_track_are_in_the_rows_in_space():
    """Wind on a car between two ends, which bear it as a beam's; none in a plane."""
    ends = {f"cable.{end}.position": [x, 0.0, 0.0] for end, x in (("start", 0.0), ("end", 400.0))}
    bodies = {"car": {"mass": 100.0, "inertia": 1.0, "upper_pivot": [0.0, 0.0], "drag_area": 2.0}}
    wind = {"air.wind": [0.0, 10.0, 0.0], "carriages.car.bodies": bodies}
    line = plan_line(load_scenario(SPAN, {**ends, **wind}), 3, None)
    calculate(line)
    force, place = 0.5 * 1.225 * 2.0 * 10.0**2, line.columns[1].joint_position[0, 0]
    for end, share in (("start", 1.0 - place / 400.0), ("end", place / 400.0)):
        assert line.rows[f"{end}: load to the left [N]"][1] == pytest.approx(force * share, rel=1e-2)
    flat = plan_line(load_scenario(SPAN), 2, None)
    calculate(flat)
    assert not [name for name in flat.rows if "left" in name]


def test_every_place_is_a_rest_of_its_own():
    scenario = load_scenario("aerial_tramway")
    line = plan_line(scenario, 4, "cabin")
    calculate(line)
    there = Simulation(load_scenario("aerial_tramway", {"carriages.cabin.arc_length": line.places[2]})).snapshot
    assert line.rows["cabin: haul force [N]"][2] == pytest.approx(there.carriages["cabin"].haul_rope.force)
    x, _, z = there.supports["tower"].force
    assert line.rows["tower: load along the track [N]"][2] == -x
    assert line.rows["tower: load downwards [N]"][2] == z
    names = [figure.name for figure in line.figures]
    assert not [name for name in names if "power" in name or "drive force" in name or "acceleration" in name]


def test_carriers_go_by_one_spacing():
    scenario = load_scenario("gondola")
    line = plan_line(scenario, 3, None)
    calculate(line)
    spacing = scenario.loop_length / 20
    np.testing.assert_allclose(line.places, np.array([0.0, 1.0, 2.0]) * spacing / 3.0)
    up = [columns.arc_length[(columns.attached > 0.0) & (columns.vehicle_rope == 0.0)] for columns in line.columns]
    np.testing.assert_allclose(
        [places.min() for places in up], np.array([0.5, 0.5 + 1.0 / 3.0, 1.0 / 6.0]) * spacing, rtol=1e-3
    )  # it hangs in rope that is stretched


def test_what_a_haul_rope_pulls_goes_together_by_the_travel_of_its_drive():
    line = plan_line(load_scenario("jig_back"), 3, None)
    assert (line.moved, line.places.tolist()) == ("haul_rope", [0.0, 506.0, 1012.0])
    assert plan_line(line.scenario, 3, "cabin_2").moved == "haul_rope"
    calculate(line)
    assert line.places == pytest.approx([0.0, 506.0, 507.4, 1012.0], abs=0.3)  # and where the cabins pass each other
    places = np.array([columns.arc_length for columns in line.columns])[[0, 1, 3]]
    np.testing.assert_allclose(places[:, 0], [14.0, 520.0, 1026.0], rtol=0.0, atol=1.5)  # the haul rope gives way
    np.testing.assert_allclose(places[:, 1], [1028.0, 522.0, 16.0], rtol=0.0, atol=3.0)
    cabins = np.array([columns.joint_position[:, 2] for columns in line.columns])
    assert np.all(np.diff(cabins, axis=0) * [1.0, -1.0] > 0.0)  # one up, one down
    limits = tension_limits(line)  # kN, each with the ropes whose limit it is
    assert list(limits) == pytest.approx([5200.0 / 3.15, 760.0 / 4.5])
    assert list(limits.values()) == ["safety factor of 3.15, track_1, track_2", "safety factor of 4.5, haul_1, haul_2"]
    _, axes = plt.subplots()
    _clearance(axes, line)
    shown = [text.get_text() for text in axes.get_legend().get_texts()]
    ropes = [f"{name}: rope" for name in ("track_1", "track_2", "haul_1", "haul_2")]
    assert shown == [*ropes, "cabin_1", "cabin_2", "limit"]
    assert axes.get_xlabel() == "x, along the track [m]"
    drawn = {one.get_label(): one for one in axes.get_lines()}
    for name in ("track_1", "haul_2"):  # the lowest that is drawn is the figure
        lowest = np.nanmin(drawn[f"{name}: rope"].get_ydata())
        assert lowest == pytest.approx(line.rows[f"{name}: rope clearance over the terrain [m]"].min(), abs=0.3)
    for name in ("cabin_1", "cabin_2"):
        assert np.ptp(drawn[name].get_xdata()) > 900.0
        assert np.min(drawn[name].get_ydata()) == line.rows[f"{name}: clearance over the terrain [m]"].min()
    plt.close()
    with pytest.raises(ValueError, match="--vehicle: given 'cabin_3'; allowed: haul_rope"):
        plan_line(line.scenario, 3, "cabin_3")


HOLD_DOWN = {"rollers": {"position": [200.0, -7.8], "contacts": 2, "length": 1.0, "hold_down": True}}


MAST = {"towers.tower.mast_offset": 3.0, "towers.tower.mast_width": 1.0, "air.wind": [0.0, 10.0, 0.0]}


@pytest.mark.parametrize(
    ("name", "changes", "quantity"),
    [
        ("windy_tramway", MAST, "tower_clearance"),
        ("jig_back", QUICK, "vehicle_separation"),
        ("chairlift", {"space": 3}, "vehicle_separation"),
    ],
)
def test_clearances_are_those_of_passing_with_any_number_of_places(name, changes, quantity):
    """Formerly at the given places alone: 48 m along the track to a mast was kept, jig-backs met with odd numbers."""
    found = []
    for count in (2, 5):
        line = plan_line(load_scenario(name, changes), count, None)
        calculate(line, rows=False)
        assert np.all(np.diff(line.places) > 0.1)  # as often as clearances are looked at
        found.append(min(one.value for one in line.figures if one.id.quantity == quantity))
    assert found[0] == pytest.approx(found[1], abs=0.02)
    assert found[0] < 7.0


@pytest.mark.parametrize("space", [2, 3])
def test_a_hold_down_in_the_air_is_told(space):
    """Hold-down tower on which the bare rope lies and from which a load at mid-span lifts it."""
    line = plan_line(load_scenario({**SPAN, "space": space, "towers": HOLD_DOWN}), 3, None)
    calculate(line)
    found = {figure.name: figure for figure in line.figures}
    margin = found["rollers: deropement margin, load over that at rest"]
    assert (margin.value, margin.kept, margin.place, margin.time) == (0.0, False, "does not touch", line.places[1])
    roller = found["rollers: load of a roller, lowest"]
    assert (roller.value, roller.unit, roller.limit, roller.kept, roller.time) == (
        0.0,
        "N",
        500.0,
        False,
        line.places[1],
    )
    at_ends = line.rows["rollers: load of a roller, lowest [N]"][[0, 2]]
    loads = np.array([line.rows[f"rollers: load {part} [N]"][[0, 2]] for part in ("along the track", "downwards")])
    np.testing.assert_allclose(at_ends, 0.5 * np.linalg.norm(loads, axis=0), rtol=0.05)


@pytest.mark.parametrize("space", [2, 3])
def test_a_hold_down_of_a_strand_in_the_air_is_told(space):
    changes = {"towers.tower_2.hold_down": True, "towers.tower_2.position": [150.0, 28.0], "space": space}
    line = plan_line(load_scenario("chairlift", changes), 2, None)
    calculate(line)
    found = {figure.name: figure for figure in line.figures}
    margins = [name for name in found if "deropement" in name]
    assert margins == ["tower_2_up: deropement margin, load over that at rest"]
    assert found[margins[0]].kept is False
    loads = [found[f"tower_2_{strand}: load of a roller, lowest"] for strand in ("up", "down")]
    assert loads[0].value == 0.0
    assert 300.0 < loads[1].value < 500.0
    assert not any(one.kept for one in loads)


def test_the_command_writes_table_files_and_picture(tmp_path, capsys):
    files = {name: tmp_path / f"line.{name}" for name in ("csv", "json", "png")}
    arguments = ["aerial_tramway", "--places", "3", "--csv", str(files["csv"]), "--json", str(files["json"])]
    assert main([*arguments, "--plot", str(files["png"])]) == 0
    printed = capsys.readouterr().out
    assert "aerial_tramway at rest, cabin at 3 places" in printed
    for shown in ("rope safety factor", "at least 3.15", "tower: load along the track, highest", "cabin: haul force"):
        assert shown in printed
    assert "frames" not in printed
    content = json.loads(files["json"].read_text())
    rows = list(csv.reader(files["csv"].open()))
    assert rows[0] == content["columns"]
    assert [[float(value) for value in row] for row in rows[1:]] == content["rows"]
    factor = next(one for one in content["envelope"] if one["name"] == "rope safety factor")
    assert factor["kept"] is True
    assert factor["value"] == min(row[rows[0].index("rope safety factor [-]")] for row in content["rows"])
    assert files["png"].read_bytes().startswith(b"\x89PNG")


def test_what_a_finer_mesh_changes_stands_beside_each_figure(tmp_path, capsys):
    """Almost no change of the sag of a light rope; no verdict within the uncertainty of a limit."""
    path, scenario = tmp_path / "line.json", tmp_path / "span.yaml"
    with scenario.open("w") as file:
        YAML(typ="safe").dump({**SPAN, "cable": SPAN["cable"] | {"joint": "paper"}, "limits": {"sag": 8.9}}, file)
    assert main([str(scenario), "--places", "3", "--check", "--json", str(path)]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"sag below the chord .* ± 0\.", printed)
    envelope = {one["name"]: one for one in json.loads(path.read_text())["envelope"]}
    sag = envelope["sag below the chord"]
    finer = plan_line(refined(load_scenario(str(scenario))), 3, None)
    calculate(finer)
    assert sag["uncertainty"] == pytest.approx(abs(finer.rows["sag below the chord [m]"].max() - sag["value"]))
    assert sag["uncertainty"] > 0.0


def test_limits_that_are_not_kept_stand_below_the_table(capsys):
    changes = ("--set", "limits.swing=0.3", "--set", "limits.support_load=1000", "--set", "limits.sag=3")
    assert main(["single_span", "--places", "2", *changes]) == 0
    lines = capsys.readouterr().out.splitlines()
    (head,) = [number for number, line in enumerate(lines) if re.match(r"\d of \d+ limits are not kept:", line)]
    below = [line for line in lines[head + 1 :] if line.startswith("  ")]
    assert lines[head + 1 + len(below)] == "not judged: limits.rope_safety_factor: cable.breaking_force is not given"
    assert int(lines[head][0]) == len(below) >= 3
    sag = [line for line in below if line.startswith("  sag below the chord: not kept: ")]
    assert ", at most 3 m, cabin at " in sag[0]
    assert not any(" not kept" in line for line in lines[head + 1 + len(below) :])
    assert main(["single_span", "--places", "2", "--set", "limits.tension_per_transverse_load=2"]) == 0
    assert re.fullmatch(r"all \d+ limits are kept", capsys.readouterr().out.splitlines()[-2])


def test_a_line_in_the_wind_is_drawn_from_above_too(tmp_path):
    """Additional panel with the lateral deflection, wind over weight for a level rope."""
    drag = 0.5 * 1.225 * 1.2 * 0.05 * 20.0**2  # N/m
    changes = {"space": 3, "cable.diameter": 0.05, "cable.mass_per_length": 3.0, "carriages.car.arc_length": 3.0}
    heights = {}
    for wind in (0.0, 20.0):
        line = plan_line(load_scenario(SPAN, {**changes, "air.wind": [0.0, wind, 0.0]}), 2, None)
        calculate(line)
        write_line_plot(line, tmp_path / "line.png")
        heights[wind] = plt.imread(tmp_path / "line.png").shape[0]
        rope = line.columns[0].rope_position
        middle = rope[len(rope) // 2]
    assert heights[20.0] > 1.2 * heights[0.0]
    assert middle[1] / -middle[2] == pytest.approx(drag / (3.0 * 9.81), rel=0.05)


def test_a_line_without_a_vehicle_has_its_loads_over_its_towers():
    """Formerly an empty panel over `arc length of  [m]`, and masts of 15 m below wires with a sag of 1 m."""
    towers = {f"support_{x}": {"position": [1.0 * x, 0.0], "kind": "saddle"} for x in (100, 200, 300)}
    cable = SPAN["cable"] | {"mass_per_length": 1.0, "unstrained_length": 400.0}
    line = plan_line(load_scenario({"cable": cable, "towers": towers}), 4, None)
    calculate(line)
    _, (profile, loads) = plt.subplots(2)
    _profile(profile, line)
    _towers(loads, line)
    down = [one for one in loads.get_lines() if one.get_marker() == "_" and len(one.get_xdata())]
    assert loads.get_xlabel() == "x, along the track [m]"
    assert [one.get_xdata().tolist() for one in down] == [[100.0] * 2, [200.0] * 2, [300.0] * 2]
    for name, one in zip(towers, down, strict=True):
        assert one.get_ydata() == pytest.approx(1e-3 * line.rows[f"{name}: load downwards [N]"][0])
    heights = np.concatenate([one.get_ydata() for one in profile.get_lines()])
    assert np.ptp(heights) < 1.5 * np.ptp(line.columns[0].rope_position[:, 2])
    plt.close()


def test_many_towers_have_the_range_of_their_loads_above_their_places():
    """Bars in the colour of their rope, instead of two lines for each tower in neighbouring shades."""
    line = plan_line(load_scenario("gondola"), 3, None)
    calculate(line)
    _, axes = plt.subplots()
    _towers(axes, line)
    assert [one.get_text() for one in axes.get_legend().get_texts()] == ["up", "down", "downwards", "along the track"]
    bars = [one for one in axes.get_lines() if one.get_marker() == "_" and len(one.get_xdata())]
    places = line.scenario.tower_places
    for tower, bar in zip(line.scenario.of_rope("up").towers, bars, strict=False):
        loads = 1e-3 * line.rows[f"{tower}: load downwards [N]"]
        assert bar.get_xdata()[0] == places[tower][0]
        assert bar.get_ydata() == pytest.approx([loads.min(), loads.max()])
    assert len({one.get_color() for one in bars}) == 2
    plt.close()


def test_on_a_narrow_terminal_each_place_says_whose_it_is(monkeypatch, capsys):
    monkeypatch.setattr(line_command, "table_console", lambda: Console(width=80))
    assert main(["single_span", "--places", "2"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 80
    assert sum(" cabin at " in line for line in lines) > 10


def test_what_draws_is_asked_for_before_anything_runs(monkeypatch, refusal, tmp_path):
    monkeypatch.setattr(simulate_options, "find_spec", lambda _: None)
    for command, *arguments in (
        (main, "aerial_tramway", "--plot", "line.png"),
        (simulate.main, "aerial_tramway", "--sweep", "air.wind=0:1:1", "--plot", "sweep.png"),
        (review.main, str(tmp_path), "--plots", str(tmp_path)),
    ):
        line = refusal(command, *arguments)
        assert re.search(r"--plots? needs matplotlib, which this Python does not have: \S*pip install matplotlib", line)


def test_what_is_for_programs_is_alone_on_the_output(capsys):
    assert main(["single_span", "--places", "2", "--csv", "-"]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith('place [m],"rope tension, highest [N]"')
    assert len(printed.out.splitlines()) == 3
    assert "single_span at rest" in printed.err


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["aerial_tramway", "--vehicle", "bus"], 2, "line: --vehicle: given 'bus'; allowed: cabin"),
        (["gondola", "--vehicle", "cabin_3"], 2, "allowed: cabin"),
        (["no_such"], 2, "no_such"),
        (["--places", "1"], 2, "argument --places: given '1'; allowed: a whole number from 2 to 2000"),
        (["--places", "2001"], 2, "--places: given '2001'"),
        (["--places", "many"], 2, "--places: given 'many'"),
        (["aerial_tramway", "--places", "2", "--csv", "/nowhere/line.csv"], 1, "line: /nowhere/line.csv: No such file"),
        (["aerial_tramway", "--places", "2", "--plot", "/tmp/line.nothing"], 2, "--plot: given /tmp/line.nothing;"),
        (
            ["aerial_tramway", "--places", "2", "--set", "carriages.cabin.drive.haul_rope.pretension=0",
             "--set", "carriages.cabin.drive.haul_rope.station=start"],
            1,
            "line: cabin at 3.0 m: carriages.cabin.drive.haul_rope: given one that would have to push with",
        ),
    ],
)  # fmt: skip
def test_what_is_wrong_is_a_line(arguments, code, words, refusal):
    assert words in refusal(main, *arguments, code=code)


@pytest.mark.long
def test_the_envelope_of_a_haul_rope_has_no_steps_where_cabins_stood():
    """Tension jumps at the clamps of calculated places, formerly steps of 6 kN in the envelope."""
    line = plan_line(load_scenario("jig_back", QUICK), 5, None)
    calculate(line)
    layout = Simulation(line.scenario).layout
    envelopes = tension_envelope(line, np.array([columns.rope_tension for columns in line.columns]))
    for rope, start in (("haul_1", 30.0), ("haul_2", 30.0)):
        part = layout.ropes[rope]
        inner = (layout.arc_lengths[part] > start + 10.0) & (layout.arc_lengths[part] < 1030.0)
        for tensions in envelopes:
            assert np.abs(np.diff(tensions[part][inner])).max() < 700.0, rope


@pytest.mark.parametrize(
    ("value", "uncertainty", "verdict"),
    [
        (1.4, None, "kept"),
        (1.4, 0.05, "kept"),
        (1.4, 0.2, "not decided"),
        (1.6, 0.2, "not decided"),
        (1.8, 0.2, "not kept"),
        (1.5, 0.0, "kept"),  # on its limit, as a drive keeps a speed
    ],
)
def test_a_verdict_within_its_own_uncertainty_is_none(value, uncertainty, verdict):
    figure = named("acceleration", value, "m/s^2", 1.0, limit=1.5, uncertainty=uncertainty)
    assert figure.verdict == verdict
    assert named("acceleration", value, "m/s^2", 1.0, uncertainty=uncertainty).verdict == ""


@pytest.mark.parametrize("elements", [40, {"target": 20.0, "at_towers": 5.0, "growth": 1.44}])
def test_elements_and_steps_are_halved_everywhere(elements):
    coarse = load_scenario("aerial_tramway", {"cable.elements": elements})
    fine = refined(coarse)
    counts = [build_system(one).cable.element_count for one in (coarse, fine)]
    assert counts[1] == pytest.approx(2 * counts[0], rel=0.05)
    assert fine.solver.step == 0.5 * coarse.solver.step


def test_simulate_says_how_sure_its_figures_are(capsys):
    arguments = ["seed_example", "--duration", "0.2", "--record", "off", "--set", "limits.swing=3.0", "--check"]
    assert simulate.main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    (swing,) = (line for line in lines if "swing along the track" in line)
    assert "kept, ± " in swing
    assert any("rope tension, highest" in line and "± " in line for line in lines)


def test_a_state_is_of_one_mesh(capsys):
    assert simulate.main(["--snapshot", "state.npz", "--check"]) == 2
    assert "--check: given with a snapshot" in capsys.readouterr().err


def test_profile_and_clearance_are_those_of_the_line_in_csv_and_dxf(tmp_path):
    files = [tmp_path / f"profile.{kind}" for kind in ("csv", "dxf")]
    for file in files:
        assert main(["aerial_tramway", "--places", "2", "--profile", str(file)]) == 0
    with files[0].open() as file:
        rows = list(csv.DictReader(file))
    rope = [row for row in rows if row["what"] == "rope"]
    assert float(rope[0]["x [m]"]) == pytest.approx(0.0, abs=3.0)
    heights = {float(row["x [m]"]): float(row["clearance [m]"]) for row in rope}
    assert min(heights.values()) == pytest.approx(13.0, abs=3.0)
    assert [row["x [m]"] for row in rows if row["what"] == "tower"] == ["400.0"]
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.readfile(files[1])
    assert not drawing.audit().errors
    lines = {one.dxf.layer: one for one in drawing.modelspace().query("LWPOLYLINE")}
    assert set(lines) == {"TERRAIN", "ROPE_CABLE_LOWEST", "ROPE_CABLE_HIGHEST"}
    assert lines["TERRAIN"].get_points("xy")[0] == (-30.0, -14.0)
    drawn = dict(lines["ROPE_CABLE_LOWEST"].get_points("xy"))
    assert [round(z, 4) for z in drawn.values()] == pytest.approx([float(row["z [m]"]) for row in rope])


def test_a_wrong_name_is_a_line(capsys):
    assert main(["--profile", "line.dwg"]) == 2
    assert "--profile: given 'line.dwg'; allowed: a file that ends with .csv or .dxf" in capsys.readouterr().err
