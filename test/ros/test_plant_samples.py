"""Samples of a plant: what is left out and said, stamps of other clocks, and messages that a twin reads back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cable_twin.messages import SECOND, decode, stamp_in
from cable_twin.messages.sensor_messages import Imu, WrenchStamped, measurements_from_message
from cable_twin.messages.topics import JointState, Vector3Stamped
from cable_twin.ros.door.clocks import Correction, OneWay, RoundTrips
from cable_twin.ros.door.link import without
from cable_twin.ros.door.plant_map import Tag
from cable_twin.ros.door.samples import Measured, Sample, TagState
from cable_twin.ros.door.tags_to_messages import Assembly
from cable_twin.scenario.schema import Sensor

NOW = 1_800_000_000 * SECOND
TENTH = SECOND // 10


def tag(**changed):
    return Tag.model_validate(
        {"source": "plc", "address": "ns=2;i=1", "quantity": "support_force", "of": "tower", "unit": "kN", **changed}
    )


class Told:
    """Lines that were told, newest last."""

    def __init__(self):
        self.lines = []

    def __call__(self, level, text):
        self.lines.append((level, text))

    def texts(self):
        lines, self.lines = self.lines, []
        return [text for _, text in lines]


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def judge(told):
    """Judge of the samples of one tag, 0.1 s apart."""

    def make(**changed):
        state, number = TagState("load", tag(**changed), told), 0

        def take(value, quality="good", detail="", age=0.0, after=0.1):
            nonlocal number
            number += round(after * SECOND)
            stamp_ns = NOW + number - round(age * SECOND)
            found = state.take(Sample("load", value, quality, detail, stamp_ns, NOW + number))
            return None if found is None else found.value

        return state, take

    return make


def test_a_value_gets_scale_offset_sign_and_unit(judge):
    _, take = judge(scale=2.0, offset=-1.0, sign=-1)
    assert take(3.0) == -5000.0
    assert take(4) == -7000.0


@pytest.mark.parametrize(
    ("value", "line"),
    [
        (math.nan, "given nan; allowed: a finite number, in kN"),
        (math.inf, "given inf; allowed: a finite number, in kN"),
        (10**400, "given a huge number; allowed: a finite number, in kN"),
        ("12,5", "given '12,5'; allowed: a number, in kN"),
        (True, "given a bool; allowed: a number, in kN"),
        (None, "given a NoneType; allowed: a number, in kN"),
        ([1.0], "given a list; allowed: a number, in kN"),
        (700.0, "given 700 kN; allowed: 5 to 600 kN"),
        (250_000.0, "given 250000 kN; allowed: 5 to 600 kN; a thousand times off: another unit?"),
        (0.25, "given 0.25 kN; allowed: 5 to 600 kN; a thousand times off: another unit?"),
        (4.9, "given 4.9 kN; allowed: 5 to 600 kN"),
    ],
)
def test_a_value_that_cannot_be_is_left_out_with_one_line(judge, told, value, line):
    state, take = judge(range=[5.0, 600.0])
    assert take(250.0) == 250e3
    for _ in range(50):
        assert take(value) is None
    assert told.texts() == [f"tags.load: {line}; left out until it is right again"]
    assert take(251.0) == 251e3
    assert told.texts() == ["tags.load: right again, after 50 samples left out"]
    assert state.counts["taken"] == 2


def test_bad_quality_is_left_out_and_uncertain_is_where_the_map_says_so(judge, told):
    _, take = judge()
    assert take(1.0, "uncertain", "UncertainSensorNotAccurate") is None
    assert take(1.0, "bad", "BadSensorFailure") is None
    assert told.texts() == [
        "tags.load: given quality UncertainSensorNotAccurate; allowed: good; left out until it is right again"
    ]
    _, lenient = judge(quality="uncertain")
    assert lenient(1.0, "uncertain", "UncertainSensorNotAccurate") == 1000.0
    assert lenient(1.0, "bad", "BadSensorFailure") is None
    assert told.texts() == [
        "tags.load: given quality BadSensorFailure; allowed: good or uncertain; left out until it is right again"
    ]


def test_a_tag_that_changes_its_mind_with_each_sample_is_no_flood(judge, told):
    _, take = judge()
    for _ in range(200):  # 40 s
        take(1.0)
        take(math.nan)
    assert len(told.texts()) <= 10


def test_a_reason_that_came_too_soon_to_be_said_is_said_later(judge, told):
    state, take = judge(range=[1.0, 2.0])
    take(0.0)
    take(1.5)
    take(math.nan)
    assert len(told.texts()) == 2
    for second in range(15):
        state.check_age(NOW + second * SECOND)
    assert told.texts() == ["tags.load: given nan; allowed: a finite number, in kN; left out until it is right again"]


@pytest.mark.parametrize(
    ("age", "words"), [(3600.0, "3600 s ago"), (-7200.0, "7200 s from now"), (0.5, None), (-0.5, None)]
)
def test_a_stamp_of_another_clock_is_left_out(judge, told, age, words):
    _, take = judge()
    assert (take(1.0, age=age) is None) == (words is not None)
    expected = f"tags.load: given a stamp {words}; allowed: 60 s ago to 1 s from now, else `stamp: receipt`; left out"
    assert [text.partition(" until")[0] for text in told.texts()] == ([expected] if words else [])


def test_silence_is_said_once_and_its_end(judge, told):
    state, take = judge(stale_after=2.0)
    take(1.0)
    for tenths in range(40):
        state.check_age(NOW + SECOND + tenths * TENTH)
    assert told.texts() == ["tags.load: no sample for 2 s; left out until it is right again"]
    assert take(1.0, after=5.0) == 1000.0
    assert told.texts() == ["tags.load: right again"]


@pytest.mark.parametrize("hold", [False, True])
def test_a_tag_that_never_got_a_value_is_named(judge, told, hold):
    state, take = judge(stale_after=2.0, hold=hold)
    for tenths in range(20):
        state.check_age(NOW + tenths * TENTH)
    assert told.texts() == []
    for tenths in range(20, 40):
        state.check_age(NOW + tenths * TENTH)
    assert told.texts() == ["tags.load: no sample for 2 s; left out until it is right again"]
    assert take(1.0, after=5.0) == 1000.0
    told.texts()
    for tenths in range(60, 300):
        state.check_age(NOW + tenths * TENTH)
    assert len(told.texts()) == (not hold)  # a held value stays


def test_an_old_sample_after_a_new_connection_is_not_published_again(judge, told):
    state, take = judge()
    assert take(1.0) == 1000.0
    assert take(1.0, age=0.2) is None
    assert state.reason == ""
    assert told.texts() == []


# --- clocks


def asked(trips, offset, *, renewed=0, delays=(0.002,), every=0.01, count=200, start=NOW):
    """Ask a clock that is renewed every `renewed` ns, with delays (s) of question and answer in turn."""
    now = start
    for number in range(count):
        delay = round(delays[number % len(delays)] * SECOND)
        theirs = now + delay + offset
        theirs = theirs // renewed * renewed if renewed else theirs
        trips.add(now, theirs, now + 2 * delay)
        now += 2 * delay + round(every * SECOND)
    return trips.best


def test_an_offset_is_that_of_the_quickest_question():
    found, uncertainty = asked(RoundTrips(), 3600 * SECOND, delays=(0.04, 0.003, 0.025))
    assert uncertainty == 3_000_000
    assert abs(found - 3600 * SECOND) <= uncertainty


def test_a_clock_that_is_renewed_once_a_second_is_known_better_than_that():
    offset = 12 * SECOND + 345_678_901
    found, uncertainty = asked(RoundTrips(), offset, renewed=SECOND)
    assert uncertainty <= 10_000_000
    assert abs(found - offset) <= uncertainty


def test_a_clock_that_is_set_is_followed_at_once():
    trips = RoundTrips()
    asked(trips, 0, count=10)
    trips.begin()
    found, _ = asked(trips, 7200 * SECOND, delays=(0.04,), count=4, start=NOW + 10 * SECOND)
    assert found == pytest.approx(7200 * SECOND, abs=40_000_000)


def test_one_way_the_quickest_message_of_a_minute_counts():
    one_way = OneWay()
    for number, delay in enumerate((0.4, 0.1, 0.3, 0.2)):
        stamp = NOW + number * SECOND
        one_way.add(stamp - 100 * SECOND, stamp + round(delay * SECOND))
    assert one_way.best == -round(100.1 * SECOND)
    for number in range(4, 70):
        stamp = NOW + number * SECOND
        one_way.add(stamp - 100 * SECOND, stamp + round(0.3 * SECOND))
    assert one_way.best == -round(100.3 * SECOND)


def test_an_offset_is_said_once_and_again_when_it_has_changed(told):
    correction = Correction("plc: its clock", told, correct=True)
    for jitter in range(10):
        correction.update(3600 * SECOND + jitter * 1_000_000, 400_000)
    assert told.texts() == ["plc: its clock is 3600 s ahead of ours (+-0.4 ms); stamps are shifted by that"]
    assert correction.shift_ns == 3600 * SECOND + 9_000_000
    correction.update(-2_000_000, 300_000)
    assert told.texts() == ["plc: its clock is now 2 ms behind ours (+-0.3 ms); stamps are shifted by that"]
    correction.update(-1_000_000, 3_000_000)
    assert correction.shift_ns == 0
    trusted = Correction("plc: its clock", told, correct=False)
    trusted.update(2 * SECOND, 400_000)
    assert trusted.shift_ns == 0
    assert told.texts() == ["plc: its clock is 2 s ahead of ours (+-0.4 ms); stamps are taken as they are"]


def test_a_delay_is_no_other_clock(told):
    now = [1000.0]
    correction = Correction("broker: its clock", told, correct=True, tolerance_ns=10 * SECOND, clock=lambda: now[0])
    correction.update(-TENTH)
    assert (correction.shift_ns, told.texts()) == (0, [])
    for tenths in range(31):  # of a plant that is slower than time
        now[0] += 3.0
        correction.update(-tenths * TENTH)
    assert correction.shift_ns == 0
    lines = told.texts()
    assert len(lines) == 1
    assert lines[0].endswith("s behind ours, or its messages are late; stamps are taken as they are")
    correction.update(-3600 * SECOND)
    assert correction.shift_ns == -3600 * SECOND
    assert told.texts() == [
        "broker: its clock is now 3600 s behind ours, or its messages are late; stamps are shifted by that"
    ]


def test_secrets_are_replaced_in_what_a_library_says():
    assert without(["Hunter2x"], "login operator:Hunter2x failed") == "login operator:*** failed"


# --- messages


def sent(tags, *samples):
    """Messages of samples: tag, value in SI units, and time (s)."""
    measured = [(name, Measured(NOW + round(time * SECOND), value)) for name, value, time in samples]
    return Assembly(tags).take(measured)


def test_samples_of_one_scan_are_one_message_that_a_twin_reads_back():
    tags = {
        "s": tag(quantity="position", of="cabin", unit="m"),
        "v": tag(quantity="speed", of="cabin", unit="m/s"),
        "f": tag(quantity="drive_force", of="cabin", unit="kN"),
        "x": tag(axis="x"),
        "z": tag(axis="z"),
        "p": tag(quantity="pitch", of="cabin", unit="deg", deviation=0.5),
        "r": tag(quantity="roll", of="cabin", unit="deg"),
    }
    kinds = {"encoder": "cabin", "drive_force": "cabin", "load_cell": "tower", "inclinometer": "cabin"}
    sensors = {kind: Sensor(kind=kind, of=of) for kind, of in kinds.items()}
    sensors["roll"] = Sensor(kind="inclinometer", of="cabin", axis="roll")
    values = {"v": 5.0, "s": 120.0, "f": 4e4, "z": 3e5, "x": -2e4, "p": 0.1, "r": -0.2}
    ready = sent(tags, *((name, value, 0.001 * row) for row, (name, value) in enumerate(values.items())))
    found = {}
    for topic, data in ready:
        own = f"sensors/{topic.removeprefix('/plant/')}"
        found |= {one.sensor: one.values for one in measurements_from_message(own, data, sensors, NOW)}
    assert found["encoder"] == (120.0, 5.0)
    assert found["drive_force"] == (4e4,)
    assert found["load_cell"] == (-2e4, 0.0, 3e5)
    assert found["inclinometer"] == pytest.approx((0.1,))
    assert found["roll"] == pytest.approx((-0.2,))
    imu = decode(next(data for topic, data in ready if "inclinometer" in topic), Imu.__msgtype__)
    assert imu.orientation_covariance[4] == pytest.approx(math.radians(0.5) ** 2)
    assert imu.angular_velocity_covariance[0] == -1.0


def test_a_burst_keeps_every_scan_and_a_rate_thins_it():
    tags = {"s": tag(quantity="position", of="cabin", unit="m", rate=10.0)}
    ready = sent(tags, *(("s", float(row), 0.05 * row) for row in range(9)))
    assert [stamp_in(one.data) for one in ready] == [NOW + row * TENTH for row in range(5)]


def test_a_speed_goes_along_while_it_is_fresh():
    tags = {
        "s": tag(quantity="position", of="cabin", unit="m"),
        "v": tag(quantity="speed", of="cabin", unit="m/s", stale_after=1.0),
    }
    ready = sent(tags, ("v", 5.0, 0.0), ("s", 1.0, 0.5), ("s", 2.0, 3.0))
    messages = [decode(one.data, JointState.__msgtype__) for one in ready]
    assert [[*one.velocity] for one in messages] == [[5.0], []]


def test_a_vector_waits_for_all_its_axes_and_forgets_a_bad_one():
    tags = {"x": tag(axis="x"), "z": tag(axis="z")}
    assembly = Assembly(tags)
    assert assembly.take([("x", Measured(NOW, 1.0))]) == []
    (ready,) = assembly.take([("z", Measured(NOW + SECOND, 2.0))])
    force = decode(ready.data, WrenchStamped.__msgtype__).wrench.force
    assert (force.x, force.y, force.z) == (1.0, 0.0, 2.0)
    assembly.drop("x")
    assert assembly.take([("z", Measured(NOW + 2 * SECOND, 3.0))]) == []


def test_a_load_cell_has_the_direction_of_the_map():
    (ready,) = sent({"f": tag(direction=[3.0, 0.0, -4.0])}, ("f", 10.0, 0.0))
    force = decode(ready.data, WrenchStamped.__msgtype__).wrench.force
    assert (force.x, force.y, force.z) == pytest.approx((6.0, 0.0, -8.0))


@pytest.mark.parametrize(
    ("direction", "along", "left"),
    [(0.0, -5.0, 0.0), (180.0, 5.0, 0.0), (90.0, 0.0, 5.0), (270.0, 0.0, -5.0)],
)
def test_wind_by_speed_and_direction_is_along_the_track_and_to_its_left(direction, along, left):
    """Track to the north: wind from the north is against it, from the east it goes to the left, the west."""
    tags = {
        "v": tag(quantity="wind_speed", unit="m/s"),
        "d": tag(quantity="wind_direction", unit="deg", heading=0.0),
    }
    for turn in (0.0, 75.0):
        tags["d"] = tags["d"].model_copy(update={"heading": turn})
        ready = sent(tags, ("d", math.radians(direction + turn), 0.0), ("v", 5.0, 0.0))
        wind = decode(ready[-1].data, Vector3Stamped.__msgtype__).vector
        assert np.array([wind.x, wind.y, wind.z]) == pytest.approx([along, left, 0.0], abs=1e-9)
