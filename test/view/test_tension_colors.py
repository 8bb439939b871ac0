"""Colours and names of several ropes: each over its own range, in pictures and markers alike."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest

pytest.importorskip("rerun")

from drawn_run import column, static
from rerun.chunk import RrdReader

from cable_twin.messages import MARKERS, MessageEncoder, decode
from cable_twin.recording.run import open_view
from cable_twin.ros.markers import Markers
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation

SCENARIOS = {"jig_back": {}, "bicable": {}, "chairlift": {}, "chairlift in space": {"space": 3}}


@pytest.fixture(scope="module", params=list(SCENARIOS))
def shown(request, tmp_path_factory):
    """Simulation at its start, its recording, and its markers by namespace."""
    scenario = load_scenario(request.param.split()[0], SCENARIOS[request.param])
    simulation, path = Simulation(scenario), tmp_path_factory.mktemp("colors") / "run.rrd"
    view = open_view(scenario, path)
    view.log(simulation.snapshot)
    view.close()
    encoder = MessageEncoder(simulation.layout, 0)
    encoder.offer(MARKERS, partial(Markers, scenario, simulation.layout, frame_id="map"))
    ((_, message),) = encoder.frame(simulation.snapshot, [MARKERS])
    markers = {}
    for marker in decode(message, "visualization_msgs/msg/MarkerArray").markers:
        markers.setdefault(marker.ns, []).append(marker)
    return simulation, path, markers


def test_each_rope_has_colours_over_its_own_tensions(shown):
    simulation, path, markers = shown
    _, (colors,) = column(path, "/track/rope", "LineStrips2D:colors")
    _, (strips,) = column(path, "/track/rope", "LineStrips2D:strips")
    positions = simulation.snapshot.columns.rope_position
    for number, part in enumerate(simulation.layout.ropes.values()):
        own = {tuple(place) for place in np.float32(positions[part][:, ::2] * (1.0, -1.0))}
        drawn = {color for color, strip in zip(colors, strips, strict=True) if own >= {tuple(strip[0])}}
        assert len(drawn) >= 5
        blues = [color.b for color in markers["rope"][number].colors]
        assert max(blues) - min(blues) > 0.2


def test_legend_and_markers_tell_the_range_of_each_rope(shown):
    simulation, path, markers = shown
    _, ((legend,),) = column(path, "/track/tension_colors", "Points2D:labels")
    lines = legend.splitlines()
    assert [marker.text.rstrip() for marker in markers["tension_colors"]] == lines
    for line, (name, cable) in zip(lines, simulation.snapshot.ropes.items(), strict=True):
        called, _, span = line.partition(": ")
        low, to, high, unit = span.split()
        assert (called, to, unit) == (name, "to", "kN")
        lowest, highest = 1e-3 * cable.tensions.min(), 1e-3 * cable.tensions.max()
        assert float(low) <= lowest <= highest <= float(high)
        assert float(high) - float(low) < max(4.0 * (highest - lowest), 0.2 * highest)


def test_names_of_supports_do_not_stand_on_each_other(shown):
    simulation, path, markers = shown
    span = max(np.ptp(simulation.snapshot.columns.rope_position, axis=0))
    found = {"markers": [(one.pose.position.x, one.pose.position.y) for one in markers["names"]]}
    found["track"] = [(x, 0.0) for x, _ in static(path, "/track/names", "Points2D:positions")]
    texts = {
        "markers": [one.text for one in markers["names"]],
        "track": static(path, "/track/names", "Points2D:labels"),
    }
    if "/space/names" in entities(path):
        found["space"] = [place[:2] for place in static(path, "/space/names", "Points3D:positions")]
        texts["space"] = static(path, "/space/names", "Points3D:labels")
    for view, places in found.items():
        assert {"return", "drive"} <= set(texts[view])
        assert not [text for text in texts[view] if text.endswith(("_up", "_down")) or "/" in text]
        apart = np.abs(np.subtract.outer(*2 * [np.array(places)[:, 0]])) + 1e9 * np.eye(len(places))
        assert apart.min() > 0.02 * span


def entities(path):
    """Names of all entities in a recording."""
    return {chunk.entity_path for chunk in RrdReader(path).stream()}
