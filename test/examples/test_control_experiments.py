"""Control experiments as processes beside a twin: reduced swing, and errors of users reported in a line."""

from __future__ import annotations

import math
import re
import signal
import sys
from argparse import Namespace
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small_tramway import IN_SPACE
from twin_process import PATIENCE, TwinProcess

from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.offline import review
from cable_twin.recording.log_reader import read_log, read_snapshots
from cable_twin.scenario import load_scenario
from verification import JIT
from verification.supports import tramway

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = ("trapezoid_driver.py", "swing_damping.py", "tower_pass.py")
WIND_SPEED = "wind_speed.py"
DESTINATION = 110.0  # m
ATTEMPTS = 3
LONGEST_GAP = 0.3  # s of simulated time between two commands: more, and the machine was too busy for control
SETTLE = 10.0  # s
TRIP_TIMEOUT = 300.0  # s of the clock


def load_module():
    specification = spec_from_file_location("control_experiment", EXAMPLES / "control_experiment.py")
    module = module_from_spec(specification)
    sys.modules["control_experiment"] = module
    specification.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def plans():
    """Module of the control experiments with their common parts."""
    return load_module()


def test_frequencies_are_those_of_closed_forms(plans):
    g = 9.81
    (rod,) = plans.swing_frequencies({"rod": {"mass": 3.0, "inertia": 3.0 * 4.0 / 12.0, "upper_pivot": [0.0, 1.0]}}, g)
    assert rod == pytest.approx(math.sqrt(1.5 * g / 2.0))  # a rod of 2 m hung from its end: 3 g / 2 l
    point = {"mass": 2.0, "inertia": 0.0, "upper_pivot": [0.0, 1.5], "lower_pivot": [0.0, 0.0]}
    slow, fast = plans.swing_frequencies({"upper": point, "lower": point}, g)  # double pendulum: (2 -+ sqrt 2) g / l
    assert slow == pytest.approx(math.sqrt((2.0 - math.sqrt(2.0)) * g / 1.5))
    assert fast == pytest.approx(math.sqrt((2.0 + math.sqrt(2.0)) * g / 1.5))


def test_shaped_plan_goes_as_far_and_excites_none_of_its_frequencies(plans):
    plan = plans.SpeedPlan.trapezoid(-80.0, 4.0, 0.3, 0.2)
    frequencies = np.array([1.1, 2.9])
    shaped = plan.shaped(frequencies)
    assert shaped.duration == pytest.approx(plan.duration + math.pi / 1.1 + math.pi / 2.9)
    times = np.linspace(0.0, shaped.duration, 20_001)
    for one in (plan, shaped):
        speeds = np.array([one.speed(time) for time in times])
        assert np.trapezoid(speeds, times) == pytest.approx(-80.0, rel=1e-6)
        assert abs(speeds).max() <= 4.0 + 1e-12
        assert speeds[-1] == pytest.approx(0.0, abs=1e-9)
    accelerations = np.gradient(np.array([shaped.speed(time) for time in times]), times)
    for frequency in frequencies:  # what an undamped pendulum is left with
        assert abs(np.trapezoid(accelerations * np.exp(1j * frequency * times), times)) < 1e-3


@pytest.mark.parametrize("distance", [0.5, 20.0, 400.0])
def test_trapezoid_keeps_speed_and_acceleration_and_leaves_time_for_the_jerk(plans, distance):
    plan = plans.SpeedPlan.trapezoid(distance, 5.0, 0.3, 0.2)
    assert np.trapezoid(plan.speeds, plan.times) == pytest.approx(distance)
    assert plan.speeds.max() <= 5.0
    assert abs(np.diff(plan.speeds) / np.diff(plan.times)).max() == pytest.approx(0.3)
    assert plan.times[2] - plan.times[1] >= 1.5 - 1e-9


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.long
def test_model_ahead_feels_a_tower(plans, capsys):
    specification = spec_from_file_location("tower_pass", EXAMPLES / "tower_pass.py")
    tower_pass = module_from_spec(specification)
    sys.modules["tower_pass"] = tower_pass
    specification.loader.exec_module(tower_pass)
    # with the joint of the paper: on this saddle of few contacts, a bend at a node sinks in at any speed
    simulation = tramway(cabin={"arc_length": 440.0}, cable__elements=100, cable__joint="paper")
    link = SimpleNamespace(
        name="cabin",
        scenario=simulation.scenario.resolved(),
        motion=plans.Motion(0.0, 440.0, 0.0, {}),
        ended=False,
    )
    options = Namespace(at="tower", window=5.0, speed=3.0, slowest=1.0, settle=1.0, unshaped=False)
    options.at, options.window = tower_pass.find_place(link, options)
    assert np.linalg.norm(simulation.cable_positions([options.at])[0] - [500.0, 0.0, 80.0]) < 0.5
    assert options.window == 17.0  # half of 24 m of shoe, and 5 m
    slow, fast = (tower_pass.predict(link, options, tower_pass.trip(link, options, speed)) for speed in (1.0, 2.4))
    assert fast.acceleration > 1.2 * slow.acceleration
    assert slow.beyond(Namespace(swing_limit=2.0 * slow.swing, acceleration_limit=slow.acceleration / 3.0)) == 3.0
    options.swing_limit, options.acceleration_limit = 90.0, 0.5 * (fast.acceleration + slow.acceleration)
    passing, _, calm = tower_pass.choose(link, options)
    assert 1.0 <= passing < 2.4
    assert calm.keeps(options)
    with pytest.raises(plans.ExperimentError, match="--at 'pylon' given; allowed: an arc length in m, tower"):
        tower_pass.find_place(link, Namespace(at="pylon"))


@pytest.fixture
def wind_law(plans):
    """Wind law of a 500 m trip at 7 m/s, reduced from 10 m/s of wind on and zero from 20 m/s on, with its module."""
    specification = spec_from_file_location("wind_speed", EXAMPLES / WIND_SPEED)
    module = module_from_spec(specification)
    specification.loader.exec_module(module)
    options = Namespace(
        **{"speed": 7.0, "slow_speed": 2.0, "full_speed_wind": 10.0, "stop_wind": 20.0, "roll_limit": 11.5},
        settle=5.0,
    )
    return module, module.WindLaw(options, 500.0, 0.45)


def test_speed_goes_down_with_the_wind_and_its_gusts_are_remembered(plans, wind_law, capsys):
    module, law = wind_law
    speeds = {}
    for tenth in range(1000):
        time = 0.1 * tenth
        wind = 5.0 if time < 10.0 else 15.0 if time < 11.0 else 5.0 if time < 40.0 else 25.0 if time < 45.0 else 8.0
        law.wind.take(time, wind)
        speeds[tenth] = law(plans.Motion(time, 100.0, 5.0, {}))
    assert speeds[50] == 7.0
    assert speeds[105] == speeds[205] == pytest.approx(4.5)  # half way from 7 to 2 m/s, and 10 s on
    assert speeds[215] == 7.0
    standing = [tenth for tenth, speed in speeds.items() if speed == 0.0]
    assert standing == list(range(400, standing[-1] + 1))
    assert 0.1 * standing[-1] == pytest.approx(44.9 + module.HELD + module.CALM, abs=0.3)
    assert speeds[999] == 7.0
    assert len(capsys.readouterr().out.splitlines()) == 5  # not a line each time


def test_roll_and_key_figures_count_and_the_way_has_an_end(plans, wind_law):
    _, law = wind_law
    assert law(plans.Motion(0.0, 100.0, 0.0, {})) == 0.0  # no wind is known yet
    law.wind.take(0.0, 3.0)
    law.roll.take(0.0, math.radians(12.0))
    assert law(plans.Motion(0.1, 100.0, 0.0, {})) == 0.0

    def status(quantity, value):
        texts = {"value": str(value), "limit": "0.2", "id": f"{quantity}/carriages.cabin/highest"}
        return SimpleNamespace(name=quantity, values=[SimpleNamespace(key=k, value=v) for k, v in texts.items()])

    law.judged(["carriers"], SimpleNamespace(status=[status("lateral_swing", 0.19)]))
    law.judged(["carriages.cabin"], SimpleNamespace(status=[status("speed", 9.0), status("lateral_swing", 0.15)]))
    assert law.allowed(0.0) == 7.0
    law.judged(["carriages.cabin"], SimpleNamespace(status=[status("lateral_swing", 0.17)]))
    assert law.allowed(0.0) == 2.0
    law.roll.take(1.0, 0.0)
    place, speed, time = 480.0, 0.0, 50.0
    law(plans.Motion(time, place, speed, {}))
    while (speed := law(plans.Motion(time, place, speed, {}))) is not None:
        place, time = place + 0.1 * speed, time + 0.1
        assert abs(speed) <= 2.0
    assert place == pytest.approx(500.0, abs=0.1)


pytest.importorskip("rclpy")


def start(directory, script, *arguments, domain):
    return TwinProcess(directory, "--wait", str(PATIENCE), *arguments, module=str(EXAMPLES / script), domain=domain)


def write_span(directory):
    """Write `single_span` with a mesh of low cost."""
    path = directory / "span.yaml"
    path.write_text(load_scenario("single_span", {"cable.elements": 40}).to_yaml())
    return str(path)


@pytest.fixture(scope="module")
def trips(tmp_path_factory):
    """Logs and output of one trip on two twins at once, driven by controllers (a) and (b)."""
    for _ in range(ATTEMPTS):
        result = drive_both([tmp_path_factory.mktemp(Path(script).stem) for script in SCRIPTS[:2]])
        times = [[applied.time for applied in read_log(run).commands] for run, _ in result]
        if max(float(np.diff(item).max()) for item in times) < LONGEST_GAP:
            break
    return result


def drive_both(directories):
    """Run two twins, each with a controller; returns logs and output of the controllers."""
    arguments = ["--rerun", "none", "--frame-rate", "50", "--command-timeout", "5"]
    started, pairs = [], []
    try:
        for script, directory in zip(SCRIPTS, directories, strict=False):
            sim = TwinProcess(directory, "--scenario", write_span(directory), *arguments)
            started.append(sim)
            sim.wait_for("runs at 50 Hz")
            trip = ["cabin", "--to", str(DESTINATION), "--settle", str(SETTLE)]
            controller = start(directory, script, *trip, domain=sim.domain)
            started.append(controller)
            pairs.append((sim, controller))
        for sim, controller in pairs:
            assert controller.wait(TRIP_TIMEOUT) == 0, controller.output
            assert sim.end() == 0, sim.output
        return [(sim.run_directory, controller.output) for sim, controller in pairs]
    finally:
        for process in started:
            process.kill()


def measure(run):
    """Largest swing (deg) of a trip, largest swing in its last six seconds, and final arc length (m)."""
    log = read_log(run)
    figures = KeyFigures(load_scenario(log.scenario))
    swings = []
    for item in read_snapshots(log):
        if isinstance(item, Snapshot):
            figures.update(item)
            swings.append((item.time, math.degrees(item.carriages["cabin"].bodies["cabin"].pitch)))
            last = item
    (swing,) = [figure.value for figure in figures.figures() if figure.name == "cabin: swing along the track"]
    rest = [abs(value) for time, value in swings if time > last.time - 6.0]
    return math.degrees(swing), max(rest), last.carriages["cabin"].arc_length


@pytest.mark.long
def test_swing_is_cut_by_more_than_half(trips, tmp_path, capsys):
    (plain, plain_output), (damped, damped_output) = trips
    swing_a, rest_a, end_a = measure(plain)
    swing_b, rest_b, end_b = measure(damped)
    assert swing_a > 3.0
    assert rest_a > 1.0
    assert swing_b < 0.5 * swing_a
    assert rest_b < 0.5 * rest_a
    assert end_a == pytest.approx(DESTINATION, abs=0.5)
    assert end_b == pytest.approx(DESTINATION, abs=0.5)
    for output in (plain_output, damped_output):
        assert "Traceback" not in output
        assert "done after" in output
    for run in (plain, damped):
        assert {applied.source for applied in read_log(run).commands} == {"joint_commands"}
    assert review.main([str(plain), str(damped), "--no-viewer", "--plots", str(tmp_path)]) == 0
    assert "cabin: swing along the track" in capsys.readouterr().out
    assert (tmp_path / "swing.png").stat().st_size > 20_000


@pytest.mark.long
def test_damped_trip_replays_to_the_last_bit(trips, replayed):
    replayed(trips[1][0])


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    """Running twin without logs, at three times real time."""
    directory = tmp_path_factory.mktemp("twin")
    sim = TwinProcess(
        *(directory, "--scenario", write_span(directory), "--record", "false"),
        *("--frame-rate", "50", "--real-time-factor", "3", "--command-timeout", "5"),
    )
    sim.wait_for("runs at 50 Hz")
    yield sim
    sim.kill()


@pytest.mark.parametrize("script", SCRIPTS)
def test_what_the_twin_excludes_is_one_line(twin, script):
    place = "--at" if script == "tower_pass.py" else "--to"
    what = "carriage or drive" if script == SCRIPTS[0] else "carriage with a drive of its own"
    expected = {
        ("gondola",): f"{what}: given 'gondola'; allowed: cabin",
        ("cabin", "--speed", "11"): "--speed 11 m/s given; the drive of 'cabin' allows 10 m/s",
        ("cabin", place, "2000"): "arc length 2000 m given; allowed: more than 0 and less than 1044.25 m",
    }
    started = [start(twin.directory, script, *arguments, domain=twin.domain) for arguments in expected]
    for process, said in zip(started, expected.values(), strict=True):
        assert process.wait() == 1
        assert process.output.splitlines()[-1] == f"{script}: {said}"
        assert "Traceback" not in process.output


def test_pass_is_predicted_driven_and_compared_and_interrupts_stop_the_twin(twin):
    process = start(
        *(twin.directory, "tower_pass.py", "cabin", "--at", "80", "--window", "3", "--speed", "3", "--settle", "1"),
        *("--slowest", "1", "--swing-limit", "2"),
        domain=twin.domain,
    )
    assert process.wait(TRIP_TIMEOUT) == 0, process.output
    (passed,) = [line for line in process.output.splitlines() if "passed with a swing of" in line]
    words = passed.split()
    assert float(words[6]) == pytest.approx(float(words[9]), abs=0.5)  # deg
    for script in SCRIPTS[:2]:  # from where the one before has left it
        process = start(twin.directory, script, "cabin", "--to", "800", domain=twin.domain)
        process.wait_for(" s with ramps" if script == SCRIPTS[0] else "shaped for")
        process.send(signal.SIGINT)
        assert process.wait() == 0
        assert "ended" in process.output.splitlines()[-1]
        assert "Traceback" not in process.output


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.long
def test_a_lift_goes_to_a_place_and_slower_in_the_wind(tmp_path):
    """Drive of a jig-back; of the other experiments, which need the swing of one carriage, there is a line."""
    # a command that is late by 0.3 s is 0.15 m
    slow = ["--frame-rate", "50", "--real-time-factor", "0.5", "--command-timeout", "5", "--record", "false"]
    sim = TwinProcess(tmp_path, "--scenario", "jig_back", "--set", "air.wind=[0, 6, 0]", *slow)
    calm = ["haul_rope", "--speed", "1", "--settle", "0.5"]
    wind = ["--full-speed-wind", "4", "--stop-wind", "8", "--slow-speed", "0.5"]
    started = [sim]
    try:
        sim.wait_for("runs at 50 Hz")
        for script, *arguments in (("trapezoid_driver.py", "--to", "1.5"), (WIND_SPEED, "--to", "3", *wind)):
            started.append(driver := start(tmp_path, script, *calm, *arguments, domain=sim.domain))
            assert driver.wait(TRIP_TIMEOUT) == 0, driver.output
            (place,) = re.findall(r"done after .* m/s at (.*) m", driver.output)
            assert float(place) == pytest.approx(float(arguments[1]), abs=0.15)
        assert "wind 6.0 m/s" in driver.output
        assert ": 0.75 m/s" in driver.output  # half way from 1 to 0.5 m/s
        own = "carriage with a drive of its own: given 'haul_rope'; allowed: none of this twin"
        for said, script, *arguments in (
            *((own, one, "haul_rope") for one in SCRIPTS[1:]),
            ("carriage or drive: given 'cabin_1'; allowed: haul_rope", WIND_SPEED, "cabin_1"),
            ("travel 2000 m given; allowed: 0 to 1012 m", "trapezoid_driver.py", "haul_rope", "--to", "2000"),
        ):
            started.append(driver := start(tmp_path, script, *arguments, domain=sim.domain))
            assert driver.wait() == 1
            assert driver.output.strip() == f"{script}: {said}"
    finally:
        for process in started:
            process.kill()


@pytest.mark.parametrize("script", [*SCRIPTS, WIND_SPEED])
def test_help_has_an_example_and_bad_options_are_one_line(ended, script):
    code, said, _ = ended(EXAMPLES / script, "--help")
    assert code == 0
    assert f"python examples/{script} cabin" in said
    code, _, errors = ended(EXAMPLES / script, "cabin", "--speed", "nan")
    assert code == 1
    assert errors == (
        f"{script}: argument --speed: 'nan' given, more than 0 m/s is needed; all options: {script} --help\n"
    )


def test_without_a_twin_it_says_so(domain, tmp_path):
    process = start(tmp_path, "trapezoid_driver.py", "cabin", "--wait", "2", domain=domain)
    assert process.wait() == 1
    assert process.output.strip() == (
        "trapezoid_driver.py: no twin that moves on answers as /cable_twin after 2 s (no listener to joint_commands, "
        "no scenario, no joint_states): is `sim` running, not paused, and with the same ROS_DOMAIN_ID?"
    )


@pytest.mark.long
@pytest.mark.skipif(not JIT, reason="minutes without compilation")
def test_it_goes_slower_in_the_wind_of_a_running_twin_and_stands_in_a_storm(tmp_path):
    """Wind published before the trip as by an anemometer's node, so that `air/wind` alone tells of it."""
    scenario = {**IN_SPACE, "air": {"wind": [0.0, 6.0, 0.0]}}
    (tmp_path / "windy.yaml").write_text(load_scenario(scenario).to_yaml())
    fast = ["--frame-rate", "50", "--real-time-factor", "3", "--command-timeout", "5", "--rerun", "none"]
    sim = TwinProcess(tmp_path, "--scenario", str(tmp_path / "windy.yaml"), *fast)
    trip = ["cabin", "--to", "30", "--speed", "4", "--full-speed-wind", "4", "--stop-wind", "8", "--settle", "1"]
    try:
        sim.wait_for("runs at 50 Hz")
        driver = start(tmp_path, WIND_SPEED, *trip, domain=sim.domain)
        try:
            assert driver.wait(TRIP_TIMEOUT) == 0, driver.output
            storm = start(tmp_path, WIND_SPEED, *trip[:2], "60", "--stop-wind", "5", "--full-speed-wind", "4",
                          domain=sim.domain)  # fmt: skip
            storm.wait_for(": 0.00 m/s")
            storm.send(signal.SIGINT)
            assert storm.wait() == 0, storm.output
        finally:
            driver.kill()
        assert sim.end() == 0, sim.output
    finally:
        sim.kill()
    assert "wind 6.0 m/s" in driver.output
    assert ": 3.00 m/s" in driver.output  # half way from 4 to 2 m/s
    assert "strongest wind 6.0 m/s; largest swing across" in driver.output
    assert "done after" in driver.output
    log = read_log(sim.run_directory)
    snapshots = [item for item in read_snapshots(log) if isinstance(item, Snapshot)]
    speeds = [item.carriages["cabin"].speed for item in snapshots]
    assert 2.8 < max(speeds) < 3.3
    places = [item.carriages["cabin"].arc_length for item in snapshots]
    assert max(places) < 31.0  # none of the second trip
    assert "Traceback" not in driver.output + storm.output
