"""Frame loops of small simulations, and a steady clock moved by the test."""

from __future__ import annotations

import threading

from cable_twin.runtime.frame_loop import FrameLoop
from cable_twin.runtime.run_clock import SteadyClock
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation


class SteppedClock(SteadyClock):
    """Clock that advances only by waits and by the test, so that a loop on it runs as fast as it computes."""

    def __init__(self) -> None:
        self.time = 1000.0  # s

    def now(self) -> float:
        return self.time

    def wait_until(self, due: float, interrupt: threading.Event) -> None:
        self.time = max(self.time, due)


def frame_loop(scenario="aerial_tramway", *, overrides=None, **options):
    """Frame loop of a small simulation; callbacks that are not given do nothing."""
    if isinstance(scenario, str):
        scenario = load_scenario(scenario, {"cable.elements": 10, "solver.step": 0.005, **(overrides or {})})
    defaults = {
        "frame_steps": 2,
        "real_time_factor": 1.0,
        "command_timeout": 0.5,
        "on_run": lambda first: None,
        "prepare": lambda snapshot: snapshot,
        "publish": lambda frame: None,
        "before_command": lambda: None,
        "on_applied": lambda applied: None,
        "on_fault": lambda line: None,
    }
    return FrameLoop(Simulation(scenario), **{**defaults, **options})
