"""Step response figures against closed forms, and those of a real run in `review`."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from prescribed_frames import frame, put, writable
from twin_process import write_quick_scenario

from cable_twin.offline import review, simulate
from cable_twin.offline.responses import Responses

PERIOD, SPEED, BEGIN = 0.01, 4.0, 1.0  # s, m/s, s


def gathered(response, *, duration=30.0, drives=()):
    """Responses of a carriage, or of the drive of a moving rope, to a step of `SPEED` in a given form from 0 to 1."""
    responses = Responses()
    for number in range(round(duration / PERIOD)):
        time = number * PERIOD
        one = frame(time, () if drives else ("cabin",), drives=drives)
        told = SPEED if time > BEGIN else 0.0  # a command comes after the frame of its time
        speed = SPEED * response(time - BEGIN) if time >= BEGIN else 0.0
        c = writable(one)
        if drives:
            c.drive_position[0], c.drive_speed[0], c.moving_cable_force[0] = 0.0, speed, 1e3
            c.drive_command_kind[0], c.drive_commanded_speed[0], c.drive_reference_speed[0] = 2.0, told, speed + 0.1
        else:
            put(one, speed=speed, drive_force=1e3)
            c.command_kind[0], c.commanded_speed[0], c.reference_speed[0] = 2.0, told, speed + 0.1
        responses.take(one)
    return responses


@pytest.mark.parametrize("drives", [(), ("haul_rope",)], ids=["carriage", "moving rope"])
def test_a_first_order_response_has_its_closed_form(drives):
    lag = 2.0  # s
    responses = gathered(lambda time: 1.0 - math.exp(-time / lag), drives=drives)
    (step,) = responses.finish()
    assert (step.name, step.time, step.before, step.command) == (drives[0] if drives else "cabin", BEGIN, 0.0, SPEED)
    assert step.rise == pytest.approx(lag * math.log(9.0), abs=2.0 * PERIOD)
    assert step.settling == pytest.approx(lag * math.log(50.0), abs=2.0 * PERIOD)
    assert step.overshoot == 0.0
    assert step.steady_error == pytest.approx(0.0, abs=1e-4)
    (effort,) = responses.efforts.values()
    assert [effort.rms_error, effort.largest_error] == pytest.approx([0.1, 0.1])
    assert effort.rms_force == pytest.approx(1e3)
    assert effort.driving == pytest.approx(1e3 * SPEED * (29.0 - lag), rel=0.01)
    assert effort.braking == 0.0


def test_a_damped_swing_has_its_overshoot_and_offset_its_steady_error():
    damping, frequency = 0.3, 2.0  # -, rad/s
    damped = frequency * math.sqrt(1.0 - damping**2)

    def response(time):
        decay = math.exp(-damping * frequency * time)
        return 1.0 - decay * (math.cos(damped * time) + damping * frequency / damped * math.sin(damped * time))

    (step,) = gathered(response).finish()
    assert step.overshoot == pytest.approx(math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2)), abs=1e-3)
    times = np.arange(0.0, 29.0, 1e-3)
    outside = np.abs(np.array([response(time) for time in times]) - 1.0) > 0.02
    assert step.settling == pytest.approx(times[np.flatnonzero(outside)[-1]], abs=2.0 * PERIOD)
    (short,) = gathered(lambda time: 0.9 * response(time)).finish()
    assert short.settling is None
    assert short.steady_error == pytest.approx(-0.1 * SPEED, rel=1e-3)
    (slow,) = gathered(lambda time: 0.01 * time).finish()
    assert (slow.rise, slow.settling) == (None, None)


def test_commands_that_do_not_hold_are_no_steps():
    assert gathered(lambda time: 1.0, duration=BEGIN + 1.5).finish() == []


@pytest.mark.parametrize("commands", [[SPEED], [math.nan, SPEED], [math.nan, 0.0]], ids=str)
def test_a_command_that_is_in_force_or_reached_already_is_no_step(commands):
    """At the begin of a branch or a later file of a log, and after a force or a stop; a small change is one."""
    responses = Responses()
    for number in range(3000):
        one = frame(number * PERIOD, ("cabin",))
        command = commands[min(number // 1000, len(commands) - 1)]
        command = 1.01 * command if number >= 2000 else command
        put(one, speed=commands[-1] + 0.01, drive_force=1e3)
        c = writable(one)
        c.command_kind[0], c.commanded_speed[0], c.reference_speed[0] = 2.0, command, commands[-1]
        responses.take(one)
    assert [one.command for one in responses.finish()] == ([1.01 * SPEED] if commands[-1] else [])


def test_review_shows_them_and_names_runs_as_output_did(tmp_path, capsys, monkeypatch):
    """Two runs of a script with a step: a table each, JSON, and run names in the legends."""
    scenario = write_quick_scenario(tmp_path)
    (tmp_path / "step.yaml").write_text("- {time: 1, name: cabin, speed: 1, step: 2, duration: 6}\n")
    runs = []
    for name, softer in (("hard", []), ("soft", ["--set", "carriages.cabin.drive.limits.acceleration=0.5"])):
        arguments = [str(scenario), "--script", str(tmp_path / "step.yaml"), "--duration", "10", "--record", "bag"]
        assert simulate.main([*arguments, *softer, "--output", str(tmp_path / name)]) == 0
        runs.append(str(next((tmp_path / name).iterdir())))
    labels = []
    monkeypatch.setattr(
        "cable_twin.offline.plots.write_plots", lambda runs, *_: labels.extend(r.label for r in runs) or []
    )
    capsys.readouterr()
    arguments = ["--no-viewer", "--plots", str(tmp_path / "plots"), "--json", str(tmp_path / "runs.json")]
    assert review.main([*runs, *arguments]) == 0
    said = capsys.readouterr().out
    assert said.count("response to steps of the commanded speed of ") == 2
    assert said.count("control effort and tracking error of ") == 2
    assert labels == ["hard", "soft"]
    assert "settling" in said
    hard, soft = json.loads((tmp_path / "runs.json").read_text())["runs"]
    (first, back), slow = hard["step_responses"], soft["step_responses"][0]
    assert (first["time"], first["before"], first["command"]) == (1.0, pytest.approx(0.0, abs=1e-3), 3.0)
    assert (back["time"], back["command"]) == (7.0, 1.0)
    assert first["rise"] == pytest.approx(0.8 * 3.0 / 4.0, abs=0.02)  # 4 m/s², short of the jerk at both ends
    assert slow["rise"] == pytest.approx(0.8 * 3.0 / 0.5, rel=0.05)
    assert hard["efforts"][0]["driving"] > 0.0
