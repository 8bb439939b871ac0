"""Service `emergency_stop` of a twin, with its own DDS participant, executor and thread.

Whatever delays the node (thousands of messages, a scenario that is loaded, a disk that stalls), a call comes through
sockets, queues and a thread that serve nothing else, goes before all requests that wait for the frame loop, and is
answered.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from itertools import pairwise

import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import SetBool

from cable_twin.frame.commands import kinds_by_service
from cable_twin.frame.records import Command
from cable_twin.ros.services import EMERGENCY_STOP, done
from cable_twin.ros.startup import new_executor
from cable_twin.runtime.frame_loop import FrameLoop, wake_promptly

ANSWER = 0.025  # s after which a call is answered even before the frame boundary at which it takes effect
TURN = 0.001  # s for which one waiting call delays the others
DEPTH = 1000  # calls that may wait on a stalled machine; with the usual 10 some got no answer
IDLE = 0.5  # s between two checks whether to end


class EmergencyStop:
    """Service `emergency_stop`, available as long as the process lives, also between frame loops.

    Args:
        node: node of the twin; the service has its name.
        arguments: ROS arguments, of which only the enclave is used.
    """

    def __init__(self, node: Node, arguments: Sequence[str] = ()) -> None:
        self._kinds = kinds_by_service()[EMERGENCY_STOP]
        self._name, self._domain = node.resolve_service_name(f"~/{EMERGENCY_STOP}"), node.context.get_domain_id()
        self._node_name, self._namespace = f"{node.get_name()}_{EMERGENCY_STOP}", node.get_namespace()
        self._arguments = _enclave(arguments)
        self._lock = threading.Lock()
        self._loop: FrameLoop | None = None
        self._waiting: Command | None = None  # stop or release for the next frame loop
        self._ready, self._closing = threading.Event(), threading.Event()
        self._fault: Exception | None = None
        self._thread = threading.Thread(target=self._run, name=EMERGENCY_STOP, daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._fault is not None:
            raise self._fault

    def serve(self, loop: FrameLoop) -> None:
        """Stop or release the drives of a frame loop at calls from now on, and at once for a call received before."""
        with self._lock:
            self._loop = loop
            waiting, self._waiting = self._waiting, None
            if waiting is not None:
                loop.submit(waiting, "service", urgent=True)

    def leave(self) -> None:
        """Detach the frame loop; calls from now on are for the next one."""
        with self._lock:
            self._loop = None

    def close(self) -> None:
        """End the emergency stop service and its thread."""
        self._closing.set()
        self._thread.join()

    def _run(self) -> None:
        wake_promptly()  # inherited by the threads of the participant
        context = rclpy.Context()
        try:
            rclpy.init(
                args=self._arguments,
                context=context,
                domain_id=self._domain,
                signal_handler_options=SignalHandlerOptions.NO,
            )
            node = Node(
                self._node_name,
                namespace=self._namespace,
                context=context,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
                parameter_overrides=[Parameter("start_type_description_service", value=False)],
            )
            group = ReentrantCallbackGroup()
            node.create_service(
                SetBool, self._name, self._on_call, qos_profile=QoSProfile(depth=DEPTH), callback_group=group
            )
            executor = new_executor(context)
            executor.add_node(node)
        except Exception as error:  # raised by the constructor, which waits
            self._fault = error
            return
        finally:
            self._ready.set()
        while not self._closing.is_set():
            executor.spin_once(timeout_sec=IDLE)
        executor.shutdown()
        node.destroy_node()
        context.try_shutdown()

    async def _on_call(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        kind = self._kinds[request.data]
        command = Command(kind.name, {})
        with self._lock:
            loop = self._loop
            idle = not request.data and loop is not None and not loop.emergency_stopped and not loop.urgent
            future = loop.submit(command, "service", urgent=True) if loop is not None else None
        if future is not None:
            await done(future, turn=TURN, within=ANSWER)
        response.success = True
        if loop is not None and loop.failed:
            response.success, response.message = False, loop.fault
        elif future is None or future.cancelled():
            with self._lock:
                self._waiting = command
            response.message = f"{kind.done}: no scenario is running at this moment; the stop holds for the next one"
        elif not future.done():
            response.message = f"{kind.done}, from the next frame boundary on"
        elif idle and loop is not None:
            response.message = f"no emergency stop was in force at {loop.simulated_time:.3f} s of simulated time"
        else:
            applied = future.result()
            assert applied is not None
            response.message = f"{kind.done} at {applied.time:.3f} s of simulated time"
        return response


def _enclave(arguments: Sequence[str]) -> list[str] | None:
    """ROS arguments with the enclave of a participant, empty without an enclave."""
    for option, value in pairwise(arguments):
        if option in ("-e", "--enclave"):
            return ["--ros-args", option, value]
    return []
