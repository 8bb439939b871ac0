"""Vehicles in a scenario file: `carriages` with bodies, payload, friction, end stops and buffers, and `carriers`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from cable_twin.scenario.sections.couplings import Strand
from cable_twin.scenario.sections.drives import Drive
from cable_twin.scenario.sections.quantities import FromList, Place, Section, Tensor, Vector, quantity


def _shape(area: Any) -> str:
    return "#axes" if isinstance(area, list | tuple) else "#number"


Area = Annotated[float, Field(ge=0)]
Areas = Annotated[
    Annotated[Area, Tag("#number")] | Annotated[tuple[Area, Area, Area], FromList, Tag("#axes")],
    Discriminator(_shape),
]


# the tags stand in the places that pydantic reports


class Friction(Section):
    """Friction of a carriage along the cable."""

    rolling: float = quantity("-", "resistance per normal contact force", 0.0, ge=0)
    viscous: float = quantity("N s/m", "resistance per speed", 0.0, ge=0)


class EndStop(Section):
    """Elastic buffer at both ends of the cable; defaults follow from mass and speed limit of the carriage."""

    stroke: float | None = quantity("m", "length of the buffer; null: 0.5 % of the cable", None, gt=0)
    stiffness: float | None = quantity(
        "N/m", "stiffness of the buffer; null: it stops the speed limit within 60 %", None, gt=0
    )
    damping: float | None = quantity(
        "s/m", "damping: force = stiffness d (1 + damping d_dot); null: 0.5 over the speed limit", None, ge=0
    )


class VehicleBuffer(Section):
    """Elastic buffer against other vehicles on the rope; defaults follow from mass and speed limit."""

    stiffness: float | None = quantity(
        "N/m",
        "stiffness of its own buffer, in series with that of the other vehicle; null: at the speed limit it gives way "
        "by 0.2 m, assumed, and by a quarter of its length at most",
        None,
        gt=0,
    )
    damping: float | None = quantity(
        "s/m", "damping: force = stiffness d (1 + damping d_dot); null: 0.5 over the speed limit", None, ge=0
    )


class Shedding(Section):
    """Vortex shedding of a body: v strouhal / width eddies a second, left and right, push it across the wind v."""

    width: float = quantity("m", "width of the body across the wind", gt=0)
    area: float = quantity("m^2", "area to which the side force refers, width times height", gt=0)
    strouhal: float = quantity(
        "-", "Strouhal number; EN 1991-1-4, table E.1: 0.12 for a square, 0.18 round", 0.12, gt=0
    )
    force_coefficient: float = quantity(
        "-", "lateral force coefficient; EN 1991-1-4, table E.2: 1.1 if edged", 1.1, ge=0
    )


class Body(Section):
    """Rigid body of a carriage; pivots are given from its centre of mass, in its own axes x, z."""

    mass: float = quantity("kg", "mass of the body", gt=0)
    inertia: float = quantity("kg m^2", "moment of inertia about the centre of mass, about y", gt=0)
    inertia_tensor: Tensor | None = quantity(
        "kg m^2", "in space, the same about x, y, z, and xy, xz, yz of the tensor if any; null: as about y", None
    )
    upper_pivot: Place = quantity("m", "place of the pin from which it hangs")
    lower_pivot: Place | None = quantity("m", "place of the pin of the next body; not needed for the last one", None)
    damping: float = quantity(
        "N m s/rad", "of a damper of its turning against the body above, or of the first against the cable", 0.0, ge=0
    )
    stiffness: float = quantity("N m/rad", "of a spring beside it, at rest when both are in line", 0.0, ge=0)
    turns: Literal["revolute", "universal"] = Field(
        default="revolute", description="in space, whether it turns against the body above in pitch, or in roll as well"
    )
    roll_damping: float = quantity("N m s/rad", "in space, of a damper of its roll against what is above", 0.0, ge=0)
    size: Vector | None = quantity("m", "width and height around the centre of mass; null: from pivots, inertia", None)
    drag_area: Areas = Field(
        default=0.0,
        description="drag coefficient times area: of any side, or against wind along its own x, y, z (m^2)",
        json_schema_extra={
            "unit": "m^2",
            "allowed": "a finite number at least 0, or a list of 3, along x, y, z, in m^2",
        },
    )
    shedding: Shedding | None = Field(default=None, description="in space, eddies that it sheds; null for none")

    @property
    def drag_areas(self) -> tuple[float, float, float]:
        """Drag areas (3,) in m² against wind along the axes of the body."""
        return self.drag_area if isinstance(self.drag_area, tuple) else (self.drag_area,) * 3


class Payload(Section):
    """Payload of a carriage; changed only while the carriage stands in a station."""

    capacity: float = quantity("kg", "most that it can carry", gt=0)
    mass: float = quantity("kg", "what it carries at the start of the run", 0.0, ge=0)
    body: str | None = Field(default=None, description="body that carries it; by default the last one")
    position: Place = quantity(
        "m", "place of the load, from the centre of mass of the empty body, in its axes", (0.0, 0.0)
    )
    station_distance: float | None = quantity(
        "m", "how near an end of the cable the station is; null for two lengths of its end stop", None, gt=0
    )
    loading_time: float = quantity(
        "s", "time in which as much as the capacity gets in or out; 0: at once, a shock", 0.0, ge=0
    )
    station_speed: float = quantity("m/s", "below what speed it counts as standing", 0.05, gt=0)


class Carriage(Section):
    """Chain of rigid bodies: the first hangs from the cable, each other one from the body before."""

    rope: str | None = Field(default=None, description="the rope on which it is; null: the first one")
    arc_length: float = quantity("m", "unstrained arc length of its joint at the start of the run")
    speed: float = quantity(
        "m/s", "speed along the cable at the start of the run, which a drive of mode speed keeps until a command", 0.0
    )
    joint: Literal["sliding", "fixed", "clamped"] = Field(
        default="sliding", description="whether the joint can move along the cable, or goes with one that moves"
    )
    drive: Drive = Field(default_factory=Drive, description="what moves it")
    clamped_to: dict[str, float] = Field(
        default_factory=dict,
        description="the rope to which it is clamped as well, and the unstrained arc length there (m); of several, in "
        "which one after the other goes on, those on which it is not yet have a place beyond their ends",
        json_schema_extra={"unit": "m", "allowed": "a mapping of names of ropes to finite numbers"},
    )
    clamp_offset: Place = quantity(
        "m", "way from its joint to that clamp as x, z, in space x, y, z; forces act at the joint", (0.0, 0.0)
    )
    friction: Friction = Field(default_factory=Friction, description="what resists it")
    end_stop: EndStop = Field(default_factory=EndStop, description="what catches it at the ends of the cable")
    buffers: VehicleBuffer = Field(
        default_factory=VehicleBuffer, description="what it and another vehicle that it meets push each other with"
    )
    bodies: dict[str, Body] = Field(description="its bodies by name, from the cable downwards", min_length=1)
    payload: Payload | None = Field(default=None, description="what it can carry")


class CarrierPayload(Section):
    """Payload of each carrier, changed in the stations: full up, empty down."""

    capacity: float = quantity("kg", "most that it can carry", gt=0)
    from_start: float = quantity("kg", "what one carries that comes onto the cable at its start", 0.0, ge=0)
    from_end: float = quantity("kg", "what one carries that comes onto the cable at its end", 0.0, ge=0)
    leaving: dict[str, Annotated[float, Field(ge=0)]] = Field(
        default_factory=dict,
        description="what one carries that leaves a bullwheel, by its name, instead of both (kg)",
        json_schema_extra={
            "unit": "kg",
            "allowed": "a mapping of names of sheaves to finite numbers at least 0, in kg",
        },
    )
    on_cable: float | None = quantity(
        "kg", "what those carry that are on the cable at the start of the run; null: as from_start", None, ge=0
    )
    body: str | None = Field(default=None, description="body that carries it; by default the last one")
    position: Vector = quantity(
        "m", "place of the load, from the centre of mass of the empty body, in its axes", (0.0, 0.0)
    )


class CarrierKind(Section):
    """One kind of carrier among several."""

    bodies: dict[str, Body] = Field(description="its bodies by name, from the cable downwards", min_length=1)
    payload: CarrierPayload | None = Field(default=None, description="what it can carry")


class Carriers(Section):
    """Carriages of one kind or a few, clamped to a moving cable at equal distances round its loop: NAME_1, NAME_2."""

    name: str = Field(default="carrier", description="what they are called, before their number")
    count: int = quantity("-", "how many there are on the loop", ge=1, le=10_000)
    spacing: float | None = quantity(
        "m",
        "unstrained distance of one to the next. One cable: its loop is count times as long; "
        "bullwheels: null, even round the loop",
        None,
        gt=0,
    )
    first: float | None = quantity("m", "place of the first on the loop, half the spacing where null", None, ge=0)
    tracks: dict[str, str] = Field(
        default_factory=dict,
        description="the track rope on which each slides beside a strand of the loop, by the name of the strand; "
        "then they are carriages that are clamped to it",
        json_schema_extra={"allowed": "a mapping of names of strands to names of ropes"},
    )
    friction: Friction = Field(default_factory=Friction, description="what resists each on its track")
    clamp_offset: Place = quantity(
        "m", "way from its joint on a track to its clamp as x, z, in space x, y, z", (0.0, 0.0)
    )
    bodies: dict[str, Body] = Field(
        default_factory=dict, description="bodies of each by name, from the cable downwards; where all are of one kind"
    )
    payload: CarrierPayload | None = Field(default=None, description="what each can carry, where all are of one kind")
    kinds: dict[str, CarrierKind] = Field(
        default_factory=dict, description="kinds by name, where they are several, instead of bodies and payload"
    )
    order: Annotated[tuple[str, ...], FromList] = Field(
        default=(), description="kinds from the first carrier on, over and over again; by default each once"
    )

    def on_strand(self, strand: Strand) -> Carriers:
        """Copy for one strand of a loop, with the payloads of carriers arriving at either end of the strand."""
        kinds = {
            name: kind.model_copy(update={"payload": _on(strand, kind.payload)}) for name, kind in self.kinds.items()
        }
        return self.model_copy(update={"payload": _on(strand, self.payload), "kinds": kinds})

    @property
    def kinds_by_path(self) -> dict[tuple[str, ...], CarrierKind]:
        """Bodies and payload of all carriers, or of each kind, by the key path that has them in a file."""
        own = CarrierKind.model_construct(bodies=self.bodies, payload=self.payload)
        return {("carriers",): own} | {("carriers", "kinds", name): kind for name, kind in self.kinds.items()}

    def kind(self, number: int) -> CarrierKind:
        """Kind of the carrier with an index from 0 on."""
        if not self.kinds:
            return CarrierKind.model_construct(bodies=self.bodies, payload=self.payload)
        order = self.order or tuple(self.kinds)
        return self.kinds[order[number % len(order)]]


def _on(strand: Strand, payload: CarrierPayload | None) -> CarrierPayload | None:
    if payload is None or not payload.leaving:
        return payload
    masses = {"from_start": payload.leaving.get(strand.before, 0.0), "from_end": payload.leaving.get(strand.after, 0.0)}
    return payload.model_copy(update=masses)
