"""Range checks of snapshot files: indices, modes, places and numbers, of one rope and several."""

from __future__ import annotations

import zipfile
from dataclasses import replace
from io import BytesIO
from typing import Annotated, NamedTuple

import numpy as np
import pytest

from cable_twin.mechanics.language.declared import ANY, Range, arrays_of, ranges_of
from cable_twin.mechanics.parameters import FloatArray, IntArray
from cable_twin.mechanics.solution.bundle.records import BUNDLE_RANGES
from cable_twin.mechanics.state import RANGES
from cable_twin.messages import topics
from cable_twin.offline import replay
from cable_twin.offline import simulate as simulate_command
from cable_twin.recording.run import start_run
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, SnapshotError
from cable_twin.simulation.snapshot_file import read_full_state
from verification import JIT

NAMES = ("seed_example", "windy_tramway", "chairlift", "jig_back")  # one rope and several, in a plane and in space
BEYOND = (2**62, -(2**31), -5)  # of every range of whole numbers
STRANGE = (np.nan, -np.inf, -1e300)

pytestmark = pytest.mark.skipif(not JIT, reason="minutes without compilation")


@pytest.fixture(scope="module", params=NAMES)
def simulation(request):
    made = Simulation(load_scenario(request.param))
    made.advance_to(0.05)
    return made


def saved(simulation):
    """Snapshot file of a simulation, as read."""
    stream = BytesIO()
    simulation.capture().write(stream)
    stream.seek(0)
    return replace(read_full_state(stream, "state.npz"), scenario=simulation.scenario)  # the same, at once


def test_what_is_sound_is_taken(simulation):
    simulation.restore(saved(simulation))


def test_no_number_outside_its_range_is_taken(simulation):
    full = saved(simulation)
    before = simulation.snapshot.numbers.tobytes()
    tried, several = set(), len(simulation.parts) > 1  # then a value of each array, as there are hundreds of them
    for within, ranges, arrays in (
        (r"state\d*/", RANGES, arrays_of(full.states[0])),
        (r"start\d*/", RANGES, arrays_of(full.starts[-1])),
        *((f"between/{part}/", BUNDLE_RANGES, part_of(full.between, part)) for part in ("now", "start")),
    ):
        for name, array in arrays.items():
            if not array.size:
                continue
            kept = array.copy()
            values = BEYOND if array.dtype.kind == "i" else STRANGE if array.dtype.kind == "f" else ()
            for value in values[: 1 if several else None]:
                array.flat[-1 if len(ranges[name]) == 1 else 0] = value
                with pytest.raises(SnapshotError, match=rf"^{within}{name}: .*; allowed: ") as raised:
                    simulation.restore(full)
                assert "\n" not in str(raised.value)
                array[...] = kept
                tried.add(name)
    assert {"joint_element", "drives.mode", "nodes.position", "clock"} <= tried or not simulation.carriages
    assert simulation.snapshot.numbers.tobytes() == before, "nothing was changed"
    simulation.restore(full)


def part_of(between, part):
    return {key.removeprefix(f"{part}/"): array for key, array in between.items() if key.startswith(f"{part}/")}


def test_a_joint_is_on_the_element_that_is_named(simulation):
    full = saved(simulation)
    state = full.states[0]
    if not state.joint_element.size:
        pytest.skip("no vehicle on its first rope")
    joint = int(np.flatnonzero(state.attached)[0])
    kept = int(state.joint_element[joint])
    state.joint_element[joint] = (kept + len(state.nodes.position) // 2) % (len(state.nodes.position) - 1)
    with pytest.raises(SnapshotError, match=r"^state/joints\.position: given .* m for vehicle 0; .* joint_element"):
        simulation.restore(full)


def test_conditions_are_true_or_false(simulation):
    full = saved(simulation)
    full.states[0].rope_drive.braking.view(np.uint8)[0] = 7
    with pytest.raises(SnapshotError, match=r"^state/rope_drive.braking: holds a byte that is neither true nor false"):
        simulation.restore(full)


def test_orders_are_finite(simulation):
    full = saved(simulation)
    name = next(iter([*simulation.drives, *simulation.carriages]))
    if name in simulation.carriages:
        with pytest.raises(SnapshotError, match=f"^loading of {name}: given nan kg; allowed"):
            simulation.restore(replace(full, loading={name: float("nan")}))
    for time in (np.nan, np.inf, 1e300, full.time + 1.0):
        with pytest.raises(SnapshotError, match=r"^time: given .* s, but state/clock has "):
            simulation.restore(replace(full, time=time))


def test_a_bag_with_such_a_snapshot_is_refused_in_a_line(tmp_path, capsys):
    simulation = Simulation(load_scenario("seed_example"))
    simulation.advance_to(0.02)
    state = simulation.parts["cable"].state
    state.joint_element[0] = 2**31  # as it is attached; no step is taken from there
    run = start_run(simulation, topics(simulation.layout), record_directory=tmp_path, frame_period=0.01, rerun="none")
    run.begin(0)
    run.close()
    assert replay.main([str(run.directory)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "state/joint_element: holds 2147483648; allowed: 0 to " in said
    assert simulate_command.main(["--from-bag", str(run.directory), "--duration", "0.1", "--record", "off"]) == 2
    assert "state/joint_element: holds 2147483648; allowed: 0 to " in capsys.readouterr().err


def test_an_archive_that_unpacks_to_more_than_it_is_is_refused(tmp_path):
    file = tmp_path / "bomb.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("header.npy", b"\x00" * 2**20)
    with pytest.raises(SnapshotError, match=r"bomb\.npz: .* 'header\.npy' is compressed; allowed: "):
        Simulation.load(file)


def test_ranges_are_those_of_the_declaration():
    class Inner(NamedTuple):
        place: FloatArray

    class Outer(NamedTuple):
        inner: Inner
        index: Annotated[IntArray, Range(0, "last")]

    globals().update(Inner=Inner)
    assert ranges_of(Outer) == {"inner.place": (ANY,), "index": (Range(0, "last"),)}

    class Open(NamedTuple):
        index: IntArray

    with pytest.raises(TypeError, match=r"Open\.index: given integers without a range"):
        ranges_of(Open)
