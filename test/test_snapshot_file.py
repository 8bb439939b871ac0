"""Snapshot files: complete, continued bit for bit, and other files refused in a line."""

from __future__ import annotations

import json
import zipfile
from dataclasses import fields, is_dataclass
from io import BytesIO

import numpy as np
import pytest
import test_loads
from bent_line import BENT
from test_moving_cable_twin import short_lift
from twin_process import write_quick_scenario

from cable_twin.frame.snapshot import Snapshot
from cable_twin.mechanics.state import FIELDS
from cable_twin.scenario import load_scenario
from cable_twin.simulation import Simulation, SnapshotError
from cable_twin.simulation.snapshot_file import FORMAT_VERSION, package_version
from verification import JIT
from verification.supports import tramway


def leaves(value):
    """Every number and array of a record."""
    if isinstance(value, Snapshot):
        layout = value.layout
        yield from leaves({"vehicles": layout.vehicles, "supports": layout.supports, "drives": layout.drives})
        yield layout.arc_lengths
        yield value.numbers
        yield from leaves(value.solver)
    elif is_dataclass(value):
        for item in fields(value):
            yield from leaves(getattr(value, item.name))
    elif isinstance(value, dict):
        for key, item in value.items():
            yield key
            yield from leaves(item)
    else:
        yield value


def assert_same_bits(first, second):
    for a, b in zip(leaves(first), leaves(second), strict=True):
        if isinstance(a, np.ndarray):
            assert a.tobytes() == b.tobytes()
        else:
            assert a == b


def give(simulation, events, time):
    """Apply due commands and advance to a time."""
    while events and events[0][0] <= time:
        due, event = events.pop(0)
        simulation.advance_to(due)
        event(simulation)
    return simulation.advance_to(time)


EVENTS = [
    (0.0, lambda simulation: simulation.command("cabin", speed=7.0)),
    (3.0, lambda simulation: simulation.command("cabin", speed=-2.0)),
    (4.4, lambda simulation: simulation.command("cabin", force=4.0e4)),
    (7.0, lambda simulation: simulation.emergency_stop()),
    (9.0, lambda simulation: simulation.emergency_stop(False)),
    (9.5, lambda simulation: simulation.command("cabin", speed=3.0)),
    (12.0, lambda simulation: simulation.reset()),
]


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return load_scenario(write_quick_scenario(tmp_path_factory.mktemp("scenario")))


@pytest.mark.parametrize("saved_at", [0.0, 1.005, 4.2, 5.0, 7.5, 10.0, 12.6])
def test_goes_on_with_the_same_bits(quick, tmp_path, saved_at):
    """Under way, in every drive mode, during an emergency stop, and after a reset."""
    simulation, events = Simulation(quick), list(EVENTS)
    give(simulation, events, saved_at)
    simulation.save(tmp_path / "state.npz")
    loaded, waiting = Simulation.load(tmp_path / "state.npz"), list(events)
    assert loaded.time == simulation.time == saved_at
    assert loaded.scenario == simulation.scenario
    assert loaded.emergency_stopped == simulation.emergency_stopped
    assert loaded.commands == simulation.commands
    assert not loaded.at_start
    start = loaded.snapshot
    assert_same_bits(Snapshot(start.layout, start.numbers, simulation.snapshot.solver), simulation.snapshot)
    for time in np.arange(saved_at + 0.05, 14.0, 0.05):
        assert_same_bits(give(simulation, events, time), give(loaded, waiting, time))
    assert_same_bits(simulation.energy(), loaded.energy())


def test_explicit_integrator_goes_on_with_the_same_bits(tmp_path):
    overrides = {"cable.elements": 6, "solver.integrator": "runge_kutta", "solver.step": 4e-5}
    simulation = Simulation(load_scenario("seed_example", overrides))
    simulation.advance_to(0.05)
    simulation.save(tmp_path / "state.npz")
    loaded = Simulation.load(str(tmp_path / "state.npz"))
    assert_same_bits(simulation.advance_to(0.1), loaded.advance_to(0.1))


def ski_lift():
    return short_lift(), [
        (0.0, lambda simulation: simulation.command("haul_rope", speed=3.0)),
        (2.5, lambda simulation: simulation.emergency_stop()),
    ]


def loaded_cabin():
    return Simulation(test_loads.scenario()), [
        (0.1, lambda simulation: simulation.payload("cabin", 120.0)),
        (0.2, lambda simulation: simulation.command("cabin", speed=3.0)),
        (0.4, lambda simulation: simulation.wind(9.0, -1.0)),
        (1.3, lambda simulation: simulation.emergency_stop()),
        (2.4, lambda simulation: simulation.reset()),
    ]


def cabin_in_space(alone=True):
    changes = {"space": 3, "air.wind": [2.0, 12.0, 0.0], "carriages.cabin.payload.position": [0.3, 0.4, -0.8]}
    return Simulation(test_loads.scenario(alone=alone, **changes)), [
        (0.1, lambda simulation: simulation.payload("cabin", 120.0)),
        (0.2, lambda simulation: simulation.command("cabin", speed=3.0)),
        (0.4, lambda simulation: simulation.wind(9.0, -1.0, -15.0)),
        (1.3, lambda simulation: simulation.emergency_stop()),
        (2.4, lambda simulation: simulation.reset()),
    ]


def two_in_space():
    return cabin_in_space(alone=False)


def tramway_with_tower():
    simulation = tramway(cabin={"arc_length": 500.0}, cable__elements=100)
    return simulation, [(0.0, lambda simulation: simulation.command("cabin", speed=5.0))]


def rope_off_its_tower():
    return Simulation(load_scenario(BENT)), [
        (0.1, lambda simulation: simulation.wind(0.0, 0.0, -40.0)),
        (3.0, lambda simulation: simulation.reset()),
    ]


@pytest.mark.skipif(not JIT, reason="minutes without compilation")
@pytest.mark.parametrize(
    "build",
    [
        ski_lift,
        loaded_cabin,
        cabin_in_space,
        pytest.param(two_in_space, marks=pytest.mark.long),  # its kernels are of no other test
        tramway_with_tower,
        rope_off_its_tower,
    ],
)
def test_all_that_a_scenario_may_hold_goes_on_with_the_same_bits(tmp_path, build):
    simulation, events = build()
    give(simulation, events, 1.0)
    simulation.save(tmp_path / "state.npz")
    loaded, waiting = Simulation.load(tmp_path / "state.npz"), list(events)
    for time in np.arange(1.1, 3.2, 0.1):
        assert_same_bits(give(simulation, events, time), give(loaded, waiting, time))
    assert not events


def test_reset_goes_back_to_the_start_of_the_one_that_was_saved(quick, tmp_path):
    simulation = Simulation(quick)
    start = simulation.snapshot
    simulation.command("cabin", speed=5.0)
    simulation.advance_to(3.0)
    simulation.save(tmp_path / "state.npz")
    loaded = Simulation.load(tmp_path / "state.npz")
    loaded.reset()
    assert_same_bits(loaded.snapshot.cable, start.cable)
    assert loaded.time == 3.0
    assert not loaded.commands


def test_state_of_another_scenario_is_refused(quick):
    full = Simulation(quick).capture()
    other = Simulation(load_scenario(quick.resolved(), {"gravity": 1.62}))
    with pytest.raises(SnapshotError, match="saved from another scenario than 'quick', or from other v"):
        other.restore(full)
    Simulation(load_scenario(quick.resolved())).restore(full)


def test_capture_is_a_copy(quick):
    simulation = Simulation(quick)
    start = simulation.capture()
    simulation.command("cabin", speed=5.0)
    simulation.restore(start)
    assert simulation.at_start
    simulation.command("cabin", speed=5.0)
    assert not simulation.at_start
    simulation.advance_to(1.0)
    full = simulation.capture()
    later = simulation.advance_to(2.0)
    simulation.restore(full)
    assert simulation.time == 1.0
    assert simulation.snapshot.carriages["cabin"].speed < later.carriages["cabin"].speed
    assert_same_bits(simulation.advance_to(2.0).cable, later.cable)


@pytest.fixture(scope="module")
def content(quick):
    """Header and arrays of a snapshot."""
    stream = BytesIO()
    simulation = Simulation(quick)
    simulation.command("cabin", speed=5.0)
    simulation.advance_to(1.0)
    simulation.capture().write(stream)
    stream.seek(0)
    with np.load(stream) as archive:
        arrays = dict(archive)
    return json.loads(arrays.pop("header").tobytes()), arrays


def write(path, header, arrays):
    np.savez(path, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays)
    return path


def test_file_holds_every_field_and_where_it_comes_from(content):
    header, arrays = content
    assert set(arrays) == {f"{part}/{field}" for part in ("state", "start") for field in FIELDS}
    assert header["package_version"] == package_version()
    assert header["commands"] == {"cabin": ["speed", 5.0]}
    assert header["time"] == 1.0


MADE = f"the snapshot was made by cable_twin {package_version()}, this is {package_version()}"


def change_header(**changes):
    return lambda header, arrays: ({**header, **changes}, arrays)


def change_arrays(**changes):
    def change(header, arrays):
        kept = {key: array for key, array in {**arrays, **changes}.items() if array is not None}
        return header, kept

    return change


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            change_header(format_version=FORMAT_VERSION + 1, package_version="9.9"),
            f"format version {FORMAT_VERSION + 1} is newer than this cable_twin reads ({FORMAT_VERSION}); "
            "update cable_twin: the snapshot was made by 9.9",
        ),
        (
            change_header(format_version=FORMAT_VERSION - 1),
            f"format version {FORMAT_VERSION - 1}; this cable_twin reads {FORMAT_VERSION}",
        ),
        (change_header(format_version="x"), f"format version 'x'; this cable_twin reads {FORMAT_VERSION}"),
        (change_header(format="other"), "not a snapshot of cable_twin: its header has another format"),
        (change_arrays(**{"state/reference.velocity": None}), f"no array reference.velocity in its state; {MADE}"),
        (change_arrays(**{"start/clock": None}), f"no array clock in its start; {MADE}"),
        (change_arrays(**{"state/weather": np.zeros(1)}), f"unknown array weather in its state; {MADE}"),
        (
            change_arrays(**{"state/reference.velocity": np.full(1, np.nan)}),
            "state/reference.velocity: holds nan; allowed: finite numbers up to 1e+15",
        ),
        (
            change_arrays(**{"state/reference.velocity": np.zeros(2)}),
            "state/reference.velocity: given float64 of shape (2,); allowed: float64 of shape (1,)",
        ),
        (
            change_arrays(**{"state/clock": np.zeros(1)}),
            "state/clock: given float64 of shape (1,); allowed: int64 of shape (1,)",
        ),
        (change_header(commands={"gondola": ["speed", 1.0]}), "command: given for gondola; allowed: cabin"),
        (
            change_header(scenario={"gravity": "strong"}),
            "scenario: mapping: ",
        ),
    ],
)
def test_what_does_not_fit_is_named(content, tmp_path, change, said):
    path = write(tmp_path / "state.npz", *change(*content))
    with pytest.raises(SnapshotError) as caught:
        Simulation.load(path)
    for line in str(caught.value).splitlines():
        assert line.startswith(f"{path}: {said}")


@pytest.mark.parametrize("header", [{}, {"scenario": 3}, {"commands": {"cabin": 3}}, {"time": "noon"}])
def test_header_without_its_keys_is_damaged(content, tmp_path, header):
    whole = {key: value for key, value in content[0].items() if key in ("format", "format_version")}
    path = write(tmp_path / "state.npz", {**whole, **header}, content[1])
    with pytest.raises(SnapshotError) as caught:
        Simulation.load(path)
    assert str(caught.value).startswith(f"{path}: damaged: ")


def test_what_is_no_snapshot_is_named(content, tmp_path):
    text, empty, foreign, pickled = (tmp_path / name for name in ("text", "empty", "foreign.npz", "pickled.npz"))
    text.write_text("not a snapshot")
    empty.touch()
    np.savez(foreign, a=np.zeros(3))
    np.savez(pickled, header=np.array([object()], dtype=object))
    archive = tmp_path / "archive.zip"
    with zipfile.ZipFile(archive, "w") as stream:
        stream.writestr("header.npy", "nothing")
    for path, said in (
        (tmp_path / "missing.npz", "no such file"),
        (tmp_path, "cannot be read (Is a directory)"),
        (text, "not a snapshot of cable_twin; allowed: a file that ~/save_snapshot or Simulation.save wrote"),
        (empty, "not a snapshot of cable_twin; allowed: a file that ~/save_snapshot or Simulation.save wrote"),
        (foreign, "not a snapshot of cable_twin: no header in it"),
        (pickled, "damaged: "),
        (archive, "damaged: "),
    ):
        with pytest.raises(SnapshotError) as caught:
            Simulation.load(path)
        (line,) = str(caught.value).splitlines()
        assert line.startswith(f"{path}: {said}")


def test_no_damage_goes_unnoticed(content, tmp_path):
    """One wrong bit, or a missing end: an error, or equal content for an unused bit."""
    whole = write(tmp_path / "whole.npz", *content).read_bytes()
    path = tmp_path / "damaged.npz"
    reference = Simulation.load(tmp_path / "whole.npz")
    random = np.random.default_rng(3)
    refused = 0
    for place in random.integers(0, len(whole), 60):
        data = bytearray(whole)
        data[place] ^= 1 << int(random.integers(8))
        path.write_bytes(data)
        try:
            loaded = Simulation.load(path)
        except SnapshotError:
            refused += 1
        else:
            assert_same_bits(loaded.snapshot, reference.snapshot)
    assert refused > 30
    for length in (10, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(SnapshotError, match="damaged"):
            Simulation.load(path)


def test_file_appears_whole_or_not_at_all(quick, tmp_path):
    simulation = Simulation(quick)
    with pytest.raises(OSError, match="No such file or directory"):
        simulation.save(tmp_path / "nowhere" / "state.npz")
    (tmp_path / "taken.npz").mkdir()
    with pytest.raises(OSError, match="directory"):
        simulation.save(tmp_path / "taken.npz")
    assert [path.name for path in tmp_path.iterdir()] == ["taken.npz"]
