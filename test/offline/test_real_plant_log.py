"""Bags of a real plant, with /plant/... topics alone: what `follow` and `calibrate` read from them."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from cable_twin.frame.records import AppliedCommand
from cable_twin.frame.sensors import standard_sensors
from cable_twin.messages import SECOND, FrameNames, JointState, header, nanoseconds, serialize
from cable_twin.messages.sensor_messages import SensorOutput, plant_name, sensor_topic
from cable_twin.messages.texts import readmitted_message
from cable_twin.offline import calibrate, follow, plant
from cable_twin.offline.calibration.data import CalibrationError, package
from cable_twin.offline.following.plant_log import PlantLog, read_plant_log
from cable_twin.recording.log_file import LogError
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

NAME = "aerial_tramway"
COARSE = {"cable.elements": {"target": 20.0, "at_towers": 6.0, "growth": 1.7}}  # for speed
BEGAN = 1_800_000_000 * SECOND  # ns since 1970
DURATION = 6.0  # s


@pytest.fixture(scope="module")
def scenario():
    bare = load_scenario(NAME, COARSE)
    return load_scenario(NAME, {**COARSE, "sensors": standard_sensors(bare, Simulation(bare).snapshot)})


@pytest.fixture(scope="module")
def bag(scenario, tmp_path_factory):
    """Bag as of `ros2 bag record`: a plant that stands, and is told so ten times a second."""
    path = tmp_path_factory.mktemp("plant") / "recorded_0.mcap"
    running = Simulation(scenario, samples=2)
    output = SensorOutput(scenario, running.layout, FrameNames())
    messages = []
    for frame in range(round(DURATION / 0.1) + 1):
        stamp = BEGAN + nanoseconds(0.1 * frame)
        still = JointState(header(stamp, "x"), ["cabin"], np.empty(0), np.zeros(1), np.empty(0))
        snapshot = running.advance_to(round(0.1 * frame, 9))
        own = [(plant_name(topic), data) for topic, data in output.messages(snapshot, BEGAN)]
        messages += [(topic, stamp, data) for topic, data in [*own, ("/plant/joint_commands", serialize(still))]]
    write(path, messages)
    return path


def write(path, messages):
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channels = {topic: writer.register_channel(topic, "cdr", 0) for topic, *_ in messages}
        for topic, stamp, data in messages:
            writer.add_message(channels[topic], stamp, data, stamp)
        writer.finish()


def test_measurements_and_commands_of_a_real_plant_are_read(scenario, bag):
    recorded = PlantLog(read_plant_log(bag.parent, NAME), scenario.sensors)
    items = [*recorded.items()]
    commands = [one for one in items if isinstance(one, AppliedCommand)]
    measured = [one for one in items if not isinstance(one, AppliedCommand)]
    assert recorded.real
    assert [(one.command.kind, one.command.values) for one in commands] == [("speed", {"cabin": 0.0})]  # once
    assert {one.sensor for one in measured} == {*scenario.sensors}
    assert all(0.0 <= one.time <= DURATION for one in measured)
    assert len(measured) > 0.8 * len(scenario.sensors) * 10.0 * DURATION


def test_sensors_that_counted_again_do_so_as_well_where_the_log_is_followed(scenario, bag, tmp_path):
    with bag.open("rb") as stream:
        messages = [(channel.topic, one.log_time, one.data) for _, channel, one in make_reader(stream).iter_messages()]
    again = ("/cable_twin/readmitted", BEGAN + 2 * SECOND, readmitted_message("load_end"))
    write(tmp_path / "twin_0.mcap", sorted([*messages, again], key=lambda one: one[1]))
    taken = list[tuple[float, str]]()

    class Told:
        """Tracker that notes what it is told."""

        def measure(self, _, arrival):
            self.now = arrival

        def command(self, _, arrival):
            pass

        def readmit(self, sensor):
            taken.append((self.now, sensor))

        def advance(self, _):
            return ()

    recorded = PlantLog(read_plant_log(tmp_path, NAME), scenario.sensors)
    assert not [*follow._as_live(recorded, Told(), DURATION)]
    assert taken == [(2.0, "load_end")]
    assert [*recorded.items()] == [*PlantLog(read_plant_log(bag.parent, NAME), scenario.sensors).items()]


def test_without_a_scenario_such_a_bag_is_refused_with_the_way_out(bag):
    with pytest.raises(LogError, match=r"with --scenario the topics /plant/\.\.\. of any bag are read"):
        read_plant_log(bag, None)


def test_a_bag_without_topics_of_a_plant_is_refused_by_their_names(scenario, bag, tmp_path):
    path = tmp_path / "other_0.mcap"
    write(path, [("/elsewhere", BEGAN, b"\0\1\0\0")])
    said = PlantLog(read_plant_log(path, NAME), scenario.sensors).nothing(scenario.sensors)
    assert "/plant/joint_states" in said
    assert "\n" not in said


def test_a_twin_follows_a_real_plant_from_where_it_is(bag, tmp_path, capfd):
    options = [str(bag), "--scenario", NAME, "--output", str(tmp_path)]
    for key, value in COARSE["cable.elements"].items():
        options += ["--set", f"cable.elements.{key}={value}"]
    assert follow.main(options) == follow.DONE
    out, said = capfd.readouterr()
    assert "cabin/payload" in out
    assert "follows the plant from" in said


@pytest.fixture(scope="module")
def split(tmp_path_factory):
    """Directory with the second file of a bag of `plant`: under way at its beginning, and later at rest."""
    path = tmp_path_factory.mktemp("split")
    (path / "trip.yaml").write_text("- {time: 1, name: cabin, speed: 3.0}\n- {time: 8, name: cabin, speed: 0.0}\n")
    options = ["--set", "carriages.cabin.payload.mass=4200", "--script", str(path / "trip.yaml"), "--duration", "20"]
    for key, value in COARSE["cable.elements"].items():
        options += ["--set", f"cable.elements.{key}={value}"]
    assert plant.main([NAME, *options, "--log", str(path / "whole")]) == 0
    (whole,) = (path / "whole").glob("*/*.mcap")
    for name, end in (("second", 99.0), ("moving", 7.5)):
        (path / name).mkdir()
        cut(whole, path / name / "part_1.mcap", 5.0, end)
    return path


def cut(whole, part, begin, end):
    """Write what a bag has between two times (s) of its run, with its scenario, as the later file of a split bag."""
    with whole.open("rb") as source, part.open("wb") as stream:
        reader, writer, channels = make_reader(source), Writer(stream), {}
        writer.start()
        for one in reader.iter_metadata():
            writer.add_metadata(one.name, one.metadata)
        first = None
        for _, channel, message in reader.iter_messages():
            first = message.log_time if first is None else first
            if begin <= (message.log_time - first) / SECOND < end or channel.topic.endswith("/scenario"):
                if channel.topic not in channels:
                    channels[channel.topic] = writer.register_channel(channel.topic, "cdr", 0)
                writer.add_message(channels[channel.topic], message.log_time, message.data, message.publish_time)
        writer.finish()


def test_a_file_that_begins_under_way_is_followed_from_where_its_plant_stands(split, capfd):
    assert follow.main([str(split / "second"), "--output", str(split)]) == follow.DONE
    out, said = capfd.readouterr()
    assert "waits until cabin of the plant stands still" in said
    assert "contradict" not in said
    (found,) = (row.split() for row in out.splitlines() if row.startswith("cabin/payload"))
    value, band = float(found[1]), float(found[3])
    assert value == pytest.approx(4200.0, abs=2.0 * band)
    assert band < 1500.0


def test_a_file_in_which_the_plant_never_stands_is_refused_in_a_line(split, capfd):
    assert follow.main([str(split / "moving"), "--output", str(split)]) == follow.UNUSABLE
    *_, said = capfd.readouterr().err.splitlines()
    assert "given a plant that never stands still for 1 s; allowed: a log in which it does" in said


def test_a_calibration_begins_where_its_plant_does(scenario, bag):
    log = read_plant_log(bag, NAME)
    elsewhere = load_scenario(scenario.resolved(), {"carriages.cabin.arc_length": 40.0})
    readings = calibrate.readings(scenario, Simulation(scenario).layout, dict.fromkeys(("start", "end", "tower"), 1e6))
    assert package(log, scenario, readings, print).series
    with pytest.raises(CalibrationError, match=r"encoder_cabin: given 12\.0. m at first; allowed: 40 m"):
        package(log, elsewhere, readings, print)


def test_topics_of_a_plant_are_those_of_a_twin_elsewhere(scenario):
    assert plant_name(sensor_topic(scenario.sensors["load_end"])) == "/plant/supports/end/force"
