"""Commands with rule profiles: `rules`, `simulate` and `review` print and write verdicts."""

from __future__ import annotations

import csv
import json

import pytest

from cable_twin.offline import review, rules, simulate

SCRIPT = "- {time: 0, name: haul_rope, speed: 1.0}\n- {time: 5, event: emergency_stop}\n"


def test_profiles_checks_and_vocabulary_are_listed(capsys):
    assert rules.main([]) == 0
    assert "france_1985" in capsys.readouterr().out
    assert rules.main(["france_1985"]) == 0
    printed = capsys.readouterr().out
    assert "FR85-16" in printed
    assert "not decidable: the twin has no overspeed" in printed
    assert rules.main(["--vocabulary"]) == 0
    assert "carrying_hauling_ropes" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "given 'nowhere': no such profile; allowed: "),
        (["nowhere.yaml"], "nowhere.yaml: no such file; allowed: a YAML file with a rule profile"),
        (["--scenario", "jig_back"], "jig_back: limits.profile: given none; allowed: names of profiles"),
    ],
)
def test_wrong_profiles_are_a_line(refusal, arguments, told):
    assert told in refusal(rules.main, *arguments)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Stop of a jig-back under a profile: log and exported files."""
    directory = tmp_path_factory.mktemp("rules")
    (directory / "trip.yaml").write_text(SCRIPT)
    facts = "limits.installation={persons: 80, lining: rubber, automatic_deceleration_control: false}"
    options = ["--script", directory / "trip.yaml", "--duration", 8, "--output", directory / "log", "--record", "bag"]
    options += ["--json", directory / "run.json", "--csv", directory / "run.csv", "--set", facts]
    options += ["--set", "limits.profile=[france_1985, vorarlberg_persons]"]
    assert simulate.main(["jig_back", *map(str, options)]) == 0
    return directory


def test_a_run_is_judged_in_all_outputs(run):
    (data,) = json.loads((run / "run.json").read_text())["runs"]
    found = {one["check"]: one for one in data["rules"]}
    assert {one["profile"] for one in data["rules"]} == {"france_1985", "vorarlberg_persons"}
    stop, speed = found["FR85-04"], found["FR85-01"]
    assert (speed["verdict"], speed["limits"], speed["unit"], speed["clause"]) == ("kept", [2.5], "m/s", "art. 3")
    assert speed["edition"] == "25 June 1985"
    figures = {one["id"]: one["value"] for one in data["key_figures"]}
    assert speed["value"] == figures["speed/drives.haul_rope/highest"]
    assert stop["value"] == figures["mean_deceleration/drives.haul_rope/mean"]
    distance = figures["stopping_distance/drives.haul_rope/highest"]
    assert stop["value"] == pytest.approx(1.0 / (2.0 * distance), rel=0.02)
    with (run / "run_rules.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {row["check"]: row["verdict"] for row in rows} == {name: one["verdict"] for name, one in found.items()}


def test_a_log_is_judged_by_its_own_profile_and_by_another(run, tmp_path, capsys, refusal):
    (log,) = (run / "log").iterdir()
    assert review.main([str(log), "--no-viewer"]) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "1 m/s, at most 2.5 m/s: kept (FR85-01, art. 3) 1 m/s, at most 4 m/s: kept (ATV1-09, § 5(1))" in printed
    assert "only vorarlberg_persons has a rule on " in printed
    own = (rules.load_profile.__wrapped__("france_1985").document.checks["FR85-02"]).model_dump(exclude_none=True)
    text = json.dumps({"document": "a book", "jurisdiction": "here", "edition": "1", "systems": ["reversible_bicable"],
                       "carries": "both", "checks": {"X-1": own | {"limit": 0.5, "when": {}}}})  # fmt: skip
    (tmp_path / "own.yaml").write_text(text)
    judged = ["--profile", str(tmp_path / "own.yaml"), "--profile", "france_1985", "--fact", "snow=1"]
    assert review.main([str(log), "--no-viewer", "--plots", str(tmp_path / "plots"), *judged]) == 0
    assert (tmp_path / "plots" / "rules.png").stat().st_size > 10_000
    printed = " ".join(capsys.readouterr().out.split())
    assert "X-1 not kept: haul_rope: speed: 1 m/s, at most 0.5 m/s" in printed
    assert "where the profiles differ" in printed
    assert "given 'nowhere': no such profile" in refusal(review.main, log, "--profile", "nowhere")


def test_a_chairlift_under_two_profiles(tmp_path, capsys):
    """The speed of boarding at four seats is not kept in France, and Pennsylvania has no rule on it."""
    (tmp_path / "trip.yaml").write_text("- {time: 0, name: haul_rope, speed: 2.5}\n")
    stated = "{persons: 4, grip: fixed, vehicle: chair, passengers: skiers, turn_at_loading: false, loading_aid: true}"
    options = ["--script", tmp_path / "trip.yaml", "--duration", 20, "--record", "off", "--json", tmp_path / "run.json"]
    options += ["--set", "limits.profile=[france_2009, pennsylvania]", "--set", f"limits.installation={stated}"]
    assert simulate.main(["chairlift", *map(str, options)]) == 0
    (data,) = json.loads((tmp_path / "run.json").read_text())["runs"]
    found = {one["check"]: (one["verdict"], one["limits"]) for one in data["rules"]}
    assert found["FR09-12"] == ("not kept", [2.3])
    assert found["FR09-14"] == ("kept", [2.7])
    assert found["FR09-15"] == ("kept", [6.0])
    assert found["FR09-04"][0] == "does not apply"
    assert found["USPA-01"] == ("not decided", [5.0])  # with its dynamic parts the tension is too high
    printed = " ".join(capsys.readouterr().out.split())
    assert "FR09-12 not kept: haul_rope: speed: 2.5 m/s, at most 2.3 m/s, at " in printed
    assert "(Arrêté of 7 August 2009, design, operation and maintenance of ropeways, " in printed
    assert "only pennsylvania has a rule on rope safety factor (USPA-01)" in printed
