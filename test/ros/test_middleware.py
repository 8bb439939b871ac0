"""Middleware settings of the twin's participants, and the executor of its node."""

from __future__ import annotations

import os
import socket
import struct
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import islice
from pathlib import Path
from shutil import which
from subprocess import run
from xml.etree import ElementTree

import pytest
from twin_process import COMPILING, write_quick_scenario

pytest.importorskip("rclpy")
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from cable_twin.ros.startup import (
    ANNOUNCED_EVERY,
    ANNOUNCEMENTS,
    DISCOVERY,
    MAKING,
    OLDER_PROFILES,
    PROFILES,
    READY,
    SHARED_MEMORY,
    _remove,
    _unfinished,
    discovery_time,
    new_executor,
    remove_unfinished_ports,
    take_profile,
)

LEASE_DURATION, BUILTIN_ENDPOINT_SET = 0x0002, 0x0058  # parameters that participants announce: RTPS 2.5, table 9.14
TYPE_LOOKUP = 0xF000  # its bits of the service that asks for types: XTypes 1.3, 7.6.3.3.3
DATA, PARTICIPANTS = 0x15, bytes.fromhex("000100c2")
AT_ONCE = 6  # announcements that come at once, at the start of a participant
# a shell with a shared memory of its own: all twins of the machine remove half-made ports, and tell what they removed
OWN_MEMORY = f'mount -t tmpfs tmpfs {SHARED_MEMORY} && eval "$0"'
APART = (*["unshare", "--user", "--map-root-user", "--mount", "sh", "-c"], OWN_MEMORY)
MAY_BE_APART = which("unshare") is not None and run([*APART, "true"], capture_output=True, check=False).returncode == 0
PEERS = 32  # participants of a machine that rmw_fastrtps announces itself to, with LOCALHOST


def test_profiles_of_the_user_are_left_alone(monkeypatch):
    for name in (PROFILES, OLDER_PROFILES):
        monkeypatch.delenv(PROFILES, raising=False)
        monkeypatch.delenv(OLDER_PROFILES, raising=False)
        monkeypatch.setenv(name, "mine.xml")
        take_profile()
        assert os.environ.get(name) == "mine.xml"
        assert discovery_time("rmw_fastrtps_cpp") == DISCOVERY
        assert (PROFILES in os.environ) == (name == PROFILES)


def write_port(path: Path, word: int, age: float) -> Path:
    """Write a shared memory port as left some seconds after a kill."""
    path.write_bytes(word.to_bytes(4, "little") + bytes(52396))
    then = time.time() - age
    os.utime(path, (then, then))
    return path


def test_only_ports_that_nobody_makes_any_more_are_removed(tmp_path):
    left = [
        write_port(tmp_path / "fastdds_port7000", READY, 2.0 * MAKING),
        write_port(tmp_path / "fastdds_port7001", 0, 0.0),
        write_port(tmp_path / "fastdds_port7002_el", 0, 2.0 * MAKING),
    ]
    unfinished = [write_port(tmp_path / f"fastdds_port{7003 + word}", word, 2.0 * MAKING) for word in (0, 1)]
    said = remove_unfinished_ports(tmp_path)
    assert [line.split(":")[0] for line in said] == [f"removed {port}" for port in unfinished]
    assert sorted(tmp_path.iterdir()) == left


def test_what_others_put_in_the_place_of_a_port_neither_holds_up_nor_is_removed(tmp_path):
    unfinished = write_port(tmp_path / "aside", 0, 2.0 * MAKING)
    os.mkfifo(tmp_path / "fastdds_port7000")
    (tmp_path / "fastdds_port7001").symlink_to(unfinished)
    (tmp_path / "fastdds_port7002").mkdir()
    for path in tmp_path.iterdir():
        os.utime(path, (0.0, 0.0), follow_symlinks=False)
    before = sorted(tmp_path.iterdir())
    assert remove_unfinished_ports(tmp_path) == []
    assert sorted(tmp_path.iterdir()) == before


def test_a_port_that_is_made_anew_meanwhile_stays(tmp_path):
    port = write_port(tmp_path / "fastdds_port7000", 0, 2.0 * MAKING)
    seen = _unfinished(port)
    write_port(tmp_path / "anew", READY, 0.0).replace(port)
    assert not _remove(port, seen)
    assert port.exists()


@pytest.mark.skipif(rclpy.get_rmw_implementation_identifier() != "rmw_fastrtps_cpp", reason="of Fast DDS")
@pytest.mark.skipif(not MAY_BE_APART, reason="no right to mount a shared memory of its own")
def test_twin_starts_where_a_killed_process_left_a_port_half_made(processes, domain, tmp_path):
    port = write_port(tmp_path / f"fastdds_port{7400 + 250 * domain + 11}", 0, 2.0 * MAKING)
    scenario = str(write_quick_scenario(tmp_path))
    leave_port_and_start = f'cp -p "$1" {SHARED_MEMORY} && shift && exec "$@"'
    command = [*APART, leave_port_and_start, str(port), sys.executable, "-m", "cable_twin.ros.sim"]
    twin = processes("--scenario", scenario, "--record", "false", "--outlook", "false", domain=domain, command=command)
    twin.wait_for("runs at")
    left = SHARED_MEMORY / port.name
    assert f"sim: removed {left}: left by a process that was killed while creating it" in twin.output


@pytest.mark.skipif(rclpy.get_rmw_implementation_identifier() != "rmw_fastrtps_cpp", reason="of Fast DDS")
def test_twin_asks_nobody_for_types_announces_itself_often_and_is_soon_known_to_be_gone(processes, domain, tmp_path):
    processes("--scenario", str(write_quick_scenario(tmp_path)), "--record", "false", domain=domain)
    said = announcements(domain, COMPILING)
    first = next(said)
    assert parameter(BUILTIN_ENDPOINT_SET, *first) & TYPE_LOOKUP == 0
    assert parameter(LEASE_DURATION, *first) == 5  # s
    *_, last = (time.monotonic() for _ in islice(said, AT_ONCE))
    *_, later = (time.monotonic() for _ in islice(said, 20))
    assert later - last < 30.0  # s: a minute, were it every 3 s


def test_time_of_discovery_is_that_of_the_profile(monkeypatch):
    for name in (PROFILES, OLDER_PROFILES):
        monkeypatch.setenv(name, "")  # so that it is as before after the test
        monkeypatch.delenv(name)
    take_profile()
    space = {"dds": "http://www.eprosima.com"}
    found = ElementTree.parse(os.environ[PROFILES]).find(".//dds:leaseAnnouncement", space)
    parts = [float(found.findtext(f"dds:{name}", None, space)) for name in ("sec", "nanosec")]
    assert parts[0] + 1e-9 * parts[1] == pytest.approx(ANNOUNCED_EVERY)
    assert discovery_time("rmw_fastrtps_cpp") == ANNOUNCEMENTS * ANNOUNCED_EVERY < DISCOVERY
    assert discovery_time("rmw_cyclonedds_cpp") == DISCOVERY


def announcements(domain: int, timeout: float) -> Iterator[tuple[bytes, str]]:
    """Discovery messages of participants in a domain: parameter lists and byte order."""
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as peer:
        peer.bind(("127.0.0.1", 7400 + 250 * domain + 10 + 2 * (PEERS - 1)))
        peer.settimeout(timeout)
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            packet = peer.recv(65536)
            place = 20  # behind the header
            while place + 24 <= len(packet):
                kind, flags, length = packet[place], packet[place + 1], packet[place + 2 : place + 4]
                order = "<" if flags & 1 else ">"
                content = packet[place + 4 : place + 4 + struct.unpack(f"{order}H", length)[0]]
                if kind == DATA and content[8:12] == PARTICIPANTS:
                    yield content[24:], order
                place += 4 + len(content)
    raise AssertionError("no participant announces itself")


def parameter(wanted: int, content: bytes, order: str) -> int:
    """First four bytes of a parameter in a list of them."""
    place = 0
    while place + 8 <= len(content):
        number, length = struct.unpack_from(f"{order}HH", content, place)
        if number == wanted:
            return int(struct.unpack_from(f"{order}I", content, place + 4)[0])
        place += 4 + length
    raise AssertionError(f"a participant does not announce parameter {wanted:#06x}")


@pytest.fixture
def context(domain):
    made = rclpy.Context()
    rclpy.init(context=made, domain_id=domain)
    yield made
    made.try_shutdown()


@pytest.mark.parametrize("there", [True, False])
def test_events_where_there_are_any_and_both_take_messages_and_time(monkeypatch, context, there):
    if there:
        pytest.importorskip("rclpy.experimental")
    else:
        monkeypatch.setitem(sys.modules, "rclpy.experimental", None)  # as before Jazzy: an ImportError
    executor = new_executor(context)
    assert isinstance(executor, SingleThreadedExecutor) is not there
    node = rclpy.create_node("listener", context=context)
    taken, ticks = [], []
    node.create_subscription(String, "words", taken.append, QoSProfile(depth=10), raw=True)
    publisher = node.create_publisher(String, "words", 10)
    node.create_timer(0.02, lambda: (ticks.append(1), publisher.publish(String(data="word"))))
    executor.add_node(node)
    for _ in range(2000):
        executor.spin_once(timeout_sec=0.05)
        if len(taken) > 3 and len(ticks) > 3:
            break
    assert len(taken) > 3
    assert all(b"word" in data for data in taken)
    executor.shutdown()
    node.destroy_node()
