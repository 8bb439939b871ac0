"""Closed-form model of the line of a scenario for its design: supports, rope, loads and terrain."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy  # loads `optimize` where it is used

from cable_twin.frame.records import FloatArray
from cable_twin.offline.survey.lift import FACTOR as HAUL_FACTOR
from cable_twin.offline.survey.lift import Assemblies
from cable_twin.offline.survey.stations import terrain_along
from cable_twin.offline.survey.tramway import FACTOR as TRACK_FACTOR
from cable_twin.offline.survey.tramway import with_cabin
from cable_twin.scenario import Scenario
from cable_twin.scenario.spans import SpanError, Spans, spans_under_tension

PER_SPAN = 21  # points of a span at which clearance is taken
LIKE = 1e-9  # relative change of a tension that ends the search for that of a counterweight
MIDDLE, ENDS = (0.5,), (0.02, 0.98)  # shares of a span, places of the cabin at which the tension is taken
STATION = 40.0  # m from both ends, within which vehicles may come down to the ground; assumed


class DesignError(ValueError):
    """Error of a line that cannot be designed as requested; the message is one line."""


@dataclass(frozen=True, slots=True)
class LineModel:
    """Closed-form model of a line in a vertical plane: supports, rope and loads, from the tensioned end on.

    Attributes:
        scenario: scenario of the line.
        corner: (spans + 1, 2) m, distance from the tensioned end and height of ends and towers.
        towers: sheave assemblies of the towers; without hold-downs on a track rope.
        rope: figures of the rope by key.
        weights: N/m, of the rope with full vehicles, with empty ones, and bare.
        cabin: N, weight of the full vehicle on a track rope; 0 on a lift.
        depth: m, lowest point of the vehicle below the rope.
        terrain: (points, 2) m, in the axes of `corner`; empty without terrain.
        rope_keys: keys of the ropes in the file, such as ropes.up; for a jig-back of all equal track ropes.
        mass_keys: keys of the counterweights, one for each track rope, or one for both strands; empty without any.
        outwards: (2,) -, unit vector in the axes of `corner`, in which the counterweight pulls; zeros without any.
        free_stretch: -, length without tension, at the temperature of the scenario, over the unstrained length.
        forward: whether the first rope of the file starts at the tensioned end.
        hauled: whether a haul rope holds the cabin along its track rope, which otherwise does so itself.
        supports: for each tower, names in the file of all supports on it, with their heights (m) over `corner`; empty
            where a tower is in the file by its own name.
    """

    scenario: Scenario
    corner: FloatArray
    towers: Assemblies
    rope: dict[str, float]
    weights: tuple[float, float, float]
    cabin: float
    depth: float
    terrain: FloatArray
    rope_keys: tuple[str, ...]
    mass_keys: tuple[str, ...]
    outwards: FloatArray
    free_stretch: float
    forward: bool
    hauled: bool = True
    supports: tuple[tuple[tuple[str, float], ...], ...] = ()

    @property
    def strength(self) -> float:
        """Breaking force (N) of the rope.

        Raises:
            DesignError: the scenario has no breaking force.
        """
        if "breaking_force" not in self.rope:
            raise DesignError(f"{self.rope_keys[0]}.breaking_force: given none; allowed: that of the rope, in N")
        return self.rope["breaking_force"]

    @property
    def factor(self) -> float:
        """Required safety factor of the rope: from the scenario's limits, else the usual one."""
        limits = self.scenario.limits
        given = limits.rope_safety_factor
        usual = TRACK_FACTOR if self.cabin else HAUL_FACTOR
        return given if given is not None else usual

    @property
    def clearance(self) -> float:
        """Required clearance (m) of vehicles over the ground: from the scenario's limits, else 0."""
        return self.scenario.limits.vehicle_clearance or 0.0

    def spans(self, tension: float, which: int = 0) -> Spans:
        """Spans of the rope for a tension (N) at its tensioned end; `which`: 0 full vehicles, 1 empty, 2 bare rope."""
        return spans_under_tension(
            self.corner, tension, self.weights[which], self.rope["axial_stiffness"], self.free_stretch
        )

    def lengths(self, tension: float) -> float:
        """Unstrained length (m) of the rope with which the counterweight is in the middle of its travel."""
        if not self.cabin:
            return float(np.mean([self.spans(tension, which).length.sum() for which in (0, 1)]))
        bare = float(self.spans(tension, 2).length.sum())
        if not self.mass_keys:
            return bare
        return 0.5 * (bare + float(self._with_cabin(tension).length.sum()))

    def _with_cabin(self, tension: float, at: tuple[int, float] | None = None) -> Spans:
        """Spans of a track rope with the full cabin, for a tension (N) at its tensioned end; `at`: see `with_cabin`."""
        stiffness = self.rope["axial_stiffness"]
        return with_cabin(
            self.corner,
            tension,
            self.weights[2],
            stiffness,
            self.cabin,
            self.free_stretch,
            at=at,
            hauled=self.hauled,
        )

    def ways(self, tension: float) -> FloatArray:
        """Unit vectors (strands, 2) into the line along the rope at its tensioned end, for a tension (N) there.

        Of a lift that of the strand with full vehicles and of that with empty ones, of a track rope that of the bare
        rope; of a rope that this tension does not carry, that of the chord of the first span.
        """
        chord = self.corner[1] - self.corner[0]
        pulls = []
        for which in (2,) if self.cabin else (0, 1):
            try:
                pull = self.spans(tension, which).pull[0]
            except SpanError:
                pull = chord
            pulls.append(pull / np.hypot(*pull))
        return np.array(pulls)

    def pull(self, tension: float) -> float:
        """Force (N) of the counterweight, with all its strands, for a tension (N) of the rope at its tensioned end."""
        return tension * abs(float((self.ways(tension) @ self.outwards).sum()))

    def tension(self) -> float:
        """Tension (N) of the rope at the tensioned end, by the counterweight, or by the length between pinned ends."""
        if self.mass_keys:
            return self.tension_of(pull_of(self.scenario, self.mass_keys[0]))
        length = self.scenario.of_rope(next(iter(self.scenario.cables))).cable.unstrained_length

        def miss(tension: float) -> float:
            return self.lengths(tension) - length

        before = 0.0
        for tension in np.geomspace(0.3 * self.weights[2] * length, 0.02 * self.rope["axial_stiffness"], 60):
            try:
                longer = miss(tension) > 0.0
            except SpanError:
                continue
            if not longer and before > 0.0:
                return float(scipy.optimize.brentq(miss, before, tension, rtol=1e-9))
            before = float(tension)
        raise DesignError(f"unstrained_length: given {length:g} m; allowed: one with which the rope is taut")

    def tension_of(self, force: float) -> float:
        """Tension (N) of the rope at its tensioned end for a force (N) of the counterweight, the inverse of `pull`."""
        tension, before = force, 0.0
        for _ in range(30):  # the direction of the rope hardly depends on its tension
            if abs(tension - before) <= LIKE * tension:
                break
            tension, before = tension * force / self.pull(tension), tension
        return tension

    def highest_tension(self, tension: float) -> float:
        """Highest tension (N) of the rope with full vehicles, for a tension (N) at the tensioned end.

        A cabin makes a track rope without a counterweight tauter, most in the middle of a span, as the length stays;
        `tension` is then that of the bare rope. With a counterweight it does so only above itself, most next to the
        steeper end of a span, if the track rope holds it.

        Raises:
            SpanError: the rope does not carry the vehicles.
        """
        if not self.cabin:
            return float(self.spans(tension, 0).tension.max())
        bare = self.spans(tension, 2)
        shares = ENDS if self.mass_keys else MIDDLE
        places = [(row, share) for row in range(len(self.corner) - 1) for share in shares]
        length = float(bare.length.sum())
        return max(float(bare.tension.max()), *(self._tension_at(tension, length, at) for at in places))

    def _tension_at(self, tension: float, length: float, at: tuple[int, float]) -> float:
        """Highest tension (N) with the cabin at a place, for that (N) and the length (m) of the bare rope."""
        if not self.mass_keys:
            tension = self._pinned(tension, length, at)
        return float(self._with_cabin(tension, at).tension.max())

    def _pinned(self, tension: float, length: float, at: tuple[int, float]) -> float:
        """Tension (N) at the start of a rope of a length (m) with the cabin at a place, from that (N) without it."""

        def miss(tried: float) -> float:
            try:
                return float(self._with_cabin(tried, at).length.sum()) - length
            except SpanError:
                return length  # hangs too low

        low = high = tension
        while miss(high) > 0.0:
            low, high = high, 1.2 * high
            if high > self.rope["axial_stiffness"]:
                raise SpanError(f"unstrained_length: given {length:g} m, with which the rope does not carry its cabin")
        while miss(low) < 0.0:  # the track rope holds the cabin, which then takes tension off the part below it
            low, high = low / 1.2, low
        return float(scipy.optimize.brentq(miss, low, high, rtol=1e-5)) if low < high else tension

    def heights(self, tension: float) -> FloatArray:
        """Heights (spans, points) in m of the lowest points of full vehicles over the ground along each span.

        Heights within `STATION` of both ends, where vehicles come down to the ground, are infinite.
        """
        rope = self.spans(tension, 2 if self.cabin else 0)
        places = rope.shape(PER_SPAN).reshape(-1, PER_SPAN, 2)
        if self.cabin:  # the bend under a single load, to first order
            first, last = places[:, :1, 0], places[:, -1:, 0]
            there = (places[..., 0] - first) * (last - places[..., 0]) / (last - first)
            level = rope.pull[:, :1]
            slope = np.diff(self.corner, axis=0)
            share = slope[:, :1] / np.hypot(slope[:, :1], slope[:, 1:])
            places[..., 1] -= self.cabin * share**2 * there / level
        else:  # a rope of point loads bends by so much more under one of them than one of even weight
            apart = self.scenario.spacing
            places[..., 1] -= (self.weights[0] - self.weights[2]) * apart**2 / (8.0 * rope.pull[:, :1])
        ground = np.interp(places[..., 0], *self.terrain.T)
        along = np.linspace(self.corner[:-1, 0], self.corner[1:, 0], PER_SPAN, axis=1)  # as shape, whatever the heights
        inside = (along >= STATION) & (along <= self.corner[-1, 0] - STATION)
        return np.where(inside, places[..., 1] - self.depth - ground, np.inf)

    def with_heights(self, heights: FloatArray) -> LineModel:
        """Copy of the line with other heights (towers,) in m of the rope on its towers."""
        corner = self.corner.copy()
        corner[1:-1, 1] = heights
        return replace(self, corner=corner)

    def follows(self, tension: float, within: float) -> bool:
        """Whether the counterweight pulls along the rope, or the chord of its first span, but for an angle.

        Args:
            tension: N, at the tensioned end.
            within: rad.
        """
        ways = [self.ways(tension).sum(axis=0), self.corner[1] - self.corner[0]]
        return any(abs(float(way @ self.outwards)) > np.cos(within) * np.hypot(*way) for way in ways)

    def along_rope(self, tension: float) -> LineModel:
        """Copy of the line whose counterweight pulls along its rope, in the mean direction of both strands of a lift.

        Args:
            tension: N, at the tensioned end.
        """
        way = self.ways(tension).sum(axis=0)
        return replace(self, outwards=-way / np.hypot(*way))

    def directions(self) -> dict[str, list[float]]:
        """Directions (2 or 3,) of the counterweights by dotted key, in the axes of the scenario."""
        found = {}
        for key in self.mass_keys:
            given = counterweight_of(self.scenario, key).direction
            x, z = (round(one, 3) for one in self.outwards.tolist())
            sense = -1.0 if given[0] * x < 0.0 else 1.0
            found[f"{key.removesuffix('mass')}direction"] = [sense * x, *given[1:-1], z]
        return found

    def with_rope(self, rope: dict[str, float]) -> LineModel:
        """Copy of the line with another rope, given by its properties by key."""
        gravity = self.scenario.gravity
        more = gravity * (rope["mass_per_length"] - self.rope["mass_per_length"])
        weights = (self.weights[0] + more, self.weights[1] + more, self.weights[2] + more)
        return replace(self, rope=rope, weights=weights)


def pull_of(scenario: Scenario, mass_key: str) -> float:
    """Force (N) of a counterweight of a scenario, by the dotted key of its mass."""
    found = counterweight_of(scenario, mass_key)
    return float(found.force if found.force is not None else found.mass * scenario.gravity)


def counterweight_of(scenario: Scenario, mass_key: str) -> Any:
    """Section of a scenario with a counterweight, by the dotted key of its mass."""
    found: Any = scenario
    for part in mass_key.split(".")[:-1]:
        found = found[part] if isinstance(found, dict) else getattr(found, part)
    return found


KNOWN = "both strands of a lift in a plane, one track rope with a cabin, or equal track ropes with a cabin each"


def line_model(scenario: Scenario) -> LineModel:
    """Make the closed-form model of the line of a scenario.

    Raises:
        DesignError: the closed form does not know such a line.
    """
    if scenario.carriers is not None:
        if scenario.carriers.tracks:
            raise DesignError(f"carriers: given carriers that roll on track ropes; allowed: {KNOWN}")
        if scenario.dim != 2:
            raise DesignError(f"space: given 3; allowed: 2, as {KNOWN}")
        if scenario.sheaves:
            return _lift(scenario)
    tracks = [name for name in scenario.cables if name not in scenario.strands]
    riders = [scenario.rope_of(one) for one in scenario.carriages.values()]
    if not tracks or sorted(riders) != sorted(tracks) or (scenario.drives and not scenario.strands):
        raise DesignError(f"ropes: given {len(tracks)} track ropes and {len(riders)} cabins; allowed: {KNOWN}")
    return _track(scenario, tracks)


def _lift(scenario: Scenario) -> LineModel:
    carriers = scenario.carriers
    tensioned = [name for name, one in scenario.sheaves.items() if one.counterweight is not None]
    if carriers is None or carriers.kinds or len(tensioned) != 1 or len(scenario.ropes) != 2:
        raise DesignError(
            "sheaves: given another lift; allowed: a lift with one counterweight, two strands and carriers of one kind"
        )
    first = next(iter(scenario.ropes))
    strand = scenario.strands[first]
    alone = scenario.of_rope(first)
    corner = np.array([place[-2:] if len(place) == 2 else (place[0], place[2]) for place in alone.corners])
    if strand.after == tensioned[0]:  # from the tensioned end on
        corner, names = corner[::-1], list(alone.towers)[::-1]
    else:
        names = list(alone.towers)
    towers = [alone.towers[name] for name in names]
    empty = sum(body.mass for body in carriers.bodies.values()) / scenario.spacing
    capacity = carriers.payload.capacity / scenario.spacing if carriers.payload is not None else 0.0
    rope = figures_of(alone.cable)
    own = rope["mass_per_length"] + alone.cable.ice
    weights = tuple(scenario.gravity * (own + load) for load in (empty + capacity, empty, 0.0))
    outwards = _outwards(scenario.sheaves[tensioned[0]].counterweight.direction, corner)  # type: ignore[union-attr]
    plain = [name.removesuffix(f"_{first}") for name in names]
    corner, terrain = _from_tensioned_end(corner, scenario)
    return LineModel(
        scenario,
        corner,
        Assemblies(
            plain,
            [one.hold_down for one in towers],
            [one.contacts for one in towers],
            scenario.spacing,
            scenario.gravity * (empty + capacity) * scenario.spacing,
            scenario.gravity * empty * scenario.spacing,
        ),
        rope,
        (weights[0], weights[1], weights[2]),
        0.0,
        _depth(list(carriers.bodies.values())),
        terrain,
        tuple(f"ropes.{name}" for name in scenario.ropes),
        (f"sheaves.{tensioned[0]}.counterweight.mass",),
        outwards,
        alone.cable.free_stretch(scenario.air.temperature),
        strand.after != tensioned[0],
    )


def _track(scenario: Scenario, tracks: Sequence[str]) -> LineModel:
    """Closed-form model of one track rope, or of equal track ropes, with a cabin on each."""
    keys = tuple(f"ropes.{name}" if scenario.ropes else "cable" for name in tracks)
    first = scenario.of_rope(tracks[0])
    cable = first.cable
    weighted = [key for key, end in cable.ends.items() if end.support == "counterweight"]
    for key, name in zip(keys[1:], tracks[1:], strict=True):
        if (what := _unlike(first, scenario.of_rope(name))) != "":
            raise DesignError(f"{key}: given another {what} than {keys[0]}; allowed: the same {what} for all")
    corner = np.array([(place[0], place[-1]) for place in first.corners])
    names = list(first.towers)
    if weighted == ["end"]:
        corner, names = corner[::-1], names[::-1]
    towers = [first.towers[name] for name in names]
    rope = figures_of(cable)
    own = scenario.gravity * (rope["mass_per_length"] + cable.ice)
    full = [
        sum(body.mass for body in one.bodies.values()) + (one.payload.capacity if one.payload is not None else 0.0)
        for one in scenario.carriages.values()
    ]
    direction = cable.ends[weighted[0]].direction if weighted else None
    outwards = np.zeros(2) if direction is None else _outwards(direction, corner)
    supports = _supports(scenario, first, names) if len(tracks) > 1 else ()
    plain = [name.removesuffix("_1") for name in names] if supports else names
    depth = max(_depth(list(one.bodies.values())) for one in scenario.carriages.values())
    corner, terrain = _from_tensioned_end(corner, scenario)
    return LineModel(
        scenario,
        corner,
        Assemblies(plain, [one.hold_down for one in towers], [one.contacts for one in towers]),
        rope,
        (own, own, own),
        scenario.gravity * max(full),
        depth,
        terrain,
        keys,
        tuple(f"{key}.{weighted[0]}.mass" for key in keys) if weighted else (),
        outwards,
        cable.free_stretch(scenario.air.temperature),
        weighted != ["end"],
        all(one.drive.haul_rope is not None or one.clamped_to for one in scenario.carriages.values()),
        supports,
    )


def _unlike(one: Scenario, other: Scenario) -> str:
    """Name of the first difference of two track ropes designed together (course, rope, end); empty if none."""
    first, second = (np.array([(place[0], place[-1]) for place in rope.corners]) for rope in (one, other))
    if first.shape != second.shape or not np.allclose(first, second, atol=1e-3):
        return "course"
    if figures_of(one.cable) != figures_of(other.cable):
        return "rope"
    ends = [
        [
            (key, end.support, end.mass if end.support == "counterweight" else None)
            for key, end in rope.cable.ends.items()
        ]
        for rope in (one, other)
    ]
    return "end" if ends[0] != ends[1] else ""


def _supports(scenario: Scenario, first: Scenario, names: Sequence[str]) -> tuple[tuple[tuple[str, float], ...], ...]:
    """For each tower of the first rope, supports of all ropes at that x, with heights (m) over the tower's saddle."""
    places = scenario.tower_places
    return tuple(
        tuple(
            (other, float(place[-1] - first.tower_places[name][-1]))
            for other, place in places.items()
            if abs(place[0] - first.tower_places[name][0]) < 1.0
        )
        for name in names
    )


def _outwards(direction: Sequence[float], corner: FloatArray) -> FloatArray:
    """Unit vector (2,) of the direction (2 or 3,) of a counterweight, x rising from the tensioned end into the line."""
    found = np.array([direction[0], direction[-1]]) * [_sense(corner), 1.0]
    return np.asarray(found / np.hypot(*found))


def _sense(corner: FloatArray) -> float:
    """Sense of a line: 1 where x rises from the first support, else -1."""
    return 1.0 if corner[-1, 0] > corner[0, 0] else -1.0


def _from_tensioned_end(corner: FloatArray, scenario: Scenario) -> tuple[FloatArray, FloatArray]:
    """Convert supports and terrain to distances (m) from the first support, terrain in rising distance."""
    sense = _sense(corner)
    terrain = terrain_along(np.array(scenario.terrain, dtype=np.float64).reshape(-1, 2), corner[0, 0], sense)
    return np.column_stack([sense * (corner[:, 0] - corner[0, 0]), corner[:, 1]]), terrain


def figures_of(cable: Any) -> dict[str, float]:
    """Properties of a rope that scale with its diameter, by key, as far as given in the scenario."""
    keys = ("mass_per_length", "axial_stiffness", "bending_stiffness", "breaking_force", "diameter")
    return {key: float(value) for key in keys if (value := getattr(cable, key)) is not None}


def _depth(bodies: Sequence[Any]) -> float:
    """Depth (m) of the lowest point of a vehicle's chain of bodies below its joint on the rope."""
    below, lowest = 0.0, 0.0
    for body in bodies:
        centre = below + body.upper_pivot[-1]
        lowest = max(lowest, centre + (0.5 * body.size[1] if body.size is not None else 0.0))
        below = centre - (body.lower_pivot[-1] if body.lower_pivot is not None else 0.0)
    return lowest
