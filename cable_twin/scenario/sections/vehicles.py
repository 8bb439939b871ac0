"""Vehicles in a scenario file: `carriages` with bodies, payload, friction, end stops and buffers, and `carriers`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag

from cable_twin.scenario.sections.couplings import Strand
from cable_twin.scenario.sections.drives import Drive
from cable_twin.scenario.sections.quantities import FromList, Place, Section, Tensor, Vector, quantity


def _shape(area: Any) -> str:
    return "#axes" if isinstance(area, list | tuple) else "#number"


Area = Annotated[float, Field(ge=0, le=1000)]
Areas = Annotated[
    Annotated[Area, Tag("#number")] | Annotated[tuple[Area, Area, Area], FromList, Tag("#axes")],
    Discriminator(_shape),
]


# the tags stand in the places that pydantic reports


class Friction(Section):
    """Friction of a carriage along the cable."""

    rolling: float = quantity("-", "resistance per normal contact force", 0.0, ge=0, le=1)
    viscous: float = quantity("N s/m", "resistance per speed", 0.0, ge=0)


class EndStop(Section):
    """Elastic buffer at both ends of the cable; defaults follow from mass and speed limit of the carriage."""

    stroke: float | None = quantity("m", "length of the buffer; null: 0.5 % of the cable length", None, gt=0)
    stiffness: float | None = quantity(
        "N/m",
        "stiffness of the buffer; null: it stops the vehicle from its speed limit within 60 % of the stroke",
        None,
        gt=0,
    )
    damping: float | None = quantity(
        "s/m",
        "damping: force = stiffness d (1 + damping d_dot), d compression; null: 0.5 over the speed limit",
        None,
        ge=0,
    )


class VehicleBuffer(Section):
    """Elastic buffer against other vehicles on the rope; defaults follow from mass and speed limit."""

    stiffness: float | None = quantity(
        "N/m",
        "stiffness of the own buffer, in series with that of the other vehicle; null: at the speed limit it is "
        "compressed by 0.2 m, assumed, and by a quarter of the vehicle length at most",
        None,
        gt=0,
    )
    damping: float | None = quantity(
        "s/m",
        "damping: force = stiffness d (1 + damping d_dot), d compression; null: 0.5 over the speed limit",
        None,
        ge=0,
    )


class Shedding(Section):
    """Vortex shedding of a body: lateral force at the frequency v strouhal / width in a wind v."""

    width: float = quantity("m", "width of the body across the wind", gt=0)
    area: float = quantity("m^2", "reference area of the lateral force, width times height", gt=0)
    strouhal: float = quantity(
        "-", "Strouhal number; EN 1991-1-4, table E.1: 0.12 for a square, 0.18 round", 0.12, gt=0
    )
    force_coefficient: float = quantity(
        "-", "lateral force coefficient; EN 1991-1-4, table E.2: 1.1 if edged", 1.1, ge=0
    )


def _not_negative(size: tuple[float, float]) -> tuple[float, float]:
    if min(size) < 0.0:
        raise ValueError("it is below 0")
    return size


Size = Annotated[Vector, AfterValidator(_not_negative)]


class Body(Section):
    """Rigid body of a carriage; pivots are given from its centre of mass, in its own axes x, z."""

    mass: float = quantity("kg", "mass of the body", gt=0)
    inertia: float = quantity("kg m^2", "moment of inertia about the centre of mass, about y", gt=0)
    inertia_tensor: Tensor | None = quantity(
        "kg m^2",
        "in space, moments of inertia about x, y, z, then products xy, xz, yz if any; null: `inertia` about each axis",
        None,
    )
    upper_pivot: Place = quantity("m", "position of the upper pin")
    lower_pivot: Place | None = quantity("m", "position of the pin of the next body; not needed for the last one", None)
    damping: float = quantity(
        "N m s/rad", "rotational damping against the body above, of the first body against the cable", 0.0, ge=0
    )
    stiffness: float = quantity(
        "N m/rad", "rotational stiffness beside the damper, unloaded when both are in line", 0.0, ge=0
    )
    turns: Literal["revolute", "universal"] = Field(
        default="revolute", description="in space, joint to the body above: rotation in pitch, or in pitch and roll"
    )
    roll_damping: float = quantity(
        "N m s/rad", "in space, damping of the roll against the body above, or the cable", 0.0, ge=0
    )
    size: Size | None = Field(
        default=None,
        description="width and height around the centre of mass; null: from pivots, inertia (m)",
        json_schema_extra={"unit": "m", "allowed": "a list of 2 finite numbers at least 0, in m, or null"},
    )
    drag_area: Areas = Field(
        default=0.0,
        description="drag coefficient times area: of any direction, or of wind along x, y, z of the body (m^2)",
        json_schema_extra={
            "unit": "m^2",
            "allowed": "a finite number at least 0 and at most 1000, or a list of 3, along x, y, z, in m^2",
        },
    )
    shedding: Shedding | None = Field(default=None, description="in space, vortex shedding; null: none")

    @property
    def drag_areas(self) -> tuple[float, float, float]:
        """Drag areas (3,) in m² against wind along the axes of the body."""
        return self.drag_area if isinstance(self.drag_area, tuple) else (self.drag_area,) * 3


class Payload(Section):
    """Payload of a carriage; changed only while the carriage stands in a station."""

    capacity: float = quantity("kg", "largest payload", gt=0)
    mass: float = quantity("kg", "payload at the start of the run", 0.0, ge=0)
    body: str | None = Field(default=None, description="body with the payload; by default the last one")
    position: Place = quantity(
        "m", "position of the payload from the centre of mass of the empty body, in the axes of the body", (0.0, 0.0)
    )
    station_distance: float | None = quantity(
        "m",
        "distance from an end of the cable within which the station is; null: twice the stroke of the end stop",
        None,
        gt=0,
    )
    loading_time: float = quantity("s", "time for a change by the whole capacity; 0: at once, a shock", 0.0, ge=0)
    station_speed: float = quantity("m/s", "speed below which the vehicle counts as standing", 0.05, gt=0)


class Carriage(Section):
    """Chain of rigid bodies: the first hangs from the cable, each other one from the body before."""

    rope: str | None = Field(default=None, description="rope of the carriage; null: the first one")
    arc_length: float = quantity("m", "initial unstrained arc length of the joint")
    speed: float = quantity("m/s", "initial speed along the cable, kept until a command by a drive of mode speed", 0.0)
    joint: Literal["sliding", "fixed", "clamped"] = Field(
        default="sliding", description="joint to the cable: sliding along it, fixed, or clamped to a cable that moves"
    )
    drive: Drive = Field(default_factory=Drive, description="drive and brakes")
    clamped_to: dict[str, float] = Field(
        default_factory=dict,
        description="second rope to which the carriage is clamped, and the unstrained arc length there (m); of "
        "strands that follow each other, those beside the present one have an arc length beyond their ends",
        json_schema_extra={"unit": "m", "allowed": "a mapping of names of ropes to finite numbers"},
    )
    clamp_offset: Place = quantity(
        "m", "vector from the joint to this clamp as x, z, in space x, y, z; forces act at the joint", (0.0, 0.0)
    )
    friction: Friction = Field(default_factory=Friction, description="friction along the cable")
    end_stop: EndStop = Field(default_factory=EndStop, description="end stops at both ends of the cable")
    buffers: VehicleBuffer = Field(default_factory=VehicleBuffer, description="buffer against other vehicles")
    bodies: dict[str, Body] = Field(description="bodies by name, from the cable downwards", min_length=1)
    payload: Payload | None = Field(default=None, description="payload; null: none")

    @property
    def is_point(self) -> bool:
        """Whether all bodies have a width of 0, so that another such vehicle may pass."""
        return all(body.size is not None and body.size[0] == 0.0 for body in self.bodies.values())


class CarrierPayload(Section):
    """Payload of each carrier, changed in the stations: full up, empty down."""

    capacity: float = quantity("kg", "largest payload", gt=0)
    from_start: float | None = quantity(
        "kg", "payload of a carrier that enters the cable at its start; null: 0, or by `leaving`", None, ge=0
    )
    from_end: float | None = quantity(
        "kg", "payload of a carrier that enters the cable at its end; null: 0, or by `leaving`", None, ge=0
    )
    leaving: dict[str, Annotated[float, Field(ge=0)]] = Field(
        default_factory=dict,
        description="payload of a carrier after a bullwheel, by its name, instead of from_start and from_end (kg)",
        json_schema_extra={
            "unit": "kg",
            "allowed": "a mapping of names of sheaves to finite numbers at least 0, in kg",
        },
    )
    on_cable: float | None = quantity(
        "kg", "payload of carriers that are on the cable at the start of the run; null: from_start", None, ge=0
    )
    body: str | None = Field(default=None, description="body with the payload; by default the last one")
    position: Vector = quantity(
        "m", "position of the payload from the centre of mass of the empty body, in the axes of the body", (0.0, 0.0)
    )

    def entering(self, *, at_start: bool) -> float:
        """Payload (kg) of a carrier that enters the cable at its start, or at its end."""
        return (self.from_start if at_start else self.from_end) or 0.0


class CarrierKind(Section):
    """One kind of carrier among several."""

    bodies: dict[str, Body] = Field(description="bodies by name, from the cable downwards", min_length=1)
    payload: CarrierPayload | None = Field(default=None, description="payload; null: none")


class Carriers(Section):
    """Carriages of one kind or a few, clamped to a moving cable at equal distances round its loop: NAME_1, NAME_2."""

    name: str = Field(default="carrier", description="name of the carriers, followed by a number for each")
    count: int = quantity("-", "number of carriers on the loop", ge=1, le=10_000)
    spacing: float | None = quantity(
        "m",
        "unstrained distance of neighbours. One cable: its loop is count times as long; bullwheels: null, even round "
        "the loop",
        None,
        gt=0,
    )
    first: float | None = quantity("m", "position of the first carrier on the loop; null: half the spacing", None, ge=0)
    tracks: dict[str, str] = Field(
        default_factory=dict,
        description="track rope on which carriers slide, by the name of the strand to which they are clamped",
        json_schema_extra={"allowed": "a mapping of names of strands to names of ropes"},
    )
    friction: Friction = Field(default_factory=Friction, description="friction of each carrier on its track rope")
    clamp_offset: Place = quantity(
        "m", "vector from the joint on a track to the clamp as x, z, in space x, y, z", (0.0, 0.0)
    )
    station_rails: float = quantity(
        "m",
        "length at both ends of the cable, or of each strand, over which station rails hand the weight of a carrier "
        "with a detachable grip over to the rope; 0: none, as with fixed grips",
        0.0,
        ge=0,
    )
    bodies: dict[str, Body] = Field(
        default_factory=dict,
        description="bodies of each carrier by name, from the cable downwards, if all are of one kind",
    )
    payload: CarrierPayload | None = Field(default=None, description="payload of each carrier, if all are of one kind")
    kinds: dict[str, CarrierKind] = Field(
        default_factory=dict, description="several kinds by name, instead of bodies and payload"
    )
    order: Annotated[tuple[str, ...], FromList] = Field(
        default=(), description="kinds from the first carrier on, repeated round the loop; by default each kind once"
    )

    loaded: Annotated[tuple[int, ...] | None, FromList] = Field(
        default=None,
        description="numbers of the carriers that carry payloads, from 1 on; the others stay empty; null: all",
        json_schema_extra={"allowed": "a list of whole numbers, from 1 to count", "unit": "-"},
    )

    def on_strand(self, strand: Strand) -> Carriers:
        """Copy of the carriers for one strand of a loop, with the payloads of those arriving at either end of it."""
        kinds = {
            name: kind.model_copy(update={"payload": _on(strand, kind.payload)}) for name, kind in self.kinds.items()
        }
        return self.model_copy(update={"payload": _on(strand, self.payload), "kinds": kinds})

    @property
    def kinds_by_path(self) -> dict[tuple[str, ...], CarrierKind]:
        """Bodies and payload of all carriers, or of each kind, by their key path in a file."""
        own = CarrierKind.model_construct(bodies=self.bodies, payload=self.payload)
        return {("carriers",): own} | {("carriers", "kinds", name): kind for name, kind in self.kinds.items()}

    def carries(self, number: int) -> bool:
        """Whether the carrier with an index from 0 on carries payloads."""
        return self.loaded is None or number + 1 in self.loaded

    def kind(self, number: int) -> CarrierKind:
        """Kind (bodies and payload) of the carrier with an index from 0 on."""
        if not self.kinds:
            return CarrierKind.model_construct(bodies=self.bodies, payload=self.payload)
        order = self.order or tuple(self.kinds)
        return self.kinds[order[number % len(order)]]


def _on(strand: Strand, payload: CarrierPayload | None) -> CarrierPayload | None:
    if payload is None or not payload.leaving:
        return payload
    masses = {"from_start": payload.leaving.get(strand.before, 0.0), "from_end": payload.leaving.get(strand.after, 0.0)}
    return payload.model_copy(update=masses)
