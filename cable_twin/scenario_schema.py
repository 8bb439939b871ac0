"""What a scenario consists of: names, types, units, bounds and defaults of everything in a scenario file.

The models say what a value may be by itself. What values may not be together, and what this release cannot run yet,
is in `scenario_checks`; use `scenario.load_scenario`, which applies both.
"""

from __future__ import annotations

from io import StringIO
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field
from ruamel.yaml import YAML
from ruamel.yaml.representer import SafeRepresenter


class _Representer(SafeRepresenter):
    """Floats as every YAML reads them: 1e-06 is a text in YAML 1.1, 1.0e-06 is not."""

    def represent_float(self, value: float) -> Any:
        text = repr(value)
        return self.represent_scalar(
            "tag:yaml.org,2002:float", text.replace("e", ".0e") if "e" in text and "." not in text else text
        )


_Representer.add_representer(float, _Representer.represent_float)

FromList = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Vector = Annotated[tuple[float, float], FromList]


def quantity(unit: str, description: str, default: Any = ..., **bounds: Any) -> Any:
    """A field that is a number or a vector.

    Args:
        unit: SI unit, "-" for a plain number.
        description: what it is; the unit is added.
        default: value where none is given; without it the field must be given.
        **bounds: `gt`, `ge`, `lt` and `le`, as pydantic has them.

    Returns:
        The pydantic field.
    """
    return Field(default, description=f"{description} ({unit})", json_schema_extra={"unit": unit}, **bounds)


class Section(BaseModel):
    """A part of a scenario: nothing unknown in it, nothing converted, every number finite."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


class Support(Section):
    """What holds one end of the cable."""

    position: Vector = quantity("m", "place of the end as x, z; only the direction of the start where it is free")
    support: Literal["pinned", "clamped", "free"] = Field(default="pinned", description="what of the end is held")
    direction: Vector | None = quantity("-", "direction of the cable in a clamp, towards its end; any length", None)


class Load(Section):
    """A constant load at a point of the cable."""

    arc_length: float = quantity("m", "unstrained arc length from the start", ge=0)
    force: Vector = quantity("N", "force on the cable as x, z", (0.0, 0.0))
    moment: float = quantity("N m", "moment on an end of the cable, right-handed about y", 0.0)


class Cable(Section):
    """One uniform cable."""

    unstrained_length: float = quantity("m", "length without tension", gt=0)
    mass_per_length: float = quantity("kg/m", "mass per unstrained length", gt=0)
    axial_stiffness: float = quantity("N", "EA", gt=0)
    breaking_force: float | None = quantity("N", "minimum breaking force, for the rope safety factor", None, gt=0)
    bending_stiffness: float = quantity("N m^2", "EI", ge=0)
    elements: int = quantity("-", "number of elements, all of one unstrained length", ge=1, le=100_000)
    elastic_model: Literal["continuum", "element_frame"] = Field(
        default="continuum", description="strain energy on the arc itself, or in the frame of each element's chord"
    )
    damping_time: float = quantity("s", "Kelvin-Voigt relaxation time of EA and EI", 0.0, ge=0)
    initial_shape: Literal["equilibrium", "straight"] = Field(
        default="equilibrium", description="how it starts: in static equilibrium, or unstrained from start towards end"
    )
    start: Support = Field(description="what holds it at arc length 0")
    end: Support = Field(description="what holds it at its other end")
    loads: Annotated[tuple[Load, ...], FromList] = Field(default=(), description="constant loads on the cable")


class Limits(Section):
    """What a drive may do; null where there is no limit."""

    speed: float | None = quantity("m/s", "highest speed along the cable", None, gt=0)
    acceleration: float = quantity("m/s^2", "highest acceleration", 0.5, gt=0)
    jerk: float | None = quantity("m/s^3", "highest rate of the acceleration", None, gt=0)
    force: float | None = quantity("N", "highest drive force along the cable", None, gt=0)
    emergency_deceleration: float = quantity("m/s^2", "deceleration of an emergency stop", 1.5, gt=0)


class Drive(Section):
    """What moves a carriage along the cable."""

    mode: Literal["free", "speed", "force"] = Field(default="free", description="what moves it until a command comes")
    limits: Limits = Field(default_factory=Limits, description="limits of the drive")


class Friction(Section):
    """What resists a carriage along the cable."""

    rolling: float = quantity("-", "resistance per normal contact force", 0.0, ge=0)
    viscous: float = quantity("N s/m", "resistance per speed", 0.0, ge=0)


class EndStop(Section):
    """Elastic buffer at both ends of the cable; null is worked out, see `scenario_parameters.end_stop`."""

    stroke: float | None = quantity("m", "its length", None, gt=0)
    stiffness: float | None = quantity("N/m", "its stiffness", None, gt=0)
    damping: float | None = quantity("s/m", "its damping: force = stiffness d (1 + damping d_dot)", None, ge=0)


class Body(Section):
    """One rigid body of a carriage; pivots are seen from its centre of mass, in its own axes x, z."""

    mass: float = quantity("kg", "mass", gt=0)
    inertia: float = quantity("kg m^2", "moment of inertia about the centre of mass", gt=0)
    upper_pivot: Vector = quantity("m", "where it hangs")
    lower_pivot: Vector | None = quantity("m", "where the next body hangs from it; not needed for the last one", None)


class Carriage(Section):
    """A chain of bodies; the first one hangs from the cable, each other one from the body before it."""

    arc_length: float = quantity("m", "unstrained arc length of its joint at the start of the run")
    joint: Literal["sliding", "fixed"] = Field(
        default="sliding", description="whether the joint can move along the cable"
    )
    drive: Drive = Field(default_factory=Drive, description="what moves it")
    friction: Friction = Field(default_factory=Friction, description="what resists it")
    end_stop: EndStop = Field(default_factory=EndStop, description="what catches it at the ends of the cable")
    bodies: dict[str, Body] = Field(description="its bodies by name, from the cable downwards", min_length=1)


class Solver(Section):
    """Time integration."""

    integrator: Literal["generalized_alpha", "runge_kutta"] = Field(
        default="generalized_alpha", description="real-time integrator, or the explicit one of the paper"
    )
    step: float = quantity("s", "time step", 0.001, gt=0)
    spectral_radius: float = quantity("-", "what is left of the highest frequencies in a step", 0.7, ge=0, le=1)
    tolerance: float = quantity("m", "largest Newton increment of a position that ends the iteration", 1e-6, gt=0)
    max_iterations: int = quantity("-", "Newton iterations before a step is halved", 12, ge=1, le=1000)
    max_halvings: int = quantity("-", "how often a step may be halved before it fails", 6, ge=0, le=30)


class KeyFigureLimits(Section):
    """What key figures are held against; null where there is no limit. `key_figures` names the source of each."""

    rope_safety_factor: float | None = quantity("-", "lowest breaking force over tension", 3.15, gt=0)
    tension_per_transverse_load: float | None = quantity("-", "lowest tension over load of a carriage", 10.0, gt=0)
    swing: float | None = quantity("rad", "highest swing of a carriage along the track", 0.35, gt=0)
    acceleration: float | None = quantity("m/s^2", "highest acceleration of the last body of a carriage", 1.5, gt=0)
    stopping_distance: float | None = quantity("m", "longest way to a standstill", None, gt=0)
    sag: float | None = quantity("m", "largest depth of the cable below its chord", None, gt=0)


class Scenario(Section):
    """Everything that determines a run but the commands."""

    name: str = Field(
        default="custom", description="what the run is called; the name of the file by default", min_length=1
    )
    description: str = Field(default="", description="one line about it")
    gravity: float = quantity("m/s^2", "gravity, downwards", 9.81, ge=0)
    cable: Cable = Field(description="the cable")
    carriages: dict[str, Carriage] = Field(default_factory=dict, description="carriages by name")
    limits: KeyFigureLimits = Field(default_factory=KeyFigureLimits, description="limits of the key figures")
    solver: Solver = Field(default_factory=Solver, description="time integration")

    def resolved(self) -> dict[str, Any]:
        """The whole scenario with its defaults as plain data for JSON or YAML; `load_scenario` reads it back."""
        return self.model_dump(mode="json")

    def to_yaml(self) -> str:
        """The whole scenario with its defaults as YAML text, readable as YAML 1.1 and 1.2 alike."""
        yaml = YAML(typ="safe", pure=True)
        yaml.Representer = _Representer
        yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # bodies in the order of the chain
        yaml.default_flow_style = None
        yaml.width = 120
        text = StringIO()
        yaml.dump(self.resolved(), text)
        return text.getvalue()
