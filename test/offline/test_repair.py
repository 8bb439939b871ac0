"""`review --repair`: a copy of a cut bag with an index, as needed by other tools."""

from __future__ import annotations

import shutil
from itertools import chain, repeat

import pytest
from bags import alter, bag, chunks_of, damage_middle, flip_chunk, unchanged
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader
from ruamel.yaml import YAML

from cable_twin.frame.records import Command
from cable_twin.messages import (
    APPLIED_COMMANDS,
    SCENARIO,
    MessageEncoder,
    TopicNames,
    nanoseconds,
    scenario_message,
    topics,
)
from cable_twin.messages.columns import COLUMNS, COLUMNS_TOPIC, GROUPS, RowEncoder
from cable_twin.messages.command_messages import applied_command_message
from cable_twin.offline import replay
from cable_twin.offline.review import main
from cable_twin.recording.log_reader import read_log
from cable_twin.recording.log_writer import McapLog, run_metadata
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

EPOCH = 1_700_000_000_000_000_000


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Finished run of two seconds of a node with a name of its own, in many chunks."""
    simulation = Simulation(load_scenario("single_span", {"cable.elements": 20}))
    directory = tmp_path_factory.mktemp("repair") / "run"
    resolved = simulation.scenario.resolved()
    metadata = run_metadata(resolved, simulation.layout, frame_period=0.01)
    names = TopicNames("/valley/twin", {"cable": "/rope", "joint_states": "/js"})
    log = McapLog(directory, (*topics(simulation.layout), COLUMNS_TOPIC), metadata, names=names)
    log.begin(EPOCH)
    encoder, rows = MessageEncoder(simulation.layout, EPOCH), RowEncoder(simulation.layout)
    log.write(SCENARIO, EPOCH, scenario_message(simulation.scenario.resolved()))
    for frame in range(200):
        snapshot = simulation.advance_to(frame * 0.01)
        for topic, data in ((COLUMNS, rows.encode(snapshot, GROUPS)), *encoder.frame(snapshot)):
            log.write(topic, EPOCH + nanoseconds(snapshot.time), data)
        if frame == 0:
            applied = simulation.apply(Command("speed", {"cabin": 2.0}), "script")
            log.write(APPLIED_COMMANDS, EPOCH, applied_command_message(applied, EPOCH))
        if frame % 20 == 0:
            log.flush()
    log.close()
    return directory


@pytest.fixture
def cut(whole, tmp_path):
    """Copy of the finished run, cut at three quarters as by a kill."""
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    content = bag(run).read_bytes()
    bag(run).write_bytes(content[: 3 * len(content) // 4])
    return run


def test_repaired_bag_is_opened_by_others_and_holds_the_same(cut, whole, capsys):
    before = bag(cut).read_bytes()
    with pytest.raises(Exception, match=r".+"), AnyReader([cut]) as reader:
        list(reader.messages())
    assert main([str(cut), "--repair"]) == 0
    assert bag(cut).read_bytes() == before
    repaired = cut.with_name("run_repaired")
    messages = list(read_log(cut).messages())
    assert f"{repaired}: {len(messages)} messages, all that could be read of {bag(cut)}" in capsys.readouterr().out
    assert len(messages) > 500
    log = read_log(repaired)
    assert log.complete
    assert list(log.messages()) == messages == list(read_log(whole).messages())[: len(messages)]
    assert log.metadata == read_log(cut).metadata
    with AnyReader([repaired]) as reader:
        assert reader.message_count == len(messages)
        found = {item.topic: item for item in reader.connections}
    with AnyReader([whole]) as reader:
        wanted = {item.topic: item for item in reader.connections}
    assert found.keys() == wanted.keys()
    for topic, item in wanted.items():
        assert found[topic].ext.offered_qos_profiles == item.ext.offered_qos_profiles
        assert (found[topic].msgtype, found[topic].digest) == (item.msgtype, item.digest)
    with bag(repaired).open("rb") as stream:
        summary = make_reader(stream, validate_crcs=True).get_summary()
    assert summary.statistics.message_count == len(messages)
    information = YAML(typ="safe").load(repaired / "metadata.yaml")["rosbag2_bagfile_information"]
    assert information["message_count"] == len(messages)


def test_file_alone_is_repaired_beside_it(cut, tmp_path, capsys):
    alone = shutil.copy(bag(cut), tmp_path / "alone.mcap")
    assert main([str(alone), "--repair"]) == 0
    assert read_log(tmp_path / "alone_repaired").complete
    capsys.readouterr()
    assert main([str(alone), "--repair"]) == 1
    error = capsys.readouterr().err
    assert error.startswith(f"review: --repair {alone}: File exists: {tmp_path / 'alone_repaired'}")
    assert error.count("\n") == 1


def test_damaged_bag_is_read_and_repaired_but_for_the_chunk_that_is_lost(whole, tmp_path, capsys, replayed):
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    damage_middle(bag(run))
    for arguments in (
        [str(run), "--no-viewer"],
        [str(run), "--repair"],
        [str(tmp_path / "run_repaired"), "--no-viewer"],
    ):
        assert main(arguments) == 0
    output = capsys.readouterr().out
    assert f"{bag(run)}: damaged, all else is read (0.81 to 1.00 s are lost: " in output
    assert f"{bag(tmp_path / 'run_repaired')}: complete; scenario" in output
    intact, rescued = list(read_log(whole).messages()), list(read_log(tmp_path / "run_repaired").messages())
    lost = [message for message in intact if message not in rescued]
    assert rescued == [message for message in intact if message not in lost]
    assert {message[1] for message in lost} == {EPOCH + frame * 10**7 for frame in range(81, 101)}
    for directory in (run, tmp_path / "run_repaired"):  # the index says that no command was in what is lost
        output = replayed(directory)
        assert "joint_states                                  180 samples,        0 differ" in output


@pytest.mark.parametrize("finished", [True, False], ids=["index", "no index"])
def test_a_replay_ends_where_a_command_may_be_lost(whole, tmp_path, finished, capsys):
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    chunks = chunks_of(bag(run))
    if finished:
        alter(bag(whole), bag(run), unchanged, chunk_size=300_000)  # whose chunks have commands where they are given
        chunks = chunks_of(bag(run))
    else:
        bag(run).write_bytes(bag(run).read_bytes()[:-1000])
    hit = chunks[0] if finished else chunks[len(chunks) // 2]
    flip_chunk(bag(run), hit)
    assert main([str(run), "--repair"]) == 0
    capsys.readouterr()
    for directory in (run, tmp_path / "run_repaired"):
        code = replay.main([str(directory)])
        printed = capsys.readouterr()
        if finished:  # from the start
            assert (code, printed.err.endswith("it contains no frame of the twin\n")) == (2, True)
            continue
        assert code == 0
        assert "101 samples" in printed.out or "81 samples" in printed.out
        assert "every sample agrees to the last bit" in printed.out


def test_odd_qos_of_topics_does_not_keep_a_bag_from_being_repaired(whole, tmp_path, capsys):
    run = tmp_path / "run"
    shutil.copytree(whole, run)
    odd = ["", "[", "- &a [*a]", "{}", "- 7", "- depth: -3", "- {reliability: [], depth: many}", "- !!python/x 1"]
    alter(bag(whole), bag(run), unchanged, qos=chain(odd, repeat("- {reliability: perhaps, durability: 3}")))
    bag(run).write_bytes(bag(run).read_bytes()[:-100])
    assert main([str(run), "--repair"]) == 0
    assert list(read_log(tmp_path / "run_repaired").messages()) == list(read_log(whole).messages())
    with AnyReader([tmp_path / "run_repaired"]) as reader:
        assert reader.message_count == len(list(read_log(whole).messages()))


def test_complete_bag_needs_no_repair(whole, capsys):
    assert main([str(whole), "--repair"]) == 0
    assert capsys.readouterr().out == f"{bag(whole)}: complete, nothing to repair\n"
    assert not whole.with_name("run_repaired").exists()
