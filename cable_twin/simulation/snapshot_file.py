"""Full state of a simulation in one file, from which a run continues bit for bit.

The file is a numpy archive (.npz, nothing pickled) with a checksum over each part: `header`, a JSON text with format,
versions, scenario and what is commanded, and the arrays `state/FIELD` and `start/FIELD` for every field of `State`, so
that a new field comes along by itself and one that is missing is named.
"""

from __future__ import annotations

import json
import os
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np

from cable_twin.frame.records import Command
from cable_twin.mechanics.language.declared import (
    HUGEST,
    Kept,
    arrays_of,
    declared,
    is_common,
    range_faults,
    with_arrays_together,
)
from cable_twin.mechanics.on_rope.presence import bodies_of, vehicles_of
from cable_twin.mechanics.parameters import System
from cable_twin.mechanics.solution.bundle.records import BUNDLE_RANGES
from cable_twin.mechanics.state import FIELDS, RANGES, VEHICLES, State
from cable_twin.scenario import Scenario, ScenarioError, load_scenario

FORMAT = "cable_twin snapshot"
FORMAT_VERSION = 13
OWN_FIELDS = tuple(field.name for field in declared(State) if not is_common(field, VEHICLES))  # of a rope alone
SUFFIX = ".npz"
LARGEST = 2**28  # bytes of an array; the largest shipped scenario has 60 kB of them all
DRIVEN_BY = "speed", "force"  # kinds of commands that stay in force
PARTS = ("state", "start")  # of ropes beside the first: state2, start2 and on
BETWEEN = "between"  # what is on no rope alone
ANY_ERROR = Exception, MemoryError  # zipfile, zlib, numpy and json have dozens for a damaged file


class SnapshotError(ValueError):
    """Error of a snapshot file from which no simulation can start: one line with the file and the reason."""


@dataclass(frozen=True, slots=True)
class FullState:
    """Complete state of the simulation of a scenario, at one simulated time."""

    scenario: Scenario
    time: float  # s
    now: Kept  # states of all ropes with their vehicles, in one block
    before: Kept  # states at the start, restored by a reset
    emergency_stopped: bool
    commands: Mapping[str, Command]  # last drive command in force by carriage
    loading: Mapping[str, float]  # kg, wanted payload of vehicles being loaded
    at_start: bool = False  # whether at the start of the scenario without any step or command; False for a file
    couplings: tuple[Kept, ...] = ()  # motion of the couplings between ropes, now and at the start
    foreign: Mapping[str, Any] | None = None  # of a file, whose every number is checked before it is used: arrays of
    # what couples ropes, by name

    @property
    def states(self) -> tuple[State, ...]:
        """Present state of each rope."""
        return self.now.records

    @property
    def starts(self) -> tuple[State, ...]:
        """State of each rope at the start of the run."""
        return self.before.records

    @property
    def between(self) -> Mapping[str, Any]:
        """Arrays of couplings between ropes, at present and at the start of the run, by name; without empty arrays."""
        if self.foreign is not None:
            return self.foreign
        both = zip(("now", "start"), self.couplings, strict=False)
        return {f"{key}/{name}": one for key, kept in both for name, one in arrays_of(kept.record).items() if one.size}

    @property
    def state(self) -> State:
        """Present state of the first rope."""
        return self.states[0]

    @property
    def start(self) -> State:
        """State of the first rope at the start of the run."""
        return self.starts[0]

    def arrays(self, part: str) -> Mapping[str, Any]:
        """Arrays by name of the first rope: its present "state", or "start", the state at the start."""
        return arrays_of(getattr(self, part))

    def fits(self, scenario: Scenario) -> bool:
        """Whether the state was captured from an identical scenario object, and needs no check."""
        return self.scenario is scenario and self.foreign is None

    def check(self, scenario: Scenario, systems: Sequence[System], own: FullState) -> None:
        """Refuse the state if the simulation has another scenario or other arrays, or if saved values are invalid.

        Args:
            scenario: of the simulation.
            systems: of each of its ropes.
            own: full state of the simulation, for the shapes of its arrays.

        Raises:
            SnapshotError: the saved state does not fit the simulation.
        """
        if self.scenario is not scenario and self.scenario.resolved() != scenario.resolved():
            raise SnapshotError(
                f"saved from another scenario than '{scenario.name}', or from other values of its keys; "
                "allowed: a snapshot of the same scenario with equal values"
            )
        if self.between.keys() != own.between.keys():
            raise SnapshotError(
                f"couplings of ropes: {', '.join(sorted(self.between.keys() ^ own.between.keys()))}: given in one of "
                "snapshot and simulation; "
                "allowed: in both"
            )
        _check_shapes(self.between, own.between)
        for (part, number, state), (_, _, ours) in zip(self._numbered(), own._numbered(), strict=True):
            _check_shapes(
                *({f"{part}{number}/{name}": array for name, array in arrays_of(one).items()} for one in (state, ours))
            )
        if self.foreign is not None:
            self._check_numbers(systems)
            self._check_orders(scenario)

    def _check_numbers(self, systems: Sequence[System]) -> None:
        """Refuse saved indices out of bounds, and saved values outside their allowed ranges."""
        sizes: dict[str, float] = {}
        for part, number, state in self._numbered():
            system = systems[int(number or 1) - 1]
            sizes = _sizes(system, len(systems))
            # one after the other: the second reads at indices that the first has checked
            for fault in chain(range_faults(_own_arrays(system, state), RANGES, sizes), _state_faults(system, state)):
                raise SnapshotError(f"{part}{number}/{fault}")
        clock = int(self.state.clock[0])
        if not abs(self.time - clock * systems[0].solver.step) <= systems[0].solver.step:
            raise SnapshotError(
                f"time: given {self.time:.9g} s, but state/clock has {clock} steps of {systems[0].solver.step:g} s; "
                f"allowed: {clock * systems[0].solver.step:.9g} s"
            )
        sizes["beyond the rope"] = max(2.0 * system.cable.unstrained_length for system in systems)
        sizes["before the rope"] = -sizes["beyond the rope"]
        for part in ("now", "start"):
            arrays = {key.partition("/")[2]: array for key, array in self.between.items() if key.startswith(f"{part}/")}
            for fault in range_faults(arrays, BUNDLE_RANGES, sizes):
                raise SnapshotError(f"{BETWEEN}/{part}/{fault}")

    def _check_orders(self, scenario: Scenario) -> None:
        """Refuse commands and loadings of unknown carriages and drives, or of invalid kinds."""
        driven = [*scenario.vehicles, *scenario.drives]
        if strange := [name for name in self.commands if name not in driven]:
            raise SnapshotError(f"command: given for {', '.join(strange)}; allowed: {', '.join(driven) or 'none'}")
        for name, command in self.commands.items():
            value = command.values[name]
            if command.kind not in DRIVEN_BY or not abs(value) <= HUGEST:
                given = f"{command.kind!r} of {value!r}"
                raise SnapshotError(f"command for {name}: given {given}; allowed: a finite {' or '.join(DRIVEN_BY)}")
        if strange := [name for name in self.loading if name not in scenario.vehicles]:
            raise SnapshotError(f"loading: given for {', '.join(strange)}; allowed: {', '.join(scenario.vehicles)}")
        for name, mass in self.loading.items():
            if not 0.0 <= mass <= HUGEST:
                raise SnapshotError(f"loading of {name}: given {mass:g} kg; allowed: a finite number from 0 on")

    def _numbered(self) -> Iterator[tuple[str, str, State]]:
        """Saved states of all ropes: "state" or "start", number of the rope (empty for the first), and the state."""
        for part in PARTS:
            for number, state in enumerate(getattr(self, f"{part}s")):
                yield part, str(number + 1) if number else "", state

    def write(self, target: Path | IO[bytes]) -> None:
        """Write the full state to a file, whole or not at all.

        Args:
            target: Path, whose directory exists, or a binary stream.

        Raises:
            OSError: The disk refuses.
        """
        header = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "package_version": package_version(),
            "time": self.time,
            "emergency_stopped": self.emergency_stopped,
            "commands": {name: [item.kind, item.values[name]] for name, item in self.commands.items()},
            "loading": dict(self.loading),
            "scenario": self.scenario.resolved(),
        }
        arrays = {"header": np.frombuffer(json.dumps(header).encode(), np.uint8)}
        for part, number, state in self._numbered():
            names = OWN_FIELDS if number else FIELDS  # vehicles exist once, with the first rope
            arrays |= {f"{part}{number}/{name}": arrays_of(state)[name] for name in names}
        arrays |= {f"{BETWEEN}/{name}": array for name, array in self.between.items()}
        if not isinstance(target, Path):
            np.savez(target, **arrays)  # type: ignore[arg-type]  # its option allow_pickle is none of our names
            return
        new = target.with_name(f"{target.name}.new")
        try:
            with new.open("wb") as stream:
                np.savez(stream, **arrays)  # type: ignore[arg-type]
                stream.flush()
                os.fsync(stream.fileno())
            new.replace(target)
        except OSError:
            new.unlink(missing_ok=True)
            raise


def read_full_state(source: Path | IO[bytes], name: str) -> FullState:
    """Read a full state written by `FullState.write`.

    Args:
        source: Path, or a binary stream.
        name: Name of the file in messages.

    Raises:
        SnapshotError: there is no such file, or it is no snapshot, or a damaged one, or one of another version.
    """
    if not isinstance(source, Path):
        return _read(source, name)
    try:
        with source.expanduser().open("rb") as stream:
            return _read(stream, name)
    except FileNotFoundError:
        raise SnapshotError(f"{name}: no such file") from None
    except (OSError, RuntimeError) as error:  # RuntimeError: ~ of a user without a home
        raise SnapshotError(f"{name}: cannot be read ({getattr(error, 'strerror', None) or error})") from None


def package_version() -> str:
    """Version of the installed cable_twin."""
    try:
        return version("cable_twin")
    except PackageNotFoundError:
        return "unknown"


def _read(stream: IO[bytes], name: str) -> FullState:
    if not zipfile.is_zipfile(stream):
        stream.seek(0)
        what = "damaged or cut short" if stream.read(2) == b"PK" else "not a snapshot of cable_twin"
        raise SnapshotError(f"{name}: {what}; allowed: a file that ~/save_snapshot or Simulation.save wrote")
    try:
        _check_archive(stream)
        stream.seek(0)
        with np.load(stream, allow_pickle=False) as archive:
            if "header" not in archive.files:
                raise SnapshotError("not a snapshot of cable_twin: no header in it")
            header = json.loads(archive["header"].tobytes())
            _check_header(header)
            arrays = {key: np.asarray(archive[key]) for key in archive.files if key != "header"}
        commands = {key: Command(kind, {key: float(value)}) for key, (kind, value) in header["commands"].items()}
        loading = {key: float(mass) for key, mass in header["loading"].items()}
        time, stopped, scenario = float(header["time"]), bool(header["emergency_stopped"]), header["scenario"]
    except SnapshotError as error:
        raise SnapshotError(f"{name}: {error}") from None
    except ANY_ERROR as error:
        raise SnapshotError(f"{name}: damaged: {' '.join(str(error).split()) or type(error).__name__}") from None
    made = f"the snapshot was made by cable_twin {header.get('package_version')}, this is {package_version()}"
    try:
        loaded = load_scenario(scenario)
    except ScenarioError as error:
        raise SnapshotError("\n".join(f"{name}: scenario: {fault}; {made}" for fault in error.faults)) from None
    numbers = ["", *(str(number) for number in range(2, len(loaded.ropes) + 1))]
    now, before = (_states(part, numbers, arrays, name, made) for part in PARTS)
    between = {key.partition("/")[2]: array for key, array in arrays.items() if key.startswith(f"{BETWEEN}/")}
    return FullState(loaded, time, now, before, stopped, commands, loading, foreign=between)


def _check_archive(stream: IO[bytes]) -> None:
    """Refuse a snapshot archive with compressed or too large members."""
    with zipfile.ZipFile(stream) as archive:
        for member in archive.infolist():
            if member.compress_type != zipfile.ZIP_STORED or member.file_size > LARGEST:
                kind = "compressed" if member.compress_type != zipfile.ZIP_STORED else f"of {member.file_size} bytes"
                allowed = f"at most {LARGEST} bytes, not compressed"
                raise SnapshotError(f"not a snapshot of cable_twin: {member.filename!r} is {kind}; allowed: {allowed}")


def _check_header(header: Any) -> None:
    """Refuse the header of an archive of another program or of another format version."""
    if not isinstance(header, dict) or header.get("format") != FORMAT:
        raise SnapshotError("not a snapshot of cable_twin: its header has another format")
    given = header.get("format_version")
    if given == FORMAT_VERSION:
        return
    if isinstance(given, int) and given > FORMAT_VERSION:
        raise SnapshotError(
            f"format version {given} is newer than this cable_twin reads ({FORMAT_VERSION}); "
            f"update cable_twin: the snapshot was made by {header.get('package_version')}"
        )
    raise SnapshotError(f"format version {given!r}; this cable_twin reads {FORMAT_VERSION}")


def _states(part: str, numbers: Sequence[str], arrays: Mapping[str, Any], name: str, made: str) -> Kept:
    """Build the states of all ropes from their arrays, with an error that names missing and unknown fields."""
    found: list[dict[str, Any]] = []
    for number in numbers:
        within, fields = f"{part}{number}", OWN_FIELDS if number else FIELDS
        given = {key.partition("/")[2] for key in arrays if key.startswith(f"{within}/")}
        if missing := [field for field in fields if field not in given]:
            raise SnapshotError(f"{name}: no array {', '.join(missing)} in its {within}; {made}")
        if unknown := sorted(given - set(fields)):
            raise SnapshotError(f"{name}: unknown array {', '.join(unknown)} in its {within}; {made}")
        found.append({field: arrays[f"{within}/{field}"] for field in fields})
    return Kept(*with_arrays_together(State, found, VEHICLES))


def _check_shapes(given: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """Refuse arrays with other shapes or types than in a simulation."""
    for name, target in own.items():
        array = given[name]
        if array.shape != target.shape or array.dtype != target.dtype:
            raise SnapshotError(
                f"{name}: given {array.dtype} of shape {array.shape}; "
                f"allowed: {target.dtype} of shape {target.shape}, as its scenario needs"
            )


def _sizes(system: System, ropes: int) -> dict[str, float]:
    """Values of the symbolic bounds, such as the last vehicle's index, used in the allowed ranges of state arrays."""
    length = system.cable.unstrained_length
    return {
        "last element": system.cable.element_count - 1,
        "vehicles": system.carriages.fixed.size,
        "last vehicle": system.carriages.fixed.size - 1,
        "last rope": ropes - 1,
        "before the rope": -2.0 * length,  # an end stop yields, and a rope goes by
        "beyond the rope": 2.0 * length,
    }


def _own_arrays(system: System, state: State) -> dict[str, Any]:
    """Arrays of a state by name; arrays of vehicles and bodies have rows only for vehicles on the rope."""
    rows = {"vehicle": vehicles_of(system, state), "body": bodies_of(system, state)}
    arrays = arrays_of(state)
    for field in declared(State):
        if is_common(field, VEHICLES) and field.name != "vehicle_rope":  # by which the rows are chosen
            arrays[field.name] = arrays[field.name][rows[str(field.shape[0])]]
    return arrays


def _mesh_faults(system: System, state: State) -> Iterator[str]:
    """Errors in a saved mesh: nodes out of order, and nodes that follow a load without a reference back."""
    places = state.mesh.arc_length
    if not np.all(np.diff(places) > 0.0) or np.any(np.abs(np.diff(places) - state.mesh.length) > 1e-9 * places[-1]):
        yield "mesh.arc_length: nodes are out of order, or apart by other than mesh.length"
    loads = np.flatnonzero(state.node_load >= 0)
    followed = np.flatnonzero(vehicles_of(system, state) & (state.joint_node >= 0))
    if loads.size > 0 and not system.cable.load_nodes:
        yield f"node_load: node {loads[0]} follows a load; allowed: none with this scenario's cable.joint"
    elif loads.size != followed.size or np.any(state.joint_node[state.node_load[loads]] != loads):
        yield "node_load: nodes follow other loads than joint_node says"
    elif np.any(loads == 0) or np.any(loads == places.size - 1):
        yield "node_load: an end of the rope follows a load; allowed: inner nodes"


def _state_faults(system: System, state: State) -> Iterator[str]:
    """Errors in a saved state other than ranges: mesh, joints off their elements, quaternions without unit length."""
    yield from _mesh_faults(system, state)
    nodes = state.mesh.arc_length
    near = system.cable.element_length.max()  # within a step it goes on to the next one
    for joint in np.flatnonzero(state.attached & vehicles_of(system, state)):
        element, place = int(state.joint_element[joint]), float(state.joints.position[joint])
        start = -np.inf if element == 0 else nodes[element] - near
        end = np.inf if element == system.cable.element_count - 1 else nodes[element + 1] + near
        if not start <= place <= end:
            allowed = f"{start:.6g} to {end:.6g} m, for its joint_element {element}"
            yield f"joints.position: given {place:.6g} m for vehicle {joint}; allowed: {allowed}"
    bodies = state.bodies.position
    if bodies.shape[1] == 7:
        lengths = np.linalg.norm(bodies[:, 3:], axis=1)
        for body in np.flatnonzero(~(np.abs(lengths - 1.0) <= 1e-6))[:1]:
            yield (f"bodies.position: the quaternion of body {body} has a length of {lengths[body]:.3g}; allowed: 1")


__all__ = ["SUFFIX", "FullState", "SnapshotError", "package_version", "read_full_state"]
