"""Which number of a frame is what: names and places of all that a frame holds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from math import prod

import numpy as np

from cable_twin.mechanics.readout.columns import Columns
from cable_twin.records import FloatArray
from cable_twin.scenario import Scenario, in_space

ENDS = ("start", "end")  # the first two supports of every rope
CABLE = "cable"  # name of the only rope
DERAILED = ("", "outward to the left", "outward to the right", "by lifting off")  # by the number in `tower_derailed`
SHAPES: Mapping[str, tuple[str | int, ...]] = {  # of the columns, in their order
    "time": (1,),
    "arc_length": ("vehicles",),
    "speed": ("vehicles",),
    "drive_force": ("vehicles",),
    "joint_position": ("vehicles", 3),
    "contact_force": ("vehicles", 3),
    "attached": ("vehicles",),
    "payload": ("vehicles",),
    "haul_travel": ("vehicles",),
    "haul_speed": ("vehicles",),
    "haul_force": ("vehicles",),
    "haul_pull": ("vehicles", 3),
    "push": ("vehicles",),
    "push_highest": ("vehicles",),
    "touched": ("vehicles",),
    "touch_place": ("vehicles",),
    "touch_speed": ("vehicles",),
    "touch_time": ("vehicles",),
    "body_position": ("bodies", 3),
    "body_orientation": ("bodies", 4),
    "body_velocity": ("bodies", 3),
    "body_angular_velocity": ("bodies", 3),
    "body_angles": ("bodies", 3),
    "support_force": ("supports", 3),
    "support_travel": ("supports",),
    "tower_load": ("supports",),
    "tower_lowest_load": ("supports",),
    "tower_rest_load": ("supports",),
    "tower_lateral": ("supports",),
    "tower_lateral_ratio": ("supports",),
    "tower_derailed": ("supports",),
    "tower_derailed_time": ("supports",),
    "drive_position": ("drives",),
    "drive_speed": ("drives",),
    "moving_cable_force": ("drives",),
    "rope_position": ("samples", 3),
    "rope_tension": ("samples",),
    "wind": (3,),
    "connector_force": ("connectors",),
    "pantograph_force": ("pantographs",),
    "pantograph_position": ("pantographs", 3),
    "pantograph_speed": ("pantographs",),
}


class Layout:
    """Which number of a frame is what, for one scenario.

    Attributes:
        vehicles: names of the bodies by name of their vehicle, in the order of the scenario: carriages, then carriers.
        carriages: names of the vehicles that are named one by one.
        carriers, hauled: names of those of which there are many of one kind, and of those that a haul rope pulls.
        supports: names of what holds the cable: start, end, towers.
        drives: names of the drives that move a cable.
        towers: names of those of them that are between the ends of a rope.
        space: whether it is one in space.
        grooves: places (3,) in m of the towers that hold a rope sideways, in space, by name.
        arc_lengths: (samples,) m, unstrained, where the ropes are shown, one after the other.
        ropes: which of these are of which rope, by its name.
        connectors, pantographs: names of what hangs between ropes, and of what pushes one from below.
        alone: layout of each rope with what is on it, where there are several.
        tower_rows: numbers of the towers among the supports.
        end_samples: number of the sample at each end of each rope, by the name of the support.
        sample_ropes, vehicle_ropes: number of the rope of each sample (samples,) and vehicle (vehicles,).
        rope_offsets: (ropes,) m, by which arc lengths of each rope are more than those of the ropes before it.
        bodies: names of all bodies, VEHICLE/BODY.
        first_body: (vehicles + 1,) number of the first body of each vehicle.
        vehicle_rows, support_rows, drive_rows: number by name.
        body_rows: the same of the bodies of each vehicle, from its first one on.
        size: numbers of a frame.
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
        connectors: Sequence[str] = (),
        pantographs: Sequence[str] = (),
        space: bool = False,
        grooves: Mapping[str, Sequence[float]] | None = None,
    ) -> None:
        """Lay out frames; the last so many of the vehicles are carriers, and those named have haul ropes."""
        self.space, self.grooves = space, dict(grooves or {})
        self.vehicles = {name: tuple(bodies) for name, bodies in vehicles.items()}
        names = tuple(self.vehicles)
        self.carriages, self.carriers = names[: len(names) - carriers], names[len(names) - carriers :]
        self.supports, self.drives, self.hauled = tuple(supports), tuple(drives), tuple(hauled)
        self.arc_lengths = np.array(arc_lengths, dtype=np.float64)
        self.arc_lengths.setflags(write=False)
        self.towers = self.supports[len(ENDS) :] if towers is None else tuple(towers)
        self.ropes = {CABLE: slice(0, self.arc_lengths.size)} if ropes is None else dict(ropes)
        self.connectors, self.pantographs = tuple(connectors), tuple(pantographs)
        self.alone: dict[str, Layout] = {}
        self.tower_rows = [self.supports.index(name) for name in self.towers]
        self.end_samples = {
            end if end in self.supports else f"{rope}/{end}": sample
            for rope, part in self.ropes.items()
            for end, sample in zip(ENDS, (part.start, part.stop - 1), strict=True)
        }
        self.sample_ropes = np.concatenate(
            [np.full(part.stop - part.start, n) for n, part in enumerate(self.ropes.values())]
        )
        lengths = [self.arc_lengths[part.stop - 1] + 1.0 for part in self.ropes.values()]
        self.rope_offsets = np.concatenate([[0.0], np.cumsum(lengths)[:-1]])
        self.vehicle_ropes = np.zeros(len(self.vehicles), dtype=np.int64)
        self.bodies = tuple(f"{name}/{body}" for name, bodies in self.vehicles.items() for body in bodies)
        self.first_body = [0, *np.cumsum([len(bodies) for bodies in self.vehicles.values()], dtype=int).tolist()]
        counts: dict[str | int, int] = {
            "vehicles": len(self.vehicles),
            "bodies": len(self.bodies),
            "supports": len(self.supports),
            "drives": len(self.drives),
            "samples": self.arc_lengths.size,
            "connectors": len(self.connectors),
            "pantographs": len(self.pantographs),
        }
        shapes = [tuple(counts.get(count, count) for count in SHAPES[name]) for name in Columns._fields]
        ends = [0, *np.cumsum([prod(shape) for shape in shapes], dtype=int).tolist()]  # type: ignore[arg-type]
        self._places = [(first, last, shape) for (first, last), shape in zip(pairwise(ends), shapes, strict=True)]
        self.size: int = ends[-1]
        self.vehicle_rows, self.support_rows = numbered(self.vehicles), numbered(self.supports)
        self.drive_rows = numbered(self.drives)
        self.body_rows = tuple(numbered(bodies) for bodies in self.vehicles.values())

    @classmethod
    def of(cls, scenario: Scenario, samples: int) -> Layout:
        """Layout of the frames of a scenario, with so many points (at least 2) of each of its ropes."""
        names = tuple(scenario.ropes)
        alone = [scenario.of_rope(name) for name in names] or [scenario]
        supports = [
            [*(f"{name}/{end}" if name else end for end in ENDS), *one.towers]
            for name, one in zip(names or ("",), alone, strict=True)
        ]
        layout = cls(
            {name: tuple(vehicle.bodies) for name, vehicle in scenario.vehicles.items()},
            [name for own in supports for name in own],
            tuple(scenario.drives),
            np.concatenate([np.linspace(0.0, one.cable.unstrained_length, samples) for one in alone]),
            carriers=0 if scenario.carriers is None else scenario.carriers.count,
            hauled=tuple(name for name, one in scenario.carriages.items() if one.drive.haul_rope is not None),
            towers=[name for own in supports for name in own[len(ENDS) :]],
            ropes={name: slice(row * samples, (row + 1) * samples) for row, name in enumerate(names or (CABLE,))},
            connectors=tuple(scenario.connectors),
            pantographs=tuple(scenario.pantographs),
            space=scenario.dim == 3,
            grooves={n: in_space(tower.position) for n, tower in scenario.towers.items() if scenario.dim == 3},
        )
        counts = [len(one.vehicles) for one in alone]
        layout.vehicle_ropes = np.repeat(np.arange(len(alone)), counts)
        layout.alone = {name: cls.of(one, samples) for name, one in zip(names, alone, strict=False)}
        return layout

    def of_rope(self, columns: Columns, name: str) -> Columns:
        """Views of what is of one rope in the columns of a frame, in the order of its own layout."""
        if not self.alone:
            return columns
        before = list(self.alone.values())[: list(self.alone).index(name)]
        own, none = self.alone[name], slice(0, 0)
        rows = {"samples": self.ropes[name], "connectors": none, "pantographs": none, "drives": none}
        for key in ("supports", "vehicles", "bodies"):
            first = sum(len(getattr(one, key)) for one in before)
            rows[key] = slice(first, first + len(getattr(own, key)))
        return Columns(*(field[rows.get(str(SHAPES[key][0]), slice(None))] for key, field in columns._asdict().items()))

    def columns(self, numbers: FloatArray) -> Columns:
        """Views of the columns of a frame (size,), or of several (..., size) with their axes in front."""
        leading = numbers.shape[:-1]
        return Columns(*(numbers[..., first:last].reshape(leading + shape) for first, last, shape in self._places))


def numbered(names: Iterable[str]) -> dict[str, int]:
    """Number of each name."""
    return {name: number for number, name in enumerate(names)}


__all__ = ["CABLE", "DERAILED", "ENDS", "SHAPES", "Layout", "numbered"]
