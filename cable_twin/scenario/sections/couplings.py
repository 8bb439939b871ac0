"""Couplings between ropes, connectors and pantographs, in a scenario file."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field, create_model

from cable_twin.scenario.sections.quantities import FromList, Section, quantity

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


# `from` is a key of the file, and no name that a class can be written with
Connector: Any = create_model(
    "Connector",
    __base__=_Rod,
    __doc__=_Rod.__doc__,
    **{
        "from": (PlaceOnRope, _end("its upper end: a rope and the unstrained arc length there")),
        "to": (PlaceOnRope, _end("its lower end: the same of another rope")),
        "length": (float, quantity("m", "unstrained length", gt=0)),
        "stiffness": (float, quantity("N/m", "stiffness when it is longer than that", gt=0)),
        "compression": (float, quantity("N/m", "stiffness when it is shorter", 0.0, ge=0)),
        "damping": (float, quantity("N s/m", "damping while it is longer", 0.0, ge=0)),
    },  # type: ignore[call-overload]
)


class Stage(Section):
    """Mass of a pantograph stage, and the spring below it."""

    mass: float = quantity("kg", "mass of the stage; its weight is balanced", gt=0)
    stiffness: float = quantity("N/m", "stiffness of the spring below it", gt=0)
    damping: float = quantity("N s/m", "damping of that", 0.0, ge=0)


class Pantograph(Section):
    """Pantograph: masses on springs, pushed against a rope from below and moved along the track at a given speed."""

    rope: str = Field(description="the rope that it pushes")
    position: float = quantity("m", "place along the track, x, at the start of the run")
    speed: float = quantity("m/s", "its speed along the track from the start on", 0.0)
    height: float = quantity("m", "height of the head, z, at which the force is `uplift_force`", 0.0)
    uplift_force: float = quantity("N", "force on the rope at rest at that height", gt=0)
    contact_stiffness: float = quantity("N/m", "stiffness of head and rope, which only push", 50e3, gt=0)
    stages: Annotated[tuple[Stage, ...], FromList] = Field(
        description="its masses from the head down; the last spring stands on the vehicle", min_length=1
    )
