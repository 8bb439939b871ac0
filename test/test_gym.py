"""Environment for learning: gymnasium's own checker, names, user rewards, processes."""

from __future__ import annotations

import copy
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from test_meeting import two_cabins

from cable_twin.frame.snapshot import CABLE
from cable_twin.gym import NAME, RopewayEnv, RopewayVectorEnv, vector_env
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

TARGET = 160.0  # m


def nearer(before, action, after):
    """Reward: approach of the cabin (m) less the commanded speed."""
    return abs(before["cabin/arc_length"] - TARGET) - abs(after["cabin/arc_length"] - TARGET) - 1e-3 * abs(action[0])


def arrived(after):
    return abs(after["cabin/arc_length"] - TARGET) < 1.0


def windy(simulation, generator):
    simulation.wind(generator.uniform(-5.0, 5.0))


@pytest.fixture(scope="module")
def env():
    return RopewayEnv("single_span", reward=nearer, ended=arrived, period=0.1, duration=60.0)


@pytest.mark.parametrize("scenario", ["single_span", "gondola"])
def test_the_checker_of_gymnasium(scenario):
    made = gymnasium.make(f"cable_twin.gym:{NAME}", scenario=scenario, prepare=windy, duration=1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # units of the scenario are neither normalised nor bounded
        check_env(made.unwrapped)


def test_spaces_have_names_units_and_limits(env):
    assert env.action_names == ("cabin",)
    assert env.action_space == gymnasium.spaces.Box(-10.0, 10.0, (1,), np.float64)
    assert env.observation_names[:2] == ("cabin/arc_length", "cabin/speed")
    assert env.observation_units == ("m", "m/s", *["rad", "rad/s"] * 3)
    assert env.observation_space.high[0] == env.simulation.scenario.cable.unstrained_length
    lift = RopewayEnv(
        "gondola", observations=["haul_rope/[!cr]*", "tower_*/load", "*/start/tension", "*/end/tension"], period=0.1
    )
    assert lift.action_names == ("haul_rope",)
    towers = [f"tower_{n}_up" for n in range(1, 8)] + [f"tower_{n}_down" for n in range(7, 0, -1)]
    ends = [f"{rope}/{end}/tension" for rope in ("up", "down") for end in ("start", "end")]
    assert set(lift.observation_names[3:]) == {*(f"{tower}/load" for tower in towers), *ends}


@pytest.mark.parametrize("scenario", ["gondola", "bicable"])
def test_a_lift_is_observed_at_its_drive_and_by_the_swing_of_its_carriers(scenario):
    lift = RopewayEnv(scenario, period=0.1)
    lift.reset()
    for _ in range(5):
        observation, *_ = lift.step(np.array([5.0]))
    seen, columns = lift.named(observation), lift.simulation.snapshot.columns
    assert dict(seen) == {
        "haul_rope/position": columns.drive_position[0],
        "haul_rope/speed": columns.drive_speed[0],
        "haul_rope/force": columns.moving_cable_force[0],
        "drive/tension_on": columns.sheave_tension[0, 0],
        "drive/tension_off": columns.sheave_tension[0, 1],
        "carriers/largest_pitch": np.nanmax(abs(columns.body_angles[:, 1])),
        "carriers/largest_pitch_rate": np.nanmax(abs(columns.body_angular_velocity[:, 1])),
    }
    assert seen["carriers/largest_pitch"] > 1e-4
    with pytest.raises(ValueError, match=r"given 'cabin/\*'; did you mean 'cabin_\d+/\*', 'cabin_\d+/\*'") as caught:
        RopewayEnv(scenario, observations=["cabin/*"])
    assert len(str(caught.value)) < 100


@pytest.mark.parametrize(
    ("scenario", "overrides", "tower"),
    [("windy_tramway", {}, "tower"), ("jig_back", {}, "rollers_1"), ("gondola", {"space": 3}, "tower_2_up")],
)
def test_in_space_a_controller_sees_what_happens_across_the_track(scenario, overrides, tower):
    overrides = {**overrides, "wind.y": 8.0}
    ropeway = RopewayEnv(scenario, overrides=overrides, period=0.1)
    whole = RopewayEnv(scenario, overrides=overrides, observations=["*"], period=0.1)
    columns, layout = whole.simulation.snapshot.columns, whole.simulation.layout
    seen = whole.named(whole.reset()[0])
    usual = ropeway.named(ropeway.reset()[0])
    assert usual.items() <= seen.items()
    assert (usual["wind/x"], usual["wind/y"]) == (0.0, 8.0)
    rolls = columns.body_angles[:, 0]
    largest = usual["carriers/largest_roll"] if layout.carriers else abs(usual[f"{layout.bodies[-1]}/roll"])
    assert largest == (np.nanmax(abs(rolls)) if layout.carriers else abs(rolls[-1])) > 1e-3
    assert any(name.endswith("roll_rate") for name in usual)
    body, row = layout.bodies[0], layout.support_rows[tower]
    assert seen[f"{body}/y"] == columns.body_position[0, 1]
    assert seen[f"{body}/yaw"] == columns.body_angles[0, 2]
    assert seen[f"{tower}/force_y"] == columns.support_force[row, 1]
    assert seen[f"{tower}/lateral_force"] == columns.tower_lateral[row] != 0.0
    assert seen[f"{tower}/highest_lateral_ratio"] == columns.tower_lateral_ratio[row] > 0.0
    assert seen[f"{tower}/derailed"] == 0.0
    ends = [name for name in layout.supports if name not in layout.towers]
    assert not {f"{name}/lateral_force" for name in ends} & {*seen}


def test_a_step_is_what_the_api_does(env):
    """Equal bits, also for actions beyond the limits."""
    observation, info = env.reset(seed=1)
    assert info["time"] == 0.0
    plain = Simulation(load_scenario("single_span"))
    for speed in (3.0, 20.0, -1.0):
        before = env.named(observation)
        observation, reward, terminated, truncated, info = env.step(np.array([speed]))
        plain.command("cabin", speed=min(speed, 10.0))
        cabin = plain.advance_to(plain.time + 0.1).carriages["cabin"]
        seen = env.named(observation)
        assert seen["cabin/arc_length"] == cabin.arc_length
        assert seen["cabin/hanger/pitch"] == cabin.bodies["hanger"].pitch
        assert reward == nearer(before, [min(speed, 10.0)], seen) != 0.0
        assert (terminated, truncated, info) == (False, False, {"time": plain.time})
    assert plain.snapshot.ropes[CABLE].tensions.size > 2  # which the environment does not read


def test_a_copied_environment_goes_on_by_itself(env):
    env.reset(seed=1)
    env.step(np.array([3.0]))
    other, place = copy.deepcopy(env), env.simulation.snapshot.carriages["cabin"].arc_length
    later = other.step(np.array([3.0]))[0]
    assert env.simulation.snapshot.carriages["cabin"].arc_length == place
    assert np.array_equal(env.step(np.array([3.0]))[0], later)
    assert np.array_equal(env.reset(seed=1)[0], other.reset(seed=1)[0])


def test_the_wind_of_an_episode_is_felt(env):
    """Example of experiments.md: cabin displaced by side wind."""
    blown = RopewayEnv("single_span", prepare=lambda simulation, _: simulation.wind(10.0), period=0.1)
    pitches = []
    for one in (env, blown):
        one.reset(seed=1)
        for _ in range(10):
            observation, *_ = one.step(np.array([0.0]))
        pitches.append(one.named(observation)["cabin/hanger/pitch"])
    assert abs(pitches[1] - pitches[0]) > 1e-4


def test_episodes_end(env):
    env.reset()
    terminated = truncated = False
    while not (terminated or truncated):
        observation, _, terminated, truncated, info = env.step(np.array([8.0]))
    assert terminated
    assert arrived(env.named(observation))
    env.reset()
    count = 0
    while not truncated:
        *_, terminated, truncated, info = env.step(np.array([0.0]))
        count += 1
    assert (count, terminated, info["time"]) == (600, False, pytest.approx(60.0))
    with pytest.raises(RuntimeError, match="call reset first"):
        env.step(np.array([0.0]))


def test_what_the_solver_cannot_do_ends_an_episode():
    crash = RopewayEnv(
        two_cabins(),
        overrides={f"carriages.{name}.drive.limits.speed": 5.0 for name in ("up", "down")},
        command={"up": "speed", "down": "speed"},
        period=0.05,
    )
    crash.reset()
    terminated, steps = False, 0
    while not terminated and steps < 1000:
        *_, terminated, truncated, info = crash.step(np.array([5.0, -5.0]))
        steps += 1
    assert terminated
    assert not truncated
    assert "pressed through each other" in info["fault"]


def test_a_seed_gives_the_same_start_and_another_one_another(env):
    seeded = RopewayEnv("gondola", prepare=windy, observations=["cabin_1/cabin/pitch"], period=1.0)

    def first(seed):
        seeded.reset(seed=seed)
        return float(seeded.step(np.array([1.0]))[0][0])

    assert first(3) == first(3) != first(4)


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        ({"observations": ["cabn/speed"]}, r"observations: given 'cabn/speed'; did you mean 'cabin/speed', 'cabin/r"),
        ({"observations": ["xyz"]}, r"given 'xyz'; allowed, with \* for any text: cabin/\*, cabin/running_carriage/\*"),
        ({"command": "torque"}, "command of 'cabin': given 'torque'; allowed: speed or force"),
        ({"command": {"bus": "speed"}}, "command: given 'bus'; allowed: cabin"),
        ({"period": 0.0123}, "period: given 0.0123 s; allowed: a whole number of solver steps of 0.005 s"),
        ({"reward": 3}, "reward: given 3; allowed: a function"),
        ({"overrides": [1]}, r"overrides: given \[1\]; allowed: a mapping of dotted keys to values"),
        ({"duration": 0.0}, "duration: given 0 s; allowed: at least the period"),
        (
            {"overrides": {"carriages.cabin.drive.limits.speed": None}},
            r"drive\.limits\.speed: given null; allowed: .* m/s",
        ),
    ],
)
def test_arguments_that_do_not_fit_are_told_in_a_line(arguments, line):
    with pytest.raises(ValueError, match=line) as caught:
        RopewayEnv("single_span", **arguments)
    assert "\n" not in str(caught.value)


def test_an_action_that_is_none(env):
    env.reset()
    for action in ([np.nan], [1.0, 2.0], 1.0):
        with pytest.raises(ValueError, match="allowed: finite numbers for cabin"):
            env.step(np.array(action))


class First(gymnasium.Env):
    """First environment of a vector of them, as the checker takes it."""

    def __init__(self, many):
        self.many, self.spec = many, None
        self.action_space, self.observation_space = many.single_action_space, many.single_observation_space

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        observations, infos = self.many.reset(seed=seed, options=options)
        return observations[0], {"time": float(infos["time"][0])}

    def step(self, action):
        parts = self.many.step(np.array([action] * self.many.num_envs))
        observation, reward, terminated, truncated = (part[0] for part in parts[:4])
        return observation, float(reward), bool(terminated), bool(truncated), {"time": float(parts[4]["time"][0])}


@pytest.mark.parametrize("scenario", ["single_span", "gondola"])
def test_the_checker_of_gymnasium_takes_environments_of_an_ensemble(scenario):
    many = vector_env(2, scenario, prepare=windy, duration=1.0, threads=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # as above
        check_env(First(many), skip_render_check=True)
    assert many.action_space.shape == (2, 1)
    many.close()


def test_environments_of_an_ensemble_go_as_those_of_gymnasium_do():
    """Bit for bit through ends of episodes by user, by time and by the solver, and the starts after them."""
    given = {"reward": nearer, "ended": lambda after: after["cabin/speed"] > 1.0, "prepare": windy}
    given |= {"period": 0.5, "duration": 2.0}
    several = SyncVectorEnv([lambda: RopewayEnv("single_span", **given)] * 3)
    many = vector_env(3, "single_span", **given, threads=2)
    for one in (several, many):
        one.reset(seed=5)
    rng, ends = np.random.default_rng(0), 0
    for _ in range(16):
        actions = rng.uniform(-12.0, 12.0, (3, 1)) * [[1.0], [0.1], [1.0]]
        *expected, infos = several.step(actions)
        *found, own = many.step(actions)
        for theirs, ours in zip(expected, found, strict=True):
            assert np.array_equal(theirs, ours)
        assert np.array_equal(infos["time"], own["time"])
        ends += int(np.sum(expected[2] | expected[3]))
    assert ends > 4
    with pytest.raises(ValueError, match=r"actions: .* allowed: finite numbers \(3, 1\) for cabin"):
        many.step(np.zeros((2, 1)))
    for one in (several, many):
        one.close()


def test_what_the_solver_cannot_do_ends_an_episode_of_an_ensemble():
    limits = {f"carriages.{name}.drive.limits.speed": 5.0 for name in ("up", "down")}
    command = {"up": "speed", "down": "speed"}
    many = vector_env(2, two_cabins(), overrides=limits, command=command, period=0.05, threads=1)
    many.reset()
    for _ in range(1000):
        _, _, terminated, _, infos = many.step(np.array([[5.0, -5.0], [0.0, 0.0]]))
        if terminated.any():
            break
    assert terminated.tolist() == [True, False]
    assert "pressed through each other" in infos["fault"][0]
    _, _, terminated, _, infos = many.step(np.zeros((2, 2)))
    assert infos["time"][0] == 0.0 < infos["time"][1]
    assert "fault" not in infos
    many.close()


@pytest.mark.parametrize("context", ["fork", pytest.param("spawn", marks=pytest.mark.long)])
def test_environments_in_processes_go_as_one_alone(env, context):
    many = vector_env(2, "single_span", reward=nearer, period=0.1, processes=True, context=context)
    try:
        many.reset(seed=1)
        observations, rewards, *_ = many.step(np.array([[4.0], [-4.0]]))
    finally:
        many.close()
    for row, speed in enumerate((4.0, -4.0)):
        env.reset(seed=1)
        observation, reward, *_ = env.step(np.array([speed]))
        assert np.array_equal(observations[row], observation)
        assert rewards[row] == reward


def test_a_list_of_seeds_has_one_for_each_environment():
    many = vector_env(2, "single_span", reward=nearer, period=0.1, duration=60.0)
    with pytest.raises(ValueError, match=r"seed: given 3 seeds; allowed: one for each of 2 environments"):
        many.reset(seed=[1, 2, 3])
    with pytest.raises(ValueError, match="given 1 seeds"):
        many.reset(seed=[1])
    with pytest.raises(ValueError, match="options: given reset_mask; allowed: none"):
        many.reset(options={"reset_mask": np.array([True, False])})
    many.reset(seed=[1, 2])
    many.reset(seed=np.int64(1))  # type: ignore[arg-type]
    many.close()


def test_a_vector_by_name_is_an_ensemble():
    many = gymnasium.make_vec(f"cable_twin.gym:{NAME}", num_envs=2, scenario="single_span", duration=1.0)
    assert isinstance(many.unwrapped, RopewayVectorEnv)
    assert many.reset(seed=1)[0].shape[0] == 2
    many.close()
