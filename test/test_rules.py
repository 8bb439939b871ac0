"""Rule profiles: schema and faults, verdicts of hand-made figures, shipped documents, and real runs."""

from __future__ import annotations

import re
from copy import deepcopy
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from cable_twin.basics.limited_yaml import as_yaml
from cable_twin.basics.units import counted
from cable_twin.key_figures import QUANTITIES, KeyFigures, Subject, figure, not_judged
from cable_twin.key_figures.rules import RuleError, counts_text, judge, load_profile, profiles_of
from cable_twin.key_figures.rules.conditions import REVERSIBLE
from cable_twin.key_figures.rules.derived import derived_figures
from cable_twin.key_figures.rules.document import counts_of
from cable_twin.key_figures.rules.subjects import ROLES
from cable_twin.key_figures.rules.verdicts import sentence
from cable_twin.offline.rules import markdown, reasons
from cable_twin.offline.verdict_table import print_verdicts
from cable_twin.runtime.watches import FigureWatch
from cable_twin.scenario import ScenarioError, load_scenario
from cable_twin.scenario.checks.limits import profile_names
from cable_twin.simulation import Simulation

PAGE = Path(__file__).resolve().parents[1] / "docs" / "rules.md"
CHECK = {
    "clause": "1",
    "text": "speed of the drive",
    "quantity": "speed/drives/highest",
    "comparison": "at most",
    "limit": 2.0,
    "unit": "m/s",
}
DOCUMENT = {
    "document": "a rule book",
    "jurisdiction": "test",
    "edition": "first",
    "systems": ["monocable"],
    "carries": "both",
    "load_cases": {"storm": "a storm"},
    "checks": {"A-1": CHECK},
}


def profile(directory, name="own", **changes):
    """Profile in a file, with changes of its one check, None for a key that is left out."""
    document = deepcopy(DOCUMENT)
    check = document["checks"]["A-1"] | changes
    document["checks"]["A-1"] = {key: value for key, value in check.items() if value is not None}
    file = directory / f"{name}.yaml"
    file.write_text(as_yaml(document), encoding="utf-8")
    return str(file)


def verdict(directory, value, changes=(), uncertainty=None, **check):
    """Verdict on one speed of the drive of a chairlift."""
    scenario = load_scenario("chairlift", dict(changes))
    one = figure("speed", Subject("drives.haul_rope", "haul_rope"), "highest", value, 1.0)
    load_profile.cache_clear()
    found = [load_profile(profile(directory, **check))]
    return judge(scenario, [replace(one, uncertainty=uncertainty)], found)[0]


def test_shipped_documents_are_valid_and_counted_as_the_page_has_them():
    documents = [load_profile(name).document for name in profile_names()]
    for table in (markdown(), reasons()):
        assert "\n".join(table) in PAGE.read_text(encoding="utf-8")
    for document in documents:
        for name, check in document.checks.items():
            assert check.clause, name
            assert check.quantity or check.judged_in or check.not_decidable, name
    assert sum(counts_of(document).decided for document in documents) >= 60


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"unit": None}, "checks.A-1.unit: given nothing: it is needed; allowed: a text"),
        (
            {"quantity": "sped/drives/highest"},
            "given 'sped/drives/highest': unknown quantity; allowed: did you",
        ),
        ({"quantity": "speed/wheels/highest"}, "allowed: speed/ROLE/highest, with ROLE one of ropes, track_ropes"),
        ({"unit": "km/h"}, "checks.A-1.unit: given 'km/h': speed is in m/s; allowed: m/s"),
        ({"limit": None}, "checks.A-1.limit: given nothing; allowed: a number, a formula, or a list of cases"),
        ({"limit": "2 * sped"}, "given '2 * sped': unknown variable sped; allowed: haul_ropes,"),
        ({"limit": "open('x')"}, "not a valid formula; allowed: a number, or a formula with + - * /"),
        ({"limit": [2.0]}, "allowed: a number, a formula, or a list of cases"),
        ({"comparison": "within", "limit": [2.0, 1.0]}, "given [2.0, 1.0]: nothing can be within it; allowed: the l"),
        ({"comparison": "under"}, "given 'under'; allowed: one of at most, at least, below, above, within"),
        ({"when": {"grip": "fixd"}}, "checks.A-1.when.grip: given 'fixd'; allowed: fixed, detachable"),
        ({"when": {"colour": "red"}}, "no such fact; allowed: carries, existing,"),
        ({"load_case": "flood"}, "checks.A-1.load_case: given 'flood'; allowed: storm"),
        (
            {"not_decidable": "no"},
            "given 'quantity and not_decidable'; allowed: one of quantity, judged_in",
        ),
        ({"systems": ["lift"]}, "allowed: a list of some of reversible_bicable, circulating_bicable, monocable"),
        ({"sourc": "x"}, "checks.A-1.sourc: this key does not exist"),
    ],
)
def test_faults_of_a_profile_are_a_line_each(tmp_path, changes, told):
    file = profile(tmp_path, **changes)
    load_profile.cache_clear()
    with pytest.raises(RuleError) as error:
        load_profile(file)
    (line,) = str(error.value).splitlines()
    assert line.startswith(f"{file}: ")
    assert told in line


def test_profiles_that_contradict_are_refused(tmp_path):
    goods = as_yaml(DOCUMENT | {"carries": "goods"})
    (tmp_path / "goods.yaml").write_text(goods, encoding="utf-8")
    checks = {"A-1": CHECK, "A-2": CHECK | {"comparison": "at least", "limit": 3.0}}
    (tmp_path / "both.yaml").write_text(as_yaml(DOCUMENT | {"checks": checks}), encoding="utf-8")
    goods_and_persons = (str(tmp_path / "goods.yaml"), "france_1985")
    with pytest.raises(RuleError, match=r"^limits\.profile: given goods, france_1985: goods is for goods alone and fr"):
        profiles_of(load_scenario("jig_back"), goods_and_persons)
    with pytest.raises(RuleError, match=r"A-1\.limit: given 2\.0: contradicts A-2, at least 3 m/s; allowed: at l"):
        load_profile(str(tmp_path / "both.yaml"))
    for key, value, told in (
        ("profile", ["france_1985", "france_1985"], r"given 'france_1985': given twice; allowed: each profile once"),
        ("profile", ["france"], r"given 'france': no such profile; allowed: .*france_1985"),
        ("load_cases", ["france_1985.uplift"], r"without a profile there is no load case; allowed: none"),
    ):
        with pytest.raises(ScenarioError, match=rf"limits\.{key}\.\d: .*{told}"):
            load_scenario("jig_back", {f"limits.{key}": value})
    wrong = {"limits.profile": ["france_1985"], "limits.installation.carries": "goods"}
    with pytest.raises(RuleError, match=r"given 'france_1985': it is for persons alone.*; allowed: profiles for goods"):
        profiles_of(load_scenario("jig_back", wrong))
    wrong = {"limits.profile": ["france_1985"], "limits.load_cases": ["france_1985.flood"]}
    with pytest.raises(RuleError, match=r"given 'france_1985\.flood'; allowed: france_1985\.inward, france_1985\.up"):
        profiles_of(load_scenario("jig_back", wrong))


@pytest.mark.parametrize(
    ("value", "options", "state", "reason"),
    [
        (2.000001, {}, "kept", ""),  # rounding
        (2.001, {}, "not kept", ""),
        (2.1, {}, "not kept", ""),
        (2.1, {"waiver": "if watched"}, "authority may allow", "if watched"),
        (1.9, {"uncertainty": 0.05}, "kept", ""),
        (1.9, {"uncertainty": 0.2}, "not decided", "within the uncertainty of 0.2 m/s"),
        (1.9, {"compared": "at most", "definition": "mean"}, "not decided", "the figure is at most what .*: mean"),
        (2.1, {"compared": "at most"}, "not kept", ""),
        (2.1, {"compared": "at least"}, "not decided", "the figure is at least what"),
        (1.9, {"allowance": 0.2}, "not decided", "within the allowance of 0.2 m/s"),
        (1.7, {"allowance": 0.2}, "kept", ""),
        (2.1, {"allowance": 0.2}, "not kept", ""),
        (2.0, {"comparison": "below"}, "not kept", ""),
        (2.0, {"comparison": "within", "limit": [1.0, "rated_speed / 2"]}, "not kept", ""),
        (1.2, {"comparison": "within", "limit": [1.0, "rated_speed / 2"]}, "kept", ""),
        (1.2, {"limit": "0.5 + persons / 4"}, "not decided", "limits.installation.persons is not stated"),
        (1.2, {"limit": "1 / (persons - 4)", "changes": {"limits.installation.persons": 4}}, "not decided", "no value"),
        (1.2, {"when": {"rated_speed": "> 4"}}, "does not apply", "it is for rated_speed > 4"),
        (1.2, {"when": {"grip": "fixed"}}, "not decided", "limits.installation.grip is not stated"),
        (1.2, {"systems": ["reversible_bicable"]}, "does not apply", "it is for reversible_bicable, this is monocable"),
        (1.2, {"load_case": "storm"}, "not decided", "load case own.storm is not this run: a storm"),
        (1.2, {"quantity": "speed/pairs/highest"}, "not decided", "the scenario has no pairs"),
    ],
)
def test_verdicts(tmp_path, value, options, state, reason):
    found = verdict(tmp_path, value, **options)
    assert found.state == state, found
    assert not reason or found.reason.startswith(reason.partition(".*")[0]) or reason in found.reason
    assert (found.profile, found.check, found.document, found.edition, found.clause, found.unit) == (
        *("own", "A-1", "a rule book", "first", "1", "m/s"),
    )


@pytest.mark.parametrize(
    ("comparison", "limit", "compared", "values", "shown"),
    [
        ("at least", 5.0, "at most", (4.58, 4.86), 4.58),
        ("at least", 4.0, "at least", (4.58, 4.86), 4.58),
        ("at most", 4.0, "at least", (4.58, 4.86), 4.86),
        ("within", [4.0, 4.7], "at most", (4.3, 4.5), 4.5),
        ("at least", 5.0, "equal", (4.58, 4.86), 4.58),
    ],
)
def test_the_worst_of_several_ropes_is_shown(tmp_path, comparison, limit, compared, values, shown):
    """Also where it is not decided, as the value that is farthest on the side that is not allowed."""
    own = profile(
        *(tmp_path,),
        quantity="rope_safety_factor/moving_ropes/lowest",
        **{"comparison": comparison, "limit": limit, "unit": "-", "compared": compared, "definition": "another one"},
    )
    load_profile.cache_clear()
    ropes = zip(("up", "down"), values, strict=True)
    figures = [figure("rope_safety_factor", Subject(f"ropes.{name}", name), "lowest", one, 1.0) for name, one in ropes]
    for ordered in (figures, figures[::-1]):
        (found,) = judge(load_scenario("chairlift"), ordered, [load_profile(own)])
        assert found.value == shown, found


def test_a_case_and_a_unit_of_a_rule(tmp_path):
    limit = [{"when": {"persons": [1, 2]}, "limit": 2.5}, {"when": {"persons": "> 2"}, "limit": 2.3}]
    found = verdict(tmp_path, 2.4, {"limits.installation.persons": 4}, limit=limit)
    assert (found.state, found.limits) == ("not kept", (2.3,))
    scenario = load_scenario("chairlift", {"limits.profile": [profile(
        tmp_path, "percent", quantity="swing_tangent/vehicles/highest", limit=20, unit="%")]})  # fmt: skip
    swing = figure("swing", Subject("carriers", "chair"), "highest", 0.15, 1.0)
    (found,) = judge(scenario, [swing])
    assert found.state == "kept"
    assert found.value == pytest.approx(15.11, abs=0.01)


def test_a_haul_rope_in_the_drive_of_a_carriage_is_said_to_be_one():
    scenario = load_scenario("aerial_tramway", {"limits.profile": ["france_1985"]})
    reasons = {one.check: one.reason for one in judge(scenario, [])}
    assert reasons["FR85-17"] == (
        "the run has no figure tested_safety_factor, which needs breaking_force or tested_breaking_force of the rope"
    )
    assert reasons["FR85-29"] == "the haul rope of cabin is a part of the drive, without bullwheels"
    own = load_scenario("single_span", {"limits.profile": ["france_1985"], "carriages.cabin.drive.haul_rope": None})
    assert {one.check: one.reason for one in judge(own, [])}["FR85-29"] == "the scenario has no bullwheels"


def test_a_haul_rope_in_the_drive_of_a_carriage_is_judged_as_one():
    """At rest, by the static pull of the cabin, the counter rope and the weight of the rope up to its drive."""
    rope = "carriages.cabin.drive.haul_rope"
    changes = {"limits.profile": ["france_1985", "carinthia_1971"], f"{rope}.calculated_breaking_force": 6e5}
    twin = Simulation(load_scenario("aerial_tramway", changes))
    figures = KeyFigures(twin.scenario)
    figures.update(twin.snapshot)
    columns = twin.snapshot.columns
    pull = 60e3 + columns.haul_force[0] + 6.0 * 9.81 * (300.0 - columns.joint_position[0, 2])
    found = {str(one.id): one for one in figures.figures()}
    assert found[f"rope_tension/{rope}/highest"].value == pytest.approx(pull)
    factor = found[f"rope_safety_factor/{rope}/lowest"]
    assert (factor.value, factor.limit) == (pytest.approx(1.09e6 / pull), 4.5)
    assert factor.name == "haul rope of cabin: rope safety factor"
    verdicts = {one.check: one for one in judge(twin.scenario, figures.figures())}
    assert (verdicts["FR85-17"].state, verdicts["FR85-17"].figure) == ("kept", factor)
    assert (verdicts["ATK-08"].state, verdicts["ATK-08"].value) == ("kept", pytest.approx(6e5 / pull))
    bare = load_scenario(twin.scenario.resolved(), {f"{rope}.breaking_force": None})
    missing = f"not judged: limits.haul_rope_safety_factor: {rope}.breaking_force is not given"
    assert missing in [one.told() for one in not_judged(bare, [])]


def test_a_tramway_by_real_figures():
    """Jig-back after a stop from full speed: figures of the run, and those that follow from its dimensions."""
    facts = {"automatic_deceleration_control": True, "lining": "rubber", "persons": 80, "snow": 1.0}
    changes = {f"limits.installation.{key}": value for key, value in facts.items()}
    scenario = load_scenario("jig_back", {"limits.profile": ["france_1985"], **changes})
    simulation, figures = Simulation(scenario), KeyFigures(scenario)
    figures.update(simulation.snapshot)
    found = {one.check: one for one in judge(scenario, figures.figures())}
    factor = found["FR85-16"]
    assert factor.quantity.startswith("rope_safety_factor")  # for a tested one that is not given
    assert (factor.state, factor.comparison, factor.limits) == ("kept", "at least", (3.15,))
    assert found["FR85-12"].value == pytest.approx(80.0 / 0.066)
    assert found["FR85-29"].value == pytest.approx(9.0 / 0.032)
    assert found["FR85-57"].value == pytest.approx(80.0)
    assert found["FR85-04"].reason == "the run has no figure mean_deceleration, which needs a stop in the run"
    assert found["FR85-19"].state == "does not apply"
    stated = {"limits.profile": ["france_1985"], "limits.load_cases": ["france_1985.uplift"]}
    calm = {one.check: one for one in judge(load_scenario("jig_back", stated), figures.figures())}["FR85-09"]
    assert calm.state == "not decided"  # the case is named, and not there
    assert calm.reason == "load case france_1985.uplift has a wind of 500 Pa, this run of 0 Pa"
    uplift = load_scenario("jig_back", stated | {"air.wind.z": 30.15})
    found = {one.check: one for one in judge(uplift, figures.figures())}
    assert (found["FR85-09"].state, found["FR85-09"].comparison) == ("kept", "above")
    assert found["FR85-16"].reason == "this run is france_1985.uplift alone, a load case of certain rules"


def test_a_running_twin_warns_once_of_a_rule(tmp_path):
    own = profile(
        tmp_path, quantity="rope_safety_factor/moving_ropes/lowest", comparison="at least", limit=50, unit="-"
    )
    load_profile.cache_clear()
    scenario = load_scenario("chairlift", {"limits.profile": [own]})
    watch = FigureWatch(KeyFigures(scenario), scenario)
    watch.update(Simulation(scenario).snapshot)
    watch.statuses()
    watch.statuses()
    (told,) = [line for line in watch.take_messages() if line.startswith("rule of own: A-1 not kept: ")]
    assert "at least 50" in told
    assert "own A-1" in watch.status()[2]
    gone = load_scenario("chairlift", {"limits.profile": [str(tmp_path / "gone.yaml")]})
    (told,) = FigureWatch(KeyFigures(gone), gone).take_messages()
    assert told.startswith("no rule profile is judged: ")


def test_the_wind_is_a_figure_and_its_pressure_follows():
    scenario = load_scenario("windy_tramway", {"air.wind": [3.0, 6.0, 0.0]})
    figures = KeyFigures(scenario)
    figures.update(Simulation(scenario).snapshot)
    found = {one.id.quantity: one.value for one in derived_figures(scenario, figures.figures())}
    assert found["wind_pressure"] == pytest.approx(0.5 * scenario.air.density * 45.0)


def test_quantities_in_general_read_on_and_differ_by_role_where_rules_do(tmp_path, capsys):
    assert {one.in_general for one in QUANTITIES.values()} >= {"clearance between vehicles, least", "rope tension"}
    assert not [one.in_general for one in QUANTITIES.values() if re.search(r"  | ,|''", one.in_general)]
    scenario = load_scenario("gondola")
    factor = {"unit": "-", "comparison": "at least", "limit": 5.0}
    load_profile.cache_clear()
    found = [
        load_profile(profile(tmp_path, role, quantity=f"rope_safety_factor/{role}/lowest", **factor))
        for role in ("moving_ropes", "carrying_hauling_ropes")
    ]
    print_verdicts(Console(width=200), found, judge(scenario, [], found))
    told = " ".join(capsys.readouterr().out.split())
    for role in ("moving_ropes", "carrying_hauling_ropes"):
        assert f"only {role} has a rule on rope safety factor, {ROLES[role]} (A-1)" in told


def test_derived_figures_have_the_uncertainty_of_all_that_they_follow_from():
    """First-order propagation, here against differences."""
    scenario = load_scenario("windy_tramway")
    cabin, rope, tower = Subject("carriages.cabin", "cabin"), Subject("ropes.cable"), Subject("towers.tower", "tower")

    def derived(times=1.0, uncertainty=True):
        """Figures of the run, each as much farther as its uncertainty allows, where that makes the derived one more."""
        given = [
            figure("swing", cabin, "highest", 0.3 * times, 0.0),
            figure("wind", Subject("air"), "highest", 15.0 * times, 0.0),
            figure("support_load", tower, "lowest", 1e5 * times, 0.0),
            figure("support_load", tower, "highest", 3e5 / times, 0.0),
            figure("rope_tension", rope, "lowest", 1e6 * times, 0.0),
            figure("contact_force", cabin, "highest", 5e4 / times, 0.0),
        ]
        figures = [replace(one, uncertainty=1e-4 * one.value if uncertainty else None) for one in given]
        return {one.id.quantity: one for one in derived_figures(scenario, figures)}

    found, more = derived(), derived(1.0 + 1e-4)
    for quantity in ("swing_tangent", "wind_pressure", "load_ratio", "tension_over_load"):
        assert found[quantity].uncertainty == pytest.approx(more[quantity].value - found[quantity].value, rel=1e-3)
    assert derived(uncertainty=False)["wind_pressure"].uncertainty is None


def test_counts_of_states_have_the_grammar_of_one_and_of_several():
    states = ["does not apply", "kept", "does not apply", "can be decided"]
    assert counts_text(states) == "1 kept, 2 do not apply, 1 can be decided"
    assert counts_text(states[:1]) == "1 does not apply"
    assert (counted(1, "check"), counted(0, "check")) == ("1 check", "0 checks")


def test_a_stop_that_is_not_over_keeps_no_limit(tmp_path):
    check = {"quantity": "stopping_distance/drives/highest", "limit": 20.0, "unit": "m"}
    found = [load_profile(profile(tmp_path, **check))]
    so_far = figure("stopping_distance", Subject("drives.haul_rope", "haul_rope"), "highest", 14.0, 1.0)
    scenario = load_scenario("chairlift")
    states = [
        judge(scenario, [replace(so_far, value=value, unfinished=unfinished)], found)[0].state
        for value, unfinished in ((14.0, False), (14.0, True), (21.0, True))
    ]
    assert states == ["kept", "not decided", "not kept"]


@pytest.mark.parametrize(("value", "state"), [(0.1, "not decided"), (0.3, "not kept")])
def test_swing_at_rest_keeps_no_rule_on_swing_in_service(value, state):
    profiles = [load_profile(name) for name in ("france_1985", "vorarlberg_persons")]
    scenario = load_scenario("windy_tramway", {"limits.installation.swing_damper": True})
    cabin = Subject("carriages.cabin", "cabin")
    swings = [figure(one, cabin, "highest", value, 0.0) for one in ("swing", "lateral_swing")]
    found = {one.check: one for one in judge(scenario, swings, profiles, at_rest=True)}
    checks = "FR85-42", "FR85-54", "ATV1-10", "ATV1-10b"
    assert [found[one].state for one in checks] == [state] * len(checks)
    if state == "not decided":
        reason = "at rest the figure is at most what it is in motion, which the rule compares"
        assert {found[one].reason for one in checks} == {reason}
        moving = {one.check: one.state for one in judge(scenario, swings, profiles)}
        assert [moving[one] for one in checks] == ["kept"] * len(checks)


def test_each_shipped_rule_on_motion_says_what_a_line_at_rest_is_to_it():
    for name in profile_names():
        for key, check in load_profile(name).document.checks.items():
            quantity = (check.quantity or "").partition("/")[0]
            if quantity in ("swing_tangent", "lateral_swing_tangent", "adhesion_used"):
                assert check.compared_at_rest == "at most", key


def test_a_substitute_at_rest_is_a_bound_on_both_sides():
    scenario = load_scenario("jig_back", {"limits.profile": ["france_1985"]})
    for factor, moving in ((3.4, "kept"), (3.0, "not decided")):
        own = figure("rope_safety_factor", Subject("ropes.track_1", "track_1"), "lowest", factor, 0.0)
        other = figure("rope_safety_factor", Subject("ropes.track_2", "track_2"), "lowest", factor, 0.0)
        for at_rest, state in ((False, moving), (True, "not decided")):
            found = {one.check: one for one in judge(scenario, [own, other], at_rest=at_rest)}
            assert found["FR85-16"].state == state
            if state == "not decided":  # the reason is the bound that leaves open what the value alone would decide
                told = "at rest the figure is at least" if factor > 3.15 else "the figure is at most what the rule comp"
                assert found["FR85-16"].reason.startswith(told)


def test_a_rope_without_data_is_not_kept_by_the_others(tmp_path):
    check = {"quantity": "rope_safety_factor/ropes/lowest", "comparison": "at least", "limit": 4.0, "unit": "-"}
    found = [load_profile(profile(tmp_path, **check))]
    factors = [figure("rope_safety_factor", Subject(f"ropes.{one}", one), "lowest", 5.0, 1.0) for one in ("up", "down")]
    scenario = load_scenario("chairlift")
    assert judge(scenario, factors, found)[0].state == "kept"
    one = judge(scenario, factors[1:], found)[0]
    assert (one.state, one.reason) == (
        "not decided",
        "ropes.up without figure rope_safety_factor, which needs breaking_force of the rope",
    )
    low = [replace(factors[1], value=3.0)]
    assert judge(scenario, low, found)[0].state == "not kept"


def test_each_of_several_stops_is_judged_by_its_mean_deceleration(tmp_path):
    check = {"quantity": "mean_deceleration/drives/mean", "comparison": "within", "limit": [0.5, 1.25], "unit": "m/s^2"}
    found = [load_profile(profile(tmp_path, **check))]
    subject, values = Subject("drives.haul_rope", "haul_rope"), {"mean": 0.9, "highest": 2.6, "lowest": 0.9}
    several = [figure("mean_deceleration", subject, statistic, value, 1.0) for statistic, value in values.items()]
    one = judge(load_scenario("chairlift"), several, found)[0]
    assert (one.state, one.value) == ("not kept", 2.6)


@pytest.mark.parametrize(
    ("stop", "means", "value", "state", "reason"),
    [
        ("stop", ["emergency_brake"], 0.8, "not decided", "a stop by the motor tells nothing of a brake alone"),
        ("emergency stop", ["drive"], 0.8, "not decided", "a stop by drive tells nothing of a brake alone"),
        ("emergency stop", ["drive"], 1.9, "not decided", "a stop by drive tells nothing of a brake alone"),
        ("emergency stop", ["emergency_brake"], 0.8, "not decided", "not tried alone: service_brake"),
        ("emergency stop", ["emergency_brake"], 1.9, "not kept", ""),
        ("emergency stop", ["service_brake", "emergency_brake"], 0.8, "not decided", "a stop by service_brake and"),
        ("emergency stop", ["track_rope_brake"], 0.8, "not decided", "a stop by track_rope_brake tells"),
    ],
)
def test_a_rule_on_each_brake_is_kept_by_brakes_that_have_stopped_it_alone(stop, means, value, state, reason):
    """Formerly kept by a service stop of the motor."""
    changes = {"carriages.cabin.drive.emergency_stop": means, "limits.profile": ["france_1985"]}
    where = f"{stop} from 7.00 m/s at 300.0 m"
    one = figure("mean_deceleration", Subject("carriages.cabin", "cabin"), "mean", value, 60.0, where)
    found = {one.check: one for one in judge(load_scenario("aerial_tramway", changes), [one])}
    assert (found["FR85-04"].state, found["FR85-04"].value) == (state, value)
    assert found["FR85-04"].reason.startswith(reason)
    if (state, means) == ("not decided", ["emergency_brake"]) and stop == "emergency stop":
        changes["carriages.cabin.drive.service_brake"] = None
        found = {one.check: one for one in judge(load_scenario("aerial_tramway", changes), [one])}
        assert found["FR85-04"].state == "kept"


def test_running_speed_of_a_cabin_on_a_haul_rope_is_that_of_the_rope(tmp_path):
    (found,) = [load_profile(profile(tmp_path, limit=8.0))]
    found = found._replace(document=found.document.model_copy(update={"systems": (REVERSIBLE,)}))
    subject = Subject("carriages.cabin", "cabin")
    speeds = [figure("speed", subject, "highest", 8.6, 1.0), figure("drive_speed", subject, "highest", 8.0, 1.0)]
    one = judge(load_scenario("aerial_tramway"), speeds, [found])[0]
    assert (one.state, one.value) == ("kept", 8.0)


def test_place_of_a_vehicle_at_rest_is_no_time(tmp_path):
    found = [load_profile(profile(tmp_path))]
    one = figure("speed", Subject("drives.haul_rope", "haul_rope"), "highest", 3.0, 62.77)
    moving, resting = (judge(load_scenario("chairlift"), [one], found, at_rest=rest)[0] for rest in (False, True))
    assert "at 62.77 s" in sentence(moving)
    assert "vehicle at 62.77 m" in sentence(resting)
    assert " s," not in sentence(resting)
