"""The node `cable_twin`: parameters, topics and services around the frame loop."""

from __future__ import annotations

import gc
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, Vector3Stamped, WrenchStamped
from nav_msgs.msg import Path as PathMessage
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, PointCloud2
from std_msgs.msg import String

from cable_twin.command_messages import (
    applied_command_message,
    command_from_joint_state,
    payload_from_joint_state,
    wind_from_vector,
)
from cable_twin.key_figures import KeyFigures
from cable_twin.messages import (
    CLOCK,
    DIAGNOSTICS,
    JOINT_COMMANDS,
    KEY_FIGURES,
    PAYLOAD,
    SCENARIO,
    TF,
    WIND,
    MessageEncoder,
    Status,
    clock_message,
    decode,
    diagnostics_message,
    nanoseconds,
    scenario_message,
    topics,
)
from cable_twin.recording.run import Run, start_run
from cable_twin.records import AppliedCommand, Command, CommandError, Snapshot
from cable_twin.ros.declaration import declare_parameters
from cable_twin.ros.figure_watch import FigureWatch
from cable_twin.ros.frame_loop import FrameLoop
from cable_twin.ros.parameters import PARAMETERS, splitting_of
from cable_twin.ros.recording_watch import RecordingWatch
from cable_twin.ros.services import Services
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

try:  # not among the wheels
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

MESSAGE_TYPES = {
    f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}": kind
    for kind in (
        DiagnosticArray,
        PoseStamped,
        WrenchStamped,
        PathMessage,
        Clock,
        JointState,
        PointCloud2,
        String,
        TFMessage,
    )
    if kind is not None
}
# what is subscribed: type, and how it is understood
INPUTS: dict[str, tuple[Any, Callable[[Any], Command]]] = {
    JOINT_COMMANDS: (JointState, lambda m: command_from_joint_state(m.name, m.position, m.velocity, m.effort)),
    PAYLOAD: (JointState, lambda m: payload_from_joint_state(m.name, m.position, m.velocity, m.effort)),
    WIND: (Vector3Stamped, lambda m: wind_from_vector(m.vector.x, m.vector.y, m.vector.z)),
}
BACKLOG = 1000  # frames that may wait for the recorder where nothing else sets the pace
FIRST_FRAME_TIMEOUT = 2.0  # s that time waits for the logs to take the first frame
WARNING_PERIOD = 1.0  # s between two warnings of one kind


class TwinNode(Node):
    """Publishes a simulation in real time and takes its commands.

    Nothing is opened on the disk before `start`, so that an interrupt before it leaves nothing behind.

    Raises:
        ParameterError: a parameter is out of its range.
        ScenarioError: the scenario does not load.
        SnapshotError: the snapshot does not load.
        EquilibriumError: the cable of the scenario finds no rest.
    """

    def __init__(self) -> None:
        super().__init__("cable_twin")
        self._settings = declare_parameters(self)
        self._refused = 0
        self._commands_applied = 0
        self._parameters_set = 0
        self._parameters_refused = 0
        self._warned = -WARNING_PERIOD  # s, when a refused command was last named
        self._run: Run | None = None
        self._watch = RecordingWatch(self.get_logger())
        self._simulation = self._build_simulation()
        self._epoch_ns = time.time_ns() - nanoseconds(self._simulation.time)
        self._figures = FigureWatch(KeyFigures(self._simulation.scenario))
        self._encoder = MessageEncoder(self._simulation.carriages, self._epoch_ns, self._simulation.drives)
        self._frame_steps = self._count_frame_steps()
        self._topics = topics(
            self._simulation.carriages,
            supports=self._simulation.supports,
            clock=self._settings["publish_clock"],
            tf=TFMessage is not None,
        )
        self._raw_publishers = {
            topic.name: self.create_publisher(
                MESSAGE_TYPES[topic.type],
                topic.name if topic.name.startswith("/") else f"~/{topic.name}",
                QoSProfile(
                    depth=topic.depth,
                    reliability=ReliabilityPolicy[topic.reliability.upper()],
                    durability=DurabilityPolicy[topic.durability.upper()],
                ),
            )
            for topic in self._topics
            if topic.name not in INPUTS
        }
        self._loop = FrameLoop(
            self._simulation,
            frame_steps=self._frame_steps,
            real_time_factor=self._settings["real_time_factor"],
            command_timeout=self._settings["command_timeout"],
            on_frame=self._publish_frame,
            on_applied=self._record_applied,
            on_fault=self._report_fault,
            paused=self._settings["start_paused"],
        )
        for name, (kind, _) in INPUTS.items():
            self.create_subscription(kind, f"~/{name}", partial(self._on_command, name), 50, raw=True)
        self._offered = Services(self._loop, self._log_directory)
        self._offered.offer(self)
        self.create_timer(1.0, self._publish_diagnostics)
        self.add_on_set_parameters_callback(self._on_parameters)

    @property
    def failed(self) -> bool:
        """Whether the frame loop has ended by a fault of the program."""
        return self._loop.failed

    def start(self) -> None:
        """Open the logs and let simulated time run; a log that cannot be opened is told, and the twin goes on."""
        if self._settings["record"]:
            self._start_recording()
        elif self._settings["rerun"] == "live":
            self.get_logger().warning("no live view: it is a part of the recording, and record is false")
        self._raw_publishers[SCENARIO].publish(scenario_message(self._simulation.scenario.resolved()))
        self._publish_frame(self._simulation.snapshot)
        self._await_recorder()
        gc.collect()  # before time runs, not beside it
        gc.freeze()  # what stays to the end need not be looked through between two frames
        start = f" from {self._simulation.time:.3f} s of the snapshot on" if self._settings["snapshot"] else ""
        self._loop.start()
        rate = 1.0 / self._loop.frame_period
        scenario = self._simulation.scenario
        names = list(scenario.carriages)
        if scenario.carriers is not None:
            names.append(f"{scenario.carriers.name}_1 to {scenario.carriers.name}_{scenario.carriers.count}")
        drives = f"drive: {', '.join(scenario.drives)}; " if scenario.drives else ""
        self.get_logger().info(
            f"'{scenario.name}' runs at {rate:g} Hz{start}; {drives}carriages: {', '.join(names)}; "
            f"commands on {self.get_fully_qualified_name()}/{JOINT_COMMANDS}"
        )

    def stop(self) -> None:
        """Stop the loop and close the logs; the node itself is destroyed by its owner."""
        self._loop.stop()
        self._offered.close()
        if self._run is not None:
            waiting = threading.Timer(2.0, self.get_logger().warning, ["recording: waiting for the disk"])
            waiting.start()
            self._run.recorder.close()
            waiting.cancel()
            self._watch.look()
            self.get_logger().info(f"log closed: {self._run.directory}")

    def _build_simulation(self) -> Simulation:
        """Build the simulation, and say so when its kernels must be compiled first."""
        started = time.monotonic()
        told = threading.Event()

        def tell() -> None:
            told.set()
            self.get_logger().info("compiling the solver's kernels, once on this machine: some 15 to 30 s")

        timer = threading.Timer(2.0, tell)
        timer.start()
        try:
            if self._settings["snapshot"]:
                return Simulation.load(self._settings["snapshot"])
            return Simulation(load_scenario(self._settings["scenario"]))
        finally:
            timer.cancel()
            if told.is_set():
                self.get_logger().info(f"kernels compiled in {time.monotonic() - started:.1f} s and kept for next time")

    def _count_frame_steps(self) -> int:
        period = 1.0 / self._settings["frame_rate"]
        steps = max(round(period / self._simulation.step), 1)
        if abs(steps * self._simulation.step - period) > 1e-9:
            self.get_logger().warning(
                f"frame_rate {self._settings['frame_rate']:g} Hz is no whole number of solver steps of "
                f"{self._simulation.step:g} s: {1.0 / (steps * self._simulation.step):g} Hz is used"
            )
        return steps

    def _start_recording(self) -> None:
        directory = Path(self._settings["record_directory"])
        try:
            self._run = start_run(
                self._simulation,
                self._topics,
                record_directory=directory.expanduser(),
                frame_period=self._frame_steps * self._simulation.step,
                rerun=self._settings["rerun"],
                splitting=splitting_of(self._settings),
                namespace=self.get_fully_qualified_name(),
            )
        except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
            reason = getattr(error, "strerror", None) or error
            fault = f"nothing is recorded: record_directory '{directory}': {reason}"
            self._watch = RecordingWatch(self.get_logger(), fault=fault)
            return
        self._run.begin(self._epoch_ns)
        live = f"; live view: rerun --bind 127.0.0.1 --connect {self._run.live_url}" if self._run.live_url else ""
        self.get_logger().info(f"log: {self._run.directory}{live}")
        factor = self._settings["real_time_factor"]
        frame_time = self._loop.frame_period / factor if factor > 0.0 else 0.0
        self._watch = RecordingWatch(self.get_logger(), self._run.recorder, frame_time)
        self._watch.look()

    def _log_directory(self) -> Path:
        """Where files of this run belong; raises RuntimeError for ~ of a user without a home."""
        directory = self._run.directory if self._run is not None else Path(self._settings["record_directory"])
        return directory.expanduser().resolve()

    def _await_recorder(self) -> None:
        """Let the logs take the first frame before time runs: laying out the view takes many frames' time."""
        deadline = time.monotonic() + FIRST_FRAME_TIMEOUT
        while self._run is not None and not self._run.recorder.idle and time.monotonic() < deadline:
            time.sleep(0.005)

    def _publish_frame(self, snapshot: Snapshot) -> None:
        """Build the messages of a frame once; publish and record the same bytes."""
        stamp_ns = self._encoder.stamp_ns(snapshot)
        messages = self._encoder.frame(snapshot)
        self._figures.update(snapshot)
        if CLOCK in self._raw_publishers:
            messages.append((CLOCK, clock_message(stamp_ns)))
        if TF in self._raw_publishers:
            messages.append((TF, self._encoder.transforms(snapshot)))
        for topic, data in messages:
            self._raw_publishers[topic].publish(data)
        if self._run is not None:
            self._run.split_if_due()
            self._run.recorder.record(messages, stamp_ns, snapshot)
            while self._settings["real_time_factor"] == 0.0 and self._run.recorder.backlog > BACKLOG:
                time.sleep(0.01)  # as fast as possible is not faster than the disk

    def _record_applied(self, applied: AppliedCommand) -> None:
        self._commands_applied += 1
        self._figures.command(applied)
        data = applied_command_message(applied, self._epoch_ns)
        self._raw_publishers["applied_commands"].publish(data)
        if self._run is not None:
            stamp_ns = self._epoch_ns + round(applied.time * 1e9)
            self._run.recorder.record_command(applied, data, stamp_ns)
        if applied.source == "command_timeout":
            names = ", ".join(applied.command.values)
            self.get_logger().warning(
                f"no command for {self._loop.command_timeout:g} s: {names} ramps to a stop "
                f"from {applied.time:.2f} s of simulated time on"
            )

    def _on_command(self, topic: str, data: bytes) -> None:
        """A command on a topic of `INPUTS`: record it as it came, then apply it whole or refuse it whole."""
        kind, understand = INPUTS[topic]
        if self._run is not None:
            stamp_ns = self._epoch_ns + round(self._loop.simulated_time * 1e9)
            self._run.recorder.record([(topic, data)], stamp_ns)
        try:
            command = understand(decode(data, f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"))
        except CommandError as error:
            self._refuse(topic, error)
            return
        except Exception as error:
            self._refuse(topic, CommandError(f"not a {kind.__name__}: {error}"))
            return
        self._loop.submit(command, topic).add_done_callback(partial(self._on_obeyed, topic))

    def _on_obeyed(self, topic: str, future: Any) -> None:
        if not future.cancelled() and future.exception() is not None:
            self._refuse(topic, future.exception())

    def _refuse(self, topic: str, error: BaseException) -> None:
        self._refused += 1
        now = time.monotonic()
        if now - self._warned >= WARNING_PERIOD:
            self._warned = now
            self.get_logger().warning(
                f"{self.get_fully_qualified_name()}/{topic}: command refused, "
                f"the last good one stays: {error} ({self._refused} refused so far)"
            )

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set parameters as rclpy does, and count what was taken and what was refused, by whomever."""
        self._parameters_refused += 1  # until it is taken: rclpy raises for a name that it does not know
        result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            self._parameters_refused -= 1
            self._parameters_set += 1
        return result

    def _on_parameters(self, parameters: Sequence[RosParameter]) -> SetParametersResult:
        """Only `command_timeout` may change while the twin runs."""
        table = {parameter.name: parameter for parameter in PARAMETERS}
        for parameter in parameters:
            if parameter.name in table and (fault := table[parameter.name].fault(parameter.value)):
                return SetParametersResult(successful=False, reason=fault)
        for parameter in parameters:
            if parameter.name == "command_timeout":
                self._loop.command_timeout = float(parameter.value)
        return SetParametersResult(successful=True)

    def _publish_diagnostics(self) -> None:
        statistics = self._loop.take_statistics().summary()
        total = {f"total_{key}": value for key, value in self._loop.total_lateness.summary().items()}
        values: dict[str, str] = {key: f"{value:.9g}" for key, value in {**statistics, **total}.items()}
        values["simulated_time_s"] = f"{self._loop.simulated_time:.3f}"
        values["commands_applied"] = str(self._commands_applied)
        values["commands_refused"] = str(self._refused)
        values["parameters_set"] = str(self._parameters_set)
        values["parameters_refused"] = str(self._parameters_refused)
        values["emergency_stop"] = str(self._simulation.emergency_stopped).lower()
        self._watch.look()
        values.update(self._watch.values)
        level, message = self._judge(statistics)
        stamp_ns = self._epoch_ns + round(self._loop.simulated_time * 1e9)
        statuses = self._figures.statuses()
        for line in self._figures.take_news():
            self.get_logger().warning(line)
        summary = self._figures.summary(f"{self.get_name()}: key figures")
        messages = [
            (KEY_FIGURES, diagnostics_message(stamp_ns, *statuses)),
            (DIAGNOSTICS, diagnostics_message(stamp_ns, Status(level, self.get_name(), message, values), summary)),
        ]
        for topic, data in messages:
            self._raw_publishers[topic].publish(data)
        if self._run is not None:
            self._run.recorder.record(messages, stamp_ns)

    def _report_fault(self, line: str) -> None:
        self.get_logger().error(line)

    def _judge(self, statistics: Mapping[str, float]) -> tuple[int, str]:
        """Level and message of the diagnostics."""
        if self._loop.fault:
            return 2, self._loop.fault
        if (judged := self._watch.judge()) is not None:
            return judged
        if self._simulation.emergency_stopped:
            return 1, "emergency stop in force"
        if self._loop.paused:
            return 0, "paused"
        if statistics["missed_frames"] > 0:
            return 1, f"{statistics['missed_frames']:.0f} frames late, up to {statistics['lateness_max_ms']:.1f} ms"
        return 0, "running"
