#!/usr/bin/env python3
"""Controller in forty lines of plain rclpy: drives a carriage to a place, speed proportional to the distance left.

It answers each `joint_states` with a command that carries the stamp of that state, so that `applied_commands` shows the
dead time of the loop, which it prints in the end. Run it beside `sim`: position_controller.py cabin 90
"""

import sys
from statistics import median

import rclpy
from rclpy.node import Node
from sensor_msgs.msg import JointState

GAIN, FASTEST, NEAR = 0.4, 4.0, 0.05  # 1/s; m/s; m and m/s


class PositionController(Node):
    """Controller that answers each state with a speed."""

    def __init__(self, name: str, place: float) -> None:
        super().__init__("position_controller")
        self.name, self.place, self.last, self.sent, self.dead_times = name, place, None, {}, []
        self.commands = self.create_publisher(JointState, "/cable_twin/joint_commands", 10)
        self.create_subscription(JointState, "/cable_twin/applied_commands", self.on_applied, 10)
        self.create_subscription(JointState, "/cable_twin/joint_states", self.on_state, 10)

    def on_state(self, state: JointState) -> None:
        """Command a speed (m/s), and end at the place."""
        row = state.name.index(self.name)
        left = self.place - state.position[row]
        arrived = abs(left) < NEAR and abs(state.velocity[row]) < NEAR
        speed = 0.0 if arrived else min(max(GAIN * left, -FASTEST), FASTEST)
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
    rclpy.init()
    controller = PositionController(sys.argv[1], float(sys.argv[2]))
    try:
        rclpy.spin(controller)
    finally:
        if controller.dead_times:
            print(f"commands took effect {1e3 * median(controller.dead_times):.0f} ms after their states (median)")
