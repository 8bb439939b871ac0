"""Line in a scenario file: `cable` and `ropes` with supports, loads and mesh, `towers`, terrain beside the track."""

from __future__ import annotations

import warnings
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from cable_twin.mechanics.parameters import COLDEST, ELASTIC_MODELS, HOTTEST
from cable_twin.scenario.sections.quantities import FromList, Place, Section, Vector, quantity, strength


class EndSupport(Section):
    """Support of one end of the cable."""

    position: Place = quantity(
        "m", "position as x, z, in space x, y, z; of a free end only the direction in which the cable starts"
    )
    support: Literal["pinned", "clamped", "free", "hydraulic", "counterweight"] = Field(
        default="pinned",
        description="kind of support; a hydraulic tensioning device keeps its length, as a pin does",
    )
    direction: Place | None = quantity(
        "-",
        "direction of any length: of the cable in a clamp, towards its end, or of the pull of a counterweight",
        None,
    )
    mass: float | None = quantity("kg", "mass of a counterweight", None, gt=0)
    force: float | None = quantity("N", "pull of a counterweight; null: its weight", None, gt=0)
    travel: Vector | None = quantity("m", "least and most travel of a counterweight from `position`", None)
    buffer_stiffness: float | None = quantity(
        "N/m",
        "stiffness of the buffers at both limits of the travel; null: compressed by 5 cm under the pull",
        None,
        gt=0,
    )
    buffer_damping: float = quantity(
        "s/m", "damping of the buffers: force = stiffness d (1 + damping d_dot), d compression", 1.0, ge=0
    )


MOST_ELEMENTS = 100_000
MOST_CONTACTS = 1000
ElasticModel: Any = Literal[ELASTIC_MODELS]  # type: ignore[valid-type]  # those of the mechanics


class Load(Section):
    """Constant load at a point of the cable, whose bend there is rounded over an element."""

    arc_length: float = quantity("m", "unstrained arc length from the start", ge=0)
    force: Place = quantity("N", "force on the cable as x, z, in space as x, y, z", (0.0, 0.0))
    moment: float = quantity("N m", "moment on an end of the cable, right-handed about y", 0.0)


KINKS = ("rounded", "sharp")  # of the former key `kinks` of a rope


def warn_of_kinks() -> None:
    """Warn that the former key `kinks` of a rope does nothing."""
    text = "cable.kinks is read no more: the rope has a bend at each vehicle with joint: node, the default"
    warnings.warn(text, stacklevel=2)


class Grading(Section):
    """Graded mesh: short elements at towers, loads and ends only."""

    target: float = quantity("m", "length of an element far from towers, loads and ends", gt=0)
    at_towers: float = quantity("m", "length of an element at towers, loads and ends", gt=0)
    growth: float = quantity("-", "ratio of the lengths of neighbours between these", 1.5, gt=1, le=4)


def _form(elements: Any) -> str:
    return "#graded" if isinstance(elements, dict | Grading) else "#number"


Elements = Annotated[
    Annotated[int, Field(ge=1, le=MOST_ELEMENTS), Tag("#number")] | Annotated[Grading, Tag("#graded")],
    Discriminator(_form),
]


class Cable(Section):
    """Rope of uniform properties, with its supports, loads and mesh."""

    unstrained_length: float = quantity("m", "length without tension", gt=0)
    mass_per_length: float = quantity("kg/m", "mass per unstrained length", gt=0)
    axial_stiffness: float = quantity("N", "EA, Young's modulus times area of the steel", gt=0)
    breaking_force: float | None = strength("minimum")
    calculated_breaking_force: float | None = strength("calculated")
    tested_breaking_force: float | None = strength("tested")
    metal_area: float | None = quantity("m^2", "metallic cross-section of the rope, for rules", None, gt=0)
    largest_wire: float | None = quantity("m", "diameter of the thickest wire, for rules", None, gt=0, le=0.05)
    bending_stiffness: float = quantity("N m^2", "EI, resistance of the rope to bending", ge=0)
    elements: Elements = Field(
        description="number of elements of equal unstrained length (-), or lengths of a graded mesh",
        json_schema_extra={
            "unit": "-",
            "allowed": f"a whole number at least 1 and at most {MOST_ELEMENTS}, or a mapping of target, at_towers (m) "
            "and growth",
        },
    )
    elastic_model: ElasticModel = Field(
        default="continuum",
        description="strain energy on the arc itself, or in the frame of each element's chord, which needs at least "
        "four times the elements on slack ropes",
    )
    joint: Literal["paper", "node"] | None = Field(
        default=None,
        description="joint of a vehicle: at a place of an element, as in the paper, or at a node of the mesh that "
        "follows it, with a slope of the rope on either side; null: node, and paper beside element_frame, runge_kutta, "
        "connectors, pantographs, close carriers, points that may pass each other, a free end and a straight start",
    )
    damping_time: float = quantity("s", "Kelvin-Voigt relaxation time of EA and EI", 0.0, ge=0)
    mass_damping: float = quantity("1/s", "damping per mass, of one of several ropes", 0.0, ge=0)
    tension_damping: float = quantity(
        "s", "damping per geometric stiffness of the initial tension, of one of several ropes", 0.0, ge=0
    )
    initial_shape: Literal["equilibrium", "straight"] = Field(
        default="equilibrium", description="initial shape: static equilibrium, or unstrained from start towards end"
    )
    start: EndSupport = Field(description="support at arc length 0")
    end: EndSupport = Field(description="support at the end of the cable, its whole length from the start")
    loads: Annotated[tuple[Load, ...], FromList] = Field(default=(), description="constant loads on the cable")
    lateral: float = quantity(
        "m",
        "offset y to the left of the track, with towers and vehicles, of one of several ropes; in a plane for views "
        "only",
        0.0,
    )
    diameter: float | None = quantity("m", "diameter, for wind loads; null: no drag", None, gt=0)
    drag_coefficient: float = quantity("-", "drag coefficient across the cable", 1.2, ge=0, le=10)
    ice: float = quantity(
        "kg/m", "ice along the whole cable: weight, inertia and, with a diameter, drag", 0.0, ge=0, le=200
    )
    ice_density: float = quantity("kg/m^3", "density of the ice, for the diameter with it", 900.0, ge=10, le=1000)
    thermal_expansion: float = quantity(
        "1/K",
        "thermal strain per kelvin, by default rounded from 11.8e-6 of strand at 0 degC in Xie and Yan (2018), table 2",
        12e-6,
        ge=0,
        le=1e-3,
    )
    reference_temperature: float = quantity(
        "degC", "temperature at which the unstrained length was measured", 20.0, ge=COLDEST, le=HOTTEST
    )

    @model_validator(mode="before")
    @classmethod
    def _without_kinks(cls, data: Any) -> Any:
        """Remove the obsolete key `kinks` from the given data, with a warning that it has no effect."""
        if isinstance(data, dict) and data.get("kinks") in KINKS:
            warn_of_kinks()
            return {key: value for key, value in data.items() if key != "kinks"}
        return data

    def free_stretch(self, temperature: float) -> float:
        """Ratio of the tension-free length at a temperature (degC) to the unstrained length."""
        return 1.0 + self.thermal_expansion * (temperature - self.reference_temperature)

    @property
    def ends(self) -> dict[str, EndSupport]:
        """Supports of both ends by key: `start`, `end`."""
        return {"start": self.start, "end": self.end}

    @property
    def supports(self) -> set[str]:
        """Kinds of support of both ends."""
        return {self.start.support, self.end.support}


class Tower(Section):
    """Support of the cable between its ends: sheave assembly, or saddle of a track rope; one-sided contact."""

    rope: str | None = Field(default=None, description="rope on the tower; null: the first one")
    position: Place = quantity("m", "position of the rope at its middle, as x, z, in space as x, y, z")
    kind: Literal["sheaves", "saddle"] = Field(default="sheaves", description="sheave assembly or saddle")
    contacts: int = quantity(
        "-",
        "sheaves of the assembly, or contact points of the saddle, which stand for one surface and lie so close that "
        "vehicles do not feel them, about 0.2 m apart",
        1,
        ge=1,
        le=MOST_CONTACTS,
    )
    length: float = quantity("m", "length along the rope, from the first contact to the last", 0.0, ge=0)
    radius: float | None = quantity("m", "radius of the circle of the contacts; null: a straight line", None, gt=0)
    hold_down: bool = Field(default=False, description="true: it holds the rope down from above")
    stiffness: float = quantity("N/m", "stiffness of each contact, normal to the rope", 2e6, gt=0)
    damping: float = quantity(
        "s/m", "damping of each contact: force = stiffness d (1 + damping d_dot), d compression", 2.0, ge=0
    )
    groove: float = quantity(
        "1/m",
        "in space, lateral force over normal force, per offset of the rope from the middle of its groove",
        20.0,
        gt=0,
    )
    derailment_ratio: float = quantity(
        "-",
        "in space, lateral force over normal force of the tower at which the rope derails; assumed: flanks of 45 "
        "degrees and a friction of 0.3 hold up to 0.54 (Nadal)",
        0.5,
        gt=0,
    )
    groove_friction: float = quantity("-", "in space, lateral friction in the groove per normal force", 0.0, ge=0, le=2)
    groove_height: float = quantity(
        "m", "in space, height above all contacts at which the rope has left the tower; assumed", 0.05, gt=0
    )
    groove_direction: Place | None = quantity(
        "-",
        "in space, direction in which the grooves open, x, y, z of any length; null: upwards, of a hold-down downwards",
        None,
    )
    mast_offset: float | None = quantity(
        "m",
        "in space, offset of the middle of the mast from the rope, positive to the left of the track, also on a "
        "returning strand; null: no mast",
        None,
    )
    mast_width: float | None = quantity("m", "in space, width of the mast, which ends at the rope", None, gt=0)
    friction: float | None = quantity(
        "-", "friction along the rope per normal force; null: 0.03 for sheaves, 0.1 for a saddle", None, ge=0, le=2
    )


class TerrainSides(Section):
    """Terrain beside the track in space: linear from the profile on the track to one on each side, level beyond."""

    distance: float = quantity("m", "distance of both profiles from the track, y = 0", gt=0)
    left: Annotated[tuple[Vector, ...], FromList] = quantity("m", "ground on the left, points x, z", min_length=2)
    right: Annotated[tuple[Vector, ...], FromList] = quantity("m", "ground on the right, points x, z", min_length=2)
