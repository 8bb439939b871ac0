"""Ski lift of one moving cable as a twin: scenario, drive commands, circulating carriers, a long day."""

from contextlib import suppress
from math import inf, nan

import numpy as np
import pytest
from test_scenario_faults import faults_of, keys_of
from test_simulation import same

from cable_twin.frame.records import Command, CommandError
from cable_twin.frame.snapshot import Snapshot
from cable_twin.key_figures import KeyFigures
from cable_twin.mechanics.drives.stations import LEAVING
from cable_twin.messages import MessageEncoder, decode
from cable_twin.scenario import Scenario, ScenarioError, load_scenario
from cable_twin.simulation import Simulation
from verification import JIT
from verification.models import chairlift, moving_scenario

CHAIR = {"mass": 300.0, "inertia": 100.0, "upper_pivot": [0.0, 2.0]}
CLAMPED = {"arc_length": 5.0, "joint": "clamped", "bodies": {"car": CHAIR}}
MOVES = {"kind": "moving_cable"}
SHORT_LIMITS = {"speed": 5.0, "acceleration": 0.5, "emergency_deceleration": 1.25}
needs_jit = pytest.mark.skipif(not JIT, reason="minutes without compilation")


def short_scenario(**changes):
    """Rope of 60 m with six chairs at 20 m: three on the cable, three on the returning side."""
    lift = {
        "unstrained_length": 60.0,
        "end": (58.0, 14.0),
        "mass_per_length": 6.6,
        "axial": 5e7,
        "bending": 3e3,
        "elements": 12 if JIT else 4,
        "damping_time": 0.01,
        "limits": SHORT_LIMITS,
        "carriers": {"name": "chair", "count": 6, "spacing": 20.0, "bodies": {"chair": CHAIR}},
        "step": 0.01,
    }
    return moving_scenario(**(lift | changes))


def short_lift(**changes):
    return Simulation(short_scenario(**changes))


SHORT = short_scenario().resolved()  # nothing is compiled to collect the tests


FAULTS = [
    ("carriers.spacing", 61.0, "given 61.0 m; allowed: at most 60 m, the length of the cable"),
    ("carriers.count", 2, "given 2: carriers every 20 m fill a loop of 40 m; allowed: at least 3, for the cable o"),
    ("carriers.count", 0, "given 0; allowed: a whole number at least 1 and at most 10000"),
    ("carriers.spacing", -20.0, "given -20.0 m; allowed: a finite number above 0, in m"),
    ("carriers.first", 121.0, "given 121.0 m; allowed: 0 to 120 m, on the loop"),
    ("carriers.name", "chair lift", "given the name 'chair lift'; allowed: a letter A-Z or a-z, then"),
    ("carriers.bodies", {}, "given neither bodies nor kinds; allowed: bodies where all are of one kind"),
    ("carriers.coutn", 3, "this key does not exist; did you mean 'count'?"),
    ("drives", {}, "given a mapping: the cable stands still; allowed: only with an entry in `drives`"),
    ("drives", {"haul_rope": {"kind": "haul"}}, "given 'haul'; allowed: one of moving_cable"),
    ("drives.haul_rope.limits.force", 1e5, "null: a drive without a bullwheel moves the cable with any force that it"),
    ("drives.haul_rope.limits.power", 1e5, "null: a drive without a bullwheel moves the cable with any force that it"),
    ("drives.haul_rope.limits.deceleration", 4.0, "given 4.0 m/s^2; allowed: at most the emergency_deceleration of"),
    ("drives.haul_rope.limits.speed", 0.0, "given 0.0 m/s; allowed: a finite number above 0, in m/s, or null"),
    ("drives", {"haul_rope": MOVES, "other": MOVES}, "given a second drive of the cable; allowed: one drive for the c"),
    ("drives", {"chair_2": MOVES}, "given 'chair': a carrier would have the name 'chair_2' as well"),
    ("cable.end.support", "free", "given 'free': an end of a cable that moves; allowed: pinned or clamped, at a stati"),
    ("solver.integrator", "runge_kutta", "given 'runge_kutta': this cable moves; allowed: generalized_alpha"),
    ("carriages", {"car": {**CLAMPED, "joint": "sliding"}}, "'sliding': on a cable that moves; allowed: clamped"),
    ("carriages", {"car": {**CLAMPED, "arc_length": 121.0}}, "given 121.0 m; allowed: 0 to 120 m, on the loop"),
    ("carriages", {"car": {**CLAMPED, "drive": {"mode": "speed"}}}, "given 'speed'; allowed: free, as a clamped"),
    ("carriages", {"car": {**CLAMPED, "friction": {"rolling": 0.1}}}, "given 0.1; allowed: 0, as a clamped vehicle"),
    ("carriages", {"haul_rope": CLAMPED}, "a carriage has this name; allowed: another name, as commands address"),
]


@pytest.mark.parametrize(("key", "value", "text"), FAULTS)
def test_a_fault_says_where_what_and_what_is_allowed(key, value, text):
    (fault,) = faults_of(SHORT, {key: value})
    assert text in fault


def test_clamped_needs_a_cable_that_moves():
    carriage = {"car": {**CLAMPED, "arc_length": 1.0}}
    with pytest.raises(ScenarioError, match="given 'clamped': on a cable that stands still; allowed: sliding or fixed"):
        load_scenario("seed_example", {"carriages": carriage})


@pytest.mark.parametrize("key", sorted(key for key in keys_of(SHORT) if key.startswith(("drives", "carriers"))))
def test_no_junk_anywhere_gives_anything_but_faults(key):
    for junk in (None, True, -1, 1e300, nan, inf, "", "junk", [], [1, "2"], {}, {"a": {}}, {1: 2}, b"x", object()):
        with suppress(ScenarioError):
            assert isinstance(load_scenario(SHORT, {key: junk}), Scenario)


def test_carriers_are_numbered_and_spaced_round_the_loop():
    scenario = load_scenario(SHORT, {"carriers.first": 110.0})
    assert list(scenario.vehicles) == [f"chair_{number}" for number in range(1, 7)]
    assert [vehicle.arc_length for vehicle in scenario.vehicles.values()] == [110.0, 10.0, 30.0, 50.0, 70.0, 90.0]
    assert load_scenario(scenario.resolved()) == scenario
    assert load_scenario(SHORT, {"carriers": None}).vehicles == {}


def test_a_carriage_of_its_own_may_be_clamped_beside_the_carriers():
    """Loop without carriers of twice the cable's length."""
    car = {**CLAMPED, "arc_length": 70.0}
    simulation = short_lift(carriages={"car": car})
    assert next(iter(simulation.carriages)) == "car"
    assert not simulation.snapshot.carriages["car"].attached
    alone = short_lift(carriages={"car": car | {"arc_length": 119.0}}, carriers=None)
    alone.command("haul_rope", speed=1.0)
    assert alone.advance_to(4.0).carriages["car"].attached


def test_a_drive_takes_speeds_and_its_carriers_nothing():
    simulation = short_lift()
    refusals = [
        ({"name": "haul_rope", "force": 10.0}, "force of 'haul_rope': given 10 N; allowed: none, as this drive"),
        ({"name": "haul_rope", "speed": 5.5}, "speed of 'haul_rope': given 5.5 m/s; allowed: -5 to 5 m/s"),
        ({"name": "haul_rope", "speed": nan}, "speed of 'haul_rope': given nan m/s; allowed: a finite number"),
        ({"name": "chair_1", "speed": 1.0}, "'chair_1' moves with the cable and takes no command; allowed drives: hau"),
        ({"name": "chair_9", "speed": 1.0}, "carriage or drive: given 'chair_9'; allowed: haul_rope"),
    ]
    for command, text in refusals:
        with pytest.raises(CommandError, match=text):
            simulation.command(**command)
    snapshot = simulation.advance_to(0.2)
    assert snapshot.drives["haul_rope"].position == snapshot.drives["haul_rope"].speed == 0.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_start_emergency_stop_and_release(sign):
    """0.5 m/s² to 1 m/s, then 1.25 m/s² to rest within 0.4 m, held until the release."""
    simulation = short_lift()
    simulation.command("haul_rope", speed=sign)
    drive = simulation.advance_to(3.0).drives["haul_rope"]
    assert drive.speed == pytest.approx(sign)
    assert drive.position == pytest.approx(2.0 * sign)
    simulation.emergency_stop()
    drive = simulation.advance_to(4.0).drives["haul_rope"]
    assert drive.speed == 0.0
    assert drive.position == pytest.approx(2.4 * sign)
    with pytest.raises(CommandError, match="the emergency stop is in force"):
        simulation.command("haul_rope", speed=1.0)
    simulation.emergency_stop(active=False)
    assert simulation.advance_to(4.5).drives["haul_rope"].speed == 0.0
    simulation.command("haul_rope", speed=sign)
    assert simulation.advance_to(5.5).drives["haul_rope"].speed == pytest.approx(0.5 * sign)


@pytest.mark.parametrize(("space", "speed"), [(2, 1.0), (2, -1.0), pytest.param(3, 1.0, marks=pytest.mark.long)])
def test_a_chair_stops_where_it_does_and_not_where_the_rim_does(space, speed):
    """Stopping distance of its clamp to the first standstill, and of a passenger with swing."""
    scenario = load_scenario(short_scenario().resolved(), {"space": space})
    simulation, figures, of_log = Simulation(scenario), KeyFigures(scenario), KeyFigures(scenario)
    simulation.command("haul_rope", speed=speed)
    for one in (figures, of_log):
        one.update(simulation.advance_to(4.0))
    stop = simulation.emergency_stop()
    for one in (figures, of_log):
        one.command(stop)
    places, loads = [simulation.snapshot.columns.joint_position], [simulation.snapshot.columns.body_position]
    for frame in range(1, 201):
        figures.update(simulation.advance_to(4.0 + 0.01 * frame))
        if frame % 5 == 0:  # a log has vehicles at 20 Hz and ropes at 10 Hz
            of_log.update(simulation.snapshot if frame % 10 == 0 else without_rope(simulation.snapshot))
        places.append(simulation.snapshot.columns.joint_position)
        loads.append(simulation.snapshot.columns.body_position)
    found = {figure.name: figure for figure in figures.figures()}
    assert found["haul_rope: stopping distance"].value == pytest.approx(0.4, rel=0.02)
    name, _, how = found["chair: stopping distance"].place.partition(", ")
    assert how.startswith("emergency stop from ")
    way = np.array(places)[:, simulation.layout.vehicle_rows[name]]
    steps = np.diff(way, axis=0) @ (way[5] - way[0]) / np.linalg.norm(way[5] - way[0])
    last = int(np.argmax(steps <= 1e-5))
    assert found["chair: stopping distance"].value == pytest.approx(steps[:last].sum(), rel=0.02)
    assert 0.6 < found["chair: stopping time"].value < 2.0  # 0.8 s of the rim
    seat = found["chair: passenger's stopping distance"]
    row = simulation.layout.vehicle_rows[seat.place.partition(", ")[0]]
    gone = np.array(loads)[:, row] - loads[0][row]
    assert seat.value == pytest.approx((gone @ (way[5] - way[0]) / np.linalg.norm(way[5] - way[0])).max(), rel=0.05)
    assert seat.value > found["chair: stopping distance"].value + 0.05
    assert (seat.limit, seat.time) == (None, 4.0)
    logged = {figure.name: figure for figure in of_log.figures()}
    for quantity in ("stopping distance", "stopping time", "passenger's stopping distance"):
        one, other = logged[f"chair: {quantity}"], found[f"chair: {quantity}"]
        assert one.value == pytest.approx(other.value, rel=0.03, abs=0.1 if other.unit == "s" else 0.0)
        assert one.unfinished == other.unfinished


def without_rope(snapshot: Snapshot) -> Snapshot:
    """Frame of a log between two that hold the shape of the rope."""
    numbers = snapshot.numbers.copy()
    snapshot.layout.columns(numbers).rope_position[:] = np.nan
    return Snapshot(snapshot.layout, numbers, snapshot.solver)


def test_a_service_stop_has_its_own_deceleration():
    lift = short_lift(limits=SHORT_LIMITS | {"deceleration": 0.25})
    lift.command("haul_rope", speed=1.0)
    assert lift.advance_to(3.0).columns.drive_speed[0] == 1.0
    lift.command("haul_rope", speed=0.0)
    assert lift.advance_to(5.0).columns.drive_speed[0] == pytest.approx(0.5, abs=1e-9)


def test_reset_puts_rope_and_carriers_back():
    simulation = short_lift()
    start = simulation.snapshot
    simulation.command("haul_rope", speed=4.0)
    simulation.advance_to(4.0)
    simulation.reset()
    assert same(simulation.snapshot, start, but_time=True)


def test_the_same_commands_give_the_same_bits_whatever_the_frames():
    commands = {0.5: 4.0, 3.0: -5.0, 6.0: 0.5}
    snapshots = []
    for frame in (0.01, 0.5):
        simulation = short_lift()
        for time in np.arange(frame, 8.0 + frame / 2, frame).tolist():
            simulation.advance_to(time)
            for when, speed in commands.items():
                if abs(time - when) < 1e-9:
                    simulation.apply(Command("speed", {"haul_rope": speed}))
        snapshots.append(simulation.advance_to(8.0))
    assert same(*snapshots)


def test_vertical_support_forces_are_all_weight_at_rest():
    snapshot = short_lift().snapshot
    weight = 9.81 * (60.0 * 6.6 + 3 * 300.0)
    assert [chair.attached for chair in snapshot.carriages.values()] == [True] * 3 + [False] * 3
    assert sum(support.force[2] for support in snapshot.supports.values()) == pytest.approx(weight, rel=1e-6)


@needs_jit
@pytest.mark.parametrize(
    ("joint", "most", "sign"),
    [
        ("paper", 0.15, 1.0),
        ("node", 0.26, -1.0),
        pytest.param("paper", 0.15, -1.0, marks=pytest.mark.long),
        pytest.param("node", 0.26, 1.0, marks=pytest.mark.long),
    ],
)
def test_no_other_vehicle_feels_a_step_when_one_leaves_or_enters(sign, joint, most):
    """800 m at 2.5 m/s: accelerations of others in steps with and without a change."""
    simulation = Simulation(load_scenario(chairlift().scenario.resolved(), {"cable.joint": joint}))
    state = simulation.state
    simulation.command("haul_rope", speed=2.5 * sign)
    simulation.advance_to(60.0)
    changes, swaps = [], []
    accelerations = state.bodies.acceleration[:, :2].copy()
    attached = state.attached.copy()
    for _ in range(5000):
        simulation.advance_to(simulation.time + simulation.step)
        both = attached & state.attached
        change = np.abs(state.bodies.acceleration[:, :2] - accelerations)[both].max()
        (changes if np.array_equal(attached, state.attached) else swaps).append(change)
        accelerations, attached = state.bodies.acceleration[:, :2].copy(), state.attached.copy()
    assert len(swaps) == 4  # 125 m go by: two leave and two enter
    assert max(swaps) < most
    if joint == "paper":
        assert max(swaps) < 2.0 * np.percentile(changes, 99)
    assert max(changes) < 3.0


@needs_jit
def test_a_carrier_enters_at_the_speed_of_the_rope_and_hangs_on():
    """No jump of its own place, which advances by v h |r_x| from the first step."""
    simulation = short_lift()
    simulation.command("haul_rope", speed=2.0)
    before = simulation.snapshot
    entered = 0
    while simulation.time < 60.0:
        snapshot = simulation.advance_to(simulation.time + simulation.step)
        for name, chair in snapshot.carriages.items():
            was = before.carriages[name]
            assert abs(chair.bodies["chair"].pitch) < 0.2
            if chair.attached and was.attached:
                moved = np.linalg.norm(chair.position - was.position)
                assert moved == pytest.approx(snapshot.drives["haul_rope"].speed * simulation.step, abs=0.005)
            elif chair.attached:
                entered += 1
                assert chair.arc_length < 0.021
                body = chair.bodies["chair"]
                assert np.linalg.norm(body.velocity) == pytest.approx(2.0, rel=0.01)
        before = snapshot
    assert entered == 6  # 116 m go by


@pytest.mark.long
@needs_jit
def test_a_day_in_eleven_minutes():
    """800 m with chairs: starts, stops, emergency stops, reversals; no failed or halved step, spacing kept."""
    simulation = chairlift()
    scenario = simulation.scenario
    random = np.random.default_rng(4)
    plan = {0.0: 2.5, 150.0: 0.0, 170.0: 2.5, 300.0: -2.5, 480.0: 1.0, 560.0: 2.5}
    plan |= {610.0 + 5.0 * k: float(random.uniform(-2.5, 2.5)) for k in range(10)}
    loops = np.array([vehicle.arc_length for vehicle in scenario.vehicles.values()])
    rail = LEAVING * 838.0 / 80  # m before an end, where a chair is off the rope if that goes there and is not slow
    seen = set()
    for second in range(661):
        if second in plan:
            simulation.command("haul_rope", speed=plan[second])
        if second == 250:
            simulation.emergency_stop()
        if second == 265:
            simulation.emergency_stop(active=False)
            simulation.command("haul_rope", speed=2.5)
        snapshot = simulation.advance_to(second + 1.0)
        assert snapshot.solver.halvings == 0
        assert snapshot.solver.constraint_residual < 1e-9
        assert all(np.isfinite(column).all() for column in (snapshot.columns.body_position, snapshot.cable.positions))
        assert snapshot.cable.tensions.min() > 1e5
        expected = (loops + snapshot.drives["haul_rope"].position) % scenario.loop_length
        for (name, chair), place in zip(snapshot.carriages.items(), expected, strict=True):
            if rail < place < 838.0 - rail or place > 838.0:
                assert chair.attached == (place <= 838.0)
            assert abs(chair.bodies["chair"].pitch) < 0.5
            if chair.attached:
                seen.add(name)
                assert chair.arc_length == pytest.approx(place, abs=1e-9)
            else:
                assert chair.arc_length in (0.0, 838.0)
                assert chair.speed == chair.drive_force == chair.bodies["chair"].velocity[0] == 0.0
    assert len(seen) > 20


def test_joint_states_list_the_drive_after_the_carriages():
    simulation = short_lift()
    simulation.command("haul_rope", speed=1.0)
    snapshot = simulation.advance_to(1.0)
    encoder = MessageEncoder(simulation.layout)
    message = decode(dict(encoder.frame(snapshot, ["joint_states"]))["joint_states"], "sensor_msgs/msg/JointState")
    assert message.name[:8] == [*simulation.carriages, "haul_rope", "chair_1_chair"]
    drive = snapshot.drives["haul_rope"]
    assert (message.position[6], message.velocity[6], message.effort[6]) == (drive.position, drive.speed, drive.force)
    for array in (message.position, message.velocity, message.effort):
        assert np.all(np.isfinite(array))
