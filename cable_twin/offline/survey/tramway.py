"""Scenario of an aerial tramway from a surveyed line: a cabin on a track rope with a counterweight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

import numpy as np
import scipy  # loads `optimize` where it is used

from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey.marked import Marked, assumed, derived, given_number
from cable_twin.offline.survey.profile import Survey, SurveyError
from cable_twin.offline.survey.stations import Ends, bends, given_rope, lower_first, rope_keys, tower_keys
from cable_twin.scenario.spans import SpanError, Spans, spans_under_tension

GRAVITY = 9.81  # m/s^2
FACTOR, MARGIN = 3.15, 1.1  # rope safety factor of the track rope, and how far above it the tension is chosen
TRANSVERSE = 10.0  # -, least tension over the weight of the full cabin across the rope
TRACK_ROPE = {
    "mass_per_length": 25.3,
    "axial_stiffness": 482.0e6,
    "bending_stiffness": 115.0e3,
    "breaking_force": 4.95e6,
    "diameter": 0.066,
}
TRACK_WHY = "locked coil of 66 mm, 3010 mm^2, E = 160 GPa, wires of 1770 N/mm^2 less 7 %"
EMPTY, CAPACITY = 5600.0, 6400.0  # kg
RADIUS, PITCH = 80.0, 0.2  # m, of saddles, and between their points of contact
BEDDING = 0.4e6  # N/m per m of saddle, by which rope and lining yield
STATION = 12.0  # m, arc length of the cabin from the end of the track
BODIES: Mapping[str, Mapping[str, Any]] = {
    "running_carriage": {"mass": 1500.0, "inertia": 2045.0, "upper_pivot": [0.0, 0.2], "lower_pivot": [0.0, -0.2]},
    "hanger": {"mass": 1000.0, "inertia": 2097.0, "upper_pivot": [0.0, 2.5], "lower_pivot": [0.0, -2.5]},
    "cabin": {"mass": 3100.0, "inertia": 7556.0, "upper_pivot": [0.0, 1.5], "size": [4.5, 3.0], "drag_area": 11.0},
}


class TrackRope:
    """Track rope of a tramway in closed form: tension by its counterweight, length, travel.

    Attributes:
        corner: (spans + 1, 2) m, supports from the lower station on.
        rope: figures of the rope, as in a scenario.
        tension: N, at the lower end.
        mass: kg, of the counterweight, with the deciding reason.
        bare: spans of the rope without the cabin.
        travel: m, most travel of the counterweight to either side.
        length: m, unstrained, with the deciding reason.
        steepest: rad, steepest slope of the path of the full cabin.
    """

    def __init__(self, corner: FloatArray, rope: Mapping[str, float], load: float, mass: float | None) -> None:
        """Choose tension and unstrained length of the track rope.

        Args:
            corner: (spans + 1, 2) m, supports from the lower station on.
            rope: figures of the rope, as in a scenario.
            load: N, weight of the full cabin.
            mass: kg, of a given counterweight; None: by the safety factor of the rope.

        Raises:
            SurveyError: the rope is too weak; one line.
        """
        self.corner, self.rope = corner, rope
        weight, stiffness = GRAVITY * rope["mass_per_length"], rope["axial_stiffness"]
        strength, rise = rope["breaking_force"], float(corner[:, 1].max() - corner[0, 1])
        tension = strength / (FACTOR * MARGIN) - weight * rise
        least = TRANSVERSE * load
        if mass is None and tension < least:
            raise SurveyError(
                f"track rope: given a breaking force of {strength / 1e3:.0f} kN: with a safety factor of "
                f"{FACTOR * MARGIN:.3g} it pulls {tension / 1e3:.0f} kN at the lower end; allowed: {TRANSVERSE:g} "
                f"times the full cabin, {least / 1e3:.0f} kN: a stronger rope, or a lighter cabin"
            )
        why = f"kg: safety factor {FACTOR * MARGIN:.3g} of {strength / 1e3:.0f} kN at the upper end"
        self.mass = derived(round(tension / GRAVITY, -3), why) if mass is None else derived(mass, "kg, given")
        self.tension = self.mass.value * GRAVITY
        try:
            self.bare = spans_under_tension(corner, self.tension, weight, stiffness)
            loaded = with_cabin(corner, self.tension, weight, stiffness, load)
        except SpanError as error:
            raise SurveyError(f"track rope: {error}") from None
        pulled = float(loaded.length.sum() - self.bare.length.sum())  # into the track by the cabin in mid-span
        self.travel = float(ceil(max(3.0, pulled + 1.5)))
        self.length = derived(
            round(float(self.bare.length.sum()) + 0.5 * pulled, 2),
            f"closed form: a cabin in mid-span then lifts the counterweight by {pulled:.2f} m across its middle",
        )
        angles = np.arctan2(self.bare.pull_after[:, 1], self.bare.pull[:, 0])
        starts = np.arctan2(self.bare.pull[:, 1], self.bare.pull[:, 0])
        self.steepest = float(np.abs([*angles, *starts]).max()) + 0.5 * load / self.tension

    @property
    def slope(self) -> FloatArray:
        """Unit vector (2,) along the bare track rope at its lower end, into the line."""
        pull = self.bare.pull[0]
        return np.asarray(pull / np.hypot(*pull))

    def saddle_bends(self, load: float) -> FloatArray:
        """Angles (towers,) in rad by which the track rope bends on saddles, next to a cabin of weight `load` (N)."""
        return bends(self.bare) + load / self.tension


def with_cabin(
    corner: FloatArray,
    tension: float,
    weight: float,
    stiffness: float,
    load: float,
    free_stretch: float = 1.0,
    *,
    at: tuple[int, float] | None = None,
    hauled: bool = True,
) -> Spans:
    """Spans of a track rope with a cabin on it, which is a further support there.

    Args:
        corner: (spans + 1, 2) m, supports from the tensioned end on.
        tension: N, at the tensioned end.
        weight: N/m.
        stiffness: N, EA.
        load: N, weight of the cabin.
        free_stretch: -, length without tension over the unstrained one.
        at: row of the span, and share of it before the cabin; None: the middle of the longest span.
        hauled: whether a haul rope along the track holds the cabin; otherwise the track rope does, and its tension is
            higher above the cabin by the part of the cabin's weight along the track.

    Raises:
        SpanError: the rope does not carry the cabin.
    """
    row, share = (int(np.diff(corner[:, 0]).argmax()), 0.5) if at is None else at
    low, high = corner[row : row + 2]
    place = low + share * (high - low)

    def loaded(depth: float) -> Spans:
        here = place - [0.0, depth]
        before = spans_under_tension(np.array([*corner[: row + 1], here]), tension, weight, stiffness, free_stretch)
        start = float(before.tension[-1])
        if not hauled:  # the slope of the cabin is between those of the rope below and above it
            ways = np.array([before.pull_after[-1], high - here])
            start += load * float(np.sin(np.arctan2(ways[:, 1], ways[:, 0]).mean()))
        after = spans_under_tension(np.array([here, *corner[row + 1 :]]), start, weight, stiffness, free_stretch)
        pull, length = (np.concatenate([getattr(one, key) for one in (before, after)]) for key in ("pull", "length"))
        return Spans(np.insert(corner, row + 1, here, axis=0), pull, length, weight, stiffness, free_stretch)

    def miss(depth: float) -> float:
        across, down = loaded(depth).loads()[row].tolist()
        share_of_load = down**2 / (across**2 + down**2) if hauled else 1.0  # of the slope of the cabin, cos^2
        return float(down - load * share_of_load)

    width = float(high[0] - low[0])
    try:
        depth = float(scipy.optimize.brentq(miss, 0.0, min(share, 1.0 - share) * 0.5 * width, xtol=1e-6))
    except ValueError:
        raise SpanError(
            f"a tension of {tension / 1e3:.4g} kN does not carry a cabin of {load / 1e3:.4g} kN over "
            f"{width:.4g} m; allowed: more tension"
        ) from None
    return loaded(depth)


def tramway_scenario(survey: Survey, ends: Ends, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Make the scenario of an aerial tramway from a survey, as nested mappings with notes on value origins.

    Args:
        survey: terrain and towers.
        ends: where the track rope leaves both stations.
        changes: given values by dotted key, used where other values are derived from them.

    Raises:
        SurveyError: the rope cannot carry the cabin; one line.
    """
    upwards = ends.end[1] >= ends.start[1]
    rope = given_rope(TRACK_ROPE, "cable", changes)
    load = GRAVITY * (EMPTY + CAPACITY)
    weighted = "start" if upwards else "end"
    mass_key = f"cable.{weighted}.mass"
    mass = given_number(changes, mass_key, 0.0) if mass_key in changes else None
    track = TrackRope(lower_first(survey, ends), rope, load, mass)
    level, rise = (track.corner[-1] - track.corner[0]).tolist()
    tree_ends = track_ends(track, ends, upwards, list)
    holding = load * float(np.sin(track.steepest))
    force = round(1.1 * (holding + 0.005 * load + 42.0e3 * 1.2), -4)
    return {
        "description": f"Aerial tramway from a survey: {level:.0f} m with a rise of {rise:.0f} m, "
        f"{len(survey.towers)} tower{'s' * (len(survey.towers) != 1)}, a cabin of 12 t",
        "gravity": GRAVITY,
        "cable": {
            **rope_keys(rope, TRACK_ROPE, TRACK_WHY),
            "unstrained_length": track.length,
            "elements": assumed({"target": 20.0, "at_towers": 0.75, "growth": 2.5}, "lengths in m, short on saddles"),
            "damping_time": assumed(0.004, "s, a damping ratio of 0.2 % at 1 rad/s"),
            **tree_ends,
        },
        **({"towers": saddles(survey, track, load, upwards)} if survey.towers else {}),
        "terrain": survey.terrain.tolist(),
        "air": {"density": assumed(1.1, "kg/m^3, at 1000 m of altitude (standard atmosphere)")},
        "carriages": {
            "cabin": {
                "arc_length": assumed(
                    STATION if upwards else round(track.length.value - STATION, 2), "m, in the lower station"
                ),
                "joint": "sliding",
                "drive": _drive(force, holding, upwards),
                "friction": {"rolling": assumed(0.005, "lined rollers on a locked coil rope")},
                "end_stop": {"stroke": assumed(3.0, "m")},
                "bodies": {
                    name: {key: assumed(value, "usual cabin for 80 people, 5.6 t empty") for key, value in body.items()}
                    for name, body in BODIES.items()
                },
                "payload": {
                    "capacity": assumed(CAPACITY, "kg, 80 people of 80 kg"),
                    "mass": assumed(CAPACITY, "kg, full"),
                    "body": "cabin",
                    "position": assumed([0.0, -0.4], "m, people stand below the middle"),
                    "station_distance": assumed(20.0, "m"),
                    "loading_time": assumed(40.0, "s"),
                },
            }
        },
        "limits": {
            "rope_safety_factor": assumed(FACTOR, "track rope: 3.15 to 3.5"),
            "tension_per_transverse_load": assumed(TRANSVERSE, "least tension over the weight across the rope"),
        },
        "solver": {"step": assumed(0.005, "s")},
    }


def track_ends(track: TrackRope, ends: Ends, upwards: bool, placed: Any) -> dict[str, Any]:
    """Scenario sections of both ends of a track rope, the lower end with the counterweight.

    Args:
        track: the rope.
        ends: of the line.
        upwards: whether the line rises with x.
        placed: converts a place (x, z) of the line to a position in the scenario.
    """
    out = [round(float(one), 3) for one in -track.slope * [1.0 if upwards else -1.0, 1.0]]
    direction = placed((out[0], out[1])) if len(placed((0.0, 0.0))) == 2 else [out[0], 0.0, out[1]]
    weight = {
        "support": "counterweight",
        "direction": derived(direction, "the slope of the bare rope at the station"),
        "mass": track.mass,
        "travel": assumed([-track.travel, track.travel], "m"),
    }
    held = {"support": "pinned"}
    return {
        "start": {"position": Marked(placed(ends.start), *ends.start_why), **(weight if upwards else held)},
        "end": {"position": Marked(placed(ends.end), *ends.end_why), **(held if upwards else weight)},
    }


def saddles(survey: Survey, track: TrackRope, load: float, upwards: bool) -> dict[str, Any]:
    """Scenario sections of the saddles of a track rope, by its bend with the full cabin beside them."""
    turns: Sequence[float] = track.saddle_bends(load)[:: 1 if upwards else -1].tolist()
    found: dict[str, Any] = {}
    for tower, turn in zip(survey.towers, turns, strict=True):
        keys = tower_keys(tower, ceil(1.1 * turn * RADIUS / PITCH) + 1, PITCH, RADIUS)
        apart = float(keys["length"].value) / max(keys["contacts"].value - 1, 1)
        found[tower.name] = {
            "kind": assumed("saddle", "of a track rope"),
            **keys,
            "stiffness": assumed(float(f"{BEDDING * apart:.4g}"), f"N/m, rope and lining yield: {BEDDING:g} per m"),
        }
    return found


def _drive(force: float, holding: float, upwards: bool) -> dict[str, Any]:
    why = f"N: {holding / 1e3:.0f} kN hold the full cabin on the steepest track, and a start or stop at 1.2 m/s^2"
    usual = "haul rope of 40 mm, 630 mm^2, E = 100 GPa"
    return {
        "mode": "speed",
        "limits": {
            "speed": assumed(10.0, "m/s, 7 to 12 are common"),
            "acceleration": assumed(0.3, "m/s^2, 0.1 to 0.3 are common"),
            "deceleration": assumed(0.45, "m/s^2, 0.3 to 0.6 are common"),
            "jerk": assumed(0.2, "m/s^3"),
            "force": derived(force, why),
            "power": derived(round(1.25 * holding * 10.0 + 2.0e5, -4), "W: the steepest track at 10 m/s, and a start"),
            "emergency_deceleration": assumed(1.2, "m/s^2, 1 to 1.5 are common"),
        },
        "haul_rope": {
            "axial_stiffness": assumed(63.0e6, usual),
            "mass_per_length": assumed(6.0, usual),
            "breaking_force": assumed(1.09e6, "N, of such a rope with wires of 1960 N/mm^2"),
            "damping_ratio": assumed(0.01, usual),
            "station": assumed("end" if upwards else "start", "driven in the upper station"),
            "beyond_track": assumed(20.0, "m"),
            "pretension": assumed(60.0e3, "N"),
            "drive_inertia": assumed(30.0e3, "kg, counter rope, motor, gear and wheel reduced to the rope"),
        },
        "service_brake": assumed({"force": 80.0e3, "rise_time": 1.0}, "N and s, on the shaft of the motor"),
        "emergency_brake": assumed({"force": 90.0e3, "rise_time": 0.4}, "N and s, on the wheel"),
        "track_rope_brake": assumed({"force": 60.0e3, "rise_time": 0.3}, "N and s, for a haul rope that has failed"),
        "emergency_stop": assumed(["drive"], "the drive holds its emergency deceleration"),
    }
