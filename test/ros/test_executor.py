"""Choice of the node's executor, and the node on both kinds."""

from __future__ import annotations

import sys

import pytest

pytest.importorskip("rclpy")
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from cable_twin.ros.startup import new_executor


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
