"""The plant in Exudyn: whole trips run, and move as those of this program with the same values do."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.exudyn_model import load_exudyn
from cable_twin.frame.records import Command
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from verification.exudyn_plant import FREE_SPAN, TRUTH, course_of
from verification.exudyn_tramway import CARRIAGE, Rope, Tramway

FAR = 400.0  # m from the origin, where Newton's method has failed with Exudyn's own joint
DURATION, SPEED, ELEMENT = 12.0, 6.0, 2.0  # s, m/s, m


def test_moves_as_this_program_does(tmp_path):
    exudyn = load_exudyn()
    if exudyn is None:
        pytest.skip("needs Exudyn")
    scenario = load_scenario("aerial_tramway", {**FREE_SPAN, **TRUTH, f"carriages.{CARRIAGE}.arc_length": FAR})
    script = tmp_path / "trip.yaml"
    script.write_text(f"- {{time: 0, name: {CARRIAGE}, speed: {SPEED}}}\n", encoding="utf-8")
    course = course_of(scenario, script, DURATION)
    near, far = FAR - 20.0, FAR + float(course.way[-1]) + 10.0
    length = scenario.cable.unstrained_length
    nodes = [np.linspace(0.0, near, 40), np.arange(near + ELEMENT, far, ELEMENT), np.linspace(far, length, 60)]
    rows = []
    plant = Tramway(exudyn, Simulation(scenario), np.concatenate(nodes), scenario.solver.step)
    plant.rest()
    plant.run(course.drum, DURATION, 0.1, rows.append)
    ours = Simulation(scenario)
    ours.apply(Command("speed", {CARRIAGE: SPEED}))
    frames = [ours.advance_to(row.time) for row in rows]
    assert rows[-1].place > FAR + 10.0
    supports = ours.layout.support_rows
    forces = np.array([frame.columns.support_force for frame in frames])
    differences = {
        "place": [row.place - frame.carriages[CARRIAGE].arc_length for row, frame in zip(rows, frames, strict=True)],
        "drive": [row.drive_force for row in rows] - np.array([frame.columns.drive_force[0] for frame in frames]),
        **{
            end: np.linalg.norm([getattr(row, end) for row in rows], axis=1)
            - np.linalg.norm(forces[:, supports[end]], axis=1)
            for end in ("start", "end")
        },
    }
    means = {name: abs(float(np.mean(values))) for name, values in differences.items()}
    assert means["place"] < 0.02
    assert means["drive"] < 60.0  # of 25 kN; with elements of 1 m 10 N
    assert means["start"] < 130.0  # of 1.3 MN
    assert means["end"] < 130.0


def test_nearest_point_of_a_rope():
    rope = Rope(np.array([0.0, 2.0, 5.0]))
    nodes = np.array([[0.0, 0.0, 1.0, 0.0], [2.0, 1.0, 1.0, 0.5], [5.0, 1.0, 1.0, 0.0]])
    place = rope.nearest(nodes, rope.at(nodes, 3.3), 2.4)
    assert place == pytest.approx(3.3)
