"""Node `cable_twin`: parameters, topics and services around the frame loop."""

from __future__ import annotations

import gc
import os
import threading
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter
from rich.console import Console

from cable_twin.frame.commands import JOINT_COMMANDS, KINDS
from cable_twin.frame.records import AppliedCommand, RefusedCommand
from cable_twin.key_figures import compile_figures
from cable_twin.messages import (
    REFUSED_COMMANDS,
    SCENARIO,
    FrameNames,
    refused_command_message,
    scenario_message,
    topics,
)
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.recording.run import start_run
from cable_twin.ros.declaration import (
    ParameterError,
    as_meant,
    changes_of,
    count_frame_steps,
    declare_parameters,
    own_topics,
    topic_rates,
)
from cable_twin.ros.diagnostics import Diagnostics
from cable_twin.ros.emergency_stop import EmergencyStop
from cable_twin.ros.endpoints import Endpoints
from cable_twin.ros.for_rviz import ForRviz
from cable_twin.ros.incoming import CommandLimits, Incoming
from cable_twin.ros.live_parameters import LiveParameters, LiveParameterService, are_unchanged
from cable_twin.ros.markers import REPEAT
from cable_twin.ros.node_parameters import splitting_of
from cable_twin.ros.only_one import check_others, hold_name
from cable_twin.ros.services import Services
from cable_twin.ros.simulation_services import offer_simulation_services
from cable_twin.ros.status import Status, live_hint
from cable_twin.ros.world_loading import WorldLoading
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.output import Output
from cable_twin.runtime.run_clock import RunClock
from cable_twin.runtime.scenario_reading import ScenarioReader
from cable_twin.runtime.watches import RecordingWatch
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.terminal.bars import compilation_shown

READY_TIMEOUT = 2.0  # s that time waits for the logs to be ready


class TwinNode(Node):
    """Node that publishes a simulation in real time and takes its commands.

    Nothing is opened on the disk before `start`, so that an interrupt before it leaves nothing behind.

    Args:
        simulation: what to run, where it is built already: by a twin that ran before in this process.
        overrides: parameters that go before those of the command line.
        emergency: the service of that twin, which goes on.
        arguments: of ROS, as the process has them.

    Attributes:
        simulation: what runs.
        emergency: its service `emergency_stop`, which its owner closes in the end.
        loading: of another scenario, with which the owner of this node begins anew.

    Raises:
        ParameterError: a parameter is out of its range.
        ScenarioError: the scenario does not load.
        SnapshotError: the snapshot does not load.
        EquilibriumError: the cable of the scenario finds no rest.
        SecondTwinError: there is one of this name, and `allow_second` is false.
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
        self._held_name = hold_name(self) if alone else None
        self.simulation = simulation or self._build_simulation()
        if alone and simulation is None:  # else the one before may still be seen
            check_others(self)
        self._frame_steps = count_frame_steps(self, self._settings["frame_rate"], self.simulation.step)
        layout, frame_rate = self.simulation.layout, 1.0 / (self._frame_steps * self.simulation.step)
        own = own_topics(self._settings, self.simulation.scenario)
        rates = topic_rates(self, self._settings, frame_rate)
        self._frames = FrameNames(self._settings["frame_id"], self._settings["frame_prefix"])
        self._rviz = ForRviz(self.simulation, self._frames)
        table = topics(layout, own=own, clock=self._settings["publish_clock"], **self._rviz.present)
        table += sensor_topics(self.simulation.scenario)
        self._endpoints = Endpoints(self, table)
        self._senders = self._rviz.watching(self._endpoints)
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
            on_applied=self._tell_applied,
            on_fault=self._tell_fault,
            on_goal=self._tell_goal,
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
        incoming = Incoming(
            self._loop,
            limits,
            counts,
            self.get_logger(),
            names.full,
            self._stamp_ns,
            self._record_command,
            self._tell_refused,
        )
        self._endpoints.subscribe(incoming.take)
        self._endpoints.warn_of_unknown()
        self.status = Status(self.simulation, self._loop, self._output, self._diagnostics, self._endpoints.names)
        self.loading = WorldLoading(self, self._loop, self._check, self.get_parameter("scenario").value)
        self._offer()
        self.emergency = emergency or EmergencyStop(self, arguments)
        self.emergency.serve(self._loop)

    def _offer(self) -> None:
        """Create the services and timers of the node."""
        self._offered = Services(
            self._loop,
            self._log_directory,
            lambda: self.get_parameter("step_count").value,
            self._settings["keep_size"],
        )
        self._offered.offer(self)
        directories = [Path(self._settings["record_directory"])]
        directories += [Path(one) for one in self._settings["scenario_directories"].split(os.pathsep) if one]
        reader = ScenarioReader(directories, self._settings["scenario"])
        self._actions = offer_simulation_services(
            self, self.simulation, self._loop, self._run_clock, self._offered, self.loading, reader, self._frames
        )
        # on a clock of its own: somebody who sets use_sim_time would stop the node's
        self.create_timer(1.0, self._diagnostics.publish, clock=Clock(clock_type=ClockType.STEADY_TIME))
        look = partial(self._rviz.look, self._loop, self._output)
        self.create_timer(REPEAT, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.add_pre_set_parameters_callback(as_meant)
        live = LiveParameters(self, self._loop, self.loading, reader)
        self.add_on_set_parameters_callback(live.on_set)
        self._parameter_service = LiveParameterService(self, live)

    @property
    def failed(self) -> bool:
        """Whether the frame loop has ended by a fault of the program."""
        return self._loop.failed

    def start(self) -> None:
        """Open the logs and let simulated time run; a log that cannot be opened is reported, and the twin continues."""
        if self._settings["record"]:
            self._start_recording()
        elif self._settings["rerun"] in ("live", "web"):
            self.get_logger().warning("no live view: it is a part of the recording, and record is false")
        self._senders[SCENARIO](scenario_message(self.simulation.scenario.resolved()))
        self._output.send_once(self._rviz.once())
        self._await_recorder()
        gc.collect()  # before time runs, not beside it
        if not gc.get_freeze_count():  # by the first world: to look through all at the next ones held an answer up
            gc.freeze()  # what stays to the end need not be looked through between two frames
        start = f" from {self.simulation.time:.3f} s of the snapshot on" if self._settings["snapshot"] else ""
        self._loop.start()
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
            f"carriages: {', '.join(names)}; commands on {self._endpoints.names.full(JOINT_COMMANDS)}"
        )

    def stop(self) -> None:
        """Stop the loop and close the logs; the owner destroys the node."""
        self.emergency.leave()
        self._loop.stop()
        if self._actions is not None:
            self._actions.destroy()
        self._offered.close()
        if self._output.run is not None:
            self._begin()  # a log of a twin that never ran has its scenario, and is one
            self._output.finish()
            waiting = threading.Timer(2.0, self.get_logger().warning, ["recording: waiting for the disk"])
            waiting.start()
            self._output.run.close()
            waiting.cancel()
            self._diagnostics.recording.check()
            self.get_logger().info(f"log closed: {self._output.run.directory}")
        if self._held_name is not None:
            self._held_name.close()

    def _build_simulation(self) -> Simulation:
        """Build the simulation, with a progress display while its kernels have to be compiled."""
        given, changes = self._settings["scenario"], changes_of(self._settings)
        with compilation_shown(Console(stderr=True), self.get_logger().info):
            if not self._settings["snapshot"]:
                scenario = load_scenario(given, changes)
                own_topics(self._settings, scenario)  # refused before minutes of compiling
                return Simulation(scenario, meanwhile=compile_figures)
            simulation = Simulation.load(self._settings["snapshot"], meanwhile=compile_figures)
        own = simulation.scenario.name
        if "scenario" in self._parameter_overrides and Path(given).stem != own:
            raise ParameterError(f"parameter 'scenario' is '{given}'; allowed beside this 'snapshot': '{own}', its own")
        self.set_parameters([RosParameter("scenario", value=own)])
        return simulation

    def _check(self, simulation: Simulation) -> None:
        """Raise ParameterError where the parameters of the node do not fit a simulation."""
        own = own_topics(self._settings, simulation.scenario)
        steps = count_frame_steps(self, self._settings["frame_rate"], simulation.step)
        topic_rates(self, self._settings, 1.0 / (steps * simulation.step))
        self._endpoints.check_names(topic.name for topic in topics(simulation.layout, own=own))

    def _start_recording(self) -> None:
        directory = Path(self._settings["record_directory"])
        try:
            run = start_run(
                self.simulation,
                self._endpoints.topics,
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
        """Wait until the logs are ready before time runs, as the layout of the view takes many frames' time."""
        deadline = time.monotonic() + READY_TIMEOUT
        run = self._output.run
        while run is not None and not run.recorder.idle and time.monotonic() < deadline:
            time.sleep(0.005)

    def _on_run(self, first: bool) -> None:
        """Set the epoch at the first start of simulated time; after a pause, report the delay of stamps."""
        if first:
            self._begin()
        self._diagnostics.pace.log_start(self.simulation.time)

    def _begin(self) -> None:
        """Set the epoch and give the first frame, once, before time runs and before any change of the twin."""
        with self._begun:
            if self._run_clock.epoch_ns is None:
                self._output.begin(self._run_clock)

    def _tell_fault(self, line: str) -> None:
        self.get_logger().error(line)

    def _tell_goal(self, line: str, given_up: bool) -> None:
        if given_up:
            self.get_logger().warning(line)
        else:  # a call of its own: rclpy allows a place in the code one severity for good
            self.get_logger().info(line)

    def _tell_applied(self, applied: AppliedCommand) -> None:
        self._diagnostics.counts["commands_applied"] += 1
        self._output.apply(applied)
        stopped, self._stopped = self._stopped, self._loop.emergency_stopped
        done = KINDS[applied.command.kind].done
        if done and (stopped or applied.command.kind != "release"):  # its caller has the answer, all others this line
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

    def _tell_refused(self, topic: str, reason: str, count: int) -> None:
        refused, stamp_ns = RefusedCommand(self._loop.simulated_time, topic, reason, count), self._stamp_ns()
        self._output.send([(REFUSED_COMMANDS, refused_command_message(refused, stamp_ns))], stamp_ns)

    def set_parameters_atomically(self, parameter_list: list[RosParameter]) -> SetParametersResult:
        """Set parameters as rclpy does, and count accepted and refused ones from all sources."""
        counts = self._diagnostics.counts
        counts["parameters_refused"] += 1  # until it is taken: rclpy raises for a name that it does not know
        if are_unchanged(self, parameter_list):  # also what is read-only
            result = SetParametersResult(successful=True)
        else:
            result = super().set_parameters_atomically(parameter_list)
        if result.successful:
            counts["parameters_refused"] -= 1
            counts["parameters_set"] += 1
        return result
