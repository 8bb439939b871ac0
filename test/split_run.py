"""Runs of a small tramway with split logs and commands of all kinds, one at the start of a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from recorded_run import record
from small_tramway import TRAMWAY

from cable_twin.frame.rates import LOGGED
from cable_twin.frame.records import Command
from cable_twin.frame.snapshot import Snapshot
from cable_twin.messages.frame import MessageEncoder
from cable_twin.recording.recorder import Recorder
from cable_twin.recording.splitting import Splitting
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

FRAME_STEPS = 4  # of 5 ms
COMMANDS = {
    0.0: Command("payload", {"cabin": 120.0}),
    0.3: Command("speed", {"cabin": 5.0}),
    2.0: Command("wind", {"x": 6.0, "z": 0.0}),  # where a file begins, for a duration of 1 or 2 s
    2.815: Command("emergency_stop", {}),
    4.4: Command("release", {}),
    5.0: Command("reset", {}),
    5.255: Command("force", {"cabin": 900.0}),
    7.0: Command("speed", {"cabin": 1.0}),
}


def record_split(
    directory: Path,
    duration: float,
    splitting: Splitting,
    rerun: str = "none",
    rates: Mapping[str, float] = LOGGED,
) -> Path:
    """Simulate and record a run; returns its directory."""
    period = FRAME_STEPS * 0.005
    scenario = load_scenario(TRAMWAY)
    return record(directory, scenario, COMMANDS.items(), duration, period, rerun, splitting, rates=rates)[0]


def bags(run: Path) -> list[Path]:
    """Files of a run in the order of their numbers."""
    return sorted(run.glob("*.mcap"), key=lambda file: int(file.stem.rpartition("_")[2]))


def record_frame(recorder: Recorder, encoder: MessageEncoder, simulation: Simulation, snapshot: Snapshot) -> None:
    """Record a frame, after the start of a new file where due."""
    if recorder.split_due(snapshot.time):
        recorder.split(simulation.capture())
    recorder.record(encoder.frame(snapshot), encoder.stamp_ns(snapshot), snapshot)
