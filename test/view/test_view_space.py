"""Picture of a run in space: drawn numbers equal simulated ones, beside the plane of the track."""

from __future__ import annotations

import warnings
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

pytest.importorskip("rerun")

from bags import rerun_command
from drawn_run import column
from rerun.chunk import RrdReader
from small_tramway import IN_SPACE, TRAMWAY

from cable_twin.frame.records import Command
from cable_twin.geometry.bodies import body_solid
from cable_twin.recording.run import open_view
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation
from cable_twin.view.batch import QUIET
from cable_twin.view.plots import PLOT_COLORS
from cable_twin.view.space import WIND
from cable_twin.view.tension_colors import COLOR_STOPS
from cable_twin.view.track import BODY_COLORS, CARRIAGE_COLORS, GROUND

LIGHT, DARK = 1.0, 0.004  # luminance of what rerun draws on
READABLE = 2.0  # of a line; 3 of letters


def draw(scenario, path):
    """Draw two seconds with wind from the first on; returns the frames."""
    simulation = Simulation(scenario)
    view = open_view(scenario, path)
    snapshots = [simulation.snapshot]
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # rerun turns mistakes into warnings
        view.log(simulation.snapshot)
        for frame in range(1, 41):
            if frame == 20:
                view.log_command(simulation.apply(Command("wind", {"x": 3.0, "y": 15.0, "z": 0.0})))
            snapshots.append(simulation.advance_to(0.05 * frame))
            view.log(snapshots[-1])
        view.close()
    return snapshots


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    path = tmp_path_factory.mktemp("space") / "run.rrd"
    return path, draw(load_scenario(IN_SPACE), path)


def test_both_views_are_laid_out_and_the_file_is_sound(drawn):
    path, _ = drawn
    assert "without error" in rerun_command("rrd", "verify", path)
    blueprint = rerun_command("rrd", "print", "-vvv", path)
    for shown in ("In space", "cabin in space", "Track, rope coloured by tension", "EyeControls3D"):
        assert shown in blueprint
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    drawn_there = ("ground", "supports", "names", "rope", "wind", "carriages/cabin/cabin", "close_ups/cabin")
    assert {f"/space/{name}" for name in drawn_there} <= entities
    assert {"/plots/roll/cabin", "/plots/lateral/cabin", "/plots/wind"} <= entities


def test_rope_is_in_space_where_it_is(drawn):
    path, snapshots = drawn
    times, frames = column(path, "/space/rope", "LineStrips3D:strips")
    assert len(times) == len(column(path, "/track/rope", "LineStrips2D:strips")[0]) > 10
    for row in (0, -1):
        snapshot = snapshots[round(times[row] * 20.0)]
        lines = [np.array(line) for line in frames[row]]
        for one, following in pairwise(lines):
            np.testing.assert_array_equal(one[-1], following[0])
        rope = np.vstack([lines[0], *(line[1:] for line in lines[1:])])
        expected = np.vstack([snapshot.cable.positions, snapshot.carriages["cabin"].position])
        np.testing.assert_allclose(rope, expected[np.argsort(expected[:, 0])], atol=1e-4)
    assert abs(rope[:, 1]).max() > 0.2  # at the tower beside the line, and in the wind


def test_cabins_are_solids_with_their_roll(drawn):
    path, snapshots = drawn
    times, places = column(path, "/space/carriages/cabin/cabin", "InstancePoses3D:translations")
    _, turns = column(path, "/space/carriages/cabin/cabin", "InstancePoses3D:quaternions")
    assert len(times) == 41
    for row in (0, 25, 40):
        body = snapshots[round(times[row] * 20.0)].carriages["cabin"].bodies["cabin"]
        np.testing.assert_allclose(places[row][0], body.position, atol=1e-4)
        np.testing.assert_allclose(turns[row][0], body.orientation, atol=1e-6)
        roll = np.degrees(Rotation.from_quat(turns[row][0]).as_euler("ZYX")[2])
        assert roll == pytest.approx(np.degrees(body.roll), abs=1e-4)
    assert roll > 1.0  # to the left, as the wind blows


def test_a_solid_has_the_size_of_its_body_and_reaches_its_pin():
    body = load_scenario(IN_SPACE).carriages["cabin"].bodies["cabin"]
    solid = body_solid(body)
    assert solid.vertices[:, 2].max() == pytest.approx(body.upper_pivot[1])
    box = solid.vertices[:24]
    np.testing.assert_allclose(np.ptp(box, axis=0)[[0, 2]], body.size)
    corners = box[solid.triangles[:12]]
    faces = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert 0.5 * np.linalg.norm(faces, axis=1).sum() == pytest.approx(
        2.0 * sum(a * b for a, b in pairwise([*np.ptp(box, axis=0), np.ptp(box, axis=0)[0]]))
    )
    outwards = np.einsum("ij,ij->i", solid.vertices[:24], solid.normals[:24])
    assert (outwards > 0.0).all()


def test_plots_show_roll_place_and_wind(drawn):
    path, snapshots = drawn
    _, rolls = column(path, "/plots/roll/cabin", "Scalars:scalars")
    _, places = column(path, "/plots/lateral/cabin", "Scalars:scalars")
    times, wind = column(path, "/plots/wind", "Scalars:scalars")
    cabin = snapshots[-1].carriages["cabin"].bodies["cabin"]
    assert rolls[-1] == [pytest.approx(np.degrees(cabin.roll))]
    assert places[-1] == [pytest.approx(cabin.position[1])]
    np.testing.assert_array_equal(wind, np.where(times[:, None] > 0.96, [3.0, 15.0, 0.0], 0.0))
    _, texts = column(path, "/readout", "TextDocument:text")
    assert "| wind across | **15.0 m/s** |" in texts[-1][0]
    assert f"| swing across | **{np.degrees(cabin.roll):.1f} deg** |" in texts[-1][0]
    _, arrows = column(path, "/space/wind", "Arrows3D:vectors")
    direction = np.array(arrows[-1][0]) / np.linalg.norm(arrows[-1][0])
    np.testing.assert_allclose(direction, np.array([3.0, 15.0, 0.0]) / np.hypot(3.0, 15.0), atol=1e-6)


def test_a_planar_scenario_is_drawn_in_its_plane_alone(tmp_path):
    path = tmp_path / "run.rrd"
    scenario = load_scenario(TRAMWAY)
    view = open_view(scenario, path)
    view.log(Simulation(scenario).snapshot)
    view.close()
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert not [name for name in entities if name.startswith("/space") or name in ("/plots/wind", "/plots/roll/cabin")]


def test_carriers_of_one_look_are_one_entity_in_space(tmp_path):
    scenario = load_scenario("chairlift", {"space": 3})
    simulation, path = Simulation(scenario), tmp_path / "run.rrd"
    view = open_view(scenario, path)
    view.log(simulation.snapshot)
    view.close()
    entities = {chunk.entity_path for chunk in RrdReader(path).stream()}
    assert sum(name.startswith("/space/carriers/") for name in entities) == 1
    _, places = column(path, "/space/carriers/0", "InstancePoses3D:translations")
    np.testing.assert_allclose(places[0], simulation.snapshot.bodies.position, atol=1e-4)


def luminance(color):
    """Relative luminance of a colour 0xRRGGBBAA by WCAG 2."""
    channels = np.array([color >> 24 & 255, color >> 16 & 255, color >> 8 & 255]) / 255.0
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("ground", [LIGHT, DARK])
def test_colours_are_seen_on_light_and_on_dark_ground(ground):
    def contrast(color):
        high, low = sorted((luminance(color), ground), reverse=True)
        return (high + 0.05) / (low + 0.05)

    letters = (*PLOT_COLORS, *CARRIAGE_COLORS, QUIET)
    assert min(map(contrast, letters)) >= 3.0
    assert min(map(contrast, (*COLOR_STOPS, *BODY_COLORS, GROUND, WIND))) >= READABLE
