"""Scenario of a jig-back tramway, two cabins on two track ropes and one haul rope, from a surveyed line."""

from __future__ import annotations

from collections.abc import Mapping
from math import ceil
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads `optimize` where it is used

from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey import tramway
from cable_twin.offline.survey.marked import Marked, assumed, derived, given_number
from cable_twin.offline.survey.profile import Survey, SurveyError
from cable_twin.offline.survey.stations import Ends, Place, given_rope, lower_first, rope_keys, terrain_along
from cable_twin.offline.survey.tramway import (
    BODIES,
    CAPACITY,
    EMPTY,
    FACTOR,
    GRAVITY,
    TRANSVERSE,
    TrackRope,
    saddles,
    track_ends,
)
from cable_twin.scenario.spans import SpanError, Spans, spans_under_tension

TRACK_ROPE = {**tramway.TRACK_ROPE, "breaking_force": 5.2e6}
TRACK_WHY = "locked coil of 66 mm, 2900 mm^2, E = 160 GPa, wires of 1860 N/mm^2 less 4 %"
HAUL_ROPE = {
    "mass_per_length": 3.9,
    "axial_stiffness": 40.0e6,
    "bending_stiffness": 1.0e3,
    "breaking_force": 0.76e6,
    "diameter": 0.032,
}
HAUL_WHY = "six strands of 32 mm, 400 mm^2, E = 100 GPa, wires of 2160 N/mm^2 less 12 %"
HAUL_FACTOR, HAUL_MARGIN = 4.5, 1.05  # rope safety factor, and how far above it the usual tension is
HAUL_TENSION, LEAST_TENSION = 95.0e3, 40.0e3  # N at the lower bullwheel, highest unless the ground asks more, and least
THICKEST = 3.0  # times the diameter of the haul rope, up to which a thicker one is named
POINTS, SURE = 101, 0.05  # of a span, at which its height is taken, and m, by which clearance is kept
ASIDE = 4.5  # m, of each track rope from the middle
BEHIND = 15.0  # m, bullwheels behind the ends of the track ropes
BELOW = 2.0  # m, rollers of the haul rope below the saddles
STATION = 14.0  # m, arc length of a cabin from the end of its track
SIZES: Mapping[str, Mapping[str, Any]] = {
    "cabin": {"inertia_tensor": [5300.0, 7556.0, 7900.0], "drag_area": [11.0, 14.8, 15.0]}
}


class HaulRope:
    """Haul rope of a jig-back in closed form, with its cabins in the stations, the full cabin in the lower one.

    Attributes:
        tension: N, at the lower bullwheel, in each strand.
        mass: kg, of the counterweight that pulls both strands level, with the deciding reason.
        lengths: (2,) m, unstrained, of the strands with the lower and with the upper cabin.
        clamps: (2,) m, of the lower cabin from the lower bullwheel, of the upper one from the drive.
        ends: (2, 2) m, lower bullwheel and drive, as distance from the lower end of the track and height.
    """

    def __init__(self, track: TrackRope, rope: Mapping[str, float], ground: Ground) -> None:
        """Choose tension and unstrained lengths of the haul rope.

        Args:
            track: track rope of one of the cabins.
            rope: figures of the haul rope, as in a scenario.
            ground: terrain under the line, and the clearance to it.

        Raises:
            SurveyError: the rope is too weak; one line.
        """
        after = track.bare.pull_after[-1]
        upper = after / np.hypot(*after)
        low, high = track.corner[0], track.corner[-1]
        self.ends = np.array([low - BEHIND * track.slope, high + BEHIND * upper])
        places = np.array([low + STATION * track.slope, high - STATION * upper])  # of the cabins
        rollers = track.corner[1:-1] - [0.0, BELOW]
        weight, stiffness = GRAVITY * rope["mass_per_length"], rope["axial_stiffness"]
        pulled = GRAVITY * np.array([EMPTY + CAPACITY, EMPTY]) * [np.sin(track.steepest), upper[1]]
        lifted = weight * float(self.ends[1, 1] - self.ends[0, 1])
        hanging = np.array([self.ends[0], *rollers, places[1]])  # the strand with the least tension
        try:
            self.tension, why, misses = _choose_tension(rope, hanging, float(pulled[0]), lifted, ground)
            below = [
                spans_under_tension(np.array([self.ends[0], places[0]]), self.tension, weight, stiffness),
                _over_rollers(hanging, self.tension, weight, stiffness),
            ]
            self.mass = Marked(round(2.0 * float(below[1].pull[0, 0]) / GRAVITY, -1), f"kg, {why}", False, misses)
            pulled[0] = GRAVITY * (EMPTY + CAPACITY) * track.slope[1]
            over = [one.tension[-1] + pull for one, pull in zip(below, pulled, strict=True)]
            above = [
                _over_rollers(np.array([places[0], *rollers, self.ends[1]]), over[0], weight, stiffness),
                spans_under_tension(np.array([places[1], self.ends[1]]), over[1], weight, stiffness),
            ]
        except SpanError as error:
            raise SurveyError(f"haul rope: {error}") from None
        parts = np.array([[one.length.sum() for one in strand] for strand in zip(below, above, strict=True)])
        self.lengths = parts.sum(axis=1)
        self.clamps = np.array([parts[0, 0], parts[1, 1]])


class Ground(NamedTuple):
    """Terrain (points, 2) in m under a line from its lower end on, the asked clearance (m), and where x is along it."""

    terrain: FloatArray
    clearance: float
    lower: float  # m, x of the lower end
    forward: float  # 1 where the line rises with x, else -1

    def least(self, rope: Spans) -> tuple[float, float]:
        """Least height (m) of a rope over the ground between the stations, and its x (m)."""
        places = rope.shape(POINTS)
        along = np.union1d(places[:, 0], self.terrain[:, 0])
        along = along[(along >= 0.0) & (along <= rope.corner[-1, 0])]
        over = np.interp(along, *places.T) - np.interp(along, *self.terrain.T)
        lowest = int(over.argmin())
        return float(over[lowest]), self.lower + self.forward * float(along[lowest])


def _choose_tension(
    rope: Mapping[str, float], hanging: FloatArray, pulled: float, lifted: float, ground: Ground
) -> tuple[float, str, bool]:
    """Choose the tension (N) at the lower bullwheel: the usual one, or as much more as the clearance asks for.

    Args:
        rope: figures of the rope, as in a scenario.
        hanging: (spans + 1, 2) m, lower bullwheel, rollers, and cabin in the upper station.
        pulled: N, most pull of the full cabin along its track.
        lifted: N, weight of the rope over the rise of the line.
        ground: terrain and clearance.

    Returns:
        Tension, the deciding condition, and whether it misses the clearance.

    Raises:
        SurveyError: the rope is too weak; one line.
        SpanError: the rope does not reach.
    """
    weight, stiffness = GRAVITY * rope["mass_per_length"], rope["axial_stiffness"]
    allowed = rope["breaking_force"] / HAUL_FACTOR
    most = allowed - pulled - lifted
    usual = min(HAUL_TENSION, allowed / HAUL_MARGIN - pulled - lifted)
    if usual < LEAST_TENSION:
        raise SurveyError(
            f"haul rope: given a breaking force of {rope['breaking_force'] / 1e3:.0f} kN: with a safety factor of "
            f"{HAUL_FACTOR:g} it pulls {usual / 1e3:.0f} kN at the lower bullwheel; allowed: at least "
            f"{LEAST_TENSION / 1e3:.0f} kN: a stronger rope, or a lighter cabin"
        )

    def spare(tension: float) -> float:
        return ground.least(_over_rollers(hanging, tension, weight, stiffness))[0] - ground.clearance - SURE

    if spare(usual) >= 0.0:
        why = f"at most {HAUL_TENSION / 1e3:g} kN, safety factor {HAUL_FACTOR:g} below the drive"
        return usual, f"{usual / 1e3:.0f} kN a strand: {why}", False
    asked = float(scipy.optimize.brentq(spare, usual, allowed)) if spare(allowed) > 0.0 else np.inf
    tension = min(asked, most)
    height, x = ground.least(_over_rollers(hanging, tension, weight, stiffness))
    if asked <= most:
        why = f"least with which the haul rope keeps {ground.clearance:g} m over the ground at x = {x:.0f} m"
        return tension, f"{tension / 1e3:.0f} kN a strand: {why}", False
    left = allowed - lifted - asked  # for the cabin; grows with the section of the rope, as its weight and tension do
    thicker = rope["diameter"] * np.sqrt(pulled / left) if left > 0.0 else np.inf
    helps = f", or a haul rope of {ceil(1e3 * thicker)} mm" if thicker <= THICKEST * rope["diameter"] else ""
    return (
        tension,
        f"{tension / 1e3:.0f} kN a strand, the most with a safety factor of {HAUL_FACTOR:g}: the haul rope comes "
        f"to {height:.2f} m over the ground at x = {x:.0f} m; allowed: at least {ground.clearance:g} m, by a tower "
        f"there{helps}",
        True,
    )


def _over_rollers(corner: FloatArray, tension: float, weight: float, stiffness: float) -> Spans:
    """Spans of a rope over only those supports on which it lies; the rope passes above the others."""
    while True:
        spans = spans_under_tension(corner, tension, weight, stiffness)
        lifted = np.flatnonzero(spans.loads()[:, 1] > 0.0)
        if lifted.size == 0:
            return spans
        corner = np.delete(corner, lifted[spans.loads()[lifted, 1].argmax()] + 1, axis=0)


def jig_back_scenario(survey: Survey, ends: Ends, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Make the scenario of a jig-back tramway in space from a survey, as nested mappings with notes on value origins.

    Args:
        survey: terrain and towers.
        ends: where the track ropes leave both stations.
        changes: given values by dotted key, used where other values are derived from them.

    Raises:
        SurveyError: a rope cannot carry the cabins; one line.
    """
    upwards = ends.end[1] >= ends.start[1]
    forward = 1.0 if upwards else -1.0
    rope, haul_rope = given_rope(TRACK_ROPE, "ropes.track_1", changes), given_rope(HAUL_ROPE, "ropes.haul_1", changes)
    load = GRAVITY * (EMPTY + CAPACITY)
    mass_key = "ropes.track_1.start.mass"
    mass = given_number(changes, mass_key, 0.0) if mass_key in changes else None
    track = TrackRope(lower_first(survey, ends), rope, load, mass)
    lower = ends.start if upwards else ends.end
    asked = changes.get("limits.rope_clearance", 0.0)
    clearance = float(asked) if isinstance(asked, int | float) else -np.inf  # null: none; text the scenario refuses
    terrain = terrain_along(survey.terrain, lower[0], forward)
    haul = HaulRope(track, haul_rope, Ground(terrain, clearance, lower[0], forward))
    wheels = haul.ends * [forward, 1.0] + [lower[0], 0.0]
    level, rise = (track.corner[-1] - track.corner[0]).tolist()
    return {
        "description": f"Jig-back from a survey: two cabins of 12 t, {level:.0f} m with a rise of {rise:.0f} m, "
        f"{len(survey.towers)} tower{'s' * (len(survey.towers) != 1)}, in space",
        "gravity": GRAVITY,
        "ropes": {
            "track_1": _track(track, rope, ends, upwards, ASIDE),
            "track_2": _track(track, rope, ends, upwards, -ASIDE),
            "haul_1": _haul(haul_rope, float(haul.lengths[0]), wheels, ASIDE),
            "haul_2": _haul(haul_rope, float(haul.lengths[1]), wheels[::-1], -ASIDE),
        },
        "sheaves": _sheaves(haul, track, forward),
        **({"towers": _towers(survey, track, load, upwards)} if survey.towers else {}),
        "terrain": survey.terrain.tolist(),
        "air": {"density": assumed(1.1, "kg/m^3, at 1000 m of altitude (standard atmosphere)")},
        "carriages": {
            "cabin_1": _cabin("track_1", STATION, {"haul_1": float(haul.clamps[0])}, CAPACITY, "lower"),
            "cabin_2": _cabin("track_2", track.length.value - STATION, {"haul_2": float(haul.clamps[1])}, 0.0, "upper"),
        },
        "limits": {
            "rope_safety_factor": assumed(FACTOR, "track ropes: 3.15 to 3.5"),
            "haul_rope_safety_factor": assumed(HAUL_FACTOR, "4.5 to 5"),
            "deropement_margin": derived(None, "a cabin that passes lifts the haul rope off its rollers"),
            "roller_load": None,
            "tension_per_transverse_load": assumed(TRANSVERSE, "least tension over the weight across the rope"),
        },
        "solver": {"step": assumed(0.01, "s"), "tolerance": assumed(1e-6, "m")},
    }


def _aside(place: Place, y: float) -> list[float]:
    return [round(float(place[0]), 3), y, round(float(place[1]), 3)]


def _track(track: TrackRope, rope: Mapping[str, float], ends: Ends, upwards: bool, y: float) -> dict[str, Any]:
    """Scenario section of a track rope of a jig-back, at a lateral place (m)."""
    both = track_ends(track, ends, upwards, lambda place: _aside(place, y))
    low, high = ("start", "end") if upwards else ("end", "start")
    return {
        **rope_keys(rope, TRACK_ROPE, TRACK_WHY),
        "unstrained_length": track.length,
        "elements": assumed({"target": 30.0, "at_towers": 0.75, "growth": 3.0}, "lengths in m, short on saddles"),
        "damping_time": assumed(0.004, "s, a damping ratio of 0.2 % at 1 rad/s"),
        "start": both[low],
        "end": both[high],
    }


def _haul(rope: Mapping[str, float], length: float, wheels: FloatArray, y: float) -> dict[str, Any]:
    """Scenario section of a strand of the haul rope of a jig-back, between its bullwheels."""
    start, end = (
        assumed(_aside((wheel[0], wheel[1]), y), f"m: {BEHIND:g} m behind the end of the track ropes")
        for wheel in wheels
    )
    return {
        **rope_keys(rope, HAUL_ROPE, HAUL_WHY),
        "unstrained_length": derived(
            round(length, 2), "closed form: the counterweight is then near the middle of its travel"
        ),
        "elements": assumed({"target": 12.0, "at_towers": 1.0, "growth": 2.5}, "lengths in m, short on rollers"),
        "damping_time": assumed(0.004, "s"),
        "start": {"position": start, "support": "pinned"},
        "end": {"position": end, "support": "pinned"},
    }


def _sheaves(haul: HaulRope, track: TrackRope, forward: float) -> dict[str, Any]:
    wheel = assumed(ASIDE, "m, half the distance of the track ropes: stands for a smaller wheel and deflection sheaves")
    lining = assumed(0.22, "lining of rubber")
    return {
        "drive": {
            "radius": wheel,
            "joins": assumed(["haul_1.end", "haul_2.start"], "driven in the upper station"),
            "friction": lining,
            "inertia": assumed(400.0e3, "kg m^2, motor and gear, 20 t at the rim"),
            "drive": {
                "name": "haul_rope",
                "travel": derived([0.0, float(int(track.length.value - 2.0 * STATION - 2.0))], "m, between stations"),
                "limits": {
                    "speed": assumed(10.0, "m/s, 7 to 12 are common"),
                    "acceleration": assumed(0.3, "m/s^2, 0.1 to 0.3 are common"),
                    "jerk": assumed(0.2, "m/s^3"),
                    "emergency_deceleration": assumed(1.2, "m/s^2, 1 to 1.5 are common"),
                },
            },
        },
        "return": {
            "radius": wheel,
            "joins": assumed(["haul_2.end", "haul_1.start"], "tensioned in the lower station"),
            "friction": lining,
            "inertia": assumed(60.0e3, "kg m^2, 3 t at the rim"),
            "counterweight": {
                "direction": assumed([-forward, 0.0, 0.0], "level, away from the line"),
                "mass": haul.mass,
                "travel": assumed([-6.0, 6.0], "m"),
            },
        },
    }


def _towers(survey: Survey, track: TrackRope, load: float, upwards: bool) -> dict[str, Any]:
    """Scenario section of the towers of a jig-back: saddles of both track ropes, rollers of both haul strands."""
    found: dict[str, Any] = {}
    for name, own in saddles(survey, track, load, upwards).items():
        position = own["position"]
        place = position.value if isinstance(position, Marked) else position
        for number, y in ((1, ASIDE), (2, -ASIDE)):
            high = _aside((place[0], place[1]), y)
            there = assumed(high, position.why) if isinstance(position, Marked) else high
            found[f"{name}_{number}"] = {"rope": f"track_{number}", **own, "position": there}
    for tower in survey.towers:
        for number, y in ((1, ASIDE), (2, -ASIDE)):
            found[f"{tower.name}_rollers_{number}"] = {
                "rope": f"haul_{number}",
                "position": assumed(_aside((tower.x, tower.z - BELOW), y), f"m, {BELOW:g} m below the saddle"),
                "contacts": assumed(8, "rollers of the haul rope"),
                "length": assumed(10.0, "m, rollers of the haul rope"),
                "radius": assumed(40.0, "m, rollers of the haul rope"),
                "stiffness": assumed(0.2e6, "N/m, rollers of the haul rope"),
                "groove": assumed(1.0, "1/m: horns guide the rope back that a cabin has lifted off"),
                "groove_height": assumed(4.0, "m, the same"),
            }
    return found


def _cabin(track: str, place: float, clamps: Mapping[str, float], payload: float, station: str) -> dict[str, Any]:
    bodies = {name: {**body, **SIZES.get(name, {})} for name, body in BODIES.items()}
    return {
        "rope": track,
        "arc_length": assumed(round(place, 2), f"m, in the {station} station"),
        "clamped_to": {
            haul: derived(round(at, 2), "m, of the haul rope there, closed form") for haul, at in clamps.items()
        },
        "friction": {"rolling": assumed(0.005, "lined rollers on a locked coil rope")},
        "drive": {"track_rope_brake": assumed({"force": 60.0e3, "rise_time": 0.3}, "N and s")},
        "end_stop": {"stroke": assumed(3.0, "m")},
        "bodies": {
            name: {
                key: assumed([value[0], 0.0, value[1]] if key.endswith("pivot") else value, "usual cabin for 80 people")
                for key, value in body.items()
            }
            for name, body in bodies.items()
        },
        "payload": {
            "capacity": assumed(CAPACITY, "kg, 80 people of 80 kg"),
            "mass": assumed(payload, "kg, full up, empty down"),
            "body": "cabin",
            "station_distance": assumed(25.0, "m"),
            "loading_time": assumed(40.0, "s"),
        },
    }
