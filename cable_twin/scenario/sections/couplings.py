"""Couplings between ropes in a scenario file: bullwheels (`sheaves`), `connectors` and `pantographs`."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Annotated, Any, NamedTuple

from pydantic import Field, create_model

from cable_twin.scenario.sections.drives import Brake
from cable_twin.scenario.sections.quantities import FromList, Place, Section, Vector, quantity

EDGE = 0.005  # share of a strand, at both ends, where a vehicle starts in a station
Joined = Annotated[tuple[str, str], FromList]


class SheaveCounterweight(Section):
    """Counterweight: pulls the carriage of a bullwheel, and with it both strands, with a constant force."""

    direction: Place = quantity("-", "direction of the pull, any length")
    mass: float = quantity("kg", "mass of the counterweight, of both strands together", gt=0)
    force: float | None = quantity("N", "pull on the carriage; null: the weight of the mass", None, gt=0)
    carriage_mass: float = quantity("kg", "mass of the bullwheel and its carriage", 0.0, ge=0)
    travel: Vector = quantity("m", "least and most travel of the carriage along the pull", (-5.0, 5.0))
    buffer_damping: float = quantity(
        "s/m",
        "damping of the buffers at both limits: force = stiffness d (1 + damping d_dot), d compression",
        1.0,
        ge=0,
    )


class SheaveHydraulics(Section):
    """Hydraulic cylinder: moves the carriage of a bullwheel when the pull of both strands leaves a band."""

    direction: Place = quantity("-", "direction of the pull, any length")
    force: float = quantity("N", "set-point of the pull of both strands together", gt=0)
    band: float = quantity("N", "deviation of the pull at which it moves", gt=0)
    rate: float = quantity("m/s", "speed of the cylinder", 0.01, gt=0)
    travel: Vector = quantity("m", "least and most travel of the carriage along the pull", (-5.0, 5.0))
    locked: bool = Field(
        default=False, description="true: it holds the carriage at its initial position, as after a failure"
    )


class Sheave(Section):
    """Bullwheel: turns the rope from the end of one strand to the start of another one."""

    position: Place | None = quantity("m", "centre of the bullwheel; null: midway between the joined ends", None)
    radius: float = quantity("m", "radius at the rope", gt=0, le=50)
    joins: Joined = Field(
        description="joined ends: the end of one rope and the start of another, [up.end, down.start]",
        json_schema_extra={"allowed": "a list of two texts, ROPE.end and ROPE.start"},
    )
    wrap: float = quantity("rad", "wrap angle of the rope", pi, gt=0, le=20)
    friction: float = quantity("-", "friction of the rope on its lining", 0.22, gt=0, le=2)
    inertia: float = quantity("kg m^2", "moment of inertia about its axis, with all rotating parts", gt=0)
    resistance: float = quantity("N m", "friction torque of the bearings", 0.0, ge=0)
    counterweight: SheaveCounterweight | None = Field(default=None, description="weight that tensions the loop")
    hydraulics: SheaveHydraulics | None = Field(default=None, description="cylinder that tensions the loop")
    brake: Brake | None = Field(
        default=None, description="brake that an emergency stop applies instead of the drive, with its force at the rim"
    )

    rollback: float | None = quantity(
        "m",
        "rollback after which an emergency stop begins: travel of the rim against the last direction of its drive "
        "while no drive holds its speed; null: none",
        None,
        gt=0,
    )

    @property
    def ropes(self) -> tuple[str, str]:
        """Names of the strand that runs onto the bullwheel, and of the one that runs off it."""
        before, after = (end.partition(".")[0] for end in self.joins)
        return before, after

    @property
    def wrapped(self) -> float:
        """Length (m) of rope on the bullwheel."""
        return self.radius * self.wrap

    @property
    def tensioning(self) -> SheaveCounterweight | SheaveHydraulics | None:
        """Tensioning device of the bullwheel; None for a fixed one."""
        return self.counterweight or self.hydraulics


class Strand(NamedTuple):
    """Position of a strand on its loop, and the bullwheels at its ends."""

    loop_length: float  # m, unstrained
    offset: float  # m, position of its start on the loop
    before: str  # bullwheel at its start
    after: str  # bullwheel at its end


class Riding(NamedTuple):
    """Track rope of carriers: the strand that they are clamped to, and position of the strand on its loop."""

    strand: str  # of their clamps
    length: float  # m, of the strand, unstrained
    loop_length: float  # m, unstrained
    offset: float  # m, position of the start of the strand on the loop

    def on_track(self, place: float) -> bool:
        """Return whether a vehicle at a `place` (m) of the strand is on the track, not in a station."""
        return EDGE < place / self.length < 1.0 - EDGE


def strands_of(lengths: Mapping[str, float], sheaves: Mapping[str, Sheave]) -> dict[str, Strand]:
    """Strands of each closed loop, in order along the loop.

    Args:
        lengths: unstrained length (m) of each rope by name.
        sheaves: bullwheels by name.
    """
    onto = {sheave.joins[0]: name for name, sheave in sheaves.items()}
    found: dict[str, Strand] = {}
    for first in lengths:
        loop: list[tuple[str, float, str]] = []
        rope, place = first, 0.0
        while rope not in found and f"{rope}.end" in onto and rope not in [name for name, _, _ in loop]:
            if rope not in lengths:
                break  # a fault of its own
            sheave = onto[f"{rope}.end"]
            loop.append((rope, place, sheave))
            place += lengths[rope] + sheaves[sheave].wrapped
            rope = sheaves[sheave].ropes[1]
        if loop and rope == first:
            befores = [loop[-1][2], *(sheave for _, _, sheave in loop)]
            for (name, offset, after), before in zip(loop, befores, strict=False):
                found[name] = Strand(place, offset, before, after)
    return found


PlaceOnRope = Annotated[tuple[str, float], FromList]


class _Rod(Section):
    """Massless rod between two ropes, such as a dropper: takes tension, and compression by a given stiffness only."""

    @property
    def ends(self) -> tuple[tuple[str, float], tuple[str, float]]:
        """Rope and unstrained arc length (m) of both ends."""
        return getattr(self, "from"), getattr(self, "to")  # noqa: B009 - neither is a name of this class


def _end(description: str) -> Any:
    allowed = "a list of the name of a rope and a number, the arc length"
    return Field(description=f"{description} (m)", json_schema_extra={"unit": "m", "allowed": allowed})


# a class cannot be written with the key `from`
Connector: Any = create_model(
    "Connector",
    __base__=_Rod,
    __doc__=_Rod.__doc__,
    **{
        "from": (PlaceOnRope, _end("upper end: rope and unstrained arc length")),
        "to": (PlaceOnRope, _end("lower end: another rope and its unstrained arc length")),
        "length": (float, quantity("m", "unstrained length", gt=0)),
        "stiffness": (float, quantity("N/m", "stiffness in tension", gt=0)),
        "compression": (float, quantity("N/m", "stiffness in compression", 0.0, ge=0)),
        "damping": (float, quantity("N s/m", "damping in tension", 0.0, ge=0)),
        "rolls": (
            bool,
            Field(
                default=False,
                description="whether the lower end is a roller, as of a slack carrier: it is where its rope is nearest "
                "to the upper end, and carries it without friction; false: both ends are fixed to their ropes",
            ),
        ),
    },  # type: ignore[call-overload]
)


class Stage(Section):
    """Mass of a pantograph stage, and the spring below it."""

    mass: float = quantity("kg", "mass of the stage; its weight is balanced", gt=0)
    stiffness: float = quantity("N/m", "stiffness of the spring below it", gt=0)
    damping: float = quantity("N s/m", "damping beside the spring", 0.0, ge=0)


class Pantograph(Section):
    """Pantograph: masses on springs, pushed against a rope from below and moved along the track at a given speed."""

    rope: str = Field(description="rope above the pantograph")
    position: float = quantity("m", "initial position along the track, x")
    speed: float = quantity("m/s", "speed along the track", 0.0)
    height: float = quantity("m", "height of the head, z, at which the force at rest is `uplift_force`", 0.0)
    uplift_force: float = quantity("N", "force on the rope at rest at that height", gt=0)
    contact_stiffness: float = quantity("N/m", "stiffness of the one-sided contact of head and rope", 50e3, gt=0)
    stages: Annotated[tuple[Stage, ...], FromList] = Field(
        description="masses from the head down; the last spring stands on the vehicle", min_length=1
    )
