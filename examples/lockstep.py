#!/usr/bin/env python3
"""Controller in lockstep with the twin: every frame waits for the controller, however slow.

The twin is paused. In turn, a command is sent and waited for on `applied_commands`, so that it is in force; `~/step`
takes a frame; its `joint_states` are read. A command acts on the very next frame, there is no other dead time, and the
numbers are the same in each run, whatever else the machine does.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool, Trigger

TWIN = "/cable_twin"


class LockstepError(Exception):
    """Reason in one line for a twin that cannot be stepped."""


class Lockstep:
    """Paused twin stepped frame by frame.

    Attributes:
        state: newest message of `joint_states`.
        reference: newest message of `joint_references`.
    """

    def __init__(self, node: Node, patience: float) -> None:
        """Pause the twin and take its first frame; `patience` (s of the clock) limits every answer."""
        self._node, self._patience, self._applied = node, patience, 0
        self.state: JointState | None = None
        self.reference: JointState | None = None
        self._commands = node.create_publisher(JointState, f"{TWIN}/joint_commands", 10)
        node.create_subscription(JointState, f"{TWIN}/applied_commands", self._on_applied, 10)
        node.create_subscription(JointState, f"{TWIN}/joint_states", self._on_state, 10)
        node.create_subscription(JointState, f"{TWIN}/joint_references", self._on_reference, 10)
        self._pause, self._step = (
            node.create_client(SetBool, f"{TWIN}/pause"),
            node.create_client(Trigger, f"{TWIN}/step"),
        )
        self._until(self._commands.get_subscription_count, "a twin that listens")
        self._call(self._pause, SetBool.Request(data=True))
        self.step()

    def command(self, **speeds: float) -> None:
        """Command speeds (m/s) of carriages or drives, and wait until they take effect."""
        before = self._applied
        self._commands.publish(JointState(name=list(speeds), velocity=list(speeds.values())))
        self._until(lambda: self._applied > before, "a command that takes effect, see refused_commands")

    def step(self) -> None:
        """Step one frame, and wait for its data."""
        self.state = self.reference = None
        self._call(self._step, Trigger.Request())
        self._until(lambda: self.state and self.reference, "joint_states")

    def of(self, name: str) -> tuple[float, float, float, float]:
        """Place (m), speed (m/s) and drive force (N) of a carriage or drive, and the speed (m/s) of its reference."""
        state, reference = self.state, self.reference
        row, follows = state.name.index(name), reference.velocity[reference.name.index(name)]
        return state.position[row], state.velocity[row], state.effort[row], follows

    def resume(self) -> None:
        """Resume simulated time."""
        self._call(self._pause, SetBool.Request(data=False))

    def _call(self, client: Any, request: Any) -> None:
        if not client.wait_for_service(self._patience):
            raise LockstepError(f"no {client.srv_name}: is `sim` running, with the same ROS_DOMAIN_ID?")
        future = client.call_async(request)
        rclpy.spin_until_future_complete(self._node, future, timeout_sec=self._patience)
        answer = future.result()
        if answer is None or not answer.success:
            raise LockstepError(f"{client.srv_name}: {answer.message if answer else 'no answer'}")

    def _until(self, condition: Callable[[], Any], what: str) -> None:
        deadline = time.monotonic() + self._patience
        while not condition():
            rclpy.spin_once(self._node, timeout_sec=0.1)
            if time.monotonic() > deadline:
                raise LockstepError(f"{what}: not within {self._patience:g} s")

    def _on_applied(self, _: JointState) -> None:
        self._applied += 1

    def _on_state(self, message: JointState) -> None:
        self.state = message

    def _on_reference(self, message: JointState) -> None:
        self.reference = message


def main() -> int:
    """Drive to a place at the highest speed with a stop there, and print the motion."""
    parser = argparse.ArgumentParser(prog="lockstep.py", description="Drive a carriage to a place in lockstep.")
    parser.add_argument("name", help="carriage, or drive of a moving cable")
    parser.add_argument("--to", type=float, required=True, metavar="M", help="place (m) to go to")
    parser.add_argument("--gain", type=float, default=0.3, metavar="K", help="speed by distance, 1/s; default: 0.3")
    parser.add_argument("--deceleration", type=float, default=0.15, metavar="A", help="m/s^2; default: 0.15")
    parser.add_argument("--speed", type=float, default=3.0, metavar="V", help="m/s at most; default: 3")
    parser.add_argument("--frames", type=int, default=6000, help="frames at most; default: 6000")
    parser.add_argument("--wait", type=float, default=30.0, metavar="S", help="s to wait for an answer; default: 30")
    options = parser.parse_args()
    rclpy.init()
    try:
        twin = Lockstep(rclpy.create_node("lockstep"), options.wait)
        for frame in range(options.frames):
            place, speed, force, reference = twin.of(options.name)
            left = options.to - place
            if frame % 100 == 0:
                print(f"{frame:5d} {place:10.4f} m {speed:9.5f} m/s, reference {reference:9.5f} m/s, {force:10.1f} N")
            if abs(left) < 0.01 and abs(speed) < 0.01:
                break
            speed = min(options.gain * abs(left), math.sqrt(2.0 * options.deceleration * abs(left)), options.speed)
            twin.command(**{options.name: math.copysign(speed, left)})
            twin.step()
        twin.command(**{options.name: 0.0})
        print(f"{frame} frames, at {place:.4f} m with {speed:.5f} m/s")
        twin.resume()
    except LockstepError as error:
        print(f"lockstep.py: {error}", file=sys.stderr)
        return 1
    finally:
        rclpy.shutdown()
    return 0


if __name__ == "__main__":
    sys.exit(main())
