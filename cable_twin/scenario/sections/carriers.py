"""Carriers, of one kind or several, clamped to a rope all round its loop: section `carriers` of a scenario file."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cable_twin.scenario.sections.bullwheels import Strand
from cable_twin.scenario.sections.quantities import FromList, Place, Section, Vector, quantity
from cable_twin.scenario.sections.vehicles import Body, Friction


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
