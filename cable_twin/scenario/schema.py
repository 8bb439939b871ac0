"""What a scenario consists of: names, types, units, bounds and defaults of everything in a scenario file.

The models say what a value may be by itself. What values may not be together, and what this release cannot run yet,
is in `find_faults` and the `*_conflicts` beside it; use `load_scenario`, which applies both.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, PrivateAttr, Tag, model_validator

from cable_twin.mechanics.parameters import ELASTIC_MODELS, GUSTS, INTEGRATORS, STRONGEST_WIND
from cable_twin.scenario.as_yaml import as_yaml
from cable_twin.scenario.bullwheels import Riding, Sheave, Strand, expand_bullwheels, strands_of
from cable_twin.scenario.carriers import CarrierKind, Carriers
from cable_twin.scenario.couplings import Connector, Pantograph
from cable_twin.scenario.drives import RopeDrive
from cable_twin.scenario.quantities import FromList, Place, Section, Vector, in_space, quantity
from cable_twin.scenario.vehicles import Carriage, Payload

MOST_ELEMENTS = 100_000
# whatever the mechanics have; without a stub's idea of a literal
ElasticModel: Any = Literal[ELASTIC_MODELS]  # type: ignore[valid-type]
Integrator: Any = Literal[INTEGRATORS]  # type: ignore[valid-type]
GustShape: Any = Literal[GUSTS]  # type: ignore[valid-type]


class Support(Section):
    """What holds one end of the cable."""

    position: Place = quantity("m", "place as x, z, in space x, y, z; only the direction of the start where it is free")
    support: Literal["pinned", "clamped", "free", "hydraulic", "counterweight"] = Field(
        default="pinned",
        description="what of the end is held; a hydraulic tensioning device keeps its length, as a pin does",
    )
    direction: Place | None = quantity(
        "-", "direction of the cable in a clamp, towards its end; or in which a counterweight pulls; any length", None
    )
    mass: float | None = quantity("kg", "mass of a counterweight", None, gt=0)
    force: float | None = quantity("N", "pull of a counterweight; its weight where none is given", None, gt=0)
    travel: Vector | None = quantity("m", "least and most travel of a counterweight from `position`", None)
    buffer_stiffness: float | None = quantity(
        "N/m", "stiffness of the buffers at both limits of the travel; null: 5 cm hold the pull", None, gt=0
    )
    buffer_damping: float = quantity(
        "s/m", "damping of these buffers: force = stiffness d (1 + damping d_dot)", 1.0, ge=0
    )


class Load(Section):
    """A constant load at a point of the cable."""

    arc_length: float = quantity("m", "unstrained arc length from the start", ge=0)
    force: Place = quantity("N", "force on the cable as x, z, in space as x, y, z", (0.0, 0.0))
    moment: float = quantity("N m", "moment on an end of the cable, right-handed about y", 0.0)


class Grading(Section):
    """Elements that are short only where they must be: at towers and ends."""

    target: float = quantity("m", "length of an element far from towers and ends", gt=0)
    at_towers: float = quantity("m", "length of an element at towers and ends", gt=0)
    growth: float = quantity("-", "ratio of the lengths of neighbours between these", 1.5, gt=1, le=4)


def _form(elements: Any) -> str:
    return "#graded" if isinstance(elements, dict | Grading) else "#number"


Elements = Annotated[
    Annotated[int, Field(ge=1, le=MOST_ELEMENTS), Tag("#number")] | Annotated[Grading, Tag("#graded")],
    Discriminator(_form),
]


class Cable(Section):
    """One cable of one kind."""

    unstrained_length: float = quantity("m", "length without tension", gt=0)
    mass_per_length: float = quantity("kg/m", "mass per unstrained length", gt=0)
    axial_stiffness: float = quantity("N", "EA, Young's modulus times area of the steel", gt=0)
    breaking_force: float | None = quantity("N", "minimum breaking force, for the rope safety factor", None, gt=0)
    bending_stiffness: float = quantity("N m^2", "EI, resistance of the rope to bending", ge=0)
    elements: Elements = Field(
        description="number of elements, all of one unstrained length (-), or how long they are where",
        json_schema_extra={
            "unit": "-",
            "allowed": f"a whole number at least 1 and at most {MOST_ELEMENTS}, or a mapping of target, at_towers (m) "
            "and growth",
        },
    )
    elastic_model: ElasticModel = Field(
        default="continuum", description="strain energy on the arc itself, or in the frame of each element's chord"
    )
    damping_time: float = quantity("s", "Kelvin-Voigt relaxation time of EA and EI", 0.0, ge=0)
    mass_damping: float = quantity("1/s", "of a rope among several: damping per mass", 0.0, ge=0)
    tension_damping: float = quantity(
        "s", "of a rope among several: damping per stiffness that the tension at the start gives it", 0.0, ge=0
    )
    initial_shape: Literal["equilibrium", "straight"] = Field(
        default="equilibrium", description="how it starts: in static equilibrium, or unstrained from start towards end"
    )
    start: Support = Field(description="what holds it at arc length 0")
    end: Support = Field(description="what holds it at its other end")
    loads: Annotated[tuple[Load, ...], FromList] = Field(default=(), description="constant loads on the cable")
    lateral: float = quantity(
        "m",
        "of a rope among several: how far to the left it is, with its towers and what is on it; a plane only shows it",
        0.0,
    )
    diameter: float | None = quantity("m", "diameter, for the wind on it; null for no drag", None, gt=0)
    drag_coefficient: float = quantity("-", "drag coefficient across the cable", 1.2, ge=0)
    ice: float = quantity("kg/m", "ice along the whole cable: weight, inertia and, with a diameter, drag", 0.0, ge=0)
    ice_density: float = quantity("kg/m^3", "density of the ice, for the diameter with it", 900.0, gt=0)


class Tower(Section):
    """What the cable runs over between its ends: sheaves, or the saddle of a track rope. It never pulls."""

    rope: str | None = Field(default=None, description="the rope that runs over it; null: the first one")
    position: Place = quantity("m", "where the rope touches its middle, as x, z, in space as x, y, z")
    kind: Literal["sheaves", "saddle"] = Field(default="sheaves", description="what the rope lies on")
    contacts: int = quantity("-", "sheaves of the train, or points at which the saddle is reckoned", 1, ge=1, le=100)
    length: float = quantity("m", "length along the rope, from the first contact to the last", 0.0, ge=0)
    radius: float | None = quantity("m", "radius of the circle of the contacts; null: a straight line", None, gt=0)
    hold_down: bool = Field(default=False, description="whether it presses the rope down from above")
    stiffness: float = quantity("N/m", "stiffness of each contact, normal to the rope", 2e6, gt=0)
    damping: float = quantity("s/m", "damping of each contact: force = stiffness d (1 + damping d_dot)", 2.0, ge=0)
    groove: float = quantity(
        "1/m",
        "in space, force sideways over normal force, by how far the rope is off the middle of its groove",
        20.0,
        gt=0,
    )
    derailment_ratio: float = quantity(
        "-",
        "in space, force sideways over normal force of the tower at which the rope leaves it; assumed: flanks of 45 "
        "degrees and a friction of 0.3 hold up to 0.54 (Nadal)",
        0.5,
        gt=0,
    )
    groove_friction: float = quantity("-", "in space, friction sideways in the groove per normal force", 0.0, ge=0)
    groove_height: float = quantity(
        "m", "in space, how high the rope lifts off all contacts until it has left the tower; assumed", 0.05, gt=0
    )
    groove_direction: Place | None = quantity(
        "-",
        "in space, where the grooves open, x, y, z of any length; null: upwards, downwards of a hold-down",
        None,
    )
    mast_offset: float | None = quantity(
        "m", "in space, from the rope to the middle of the mast, positive to the left; null: no mast", None
    )
    mast_width: float | None = quantity("m", "in space, width of the mast, which reaches up to the rope", None, gt=0)
    friction: float | None = quantity(
        "-", "friction along the rope per normal force; null: 0.03 for sheaves, 0.1 for a saddle", None, ge=0
    )


class TerrainSides(Section):
    """The ground beside the track in space: straight from the profile under it to one on each side, level beyond."""

    distance: float = quantity("m", "how far from the track, y = 0, both profiles are", gt=0)
    left: Annotated[tuple[Vector, ...], FromList] = quantity("m", "ground on the left, points x, z", min_length=2)
    right: Annotated[tuple[Vector, ...], FromList] = quantity("m", "ground on the right, points x, z", min_length=2)


class Profile(Section):
    """Growth of the wind with the height above the ground, h: wind (h / reference_height)^exponent."""

    exponent: float = quantity("-", "of the power law; 0.14 open land, 0.2 as IEC 61400-1 has it", 0.14, gt=0, le=1)
    reference_height: float = quantity("m", "height above the ground where the wind is as given", 10.0, gt=0)
    ground: float = quantity("m", "z of the ground where there is no terrain", 0.0)


class Gust(Section):
    """A gust of a standard, everywhere at once, that is added to the wind."""

    time: float = quantity("s", "when it begins, since the start or the last reset", ge=0)
    amplitude: Place = quantity("m/s", "how strong it is, as x, z, in space x, y, z")
    duration: float = quantity("s", "how long it lasts; 10.5 in IEC 61400-1", 10.5, gt=0)
    shape: GustShape = Field(
        default="one_minus_cosine",
        description="of CS-25.341, up to the amplitude and back; or the extreme operating gust of IEC 61400-1, 6.3.2.2",
    )


class Turbulence(Section):
    """Turbulence with a spectrum, from a seed; frozen as it goes by with the wind, partly coherent along the line."""

    spectrum: Literal["kaimal", "von_karman"] = Field(
        default="kaimal", description="that of Kaimal, or the isotropic one of von Karman, both as IEC 61400-1 has them"
    )
    intensity: float = quantity("-", "standard deviation along the wind over its mean speed", 0.16, ge=0, le=1)
    length_scale: float = quantity(
        "m", "integral scale along the wind; IEC 61400-1: 5.67 times the height up to 60 m", 170.0, gt=0
    )
    decay: float = quantity("-", "of coherence with the distance across the wind; 12 in IEC 61400-1", 12.0, ge=0)
    points: int = quantity("-", "points along the line at which it is made", 32, ge=1, le=200)
    seed: int = quantity("-", "seed of its phases", 0, ge=0, le=2**63 - 1)


class Air(Section):
    """The air around it all; without diameter of the cable and drag areas of bodies it does nothing."""

    density: float = quantity("kg/m^3", "density of the air, by default of 15 degrees at sea level", 1.225, ge=0)
    wind: Place = quantity(
        "m/s",
        f"mean wind along the track and upwards until another comes; in space x, y, z; at most {STRONGEST_WIND:g}",
        (0.0, 0.0),
    )
    profile: Profile | None = Field(default=None, description="how the wind grows with height; null: the same at each")
    gusts: Annotated[tuple[Gust, ...], FromList] = Field(default=(), description="gusts at given times")
    turbulence: Turbulence | None = Field(default=None, description="turbulence of the wind; null for none")


class Sensor(Section):
    """What measures the plant; published beside the truth, below `sensors/`."""

    kind: Literal["encoder", "load_cell", "inclinometer", "imu"] = Field(
        description="what it measures: m along the cable, N, rad of pitch, or m/s^2 and rad/s"
    )
    of: str = Field(description="vehicle or drive (encoder), support (load_cell), vehicle or VEHICLE/BODY (others)")
    rate: float = quantity("Hz", "how often, at most every frame", 50.0, gt=0)
    noise: float = quantity("unit of the kind", "standard deviation of white noise; m/s^2 of an imu", 0.0, ge=0)
    bias: float = quantity("unit of the kind", "constant error", 0.0)
    quantum: float = quantity("unit of the kind", "step of what it can tell; 0: none", 0.0, ge=0)
    rate_noise: float = quantity("rad/s", "standard deviation of the rate of turn of an imu", 0.0, ge=0)
    rate_bias: float = quantity("rad/s", "constant error of that", 0.0)
    delay: float = quantity("s", "time from the measurement, which the stamp has, to its arrival", 0.0, ge=0, le=60)
    seed: int = quantity("-", "seed of its noise", 0, ge=0, le=2**63 - 1)


class Solver(Section):
    """Time integration; `python -m benchmarks accuracy convergence` shows what other values cost and give."""

    integrator: Integrator = Field(
        default="generalized_alpha", description="real-time integrator, or the explicit one of the paper"
    )
    step: float = quantity("s", "time step", 0.001, gt=0)
    spectral_radius: float = quantity(
        "-", "what is left of the highest frequencies in a step; more than 0.8 fails now and then", 0.7, ge=0, le=1
    )
    tolerance: float = quantity("m", "estimated error of a position at which the Newton iteration ends", 1e-9, gt=0)
    max_iterations: int = quantity("-", "Newton iterations before a step is halved", 12, ge=1, le=1000)
    max_halvings: int = quantity("-", "how often a step may be halved before it fails", 6, ge=0, le=30)


class KeyFigureLimits(Section):
    """What key figures are held against; null where there is no limit. `key_figures` names the source of each."""

    rope_safety_factor: float | None = quantity("-", "lowest breaking force over tension", 3.15, gt=0)
    haul_rope_safety_factor: float | None = quantity("-", "the same of haul ropes beside others", 4.5, gt=0)
    tension_per_transverse_load: float | None = quantity("-", "lowest tension over load of a carriage", 10.0, gt=0)
    swing: float | None = quantity("rad", "highest swing of a carriage along the track", 0.35, gt=0)
    lateral_swing: float | None = quantity("rad", "highest swing across the track, in space", 0.2, gt=0)
    tower_clearance: float | None = quantity("m", "least distance of a vehicle from a mast, in space", 0.5, ge=0)
    vehicle_separation: float | None = quantity(
        "m", "least distance of vehicles on different ropes from each other, in space", 1.0, ge=0
    )
    acceleration: float | None = quantity("m/s^2", "highest acceleration of the last body of a carriage", 1.5, gt=0)
    stopping_distance: float | None = quantity("m", "longest way to a standstill", None, gt=0)
    stopping_time: float | None = quantity("s", "longest time to a standstill", None, gt=0)
    sag: float | None = quantity("m", "largest depth of the cable below its chord, of each span", None, gt=0)
    dynamic_amplification: float | None = quantity("-", "highest tension over that at the start", None, gt=0)
    rope_clearance: float | None = quantity("m", "least height of the cable over the terrain", 0.0, ge=0)
    vehicle_clearance: float | None = quantity("m", "least height of a vehicle over the terrain", 0.0, ge=0)
    support_load: float | None = quantity("N", "highest force of the cable on a support", None, gt=0)
    deropement_margin: float | None = quantity("-", "least load of a tower over its load at rest", 0.1, ge=0, le=1)
    energy_lost: float | None = quantity(
        "-", "largest share of energy that moves which the solver may lose", 0.005, gt=0
    )


class Scenario(Section):
    """Everything that determines a run but the commands."""

    name: str = Field(
        default="custom", description="what the run is called; the name of the file by default", min_length=1
    )
    description: str = Field(default="", description="one line about it")
    gravity: float = quantity("m/s^2", "gravity, downwards", 9.81, ge=0)
    space: Literal[2, 3] | None = Field(
        default=None, description="2 for a plane, 3 for space; null: as many as the positions of supports have numbers"
    )
    cable: Cable = Field(description="the cable; where there are several `ropes` instead, the first of those")
    ropes: dict[str, Cable] = Field(default_factory=dict, description="several ropes by name, instead of one cable")
    sheaves: dict[str, Sheave] = Field(default_factory=dict, description="bullwheels that join ropes to loops, by name")
    connectors: dict[str, Connector] = Field(default_factory=dict, description="what hangs between ropes, by name")
    pantographs: dict[str, Pantograph] = Field(
        default_factory=dict, description="what pushes a rope from below and moves along it, by name"
    )
    towers: dict[str, Tower] = Field(default_factory=dict, description="towers by name, in order along the cable")
    carriages: dict[str, Carriage] = Field(default_factory=dict, description="carriages by name")
    drives: dict[str, RopeDrive] = Field(default_factory=dict, description="the drive of a moving cable, by name")
    carriers: Carriers | None = Field(default=None, description="carriages of one kind, all round a moving cable")
    air: Air = Field(default_factory=Air, description="wind and drag")
    terrain: Annotated[tuple[Vector, ...], FromList] = quantity("m", "ground under the track, points x, z", ())
    terrain_sides: TerrainSides | None = Field(default=None, description="ground beside the track, in space")
    limits: KeyFigureLimits = Field(default_factory=KeyFigureLimits, description="limits of the key figures")
    sensors: dict[str, Sensor] = Field(default_factory=dict, description="sensors by name")
    solver: Solver = Field(default_factory=Solver, description="time integration")
    _strand: Strand | None = PrivateAttr(default=None)
    _rides: Riding | None = PrivateAttr(default=None)
    _hauls: bool = PrivateAttr(default=False)

    @model_validator(mode="before")
    @classmethod
    def _first_of_ropes(cls, data: Any) -> Any:
        """Let the cable be the first of several ropes, and each tower and drive stand by itself."""
        if isinstance(data, dict):
            data = expand_bullwheels(data)
        ropes = data.get("ropes") if isinstance(data, dict) else None
        if isinstance(ropes, dict) and ropes and "cable" not in data:
            return {**data, "cable": next(iter(ropes.values()))}
        return data

    def of_rope(self, name: str) -> Scenario:
        """The same of one rope alone, with what is on it: a scenario with a cable."""
        first, riding = next(iter(self.ropes)), self._riding(name)
        strand = self.strands.get(name)
        cable = self.ropes[name]
        towers = self._along(name, {k: tower for k, tower in self.towers.items() if (tower.rope or first) == name})
        if cable.lateral and self.dim == 3:  # there it is where the mechanics have it
            ends = {
                key: end.model_copy(update={"position": self.placed(name, end.position)})
                for key, end in (("start", cable.start), ("end", cable.end))
            }
            cable = cable.model_copy(update={**ends, "lateral": 0.0})
            towers = {
                key: tower.model_copy(update={"position": self.placed(name, tower.position)})
                for key, tower in towers.items()
            }
        update = {
            "cable": cable,
            "towers": towers,
            "carriages": {key: one for key, one in self.carriages.items() if (one.rope or first) == name},
            "space": self.dim,
        }
        update |= {"ropes": {}, "connectors": {}, "pantographs": {}}
        if self.sheaves:
            along = self.strands.get(riding.strand) if riding else strand
            slides = bool(self.carriers and self.carriers.tracks)
            carriers = self.carriers.on_strand(along) if self.carriers and along and slides == bool(riding) else None
            update |= {"sheaves": {}, "drives": {}, "carriers": carriers}
        alone = self.model_copy(update=update)
        alone._strand, alone._rides = strand, riding
        alone._hauls = strand is not None and any(rope not in self.strands for rope in self.ropes)
        return alone

    def _riding(self, rope: str) -> Riding | None:
        """What rides a track rope, where something does."""
        for strand, track in (self.carriers.tracks if self.carriers else {}).items():
            if track == rope and strand in self.strands:
                place = self.strands[strand]
                return Riding(strand, self.ropes[strand].unstrained_length, place.loop_length, place.offset)
        return None

    @property
    def riding(self) -> Riding | None:
        """How carriers ride the cable, of one that is the track of a loop."""
        return self._rides

    def _along(self, name: str, towers: dict[str, Tower]) -> dict[str, Tower]:
        """Towers of one rope in the order along it: of a strand, which may come down the line that another goes up."""
        if name not in self.strands and self._riding(name) is None:
            return towers
        ends = [in_space(end.position) for end in (self.ropes[name].start, self.ropes[name].end)]
        chord = [there - here for here, there in zip(*ends, strict=True)]

        def way(item: tuple[str, Tower]) -> float:
            return sum(part * place for part, place in zip(chord, in_space(item[1].position), strict=True))

        return dict(sorted(towers.items(), key=way))

    def placed(self, rope: str | None, position: tuple[float, ...]) -> tuple[float, float, float]:
        """Where (x, y, z in m) a place of a rope (None: of the first) is shown, as far to the left as that is."""
        x, y, z = in_space(position)
        return x, y + self.ropes.get(rope or "", self.cable).lateral, z

    @property
    def tower_places(self) -> dict[str, tuple[float, float, float]]:
        """Where (x, y, z in m) all towers are shown, by name."""
        return {name: self.placed(tower.rope, tower.position) for name, tower in self.towers.items()}

    @property
    def strands(self) -> dict[str, Strand]:
        """The ropes that are strands of a closed loop."""
        return strands_of({name: rope.unstrained_length for name, rope in self.ropes.items()}, self.sheaves)

    @property
    def strand(self) -> Strand | None:
        """Where the cable is on its loop, of one that is a strand of several ropes."""
        return self._strand

    @property
    def hauls(self) -> bool:
        """Whether the cable is one of several that pulls what others carry."""
        return self._hauls

    @property
    def vehicles(self) -> dict[str, Carriage]:
        """All carriages by name: those of the file, then the carriers from the first on."""
        carriers, carriages = self.carriers, self.carriages
        if self.ropes:  # rope by rope, as they are read
            rows = {name: row for row, name in enumerate(self.ropes)}
            carriages = dict(sorted(carriages.items(), key=lambda item: rows.get(item[1].rope or "", 0)))
        if carriers is None:
            return carriages
        spacing = self.spacing
        first = 0.5 * spacing if carriers.first is None else carriers.first
        where = self._strand or self._rides
        start = where.offset if where else 0.0
        places = [(first - start + number * spacing) % self.loop_length for number in range(carriers.count)]
        return carriages | {
            f"{carriers.name}_{number + 1}": self._carrier(carriers.kind(number), place)
            for number, place in enumerate(places)
        }

    def _carrier(self, kind: CarrierKind, place: float) -> Carriage:
        """A carrier at a place (m) of the loop, with what it carries there."""
        room, length, payload = kind.payload, self.cable.unstrained_length, None
        if room is not None:
            beyond = place - length
            mass = room.from_start if room.on_cable is None else room.on_cable
            if beyond > 0.0:  # it comes on next at the nearer station
                mass = room.from_end if 2.0 * beyond < self.loop_length - length else room.from_start
            payload = Payload(capacity=room.capacity, mass=mass, body=room.body, position=room.position)
        riding, carriers = self._rides, self.carriers
        if riding is None or carriers is None:
            return Carriage(arc_length=place, joint="clamped", bodies=kind.bodies, payload=payload)
        return Carriage(
            arc_length=min(max(place / riding.length, 0.0), 1.0) * length,
            clamped_to={riding.strand: place},
            clamp_offset=carriers.clamp_offset,
            friction=carriers.friction,
            bodies=kind.bodies,
            payload=payload,
        )

    @property
    def dim(self) -> int:
        """How many dimensions it has: 2 in a plane, 3 in space."""
        cables = self.ropes.values() or [self.cable]
        places = [place for cable in cables for place in (cable.start.position, cable.end.position)]
        places += [tower.position for tower in self.towers.values()]
        return self.space or max(map(len, places))

    def vector(self, given: tuple[float, ...]) -> tuple[float, ...]:
        """The vector x, z or x, y, z with as many numbers as there are dimensions; y is 0 where it is not given."""
        return in_space(given) if self.dim == 3 else given[:: len(given) - 1]

    @property
    def loop_length(self) -> float:
        """Unstrained length (m) of the loop of a moving cable; without carriers, there and back."""
        if (where := self._strand or self._rides) is not None:
            return where.loop_length
        for strand in self.strands.values():
            return strand.loop_length
        if self.carriers is None or self.carriers.spacing is None:
            return 2.0 * self.cable.unstrained_length
        return self.carriers.count * self.carriers.spacing

    @property
    def spacing(self) -> float:
        """Unstrained distance (m) of one carrier to the next; 0 without carriers."""
        if self.carriers is None:
            return 0.0
        return self.carriers.spacing or self.loop_length / self.carriers.count

    def resolved(self) -> dict[str, Any]:
        """The whole scenario with its defaults as plain data for JSON or YAML; `load_scenario` reads it back."""
        return self.model_dump(mode="json", exclude={"cable"} if self.ropes else None)

    def to_yaml(self) -> str:
        """The whole scenario with its defaults as YAML text, readable as YAML 1.1 and 1.2 alike."""
        return as_yaml(self.resolved())
