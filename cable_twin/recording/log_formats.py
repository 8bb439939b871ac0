"""Log formats of a run: an MCAP bag, and rerun in a file, live or in a browser; all logs are opened here."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from cable_twin.geometry.bodies import body_outlines, body_solids
from cable_twin.geometry.bullwheel_rims import wheel_rims
from cable_twin.messages import FrameNames, Topic, TopicNames
from cable_twin.recording.log_writer import McapLog, run_metadata
from cable_twin.recording.recorder import View
from cable_twin.scenario import Scenario
from cable_twin.simulation import SAMPLES, Simulation
from cable_twin.view.web_view import LIVE_PORT, WebView, free_port, why_not

if TYPE_CHECKING:
    from cable_twin.view.rerun_view import RerunView


class Logs(NamedTuple):
    """All open logs of a run."""

    bag: McapLog
    views: tuple[View, ...]
    live_url: str | None  # where a rerun viewer finds the live view
    web: WebView | None  # the same for a browser
    faults: list[str]  # what could not be opened, a line each


def open_logs(
    simulation: Simulation,
    topics: Sequence[Topic],
    directory: Path,
    *,
    frame_period: float,
    rerun: str = "file",
    names: TopicNames | None = None,
    frames: FrameNames | None = None,
) -> Logs:
    """Open the logs of a run in its directory, with further arguments as in `run.start_run`.

    Raises:
        OSError: when the bag cannot be made; all others are faults, and the bag goes on.
    """
    scenario = simulation.scenario
    metadata = run_metadata(
        scenario=scenario.name,
        frame_period=frame_period,
        sample_count=SAMPLES,
        frames=frames,
        resolved=scenario.resolved(),
    )
    log = McapLog(directory, topics, metadata, names=names)
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
    return Logs(log, views, view.url if view is not None else None, web, faults)


def open_view(scenario: Scenario, path: Path | None, *, live: bool = False, **options: Any) -> RerunView:
    """Open a rerun view of a scenario, with bodies drawn from their pivots.

    Args:
        scenario: What runs.
        path: The .rrd to write, or None.
        live: Serve the picture as well.
        **options: What else `RerunView` takes.

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


__all__ = ["Logs", "open_logs", "open_view"]
