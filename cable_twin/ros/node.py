"""Node `cable_twin`: parameters, topics and services around the frame loop."""

from __future__ import annotations

import errno
import gc
import os
import socket
import threading
import time
from collections.abc import Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rich.console import Console

from cable_twin.basics.printable import printable
from cable_twin.frame.commands import JOINT_COMMANDS, KINDS
from cable_twin.frame.records import AppliedCommand, PlantEstimates, RefusedCommand
from cable_twin.key_figures import compile_figures
from cable_twin.messages import (
    READMITTED,
    REFUSED_COMMANDS,
    SCENARIO,
    FrameNames,
    refused_command_message,
    scenario_message,
    topics,
)
from cable_twin.messages.figure_messages import estimates_of_message
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.messages.texts import readmitted_message
from cable_twin.recording.run import start_run
from cable_twin.ros.command_subscriber import CommandLimits, CommandSubscriber
from cable_twin.ros.diagnostics import Diagnostics, StatusLine, live_hint
from cable_twin.ros.emergency_stop import EmergencyStop
from cable_twin.ros.endpoints import Endpoints
from cable_twin.ros.markers import REPEAT
from cable_twin.ros.parameter_table import splitting_of
from cable_twin.ros.parameters import (
    LiveParameterService,
    ParameterError,
    are_unchanged,
    changes_of,
    count_frame_steps,
    declare_parameters,
    own_topics,
    topic_rates,
    unknown_parameter,
    with_doubles,
)
from cable_twin.ros.plant_subscriber import PlantSubscriber, with_plant_sensors
from cable_twin.ros.rviz import RvizTopics
from cable_twin.ros.services import Services, SnapshotWriter
from cable_twin.ros.simulation_services import WorldLoading, offer_simulation_services
from cable_twin.runtime.following import LiveFollowing
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.outlook import Answer, LiveOutlook
from cable_twin.runtime.output import Output
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.scenario_reading import ScenarioReader
from cable_twin.runtime.watches import RecordingWatch
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.bars import compilation_shown

READY_TIMEOUT = 2.0  # s that simulated time waits for the logs to be ready


class SecondTwinError(RuntimeError):
    """Error of starting a second twin of the same name in a ROS domain, as both would use the same topics."""

    def __init__(self, node: Node) -> None:
        name, domain = node.get_fully_qualified_name(), node.context.get_domain_id()
        super().__init__(
            f"a twin named {name} runs already in ROS domain {domain}: "
            "end it, give this one another name, as with --ros-args -r __ns:=/b, or another ROS_DOMAIN_ID, or allow "
            "both with --allow-second"
        )


def claim_single_instance(node: Node) -> socket.socket:
    """Claim the name of a node on this machine until the returned socket is closed, or this process ends.

    The claim holds at once, even before DDS has discovered the node; `check_single_instance` finds twins on other
    machines.

    Raises:
        SecondTwinError: another process of this machine holds the name.
    """
    held = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        # an abstract name: no file is left behind, and it is visible as far as this machine's network is
        name = f"{node.context.get_domain_id()}{node.get_fully_qualified_name()}"
        held.bind(f"\0cable_twin/{sha256(name.encode()).hexdigest()}")
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            held.close()
            raise SecondTwinError(node) from None
    return held


def check_single_instance(node: Node) -> None:
    """Refuse a node name that a twin on another machine uses; called before the node publishes its scenario.

    Raises:
        SecondTwinError: there is a twin of this name.
    """
    if node.count_publishers(node.resolve_topic_name(f"~/{SCENARIO}")):
        raise SecondTwinError(node)


class TwinNode(Node):
    """Node that publishes a simulation in real time and takes its commands.

    No file is opened before `start`, so that an interrupt before it leaves nothing behind.

    Args:
        simulation: simulation built by a previous node of this process; None to build it from the parameters.
        overrides: parameters that take precedence over those of the command line.
        emergency: service of a previous node, which continues.
        arguments: ROS arguments of the process.

    Attributes:
        simulation: running simulation.
        emergency: service `emergency_stop`, which the owner of the node closes at the end.
        loading: loads another scenario, with which the owner starts another node.
        status: status line for the terminal.

    Raises:
        ParameterError: a parameter is out of range.
        ScenarioError: the scenario is invalid.
        SnapshotError: the snapshot is invalid.
        EquilibriumError: the cable of the scenario has no equilibrium.
        SecondTwinError: there is a twin of this name, and `allow_second` is false.
    """

    def __init__(
        self,
        simulation: Simulation | None = None,
        overrides: Sequence[RosParameter] = (),
        emergency: EmergencyStop | None = None,
        arguments: Sequence[str] = (),
    ) -> None:
        super().__init__("cable_twin", parameter_overrides=[*overrides], start_parameter_services=False)
        self._settings = declare_parameters(self)
        alone = not self._settings["allow_second"]
        self._held_name = claim_single_instance(self) if alone else None
        self.simulation = simulation or self._build_simulation()
        if alone and simulation is None:  # otherwise the previous node may still be visible
            check_single_instance(self)
        self._frame_steps = count_frame_steps(self, self._settings["frame_rate"], self.simulation.step)
        layout, frame_rate = self.simulation.layout, 1.0 / (self._frame_steps * self.simulation.step)
        own = own_topics(self._settings, self.simulation.scenario)
        rates = topic_rates(self, self._settings, frame_rate)
        self._frames = FrameNames(self._settings["frame_id"], self._settings["frame_prefix"])
        self._rviz = RvizTopics(self.simulation, self._frames)
        table = topics(
            layout,
            own=own,
            clock=self._settings["publish_clock"],
            outlook=self._settings["outlook"],
            estimate=self._settings["follow"],
            **self._rviz.present,
        )
        table += sensor_topics(self.simulation.scenario)
        self._endpoints = Endpoints(self, table)
        self._senders = self._rviz.counted_senders(self._endpoints)
        self._output = Output(
            self.simulation,
            table,
            self._senders,
            rates,
            frame_rate=frame_rate,
            own=own,
            makers=self._rviz.makers,
            frames=self._frames,
            paced=self._settings["real_time_factor"] > 0.0,
        )
        self._run_clock, self._begun = RunClock(), threading.Lock()
        self._loop = FrameLoop(
            self.simulation,
            frame_steps=self._frame_steps,
            real_time_factor=self._settings["real_time_factor"],
            command_timeout=self._settings["command_timeout"],
            on_run=self._on_run,
            prepare=self._output.prepare,
            publish=self._output.publish,
            before_command=self._begin,
            on_applied=self._report_applied,
            on_fault=self._log_fault,
            on_goal=self._log_goal,
            paused=self._settings["start_paused"],
        )
        self._stopped = self._loop.emergency_stopped  # before the last command
        real_time = self._settings["real_time_factor"] == 1.0
        self._diagnostics = Diagnostics(
            self, self.simulation, self._loop, self._output, self._run_clock, real_time=real_time
        )
        names, counts = self._endpoints.names, self._diagnostics.counts
        joints = len(layout.vehicles) + len(layout.drives) + 3 * len(layout.bodies)  # in space a body may have three
        settings = [self._settings[f"command_{name}"] for name in ("size", "rate", "max_age")]
        limits = CommandLimits(settings[0], settings[1], joints, settings[2])
        subscriber = CommandSubscriber(
            self._loop,
            limits,
            counts,
            self.get_logger(),
            names.full,
            self._stamp_ns,
            self._record_command,
            self._report_refused,
        )
        self._endpoints.subscribe(subscriber.take)
        self._endpoints.warn_of_unknown()
        self.status = StatusLine(self.simulation, self._loop, self._output, self._diagnostics, self._endpoints.names)
        self.loading = WorldLoading(self, self._loop, self._check, self.get_parameter("scenario").value)
        self._outlook = self._diagnostics.outlook = self._make_outlook() if self._settings["outlook"] else None
        self._plant = self._follow() if self._settings["follow"] else None
        self._create_services()
        self.emergency = emergency or EmergencyStop(self, arguments)
        self.emergency.serve(self._loop)

    def _make_outlook(self) -> LiveOutlook:
        """Make the publisher of outlooks (forecasts of the running twin) from the parameters of the node."""
        return LiveOutlook(
            self.simulation,
            self._loop,
            stamp_ns=self._run_clock.stamp_ns,
            publish=self._publish_outlook,
            warn=self._log_warning,
            **{key: self._settings[f"outlook_{key}"] for key in ("horizon", "rate", "gust")},
            passing=lambda: self._plant is not None and self._plant.catching_up,
        )

    def _follow(self) -> PlantSubscriber:
        """Subscriber to the topics of a plant, which the twin follows from `start` on."""
        scenario = with_plant_sensors(self.simulation)
        relief = "outlook false, or a lower outlook_rate, leaves it more of this machine"
        following = self._diagnostics.following = LiveFollowing(
            scenario,
            self._publish_estimate,
            self._log_note,
            self._log_warning,
            relief if self._settings["outlook"] else "",
        )
        plant = PlantSubscriber(
            self, scenario, self.simulation, self._loop, following, self._run_clock.stamp_ns, self._record_command
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, lambda: following.shut_out(plant.doubled()), clock=steady)
        return plant

    def _create_services(self) -> None:
        """Create the services and timers of the node."""
        writer = SnapshotWriter(self._log_directory, self._settings["keep_size"])
        self._node_services = Services(self, self._loop, writer, lambda: self.get_parameter("step_count").value)
        directories = [Path(self._settings["record_directory"])]
        directories += [Path(one) for one in self._settings["scenario_directories"].split(os.pathsep) if one]
        reader = ScenarioReader(directories, self._settings["scenario"])
        self._actions = offer_simulation_services(
            self, self.simulation, self._loop, self._run_clock, self._node_services, self.loading, reader, self._frames
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)  # as use_sim_time would stop the clock of the node
        self.create_timer(1.0, self._diagnostics.publish, clock=steady)
        self.create_timer(REPEAT, partial(self._rviz.check_listeners, self._loop, self._output), clock=steady)
        self.add_pre_set_parameters_callback(with_doubles)
        self._parameter_service = LiveParameterService(self, self._loop, self.loading, reader, self._readmit)

    def _readmit(self, sensor: str) -> str:
        """Let a sensor of the plant that is left out or swapped count again; returns why it cannot, empty otherwise."""
        if (following := self._diagnostics.following) is None:
            return f"readmit: given '{printable(sensor)}'; allowed: none, as this twin follows no plant"
        message = readmitted_message(sensor)
        fault = following.readmit(sensor, message)
        if not fault:
            self._output.send([(READMITTED, message)], self._stamp_ns())
        return fault

    @property
    def failed(self) -> bool:
        """Whether the frame loop has ended by an unexpected exception."""
        return self._loop.failed

    def start(self) -> None:
        """Open the logs and start simulated time; a log that cannot be opened is reported, and the twin continues."""
        if self._settings["record"]:
            self._start_recording()
        elif self._settings["rerun"] in ("live", "web"):
            self.get_logger().warning("no live view: it is part of the recording, and record is false")
        self._senders[SCENARIO](scenario_message(self.simulation.scenario.resolved()))
        self._output.send_once(self._rviz.once())
        self._await_recorder()
        gc.collect()  # before simulated time runs, not beside it
        if not gc.get_freeze_count():  # at the first scenario only, as doing it for later ones delays answers
            gc.freeze()  # permanent objects are not traversed between two frames
        start = f" from {self.simulation.time:.3f} s of the snapshot on" if self._settings["snapshot"] else ""
        self._loop.start()
        if self._outlook is not None:
            self._outlook.start()
        if self._diagnostics.following is not None:
            self._diagnostics.following.start()
        factor = self._settings["real_time_factor"]
        if factor != 1.0:
            pace = f"at {factor:g} times real time" if factor > 0.0 else "as fast as possible"
            self.get_logger().info(f"simulated time runs {pace}, so time stamps differ from the clock of this machine")
        scenario = self.simulation.scenario
        names = list(scenario.carriages)
        if scenario.carriers is not None:
            names.append(f"{scenario.carriers.name}_1 to {scenario.carriers.name}_{scenario.carriers.count}")
        drives = f"drive: {', '.join(scenario.drives)}; " if scenario.drives else ""
        self.get_logger().info(
            f"'{scenario.name}' runs at {1.0 / self._loop.frame_period:g} Hz{start}; {drives}"
            f"carriages: {', '.join(names) or 'none'}; "
            + (
                f"commands on {self._endpoints.names.full(JOINT_COMMANDS)}"
                if self.simulation.layout.commanded
                else "nothing takes commands"
            )
        )

    def stop(self) -> None:
        """Stop the loop and close the logs; the owner destroys the node."""
        self.emergency.leave()
        if self._outlook is not None:
            self._outlook.stop()
        if self._diagnostics.following is not None:
            self._diagnostics.following.stop()
        self._loop.stop()
        if self._actions is not None:
            self._actions.destroy()
        self._node_services.close()
        if self._output.run is not None:
            self._begin()  # so that the log of a twin that never ran has its scenario
            self._output.finish()
            waiting = threading.Timer(2.0, self.get_logger().warning, ["recording: waiting for the disk"])
            waiting.start()
            self._output.run.close()
            waiting.cancel()
            self._diagnostics.recording.check()
            ended = (
                "; it is not whole: " + self._diagnostics.recording.fault if self._diagnostics.recording.fault else ""
            )
            self.get_logger().info(f"log closed: {self._output.run.directory}{ended}")
        if self._held_name is not None:
            self._held_name.close()

    def _build_simulation(self) -> Simulation:
        """Build the simulation, with a progress display while its kernels have to be compiled."""
        given, changes = self._settings["scenario"], changes_of(self._settings)
        with compilation_shown(Console(stderr=True), self.get_logger().info):
            if not self._settings["snapshot"]:
                scenario = load_scenario(given, changes)
                own_topics(self._settings, scenario)  # checked before minutes of compiling
                return Simulation(scenario, meanwhile=compile_figures)
            simulation = Simulation.load(self._settings["snapshot"], meanwhile=compile_figures)
        own = simulation.scenario.name
        if "scenario" in self._parameter_overrides and Path(given).stem != own:
            raise ParameterError(
                f"parameter 'scenario': given '{given}'; allowed: '{own}', the scenario of the snapshot"
            )
        self.set_parameters([RosParameter("scenario", value=own)])
        return simulation

    def _check(self, simulation: Simulation) -> None:
        """Raise ParameterError if the parameters of the node do not fit a simulation of another scenario."""
        own = own_topics(self._settings, simulation.scenario)
        steps = count_frame_steps(self, self._settings["frame_rate"], simulation.step)
        topic_rates(self, self._settings, 1.0 / (steps * simulation.step))
        self._endpoints.check_names(topic.name for topic in topics(simulation.layout, own=own))

    def _start_recording(self) -> None:
        directory = Path(self._settings["record_directory"])
        try:
            run = start_run(
                self.simulation,
                (*self._endpoints.topics, *(() if self._plant is None else self._plant.topics)),
                record_directory=directory.expanduser(),
                frame_period=self._frame_steps * self.simulation.step,
                rerun=self._settings["rerun"],
                splitting=splitting_of(self._settings),
                names=self._endpoints.names,
                frames=self._frames,
            )
        except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
            reason = getattr(error, "strerror", None) or error
            fault = f"nothing is recorded: record_directory '{directory}': {reason}"
            self._diagnostics.recording = RecordingWatch(self.get_logger(), fault=fault)
            return
        self._output.run = run
        self.get_logger().info(f"log: {run.directory}{live_hint(run)}")
        factor = self._settings["real_time_factor"]
        frame_time = self._loop.frame_period / factor if factor > 0.0 else 0.0
        self._diagnostics.recording = RecordingWatch(self.get_logger(), run.recorder, frame_time)
        self._diagnostics.recording.check()

    def _log_directory(self) -> Path:
        """Directory for the files of this run; raises RuntimeError for ~ of a user without a home."""
        directory = Path(self._settings["record_directory"]) if (run := self._output.run) is None else run.directory
        return directory.expanduser().resolve()

    def _await_recorder(self) -> None:
        """Wait until the logs are ready, as the layout of the view takes the time of many frames."""
        deadline = time.monotonic() + READY_TIMEOUT
        run = self._output.run
        while run is not None and not run.recorder.idle and time.monotonic() < deadline:
            time.sleep(0.005)

    def _on_run(self, first: bool) -> None:
        """Set the epoch at the first start of simulated time; after a pause, report the delay of stamps."""
        if first:
            self._begin()
        self._diagnostics.pace.log_start(self.simulation.time, first=first)

    def _begin(self) -> None:
        """Set the epoch and publish the first frame, once, before time runs and before any change of the twin."""
        with self._begun:
            if self._run_clock.epoch_ns is None:
                self._output.begin(self._run_clock)

    def _log_fault(self, line: str) -> None:
        self.get_logger().error(line)

    def _log_warning(self, line: str) -> None:
        self.get_logger().warning(line)

    def _log_note(self, line: str) -> None:
        self.get_logger().info(line)

    def _publish_outlook(self, answer: Answer) -> None:
        self._output.send_ahead(answer.message, answer.ahead, self._stamp_ns())

    def _publish_estimate(self, message: bytes) -> None:
        estimates = PlantEstimates(self._loop.simulated_time, estimates_of_message(message))
        self._output.send_estimates(message, estimates, self._stamp_ns())

    def _log_goal(self, line: str, abandoned: bool) -> None:
        if abandoned:
            self.get_logger().warning(line)
        else:  # a separate call, as rclpy allows each line of code one severity
            self.get_logger().info(line)

    def _report_applied(self, applied: AppliedCommand) -> None:
        self._diagnostics.counts["commands_applied"] += 1
        self._output.apply(applied)
        stopped, self._stopped = self._stopped, self._loop.emergency_stopped
        done = KINDS[applied.command.kind].done
        if done and (stopped or applied.command.kind != "release"):  # for all but its caller, who has the answer
            self.get_logger().warning(f"{done} at {applied.time:.3f} s of simulated time")
        if applied.source == "command_timeout":
            names = ", ".join(applied.command.values)
            self.get_logger().warning(
                f"no command for {self._loop.command_timeout:g} s: {names} ramps to a stop "
                f"from {applied.time:.2f} s of simulated time on"
            )

    def _stamp_ns(self) -> int:
        """Stamp (ns) of the newest frame."""
        return self._run_clock.stamp_ns(self._loop.simulated_time)

    def _record_command(self, topic: str, data: bytes) -> None:
        self._output.record([(topic, data)], self._stamp_ns())

    def _report_refused(self, topic: str, reason: str, count: int) -> None:
        refused, stamp_ns = RefusedCommand(self._loop.simulated_time, topic, reason, count), self._stamp_ns()
        self._output.send([(REFUSED_COMMANDS, refused_command_message(refused, stamp_ns))], stamp_ns)

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set parameters as rclpy does, and count accepted and refused ones from all sources."""
        counts = self._diagnostics.counts
        counts["parameters_refused"] += 1  # until it is accepted, as rclpy may raise
        if are_unchanged(self, parameter_list):  # accepted also for read-only parameters
            result = SetParametersResult(successful=True)
        elif fault := unknown_parameter(self, parameter_list):
            result = SetParametersResult(successful=False, reason=fault)
        else:
            result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            counts["parameters_refused"] -= 1
            counts["parameters_set"] += 1
        return result
