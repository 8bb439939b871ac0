"""Scenario schema with sensors, solver and limits; other sections are in the imported files.

The models have the allowed values of each key. Combinations that are not allowed, or that this release cannot run yet,
are in `checks/`; use `load_scenario`, which applies both.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import inf
from typing import Annotated, Any, Literal, NamedTuple, TypeVar

from pydantic import Field, PrivateAttr, model_validator

from cable_twin.basics.limited_yaml import as_yaml
from cable_twin.mechanics.parameters import INTEGRATORS
from cable_twin.scenario.sections.air import Air
from cable_twin.scenario.sections.couplings import (
    Connector,
    Pantograph,
    Riding,
    Sheave,
    Strand,
    strands_of,
)
from cable_twin.scenario.sections.drives import HaulRope, RopeDrive
from cable_twin.scenario.sections.limits import KeyFigureLimits
from cable_twin.scenario.sections.line import Cable, TerrainSides, Tower
from cable_twin.scenario.sections.quantities import (
    OF_KIND,
    Description,
    FromList,
    OneLine,
    Section,
    Vector,
    in_space,
    quantity,
)
from cable_twin.scenario.sections.vehicles import Carriage, CarrierKind, Carriers, Payload

R = TypeVar("R")
Integrator: Any = Literal[INTEGRATORS]  # type: ignore[valid-type]  # those of the mechanics

CABLE = "cable"  # name of the rope of a scenario that has one cable and no `ropes`
CARRIERS_APART = 2  # elements, from where on those of a loop are at nodes
CLAMPS_APART = 4  # elements, from where on nodes of vehicles that are clamped to another rope do not meet
ACROSS = 1e-9  # of its length: a track that goes less than that along x goes along y


class Sensor(Section):
    """Sensor with noise, bias, resolution and delay, published below `sensors/` beside the true value."""

    kind: Literal["encoder", "drive_force", "load_cell", "inclinometer", "imu"] = Field(
        description="measured quantity: position along the cable (m), force of a drive (N), force of a support (N), "
        "pitch or roll (rad), or acceleration and angular velocity (m/s^2, rad/s)"
    )
    of: str = Field(
        description="measured object: vehicle or drive (encoder, drive_force), support (load_cell), vehicle or "
        "VEHICLE/BODY (others)"
    )
    axis: Literal["pitch", "roll"] = Field(
        default="pitch", description="angle that an inclinometer measures: pitch, or in space roll, across the track"
    )
    rate: float = quantity("Hz", "sampling rate, at most that of frames", 50.0, gt=0)
    noise: float = quantity(OF_KIND, "standard deviation of white noise; m/s^2 of an imu", 0.0, ge=0)
    bias: float = quantity(OF_KIND, "constant error", 0.0)
    quantum: float = quantity(OF_KIND, "resolution, to which values are rounded; 0: none", 0.0, ge=0)
    rate_noise: float = quantity(
        "rad/s", "standard deviation of white noise of the angular velocity of an imu", 0.0, ge=0
    )
    rate_bias: float = quantity("rad/s", "constant error of the angular velocity of an imu", 0.0)
    delay: float = quantity(
        "s", "time from the measurement, which is the time stamp, to its publication", 0.0, ge=0, le=60
    )
    jitter: float = quantity("s", "longest further delay of a sample, evenly distributed from 0 on", 0.0, ge=0, le=60)
    lost: float = quantity("-", "share of samples that never arrive", 0.0, ge=0, le=1)
    drift: float = quantity(OF_KIND, "change of the bias in an hour; of an imu, that of its acceleration", 0.0)
    stuck_after: float | None = quantity(
        "s", "time from which the sensor repeats its last value; null: never", None, ge=0
    )
    seed: int = quantity("-", "seed of the noise", 0, ge=0, le=2**63 - 1)


class Solver(Section):
    """Time integration; `python -m benchmarks accuracy convergence` shows cost and accuracy of other values."""

    integrator: Integrator = Field(
        default="generalized_alpha", description="real-time integrator, or the explicit one of the paper"
    )
    step: float = quantity("s", "time step, at most that of the slowest frames", 0.001, ge=1e-6, le=1)
    spectral_radius: float = quantity(
        "-",
        "spectral radius of generalized-alpha: share of the highest frequencies that is left after a step; more than "
        "0.8 fails now and then",
        0.7,
        ge=0,
        le=1,
    )
    tolerance: float = quantity("m", "estimated error of a position at which the Newton iteration ends", 1e-9, gt=0)
    max_iterations: int = quantity("-", "Newton iterations before a step is halved", 12, ge=1, le=1000)
    max_halvings: int = quantity("-", "halvings of a step before it fails", 6, ge=0, le=30)


class Whole(NamedTuple):
    """Relations of a rope to the other ropes of a scenario, kept in the scenario of that rope alone."""

    strand: Strand | None = None
    riding: Riding | None = None
    hauls: bool = False
    track: tuple[float, float] | None = None  # m, direction in plan
    touched: bool = False  # pantographs slide on it


class Scenario(Section):
    """Complete definition of a run except its commands."""

    name: OneLine = Field(
        default="custom",
        description="name of the run; by default that of the file",
        min_length=1,
        max_length=200,
        json_schema_extra={"allowed": "a text of 1 to 200 characters that can be printed"},
    )
    description: Description = Field(
        default="",
        description="description of the scenario in one line",
        max_length=2000,
        json_schema_extra={"allowed": "a text of up to 2000 characters that can be printed"},
    )
    gravity: float = quantity("m/s^2", "gravity, downwards", 9.81, ge=0)
    space: Literal[2, 3] | None = Field(
        default=None,
        description="dimension: 2 for a plane, 3 for space; null: the most coordinates of a position of a support",
    )
    cable: Cable = Field(description="the cable; of several `ropes`, the first one")
    ropes: dict[str, Cable] = Field(default_factory=dict, description="several ropes by name, instead of one cable")
    sheaves: dict[str, Sheave] = Field(
        default_factory=dict, description="bullwheels that join ropes to loops, by name; `bullwheels` is read as well"
    )
    connectors: dict[str, Connector] = Field(
        default_factory=dict, description="rods between ropes, such as droppers, by name"
    )
    pantographs: dict[str, Pantograph] = Field(
        default_factory=dict, description="pantographs by name, which push a rope from below and move along it"
    )
    towers: dict[str, Tower] = Field(default_factory=dict, description="towers by name, in order along the cable")
    carriages: dict[str, Carriage] = Field(default_factory=dict, description="carriages by name")
    drives: dict[str, RopeDrive] = Field(default_factory=dict, description="the drive of a moving cable, by name")
    carriers: Carriers | None = Field(
        default=None, description="vehicles of one kind or several, at equal distances round a moving cable or a loop"
    )
    air: Air = Field(default_factory=Air, description="wind and drag")
    terrain: Annotated[tuple[Vector, ...], FromList] = quantity("m", "ground under the track, points x, z", ())
    terrain_sides: TerrainSides | None = Field(default=None, description="ground beside the track, in space")
    limits: KeyFigureLimits = Field(default_factory=KeyFigureLimits, description="limits of the key figures")
    sensors: dict[str, Sensor] = Field(default_factory=dict, description="sensors by name")
    solver: Solver = Field(default_factory=Solver, description="time integration")
    _whole: Whole = PrivateAttr(default=Whole())

    @model_validator(mode="before")
    @classmethod
    def _first_of_ropes(cls, data: Any) -> Any:
        """Take the first of several ropes as `cable`."""
        ropes = data.get("ropes") if isinstance(data, dict) else None
        if isinstance(ropes, dict) and ropes and "cable" not in data:
            return {**data, "cable": next(iter(ropes.values()))}
        return data

    @property
    def cables(self) -> dict[str, Cable]:
        """All ropes by name; a single cable is called `cable`."""
        return self.ropes or {CABLE: self.cable}

    def rope_key(self, name: str) -> str:
        """Key of a rope in the file: `cable`, or `ropes.NAME`."""
        return f"ropes.{name}" if self.ropes else "cable"

    @property
    def haul_ropes(self) -> dict[str, HaulRope]:
        """Haul ropes in the drives of carriages, by the name of the carriage."""
        return {name: one.drive.haul_rope for name, one in self.carriages.items() if one.drive.haul_rope is not None}

    def haul_rope_key(self, carriage: str) -> str:
        """Key of the haul rope in the drive of a carriage in the file."""
        return f"carriages.{carriage}.drive.haul_rope"

    def drive_key(self, name: str) -> str:
        """Key of a drive of ropes in the file: `drives.NAME`, or that below the bullwheel that it turns."""
        sheave = self.drives[name].sheave
        return f"sheaves.{sheave}.drive" if sheave else f"drives.{name}"

    def rope_of(self, thing: Carriage | Tower) -> str:
        """Name of the rope on which a carriage is, or which runs over a tower."""
        return thing.rope or next(iter(self.cables))

    @property
    def corners(self) -> list[tuple[float, ...]]:
        """Positions in m of the start, the towers and the end of the cable, as the file has them."""
        return [self.cable.start.position, *(one.position for one in self.towers.values()), self.cable.end.position]

    def end_names(self, name: str) -> tuple[str, str]:
        """Names of the supports at start and end of a rope, prefixed with its name in a scenario with `ropes`."""
        start, end = (f"{name}/{end}" if self.ropes else end for end in ("start", "end"))
        return start, end

    def of_rope(self, name: str) -> Scenario:
        """Reduce the scenario to one rope, which becomes its `cable`, with the towers and vehicles on this rope."""
        if not self.ropes:
            return self
        parts = *(getattr(self, key) for key in type(self).model_fields), self._whole
        return self._made(f"of_{name}", parts, lambda: self._of_rope(name))

    def _of_rope(self, name: str) -> Scenario:
        riding = self._riding(name)
        strand = self.strands.get(name)
        cable = self.ropes[name]
        towers = self._along(name, {key: one for key, one in self.towers.items() if self.rope_of(one) == name})
        if cable.lateral and self.dim == 3:  # a part of the positions, in space
            ends = {
                key: end.model_copy(update={"position": self.placed(name, end.position)})
                for key, end in cable.ends.items()
            }
            cable = cable.model_copy(update={**ends, "lateral": 0.0})
            towers = {
                key: tower.model_copy(update={"position": self.placed(name, tower.position)})
                for key, tower in towers.items()
            }
        update = {
            "cable": cable,
            "towers": towers,
            "carriages": {key: one for key, one in self.carriages.items() if self.rope_of(one) == name},
            "space": self.dim,
        }
        update |= {"ropes": {}, "connectors": {}, "pantographs": {}}
        if self.sheaves:
            along = self.strands.get(riding.strand) if riding else strand
            slides = bool(self.carriers and self.carriers.tracks)
            carriers = self.carriers.on_strand(along) if self.carriers and along and slides == bool(riding) else None
            update |= {"sheaves": {}, "drives": {}, "carriers": carriers}
        alone = self.model_copy(update=update)
        hauls = strand is not None and any(rope not in self.strands for rope in self.ropes)
        touched = any(one.rope == name for one in self.pantographs.values())
        alone._whole = Whole(strand, riding, hauls, self.track, touched)
        return alone

    @property
    def joint(self) -> Literal["paper", "node"]:
        """Kind of joint of vehicles with the rope: as given, else at mesh nodes where possible and accurate.

        A rope that begins straight, or has a free end, may lack the tension beside which its bending moment at a
        vehicle, which a node with two slopes does not pass on, counts for little. Carriers that are closer than two
        elements would leave hardly a node to the rope. Where points pass each other, the element between their nodes
        would have no length.
        """
        unsuited = self.cable.initial_shape == "straight" or "free" in self.cable.supports or self._points_may_pass()
        if self.carriers and not self._whole.riding:
            loop = self._whole.strand.loop_length if self._whole.strand else inf
            apart = min(self.carriers.spacing or inf, loop / self.carriers.count)
            unsuited |= apart < CARRIERS_APART * self._longest_element
        return self.cable.joint or ("paper" if unsuited or self.paper_reason else "node")

    @property
    def _longest_element(self) -> float:
        """Approximate length (m) of the longest mesh element of the cable."""
        elements = self.cable.elements
        return self.cable.unstrained_length / elements if isinstance(elements, int) else elements.target

    @property
    def paper_reason(self) -> str | None:
        """Reason why vehicles on the cable cannot be joined to it at mesh nodes; None if they can."""
        model, integrator, strand = self.cable.elastic_model, self.solver.integrator, self._whole.strand
        reasons = {
            f"with elastic_model {model}": model != "continuum",
            f"with integrator {integrator}": integrator != "generalized_alpha",
            "with pantographs on the same rope": self._whole.touched,
            "with tension_damping": self.cable.tension_damping > 0.0,
            "with mass_damping of a rope that moves over bullwheels": self.cable.mass_damping > 0.0 and bool(strand),
            f"with clamps to another rope that are less than {CLAMPS_APART} elements apart": self._clamps_are_close(),
        }
        return next((reason for reason, holds in reasons.items() if holds), None)

    def _points_may_pass(self) -> bool:
        """Whether two neighbouring carriages on the cable are points, which may pass each other without contact."""
        on_rope = sorted((one for one in self.carriages.values() if not one.clamped_to), key=lambda one: one.arc_length)
        pairs = pairwise(one for one in on_rope if one.joint != "clamped")
        return any("sliding" in (a.joint, b.joint) and a.is_point and b.is_point for a, b in pairs)

    def _clamps_are_close(self) -> bool:
        """Whether vehicles on the cable have clamps to another rope that are too few mesh elements apart."""
        apart, riding = inf, self._whole.riding
        if riding and self.carriers and self.carriers.count > 1:
            apart = riding.loop_length / self.carriers.count
        held = sorted(place for one in self.carriages.values() for place in list(one.clamped_to.values())[:1])
        nearest = min([apart, *(after - before for before, after in pairwise(held))])
        return nearest < CLAMPS_APART * self._longest_element

    def _riding(self, rope: str) -> Riding | None:
        """Hauling strand and its loop for the carriers on a track rope; None for other ropes."""
        for strand, track in (self.carriers.tracks if self.carriers else {}).items():
            if track == rope and strand in self.strands:
                place = self.strands[strand]
                return Riding(strand, self.ropes[strand].unstrained_length, place.loop_length, place.offset)
        return None

    @property
    def riding(self) -> Riding | None:
        """Strand that hauls the carriers riding on the cable, where the cable is a track rope; else None."""
        return self._whole.riding

    def _along(self, name: str, towers: dict[str, Tower]) -> dict[str, Tower]:
        """Towers of one rope, sorted along a strand or its track, which may run opposite to the order of the file."""
        if name not in self.strands and self._riding(name) is None:
            return towers
        ends = [in_space(end.position) for end in self.ropes[name].ends.values()]
        chord = [there - here for here, there in zip(*ends, strict=True)]

        def along_chord(item: tuple[str, Tower]) -> float:
            return sum(part * place for part, place in zip(chord, in_space(item[1].position), strict=True))

        return dict(sorted(towers.items(), key=along_chord))

    def placed(self, rope: str | None, position: tuple[float, ...]) -> tuple[float, float, float]:
        """Position (3,) in m in space of a place on a rope (None: the first), with the lateral offset of the rope."""
        x, y, z = in_space(position)
        return x, y + self.ropes.get(rope or "", self.cable).lateral, z

    @property
    def track(self) -> tuple[float, float]:
        """Direction of the track in plan, x, y in m: along the first rope, reversed if needed towards +x."""
        if self._whole.track is not None:
            return self._whole.track
        x, y = _in_plan(self.cable)
        return (-x, -y) if x < -ACROSS * abs(y) else (x, y)

    @property
    def runs_back(self) -> bool:
        """True if the cable runs against the track, as the returning strand of a loop does."""
        return sum(one * other for one, other in zip(_in_plan(self.cable), self.track, strict=True)) < 0.0

    @property
    def tower_places(self) -> dict[str, tuple[float, float, float]]:
        """Positions (3,) in m in space of all towers, by name."""
        return {name: self.placed(tower.rope, tower.position) for name, tower in self.towers.items()}

    @property
    def strands(self) -> dict[str, Strand]:
        """Strands of closed loops among the ropes, by name."""

        def make() -> dict[str, Strand]:
            return strands_of({name: rope.unstrained_length for name, rope in self.ropes.items()}, self.sheaves)

        return dict(self._made("strands", (self.ropes, self.sheaves), make))

    @property
    def strand(self) -> Strand | None:
        """Position of the cable on its loop, for a strand of several ropes; else None."""
        return self._whole.strand

    @property
    def hauls(self) -> bool:
        """True if the cable is a haul rope: a strand in a scenario with track ropes as well."""
        return self._whole.hauls

    @property
    def vehicles(self) -> dict[str, Carriage]:
        """All vehicles by name: the carriages of the file, then the carriers in order."""
        parts = self.carriages, self.carriers, self.cable, self.ropes, self.sheaves, self._whole
        return dict(self._made("vehicles", parts, self._vehicles))

    def __getstate__(self) -> dict[Any, Any]:
        """State of the scenario for copies and other processes, without cached objects."""
        state = super().__getstate__()
        own = {key: value for key, value in state["__dict__"].items() if not key.endswith("_made")}
        return {**state, "__dict__": own}

    def _made(self, name: str, parts: tuple[Any, ...], make: Callable[[], R]) -> R:
        """Cached object built from parts of the scenario; rebuilt in copies with other parts."""
        kept: dict[str, tuple[tuple[Any, ...], R]] = self.__dict__  # as of `cached_property`, no field
        made = kept.get(f"_{name}_made")
        if made is None or any(own is not other for own, other in zip(parts, made[0], strict=True)):
            made = kept[f"_{name}_made"] = parts, make()
        return made[1]

    def _vehicles(self) -> dict[str, Carriage]:
        carriers, carriages = self.carriers, self.carriages
        rows = {name: row for row, name in enumerate(self.cables)}
        carriages = dict(sorted(carriages.items(), key=lambda item: rows.get(item[1].rope or "", 0)))
        if carriers is None or carriers.count != carriers.count:  # NaN, of a file whose count is a fault
            return carriages
        spacing = self.spacing
        first = 0.5 * spacing if carriers.first is None else carriers.first
        where = self.strand or self.riding
        start = where.offset if where else 0.0
        places = [(first - start + number * spacing) % self.loop_length for number in range(carriers.count)]
        made: dict[tuple[int, float | None], Carriage] = {}  # one for each kind and payload, of which others are copies
        found = {}
        kinds = [carriers.kind(number) for number in range(max(len(carriers.order or carriers.kinds), 1))]
        for number, place in enumerate(places):
            kind = kinds[number % len(kinds)]
            mass = self._load(kind, place)
            if mass is not None and not carriers.carries(number):
                mass = 0.0
            like = made.get((id(kind), mass))
            if like is None:
                like = made[id(kind), mass] = self._carrier(kind, mass)
            found[f"{carriers.name}_{number + 1}"] = self._placed_carrier(like, place)
        return carriages | found

    def _load(self, kind: CarrierKind, place: float) -> float | None:
        """Initial payload (kg) of a carrier at a place (m) of the loop; None for carriers without payload."""
        given, beyond = kind.payload, place - self.cable.unstrained_length
        if given is None:
            return None
        if beyond > 0.0:  # it enters the cable at the nearer station
            nearer = 2.0 * beyond < self.loop_length - self.cable.unstrained_length
            return given.entering(at_start=not nearer)
        return given.entering(at_start=True) if given.on_cable is None else given.on_cable

    def _carrier(self, kind: CarrierKind, mass: float | None) -> Carriage:
        """Carrier of a kind with a payload (kg), before it is placed on the loop."""
        given, carriers, payload = kind.payload, self.carriers, None
        if given is not None:
            payload = Payload.model_construct(
                capacity=given.capacity, mass=mass, body=given.body, position=given.position
            )
        if self.riding is None or carriers is None:
            return Carriage.model_construct(arc_length=0.0, joint="clamped", bodies=kind.bodies, payload=payload)
        return Carriage.model_construct(
            arc_length=0.0,
            clamped_to={},
            clamp_offset=carriers.clamp_offset,
            friction=carriers.friction,
            bodies=kind.bodies,
            payload=payload,
        )

    def _placed_carrier(self, like: Carriage, place: float) -> Carriage:
        """Copy of a carrier at a place (m) of the loop."""
        riding = self.riding
        if riding is None:
            return like.model_copy(update={"arc_length": place})
        length = self.cable.unstrained_length
        along = min(max(place / riding.length, 0.0), 1.0) * length
        return like.model_copy(update={"arc_length": along, "clamped_to": {riding.strand: place}})

    @property
    def dim(self) -> int:
        """Dimension of the working space: 2 in a plane, 3 in space."""
        return self.space or self._made("dim", (self.ropes, self.cable, self.towers), self._dim)

    def _dim(self) -> int:
        """Dimension of a scenario: the largest number of coordinates of a support's position."""
        cables = self.cables.values()
        places = [place for cable in cables for place in (cable.start.position, cable.end.position)]
        return max(map(len, [*places, *(tower.position for tower in self.towers.values())]))

    def vector(self, given: tuple[float, ...]) -> tuple[float, ...]:
        """Vector with as many numbers as dimensions, from x, z or x, y, z; y is 0 if not given."""
        return in_space(given) if self.dim == 3 else given[:: len(given) - 1]

    @property
    def loop_length(self) -> float:
        """Unstrained length (m) of the loop of a moving cable; without carriers, twice the length of the cable."""
        if (where := self.strand or self.riding) is not None:
            return where.loop_length
        for strand in self.strands.values():
            return strand.loop_length
        if self.carriers is None or self.carriers.spacing is None:
            return 2.0 * self.cable.unstrained_length
        return self.carriers.count * self.carriers.spacing

    @property
    def spacing(self) -> float:
        """Unstrained distance (m) between successive carriers; 0 without carriers."""
        if self.carriers is None:
            return 0.0
        return self.carriers.spacing or self.loop_length / self.carriers.count

    def resolved(self) -> dict[str, Any]:
        """Scenario with all defaults as plain data for JSON or YAML; input of `load_scenario`."""
        return self.model_dump(mode="json", exclude={"cable"} if self.ropes else None)

    def to_yaml(self) -> str:
        """Scenario with all defaults as YAML text, valid in YAML 1.1 and 1.2."""
        return as_yaml(self.resolved())


def _in_plan(cable: Cable) -> tuple[float, float]:
    """Vector from the start to the end of a cable in plan, x, y in m."""
    (x, y, _), (x_end, y_end, _) = in_space(cable.start.position), in_space(cable.end.position)
    return x_end - x, y_end - y
