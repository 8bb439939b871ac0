"""Table of signals over time for plots, for the rerun view, and for the comparison of runs.

A new signal is a row here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from cable_twin.frame.records import FloatArray
from cable_twin.frame.snapshot import COMMANDED, Columns, Layout

Whose = Literal[
    "rope",
    "driven",
    "commanded",
    "vehicles",
    "bodies",
    "supports",
    "towers",
    "air",
    "all ropes",
    "pantographs",
    "sheaves",
    "strands",
    "turned",
]
AXES = ("x", "y", "z")
ENDS_OF_LINES = {  # of their names, by the kind of their objects, with the words for them in legends
    "rope": {"_highest": "highest"},
    "strands": {"_on": "incoming strand", "_off": "outgoing strand"},
}
LINES = {  # the same of whole names, with the name that is kept beside the words
    "rope": {"highest": ("", "highest"), "start": ("", "at the start"), "end": ("", "at the end")},
    "air": {"x": ("x", "along"), "y": ("y", "from the right"), "z": ("z", "up")},
}
LEAST = {"N": 1e-3, "W": 1e-3}  # values by unit below which they are rounding; of all other units 1e-9
SPREAD = ("arc_length",)  # signals whose range over many objects tells nothing


class Driven(NamedTuple):
    """Place, speed and force of the driven objects: drives of moving cables, else all vehicles."""

    place: FloatArray  # (..., names) m
    speed: FloatArray  # (..., names) m/s
    force: FloatArray  # (..., names) N


def driven_names(layout: Layout) -> tuple[str, ...]:
    """Names of the driven objects: drives of moving cables, which move all clamped vehicles, else each vehicle."""
    return layout.drives or tuple(layout.vehicles)


def driven(layout: Layout, c: Columns) -> Driven:
    """Place, speed and force of the driven objects in one frame, or in several."""
    if layout.drives:
        return Driven(c.drive_position, c.drive_speed, c.moving_cable_force)
    return Driven(c.arc_length, c.speed, c.drive_force)


def _told(kind: str, of_carriages: str, of_drives: str) -> Callable[[Layout, Columns], FloatArray]:
    """Make a function that reads commanded speeds or forces: NaN for other commands, 0 m/s for an emergency stop."""
    taken = [COMMANDED.index(one) for one in ((kind, "emergency stop") if kind == "speed" else (kind,))]

    def read(layout: Layout, c: Columns) -> FloatArray:
        values = layout.of_commanded(getattr(c, of_carriages), getattr(c, of_drives))
        told = np.isin(layout.of_commanded(c.command_kind, c.drive_command_kind), taken)
        return np.where(told, values, math.nan)

    return read


@dataclass(frozen=True, slots=True)
class Signal:
    """Signal for plots: one quantity over time, with a line for each object that has the quantity.

    Attributes:
        name: of the quantity; a line is NAME/WHOSE.
        unit: of its values.
        whose: kind of object with the signal.
        read: values (..., names) out of the columns of one frame, or of several.
        label: of its panel in a plot of `review`, without unit.
        plot: the plot with that panel, of `PLOTS`; signals of a plot are compared as well.
        view: title of its plot in rerun, without unit; empty where the signal is not in the view.
        everywhere: whether each of these objects has the quantity; where not, NaN is no gap.
        space: whether only systems in space have the signal.
        beside: name of the signal in whose panel it is drawn, each line with the label behind its name.
    """

    name: str
    unit: str
    whose: Whose
    read: Callable[[Layout, Columns], FloatArray]
    label: str = ""
    plot: str = ""
    view: str = ""
    everywhere: bool = True
    space: bool = False
    beside: str = ""

    def names(self, layout: Layout) -> Sequence[str]:
        """Names of the objects that have the plotted signal, in the order of its values."""
        return () if self.space and not layout.space else NAMES[self.whose](layout)

    def words(self, whose: str, translated: Callable[[str], str] = str) -> str:
        """Text of a legend for the line of an object: its name, and in words which of its several lines it is."""
        name, word = LINES.get(self.whose, {}).get(whose, (whose.replace("/", " "), ""))
        for end, which in ENDS_OF_LINES.get(self.whose, {}).items():
            if whose.endswith(end):
                name, word = whose.removesuffix(end), which
        return ", ".join(part for part in (name, word and translated(word)) if part)

    def is_zero(self, values: FloatArray) -> bool:
        """Whether values over time are 0 within rounding, so that a plot of them would show noise."""
        return not (np.abs(values) > LEAST.get(self.unit, 1e-9)).any()

    def values(self, layout: Layout, c: Columns) -> FloatArray:
        """Values (..., names) of the signal in one or several frames; NaN is a gap, such as a vehicle off the cable."""
        if self.space and not layout.space:
            return np.empty((*c.time.shape[:-1], 0))
        values = self.read(layout, c)
        if self.whose not in ("vehicles", "bodies"):
            return values
        here = np.where(c.attached == 0.0, math.nan, 1.0)
        return values * (np.repeat(here, np.diff(layout.first_body), axis=-1) if self.whose == "bodies" else here)


NAMES: Mapping[Whose, Callable[[Layout], Sequence[str]]] = {
    "rope": lambda layout: (
        [f"{rope}_highest" for rope in layout.ropes] if len(layout.ropes) > 1 else ("highest", "start", "end")
    ),
    "driven": driven_names,
    "commanded": lambda layout: layout.commanded,
    "vehicles": lambda layout: tuple(layout.vehicles),
    "bodies": lambda layout: layout.bodies,
    "supports": lambda layout: layout.supports,
    "towers": lambda layout: layout.towers,
    "air": lambda _: AXES,
    "all ropes": lambda _: ("ropes",),
    "pantographs": lambda layout: layout.pantographs,
    "sheaves": lambda layout: layout.sheaves,
    "strands": lambda layout: [f"{name}_{side}" for name in layout.sheaves for side in ("on", "off")],
    "turned": lambda layout: layout.drives if layout.sheaves else (),
}


def _tension(layout: Layout, c: Columns) -> FloatArray:
    """Highest tension of a rope and tensions at both its ends; of several ropes the highest of each."""
    highest, tension = c.highest_tension[..., 0], c.rope_tension
    if len(layout.ropes) > 1:
        return highest
    return np.stack([highest[..., 0], tension[..., 0], tension[..., -1]], axis=-1)


def _adhesion(layout: Layout, c: Columns) -> FloatArray:
    """Adhesion utilisation of bullwheels: log of the tension ratio over friction times wrap; the rope slips at 1."""
    tension = np.maximum(c.sheave_tension, 1.0)  # N: of a slack strand there is no ratio
    used: FloatArray = np.abs(np.log(tension[..., 0] / tension[..., 1])) / layout.grips
    return used


def _power(layout: Layout, c: Columns) -> FloatArray:
    return c.moving_cable_force * c.drive_speed if layout.drives else c.drive_power


SIGNALS: Mapping[str, Signal] = {
    signal.name: signal
    for signal in (
        Signal("speed", "m/s", "driven", lambda of, c: driven(of, c).speed, "speed", "speed", "Speed"),
        Signal(
            "commanded_speed",
            "m/s",
            "commanded",
            _told("speed", "commanded_speed", "drive_commanded_speed"),
            "commanded",
            "speed",
            beside="speed",
        ),
        Signal(
            "reference_speed",
            "m/s",
            "commanded",
            lambda of, c: of.of_commanded(c.reference_speed, c.drive_reference_speed),
            "reference",
            "speed",
            beside="speed",
        ),
        Signal(
            "reference_position",
            "m",
            "commanded",
            lambda of, c: of.of_commanded(c.reference_position, c.drive_reference_position),
        ),
        Signal("arc_length", "m", "vehicles", lambda of, c: of.on_loop(c), "arc length", "speed"),
        Signal("tension", "N", "rope", _tension, "tension", "tension", "Tension"),
        Signal("swing", "deg", "bodies", lambda _, c: np.degrees(c.body_angles[..., 1]), "pitch", "swing", "Swing"),
        Signal(
            "roll",
            "deg",
            "bodies",
            lambda _, c: np.degrees(c.body_angles[..., 0]),
            "roll",
            "across",
            "Swing across",
            space=True,
        ),
        Signal(
            "lateral",
            "m",
            "bodies",
            lambda _, c: c.body_position[..., 1],
            "y, to the left",
            "across",
            "Place to the left",
            space=True,
        ),
        Signal("wind", "m/s", "air", lambda _, c: c.wind, "wind", "across", "Wind", space=True),
        Signal("temperature", "degC", "all ropes", lambda _, c: c.temperature),
        Signal("drive_force", "N", "driven", lambda of, c: driven(of, c).force, "force", "drive", "Drive force"),
        Signal(
            "commanded_force",
            "N",
            "commanded",
            _told("force", "commanded_force", "drive_commanded_force"),
            "commanded",
            "drive",
            beside="drive_force",
        ),
        Signal(
            "force_limit_used",
            "-",
            "commanded",
            Layout.force_used,
            "share of the force limit",
            "drive",
            everywhere=False,
        ),
        Signal("drive_power", "W", "driven", _power, "power", "drive"),
        Signal("drive_torque", "N m", "turned", lambda of, c: c.moving_cable_force * of.arms, "torque", "drive"),
        Signal(
            "sheave_tension",
            "N",
            "strands",
            lambda of, c: c.sheave_tension.reshape(*c.sheave_tension.shape[:-2], 2 * len(of.sheaves)),
            "tension of strands",
            "sheaves",
            "Bullwheel tension",
        ),
        Signal("adhesion", "-", "sheaves", _adhesion, "adhesion used", "sheaves"),
        Signal("slip", "m", "sheaves", lambda _, c: c.sheave_slip, "slip of the rope", "sheaves"),
        Signal(
            "sheave_travel",
            "m",
            "sheaves",
            lambda _, c: c.sheave_travel,
            "travel of the tensioning device",
            "sheaves",
            everywhere=False,
        ),
        Signal(
            "contact_force",
            "N",
            "vehicles",
            lambda _, c: np.linalg.norm(c.contact_force, axis=-1),
            "rope on carriage",
            "contact_forces",
        ),
        Signal(
            "haul_force",
            "N",
            "vehicles",
            lambda _, c: np.linalg.norm(c.haul_pull, axis=-1),
            "haul rope on carriage",
            "contact_forces",
            everywhere=False,
        ),
        Signal(
            "support_force",
            "N",
            "supports",
            lambda _, c: np.linalg.norm(c.support_force, axis=-1),
            "support on rope",
            "contact_forces",
        ),
        Signal(
            "travel",
            "m",
            "supports",
            lambda _, c: c.support_travel,
            "counterweight travel",
            "contact_forces",
            everywhere=False,
        ),
        Signal(
            "pantograph_force",
            "N",
            "pantographs",
            lambda _, c: c.pantograph_force,
            "pantograph on rope",
            "contact_forces",
            "Contact force",
        ),
        Signal(
            "tower_load", "N", "towers", lambda layout, c: c.tower_load[..., layout.tower_rows], view="Load on towers"
        ),
        Signal(
            "tower_lateral",
            "N",
            "towers",
            lambda layout, c: c.tower_lateral[..., layout.tower_rows],
            "tower on rope, to the left",
            "lateral_forces",
            space=True,
        ),
    )
}
PLOTS: Mapping[str, str] = {  # of `review`: file and title, in the order in which they are drawn
    "tension": "Rope tension",
    "speed": "Speed and place along the rope",
    "swing": "Swing along the track",
    "across": "Across the track: swing, place, wind",
    "drive": "Drive",
    "sheaves": "Bullwheels",
    "contact_forces": "Forces on carriages and supports",
    "lateral_forces": "Lateral forces of towers",
}


__all__ = ["PLOTS", "SIGNALS", "Signal", "driven", "driven_names"]
