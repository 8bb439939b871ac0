"""Emergency stop answered under any load of a twin."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest
from test_command_subscriber import MANY, command

pytest.importorskip("rclpy")
from rclpy.qos import QoSProfile
from std_srvs.srv import SetBool

FLOOD = 20  # messages, each of which took 9.5 s
PROMPT = 5.0  # s; a busy machine has some
BURST = 200  # calls at once; of ten that wait the others were lost


@pytest.fixture
def client(running):
    """Client that the twin has answered once, so that it knows where answers go."""
    _, participant = running
    made = participant.node.create_client(SetBool, "/cable_twin/emergency_stop", qos_profile=QoSProfile(depth=BURST))
    participant.answer(made, SetBool.Request(data=False))
    yield made
    participant.node.destroy_client(made)


def calls(participant, client, count):
    """Answers to a number of simultaneous calls, and time (s) until the last answer."""
    begin = time.monotonic()
    futures = [client.call_async(SetBool.Request(data=number % 2 == 0)) for number in range(count)]
    participant.until(lambda: all(future.done() for future in futures), what="all answers")
    return [future.result() for future in futures], time.monotonic() - begin


def test_every_one_of_many_calls_is_answered(running, client):
    _, participant = running
    answers, _ = calls(participant, client, BURST)
    assert all(answer.success for answer in answers)
    told = {re.split(" at |, from ", answer.message)[0] for answer in answers}
    assert told >= {"emergency stop", "emergency stop released"}
    assert told <= {"emergency stop", "emergency stop released", "no emergency stop was in force"}
    assert participant.next_diagnostics()[2]["emergency_stop"] == "false"  # in the order in which they were asked


@pytest.mark.parametrize(
    "message",
    [
        command(*(f"n{number}" for number in range(MANY))),
        command("cabin", frame="f" * 5_500_000),
        command(*[""] * 8000),  # as many as there are in 64 kB
    ],
    ids=["names", "frame", "empty names"],
)
def test_no_message_holds_it_up(running, client, message):
    process, participant = running
    length = len(process.output)
    refused = int(participant.next_diagnostics()[2]["commands_refused"])
    for _ in range(FLOOD):
        participant.publisher.publish(message)
    answers, seconds = calls(participant, client, 2)
    assert [answer.success for answer in answers] == [True, True]
    assert seconds < PROMPT
    participant.until(lambda: int(participant.diagnostics[2]["commands_refused"]) == refused + FLOOD, what="refusals")
    assert len(process.output) - length < 10_000
    participant.publish(name=["cabin"], velocity=[1.0])
    participant.until(lambda: participant.applied and participant.applied[-1].command.values == {"cabin": 1.0})
    assert np.isfinite(participant.speed)
