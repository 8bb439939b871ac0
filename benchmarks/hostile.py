"""Loads during an emergency stop: `python -m benchmarks.hostile LOAD DIRECTORY`, until ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

NODE = "/cable_twin"
RATE = 10_000  # messages in a second
BATCH = 0.01  # s
READERS = 10
WORLDS = "seed_example", "single_span"


def main() -> None:
    """Run a load."""
    import rclpy  # noqa: PLC0415 - an extra

    load, directory = sys.argv[1], Path(sys.argv[2])
    rclpy.init()
    node = rclpy.create_node(f"hostile_{load}")
    {"messages": _flood, "bombs": _bombs, "readers": _readers, "reader": _reader, "worlds": _worlds}[load](
        node, directory
    )


def _begin() -> None:
    print("begun", flush=True)


def _flood(node: Any, _: Path) -> None:
    """Send messages of all kinds at a constant mean rate."""
    from sensor_msgs.msg import JointState  # noqa: PLC0415 - an extra

    from cable_twin.messages import JointState as Wire  # noqa: PLC0415
    from cable_twin.messages import header, serialize  # noqa: PLC0415

    none = np.empty(0)

    def message(names: list[str], frame: str = "") -> bytes:
        return serialize(Wire(header(0, frame), names, none, np.full(len(names), 1.0), none))

    large = [message([f"n{number}" for number in range(20_000)]), message(["cabin"], "f" * 1_000_000)]
    small = [message(["nobody"]), b"\xff" * 40, message(["cabin"]), message(["\x1b[2J"] * 9), message(["cabin"] * 5)]
    publisher = node.create_publisher(JointState, f"{NODE}/joint_commands", 50)
    while not publisher.get_subscription_count():
        time.sleep(0.05)
    _begin()
    sent, started = 0, time.monotonic()
    while True:
        wanted = round((time.monotonic() - started) * RATE)
        for number in range(sent, wanted):
            rare = number % 1000 == 0
            publisher.publish(large[number // 1000 % 2] if rare else small[number % len(small)])
        sent = max(sent, wanted)
        time.sleep(BATCH)


def _bombs(node: Any, directory: Path) -> None:
    """Set the parameter `scenario` to alias bombs, a pipe and a device in turn."""
    lines = ["a0: &a0 [1, 2, 3]", *(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]" for n in range(1, 12))]
    (directory / "bomb.yaml").write_text("\n".join(lines) + "\n")
    os.mkfifo(directory / "pipe.yaml")
    (directory / "deep.yaml").write_text(f"cable: {'[' * 100_000}")
    (directory / "endless.yaml").symlink_to("/dev/zero")
    _load(node, [str(directory / f"{name}.yaml") for name in ("bomb", "pipe", "deep", "endless")])


def _worlds(node: Any, _: Path) -> None:
    """Load valid scenarios in turn: the twin restarts each time."""
    _load(node, list(WORLDS))


def _load(node: Any, names: list[str]) -> None:
    import rclpy  # noqa: PLC0415 - an extra
    from rcl_interfaces.srv import SetParameters  # noqa: PLC0415
    from rclpy.parameter import Parameter  # noqa: PLC0415

    client = node.create_client(SetParameters, f"{NODE}/set_parameters")
    client.wait_for_service()
    _begin()
    while True:
        for name in names:
            client.wait_for_service()
            given = Parameter("scenario", value=name).to_parameter_msg()
            future = client.call_async(SetParameters.Request(parameters=[given]))
            rclpy.spin_until_future_complete(node, future, timeout_sec=20.0)
            time.sleep(0.2)


def _readers(_: Any, directory: Path) -> None:
    """Run processes that subscribe reliably to the largest topics, and then stop reading."""
    command = [sys.executable, "-m", "benchmarks.hostile", "reader", str(directory)]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(READERS)]
    for process in started:
        assert process.stdout is not None
        process.stdout.readline()
        process.send_signal(signal.SIGSTOP)
    _begin()
    signal.pause()


def _reader(node: Any, _: Path) -> None:
    from sensor_msgs.msg import JointState, PointCloud2  # noqa: PLC0415 - an extra

    node.create_subscription(PointCloud2, f"{NODE}/cable", lambda _: None, 1000)
    node.create_subscription(JointState, f"{NODE}/joint_states", lambda _: None, 1000)
    while node.count_publishers(f"{NODE}/cable") == 0:
        time.sleep(0.05)
    _begin()
    signal.pause()


if __name__ == "__main__":
    main()
