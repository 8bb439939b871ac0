"""Replacement of the scenario of a running twin: built beside the running one, which then ends and restarts."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Future

from rclpy.node import Node

from cable_twin.basics.printable import printable
from cable_twin.key_figures import compile_figures
from cable_twin.ros.declaration import ParameterError
from cable_twin.ros.executor import done
from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.scenario import Scenario
from cable_twin.simulation import EquilibriumError, Simulation


class WorldLoading:
    """Loader that builds a scenario in its own thread, while the paused twin still answers.

    Args:
        node: that is told what came of it, in its log.
        loop: of what runs.
        check: raises ParameterError where the node's parameters do not fit a simulation.
        before: name or path of what runs.

    Attributes:
        source: name or path of what is loaded, for the parameter `scenario`.
        loaded: the simulation that is to go on, once there is one.
        paused: whether it is to begin paused.
        paused_before: whether what runs was paused before.
    """

    def __init__(self, node: Node, loop: FrameLoop, check: Callable[[Simulation], None], before: str) -> None:
        self._node, self._loop, self._check = node, loop, check
        self.before, self.source = before, ""
        self.loaded: Simulation | None = None
        self.paused = self.paused_before = False
        self._busy = False

    @property
    def busy(self) -> bool:
        """Whether a scenario is being loaded, or is loaded and about to begin."""
        return self._busy

    def begin(self, scenario: Scenario, source: str, *, paused: bool) -> Future[str]:
        """Pause simulated time and load a scenario; the future gives the fault, empty after success.

        Where it cannot be, what ran goes on as it was.
        """
        self._busy, self.paused_before = True, self._loop.paused
        self._loop.pause(True)
        self._node.get_logger().info(f"loading '{scenario.name}'; time stands still meanwhile")
        future: Future[str] = Future()
        threading.Thread(
            target=self._load, args=(scenario, source, paused, future), name="loading", daemon=True
        ).start()
        return future

    async def load(self, scenario: Scenario, source: str, *, paused: bool) -> str:
        """Load a scenario from a callback of the node, without blocking the executor; returns the fault."""
        future = self.begin(scenario, source, paused=paused)
        await done(future)
        return future.result()

    def _load(self, scenario: Scenario, source: str, paused: bool, future: Future[str]) -> None:
        fault = ""
        try:
            simulation = Simulation(scenario, meanwhile=compile_figures)
            self._check(simulation)
        except (EquilibriumError, ParameterError) as error:
            fault = " ".join(str(error).split())
        except Exception as error:  # a fault of the program, which the caller is to hear of and the twin survives
            fault = f"fault of the program: {printable(repr(error), 400)}"
        if fault:
            self._node.get_logger().error(
                f"'{scenario.name}' is not loaded: {fault}; the previous scenario keeps running"
            )
            self._busy = False
            self._loop.pause(self.paused_before)
        else:
            self.source, self.paused, self.loaded = source, paused, simulation
        future.set_result(fault)


__all__ = ["WorldLoading"]
