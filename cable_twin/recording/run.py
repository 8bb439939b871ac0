"""Recording of a run: directory, recorder thread, MCAP bag, and rerun view in a file, live or in a browser."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cable_twin.geometry.bodies import body_outlines, body_solids
from cable_twin.geometry.bullwheel_rims import wheel_rims
from cable_twin.messages import FrameNames, Topic, TopicNames, scenario_message, topics
from cable_twin.messages.columns import COLUMNS_TOPIC
from cable_twin.messages.sensor_messages import sensor_topics
from cable_twin.recording.log_writer import McapLog, run_metadata
from cable_twin.recording.recorder import Recorder, View
from cable_twin.recording.splitting import HOURLY, Splitting
from cable_twin.scenario import Scenario
from cable_twin.simulation import Simulation
from cable_twin.view.web_view import LIVE_PORT, WebView, free_port, why_not

if TYPE_CHECKING:
    from cable_twin.view.rerun_view import RerunView


@dataclass(frozen=True, slots=True)
class Run:
    """Recording of a simulation's run into a bag and views, active after `begin`."""

    simulation: Simulation
    recorder: Recorder
    live_url: str | None  # address of the live view for rerun viewers
    web: WebView | None = None  # live view for a browser

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
        """Begin the recording of the run, before its first frame is recorded and before the simulation continues.

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
    table: Sequence[Topic] | None = None,
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
        simulation: simulation to record.
        table: topics of the bag; those of the simulation and of its sensors where None.
        record_directory: parent of the new directory.
        frame_period: s.
        rerun: "none", "file", "live" (file and server on 127.0.0.1), or "web" (file, server and page for a browser).
        splitting: when the logs go on in new files, and how long old files are kept.
        names: full names of topics in the bag; the default names where None.
        frames: names of coordinate frames; the default names where None.

    Raises:
        OSError: when the directory or the bag in it cannot be made. A rerun recording that cannot be opened is a fault
            of the recorder, and the bag goes on.
    """
    directory = _new_directory(record_directory)
    if table is None:
        table = (*topics(simulation.layout), *sensor_topics(simulation.scenario))
    logs = _open_logs(simulation, table, directory, frame_period=frame_period, rerun=rerun, names=names, frames=frames)
    new_directory = partial(_new_directory, record_directory)
    recorder = Recorder(logs.bag, *logs.views, splitting=splitting, new_directory=new_directory)
    recorder.faults += logs.faults
    return Run(simulation, recorder, logs.live_url, logs.web)


def _new_directory(parent: Path, gone: Path | None = None) -> Path:
    """Make a directory for a run, named after the time; waits for the next second where the name is or was in use."""
    parent.mkdir(parents=True, exist_ok=True)
    while True:
        directory = parent / datetime.now().strftime("%Y-%m-%d_%H-%M-%S")
        with suppress(FileExistsError):
            if directory != gone:
                directory.mkdir()
                return directory
        time.sleep(0.2)


class _Logs(NamedTuple):
    """Open logs of a run: bag, rerun views, live view, and errors of views that could not be opened."""

    bag: McapLog
    views: tuple[View, ...]
    live_url: str | None  # address of the live view for rerun viewers
    web: WebView | None  # live view for a browser
    faults: list[str]  # logs that could not be opened, a line each


def _open_logs(
    simulation: Simulation,
    table: Sequence[Topic],
    directory: Path,
    *,
    frame_period: float,
    rerun: str = "file",
    names: TopicNames | None = None,
    frames: FrameNames | None = None,
) -> _Logs:
    """Open bag and views of a run in its directory, with further arguments as in `start_run`.

    Raises:
        OSError: when the bag cannot be made; all others are faults, and the bag goes on.
    """
    scenario = simulation.scenario
    metadata = run_metadata(scenario.resolved(), simulation.layout, frame_period=frame_period, frames=frames)
    log = McapLog(directory, (*table, COLUMNS_TOPIC), metadata, names=names)
    view, web = None, None
    faults: list[str] = []
    for live in {"none": (), "file": (False,)}.get(rerun, (True, False)):
        try:
            port = {"live_port": free_port(LIVE_PORT)} if live and rerun == "web" else {}
            view = open_view(scenario, log.path.with_suffix(".rrd"), live=live, **port)
            view.lay_out(simulation.snapshot)
            break
        except Exception as error:  # rerun has no class of its own; the bag is worth having without it
            missing = "live view, a file only" if live else "rerun recording"
            faults.append(f"recording: no {missing}: {why_not(error)}")
    if rerun == "web" and view is not None and view.url is not None:
        try:
            web = WebView(view.url)
        except (OSError, ImportError) as error:
            faults.append(f"recording: no web view: {why_not(error)}")
    views = () if view is None else (view,)
    return _Logs(log, views, view.url if view is not None else None, web, faults)


def open_view(scenario: Scenario, path: Path | None, *, live: bool = False, **options: Any) -> RerunView:
    """Open a rerun view of a scenario, written to a file, served live, or both.

    Args:
        scenario: Scenario of the run.
        path: The .rrd to write, or None.
        live: Serve the picture as well.
        **options: Other arguments of `RerunView`.

    Raises:
        OSError: When the file cannot be created or the port is in use.
    """
    from cable_twin.view.rerun_view import RerunView  # noqa: PLC0415 - half a second
    from cable_twin.view.space import InSpace  # noqa: PLC0415

    space = None
    apart = any(rope.lateral for rope in scenario.ropes.values())
    if scenario.dim == 3 or apart:
        towers = {name: np.array(place) for name, place in scenario.tower_places.items()}
        space = InSpace(body_solids(scenario), towers, between=apart)
    return RerunView(
        scenario.name,
        body_outlines(scenario),
        path=path,
        live=live,
        ground=scenario.terrain or None,
        support_positions={name: (tower.position[0], tower.position[-1]) for name, tower in scenario.towers.items()},
        carriers=[name for name in scenario.vehicles if name not in scenario.carriages],
        space=space,
        wheels=wheel_rims(scenario),
        **options,
    )
