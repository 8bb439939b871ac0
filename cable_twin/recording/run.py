"""Recorded run of a simulation: directory, logs and writer thread."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path

from cable_twin.messages import FrameNames, Topic, TopicNames, scenario_message
from cable_twin.recording.log_formats import open_logs
from cable_twin.recording.recorder import Recorder
from cable_twin.recording.splitting import HOURLY, Splitting
from cable_twin.simulation import Simulation
from cable_twin.view.web_view import WebView


@dataclass(frozen=True, slots=True)
class Run:
    """Recorded run, active after `begin`."""

    simulation: Simulation
    recorder: Recorder
    live_url: str | None  # where a rerun viewer finds the live view
    web: WebView | None = None  # the same for a browser

    @property
    def directory(self) -> Path:
        """Present directory of the logs: a new one after the loss of the first."""
        directory = self.recorder.directory
        assert directory is not None
        return directory

    def close(self) -> None:
        """Close the logs after writing all queued data, and end the live view."""
        self.recorder.close()
        if self.web is not None:
            self.web.close()

    def begin(self, epoch_ns: int) -> None:
        """Begin the run, before its first frame is recorded and before the simulation continues.

        The scenario is the first message of each bag; where the simulation is not at its start, the full state is
        attached.

        Args:
            epoch_ns: Wall time (ns since 1970) of simulated time zero.
        """
        simulation = self.simulation
        scenario = scenario_message(simulation.scenario.resolved())
        full_state = None if simulation.at_start else simulation.capture()
        self.recorder.begin(epoch_ns, simulation.time, scenario, full_state)


def start_run(
    simulation: Simulation,
    topics: Sequence[Topic],
    *,
    record_directory: Path,
    frame_period: float,
    rerun: str = "file",
    splitting: Splitting = HOURLY,
    names: TopicNames | None = None,
    frames: FrameNames | None = None,
) -> Run:
    """Open the logs of a run in a new directory named after the time; `Run.begin` begins the run.

    Args:
        simulation: what is recorded.
        topics: what the bag will hold.
        record_directory: parent of the new directory.
        frame_period: s.
        rerun: "none", "file", "live" (a file, and a server on 127.0.0.1), or "web" (that, and a page for a browser).
        splitting: when the logs go on in new files, and how long old ones are kept.
        names: full names of topics in the bag, where they are not the usual ones.
        frames: names of coordinate frames, likewise.

    Raises:
        OSError: when the directory or the bag in it cannot be made. A rerun recording that cannot be opened is a fault
            of the recorder, and the bag goes on.
    """
    directory = _new_directory(record_directory)
    logs = open_logs(simulation, topics, directory, frame_period=frame_period, rerun=rerun, names=names, frames=frames)
    new_directory = partial(_new_directory, record_directory)
    recorder = Recorder(logs.bag, *logs.views, splitting=splitting, new_directory=new_directory)
    recorder.faults += logs.faults
    return Run(simulation, recorder, logs.live_url, logs.web)


def _new_directory(parent: Path) -> Path:
    """Make a directory named after the time; waits for the next second where the name exists."""
    parent.mkdir(parents=True, exist_ok=True)
    while True:
        directory = parent / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        try:
            directory.mkdir()
        except FileExistsError:
            time.sleep(0.2)
        else:
            return directory
