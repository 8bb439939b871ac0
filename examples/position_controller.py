#!/usr/bin/env python3
"""Controller in fewer than fifty lines of plain rclpy: drives a carriage or lift to a place, slower the nearer it is.

It answers each `joint_states` with a command that carries the stamp of that state, so that `applied_commands` shows the
dead time of the loop, which it prints in the end. It is nowhere faster than half of the drive's deceleration can stop.
Run it beside `sim`: position_controller.py cabin 90; or beside `sim gondola`: position_controller.py haul_rope 30
"""

import json
import sys
from math import copysign, inf, sqrt
from statistics import median

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import String

GAIN, NEAR = 0.4, 0.05  # 1/s; m and m/s
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


class PositionController(Node):
    """Controller that answers each state with a speed."""

    def __init__(self, name: str, place: float) -> None:
        super().__init__("position_controller")
        self.name, self.place, self.last, self.sent, self.dead_times = name, place, None, {}, []
        self.commands = self.create_publisher(JointState, "/cable_twin/joint_commands", 10)
        self.create_subscription(String, "/cable_twin/scenario", self.on_scenario, LATCHED)
        self.create_subscription(JointState, "/cable_twin/applied_commands", self.on_applied, 10)

    def on_scenario(self, scenario: String) -> None:
        """Read the speed (m/s) and deceleration (m/s^2) that the drive allows, and begin."""
        found = json.loads(scenario.data)
        limits = (found["drives"].get(self.name) or found["carriages"][self.name]["drive"])["limits"]
        self.fastest, self.braking = limits["speed"] or inf, limits["deceleration"] or limits["acceleration"] or 1.0
        self.create_subscription(JointState, "/cable_twin/joint_states", self.on_state, 10)

    def on_state(self, state: JointState) -> None:
        """Command a speed (m/s), and end at the place."""
        row = state.name.index(self.name)
        left = self.place - state.position[row]
        arrived = abs(left) < NEAR and abs(state.velocity[row]) < NEAR
        speed = 0.0 if arrived else copysign(min(GAIN * abs(left), sqrt(self.braking * abs(left)), self.fastest), left)
        if speed != self.last:  # of a repeated speed no answer tells which of its commands it is of
            self.last, self.sent[speed] = speed, state.header.stamp
        self.commands.publish(JointState(header=state.header, name=[self.name], velocity=[speed]))
        if arrived:
            print(f"{self.name} is at {state.position[row]:.2f} m")
            raise SystemExit

    def on_applied(self, applied: JointState) -> None:
        """Record the delay (s) between a state and the effect of the command."""
        if stamp := self.sent.pop(applied.velocity[0] if applied.velocity else None, None):
            now = applied.header.stamp
            self.dead_times.append(now.sec - stamp.sec + 1e-9 * (now.nanosec - stamp.nanosec))


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("usage: position_controller.py NAME PLACE; carriage and m along the rope, or drive and m of travel")
    rclpy.init()
    controller = PositionController(sys.argv[1], float(sys.argv[2]))
    try:
        rclpy.spin(controller)
    finally:
        if controller.dead_times:
            print(f"commands took effect {1e3 * median(controller.dead_times):.0f} ms after their states (median)")
