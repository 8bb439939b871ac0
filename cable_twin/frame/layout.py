"""Layout of a frame: names of all objects, and index of each value in the row of a frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from itertools import pairwise
from math import inf, prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cable_twin.frame.records import FloatArray
from cable_twin.mechanics.language.declared import declared
from cable_twin.mechanics.readout.columns import Columns
from cable_twin.scenario import Scenario, most_by_drive
from cable_twin.scenario.sections.line import Cable

IntArray = NDArray[np.int64]
COLUMNS = declared(Columns)  # name, shape, unit of each
SLACKEST = 1.0  # N, tension of a strand below which what its bullwheel transfers is as with this one
CRAWL = 1e-9  # m/s, speed below which a limit of power limits as at this one, which is not at all
ENDS = ("start", "end")  # the first two supports of every rope
CABLE = "cable"  # name of the only rope
COMMANDED = ("nothing", "force", "speed", "emergency stop")  # by the number in `command_kind`
DERAILED = ("", "outward to the left", "outward to the right", "by lifting off")  # by the number in `tower_derailed`


class Layout:
    """Layout of the frames of one scenario: names of all objects, and columns with their indices in a frame.

    Attributes:
        vehicles: names of the bodies by name of their vehicle, in the order of the scenario: carriages, then carriers.
        carriages: names of the vehicles that the scenario names one by one.
        carriers: names of the vehicles of one kind that the scenario gives by their count.
        hauled: names of the vehicles that a haul rope pulls, or that are clamped to a second rope.
        supports: names of the supports of the ropes: start, end, towers.
        drives: names of the drives that move a cable.
        commanded: names of the objects that take speed and force commands: self-driven carriages, then drives.
        towers: names of the supports between the ends of a rope.
        space: whether the system is in space, not in a plane.
        grooves: places (3,) in m of the towers that hold a rope sideways, in space, by name.
        arc_lengths: (samples,) m, unstrained, of the samples of all ropes, one rope after the other.
        ropes: slice of the samples of each rope, by name.
        sheaves: names of the bullwheels that join ropes.
        connectors, pantographs: names of the connectors between ropes, and of the pantographs below a rope.
        several: whether ropes have names in the scenario.
        tower_rows: numbers of the towers among the supports.
        end_samples: number of the sample at each end of each rope, by the name of the support.
        sample_ropes: number of the rope of each sample (samples,).
        vehicle_ropes: (vehicles,) number of the rope of each vehicle, of one that goes round a loop the first.
        joints: (joints, 2) number of a rope and of a vehicle that may be on it; a carrier has one row a strand.
        rope_supports: rows of the supports of each rope.
        tensioned: names of the bullwheels with a tensioning device.
        arms: (drives,) m, radius of the bullwheel of each drive.
        drive_limits: (drives,) N, highest force of each, by its drive and by what its rope may bear; NaN of a moving
            cable.
        drive_sheaves: (drives,) number of the bullwheel of each drive; 0 of a moving cable.
        drive_powers: (drives,) W, highest power of each, inf without a limit.
        grips: (sheaves,) friction times wrap of each bullwheel: highest logarithm of the ratio of its tensions.
        laterals: m by name, offset to the left of each rope and of its vehicles in views of a planar system.
        loop_offsets: (ropes,) m, arc length on its loop of the start of each rope that is a strand, else 0.
        rope_offsets: (ropes,) m, added to the arc lengths of each rope to put all ropes one after the other.
        bodies: names of all bodies, VEHICLE/BODY.
        first_body: (vehicles + 1,) number of the first body of each vehicle.
        vehicle_rows, support_rows, drive_rows: number by name.
        body_rows: number by name of the bodies of each vehicle, from its first one on.
        size: count of the numbers of a frame.
    """

    def __init__(
        self,
        vehicles: Mapping[str, Sequence[str]],
        supports: Sequence[str],
        drives: Sequence[str],
        arc_lengths: FloatArray,
        *,
        carriers: int = 0,
        hauled: Sequence[str] = (),
        towers: Sequence[str] | None = None,
        ropes: Mapping[str, slice] | None = None,
        sheaves: Sequence[str] = (),
        connectors: Sequence[str] = (),
        pantographs: Sequence[str] = (),
        passive: Sequence[str] = (),
        space: bool = False,
        grooves: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Define the columns; the last `carriers` vehicles are carriers, those in `hauled` have haul ropes.

        Of carriages the `passive` ones take no commands.
        """
        self.space, self.grooves = space, dict(grooves or {})
        self.vehicles = {name: tuple(bodies) for name, bodies in vehicles.items()}
        names = tuple(self.vehicles)
        self.carriages, self.carriers = names[: len(names) - carriers], names[len(names) - carriers :]
        self.commanded = (*(name for name in self.carriages if name not in passive), *drives)
        self.supports, self.drives, self.hauled = tuple(supports), tuple(drives), tuple(hauled)
        self.arc_lengths = np.array(arc_lengths, dtype=np.float64)
        self.arc_lengths.setflags(write=False)
        self.towers = self.supports[len(ENDS) :] if towers is None else tuple(towers)
        self.ropes = {CABLE: slice(0, self.arc_lengths.size)} if ropes is None else dict(ropes)
        self.sheaves, self.connectors, self.pantographs = tuple(sheaves), tuple(connectors), tuple(pantographs)
        self.tower_rows = [self.supports.index(name) for name in self.towers]
        self.end_samples = {
            end if end in self.supports else f"{rope}/{end}": sample
            for rope, part in self.ropes.items()
            for end, sample in zip(ENDS, (part.start, part.stop - 1), strict=True)
        }
        self.sample_ropes = np.concatenate(
            [np.full(part.stop - part.start, n) for n, part in enumerate(self.ropes.values())]
        )
        self._place_ropes()
        self.bodies = tuple(f"{name}/{body}" for name, bodies in self.vehicles.items() for body in bodies)
        self.first_body = [0, *np.cumsum([len(bodies) for bodies in self.vehicles.values()], dtype=int).tolist()]
        self._places, self.size = self._lay_out()
        self.vehicle_rows, self.support_rows = numbered(self.vehicles), numbered(self.supports)
        self.drive_rows = numbered(self.drives)
        self.body_rows = tuple(numbered(bodies) for bodies in self.vehicles.values())

    def _lay_out(self) -> tuple[list[tuple[int, int, tuple[int, ...]]], int]:
        """Index range and shape of each column in the row of a frame, and the total number of values."""
        counts: dict[str | int, int] = {
            "vehicles": len(self.vehicles),
            "carriages": len(self.carriages),
            "bodies": len(self.bodies),
            "supports": len(self.supports),
            "drives": len(self.drives),
            "samples": self.arc_lengths.size,
            "ropes": len(self.ropes),
            "sheaves": len(self.sheaves),
            "connectors": len(self.connectors),
            "pantographs": len(self.pantographs),
        }
        shapes = [tuple(int(counts.get(count, count)) for count in column.shape) for column in COLUMNS]
        ends = [0, *np.cumsum([prod(shape) for shape in shapes], dtype=int).tolist()]
        return [(first, last, shape) for (first, last), shape in zip(pairwise(ends), shapes, strict=True)], ends[-1]

    def _place_ropes(self) -> None:
        """Initialise offsets and relations of one rope, its vehicles and supports; `of` sets those of several ropes."""
        self.several = False
        lengths = [self.arc_lengths[part.stop - 1] + 1.0 for part in self.ropes.values()]
        self.rope_offsets = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
        self.vehicle_ropes = np.zeros(len(self.vehicles), dtype=np.int64)
        self.tensioned: tuple[str, ...] = ()
        self.arms, self.grips = np.full(len(self.drives), np.nan), np.full(len(self.sheaves), np.nan)
        self.drive_limits, self.drive_sheaves = np.full(len(self.drives), np.nan), np.zeros(len(self.drives), np.intp)
        self.drive_powers = np.full(len(self.drives), np.inf)
        self.loop_offsets, self.laterals = np.zeros(len(self.ropes)), dict.fromkeys(self.ropes, 0.0)
        self.joints = np.array([(0, row) for row in range(len(self.vehicles))], dtype=np.int64).reshape(-1, 2)
        self.rope_supports: tuple[slice, ...] = (slice(0, len(self.supports)),)

    @classmethod
    def of(cls, scenario: Scenario, samples: int) -> Layout:
        """Layout of the frames of a scenario, with a number of samples (at least 2) on each rope."""
        names = tuple(scenario.cables)
        alone = [scenario.of_rope(name) for name in names]
        supports = [[*scenario.end_names(name), *one.towers] for name, one in zip(names, alone, strict=True)]
        layout = cls(
            {name: tuple(vehicle.bodies) for name, vehicle in scenario.vehicles.items()},
            [name for own in supports for name in own],
            tuple(scenario.drives),
            np.concatenate([_sample_places(one.cable, samples) for one in alone]),
            carriers=0 if scenario.carriers is None else scenario.carriers.count,
            hauled=[n for n, one in scenario.carriages.items() if one.drive.haul_rope is not None or one.clamped_to],
            towers=[name for own in supports for name in own[len(ENDS) :]],
            ropes={name: slice(row * samples, (row + 1) * samples) for row, name in enumerate(names)},
            sheaves=tuple(scenario.sheaves),
            connectors=tuple(scenario.connectors),
            pantographs=tuple(scenario.pantographs),
            passive=[name for name, one in scenario.carriages.items() if one.joint != "sliding" or one.clamped_to],
            space=scenario.dim == 3,
            grooves=scenario.tower_places if scenario.dim == 3 else None,
        )
        layout.several = bool(scenario.ropes)
        ends = [0, *np.cumsum([len(own) for own in supports]).tolist()]
        layout.rope_supports = tuple(slice(first, last) for first, last in pairwise(ends))
        wheels = scenario.sheaves
        layout.arms[:] = [wheels[one.sheave].radius if one.sheave else np.nan for one in scenario.drives.values()]
        layout.tensioned = tuple(name for name, wheel in wheels.items() if wheel.tensioning)
        for row, (name, drive) in enumerate(scenario.drives.items()):
            if drive.sheave:
                layout.drive_limits[row] = most_by_drive(scenario, name)
                layout.drive_sheaves[row] = layout.sheaves.index(drive.sheave)
        layout.drive_powers[:] = [one.limits.power or np.inf for one in scenario.drives.values()]
        layout.grips[:] = [wheel.friction * wheel.wrap for wheel in wheels.values()]
        for row, (name, own) in enumerate(zip(names, alone, strict=True) if layout.several else ()):
            layout.laterals[name] = own.cable.lateral
            layout.vehicle_ropes[[layout.vehicle_rows[vehicle] for vehicle in own.carriages]] = row
            strand = scenario.strands.get(name)
            layout.loop_offsets[row] = strand.offset if strand else 0.0
            if scenario.carriers and scenario.carriers.tracks:  # what rides a loop is told by its track, on no strand
                ridden = name in scenario.carriers.tracks.values()
                layout.loop_offsets[row] = layout.rope_offsets[row] if ridden else inf
        layout.joints = np.array(
            [(row, layout.vehicle_rows[name]) for row, own in enumerate(alone) for name in own.vehicles],
            dtype=np.int64,
        ).reshape(-1, 2)
        return layout

    @property
    def rides_loop(self) -> bool:
        """Whether carriers move from rope to rope on a loop."""
        return bool(self.several and self.carriers)

    def columns_of(self, rope: int, columns: Columns) -> Columns:
        """Views of a frame's columns, reduced to the samples, supports and tension range of one rope, by its index.

        Columns of vehicles and bodies stay whole; drives of several ropes belong to bullwheels and to no rope.
        """
        rows = {
            "samples": [*self.ropes.values()][rope],
            "supports": self.rope_supports[rope],
            "ropes": slice(rope, rope + 1),
            "drives": slice(None) if len(self.ropes) == 1 else slice(0),
        }
        own = (rows.get(str(column.shape[0]), slice(None)) for column in COLUMNS)
        return Columns(*(field[part] for field, part in zip(columns, own, strict=True)))

    def on_loop(self, columns: Columns) -> FloatArray:
        """Arc lengths (..., vehicles) in m of vehicles; of carriers on a loop, along its strands joined end to end."""
        if not self.rides_loop:
            return columns.arc_length
        places, ropes = columns.arc_length.copy(), columns.vehicle_rope[..., len(self.carriages) :]
        known = np.fmax(ropes, 0.0).astype(np.int64)  # the first one where it is not known
        places[..., len(self.carriages) :] += self.loop_offsets[known]
        return places

    def of_commanded(self, of_carriages: FloatArray, of_drives: FloatArray) -> FloatArray:
        """Values (..., names) of all commanded objects, gathered from a column of carriages and one of drives."""
        rows = [self.vehicle_rows[name] for name in self.commanded if name in self.vehicle_rows]
        return np.concatenate([of_carriages[..., rows], of_drives], axis=-1)

    def force_used(self, c: Columns) -> FloatArray:
        """Utilisation (..., names) of the force limits of commanded objects: 1 in saturation, NaN without a limit."""
        share = np.abs(c.drive_force[..., : len(self.carriages)]) / c.force_limit
        force, speed = c.moving_cable_force, c.drive_speed
        if not self.sheaves:
            return self.of_commanded(share, np.full_like(force, np.nan))
        tensions = np.moveaxis(c.sheave_tension[..., self.drive_sheaves, :], -1, 0)
        limits = self.drive_limits, self.drive_powers, np.expm1(self.grips[self.drive_sheaves])
        return self.of_commanded(share, of_bullwheel(limits, force, speed, tensions, np.minimum, np.maximum)[0])

    @cached_property
    def places(self) -> Columns:
        """Columns that hold, instead of values, the index of each value in the row of a frame."""
        return self.columns(np.arange(self.size))

    def columns(self, numbers: NDArray[Any]) -> Columns:
        """Columns as views of the row of a frame (size,), or of the rows of several frames (..., size)."""
        leading = numbers.shape[:-1]
        if not leading:  # made for each frame
            return Columns(
                *[
                    numbers[first:last] if len(shape) == 1 else numbers[first:last].reshape(shape)
                    for first, last, shape in self._places
                ]
            )
        return Columns(*(numbers[..., first:last].reshape(leading + shape) for first, last, shape in self._places))


def of_bullwheel(
    limits: Sequence[Any], force: Any, speed: Any, tensions: Any, least: Any = min, most: Any = max
) -> tuple[Any, Any]:
    """Utilisation of the force limit of a bullwheel's drive, and this limit: of force, power and slip the least one.

    The rope slips where the ratio of its tensions is e^(μα), by the present tension of the slacker strand, of which one
    below 1 N counts as that.

    Args:
        limits: highest force (N) and power (W) of the drive, and e^(μα) - 1.
        force: present force at the rim (N).
        speed: of the rope (m/s).
        tensions: (2, ...) of both strands (N).
        least: the lower one of two numbers, of arrays `np.minimum`.
        most: the higher one of two numbers, of arrays `np.maximum`.

    Returns:
        The share, 1 in saturation, and the limit (N); NaN where the highest force is NaN.
    """
    highest, power, grip = limits
    slips = grip * most(least(*tensions), SLACKEST)
    limit = least(least(highest, slips), power / most(abs(speed), CRAWL))
    return abs(force) / limit, limit


def numbered(names: Iterable[str]) -> dict[str, int]:
    """Row indices by name, for names in the order of the rows of a column."""
    return {name: number for number, name in enumerate(names)}


def _sample_places(cable: Cable, samples: int) -> FloatArray:
    """Arc lengths (samples,) in m of the samples of a rope: even, but for those next to weights on it, which are there.

    Sag is largest and clearance least at a weight.
    """
    places = np.linspace(0.0, cable.unstrained_length, samples)
    taken = {0, samples - 1}
    for load in cable.loads:
        row = round(load.arc_length / cable.unstrained_length * (samples - 1))
        if load.force[-1] < 0.0 and row not in taken:
            taken.add(row)
            places[row] = load.arc_length
    return places


__all__ = ["CABLE", "COMMANDED", "DERAILED", "ENDS", "Layout", "numbered", "of_bullwheel"]
