"""Wind, gusts and turbulence: section `air` of a scenario file."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from cable_twin.mechanics.parameters import COLDEST, GUSTS, HOTTEST, STRONGEST_WIND
from cable_twin.scenario.sections.quantities import FromList, Place, Section, quantity

GustShape: Any = Literal[GUSTS]  # type: ignore[valid-type]  # those of the mechanics


class Profile(Section):
    """Growth of the wind with the height above the ground, h: wind (h / reference_height)^exponent."""

    exponent: float = quantity(
        "-", "exponent of the power law; 0.14 for open land, 0.2 in IEC 61400-1", 0.14, gt=0, le=1
    )
    reference_height: float = quantity("m", "height above the ground at which the given wind blows", 10.0, gt=0)
    ground: float = quantity("m", "z of the ground, without `terrain`", 0.0)


class Gust(Section):
    """Gust of a standard, uniform over the line and added to the mean wind."""

    time: float = quantity("s", "time of the gust after the start or the last reset", ge=0)
    amplitude: Place = quantity("m/s", "amplitude as x, z, in space x, y, z")
    duration: float = quantity("s", "duration; 10.5 in IEC 61400-1", 10.5, gt=0)
    shape: GustShape = Field(
        default="one_minus_cosine",
        description="one minus cosine of CS-25.341, or extreme operating gust of IEC 61400-1, 6.3.2.2",
    )


class Turbulence(Section):
    """Turbulence with a spectrum, from a seed; frozen and carried by the wind, partly coherent along the line."""

    spectrum: Literal["kaimal", "von_karman"] = Field(
        default="kaimal", description="spectrum of Kaimal, or the isotropic one of von Karman, both of IEC 61400-1"
    )
    intensity: float = quantity("-", "standard deviation along the wind over its mean speed", 0.16, ge=0, le=1)
    length_scale: float = quantity(
        "m", "integral scale along the wind; IEC 61400-1: 5.67 times the height up to 60 m", 170.0, gt=0
    )
    decay: float = quantity(
        "-", "decay of the coherence with the distance across the wind; 12 in IEC 61400-1", 12.0, ge=0
    )
    points: int = quantity("-", "number of points along the line with turbulence of their own", 32, ge=1, le=200)
    seed: int = quantity("-", "seed of the random phases", 0, ge=0, le=2**63 - 1)


class Air(Section):
    """Air acting on ropes with a diameter and bodies with a drag area; wind without either is refused."""

    density: float = quantity(
        "kg/m^3", "density of the air, by default at 15 degrees and sea level", 1.225, ge=0, le=10
    )
    temperature: float = quantity(
        "degC",
        "temperature of ropes at the start, which strains them by their thermal_expansion",
        20.0,
        ge=COLDEST,
        le=HOTTEST,
    )
    wind: Place = quantity(
        "m/s",
        f"mean wind along the track and upwards at the start, in space x, y, z; at most {STRONGEST_WIND:g}",
        (0.0, 0.0),
    )
    profile: Profile | None = Field(default=None, description="growth of the wind with height; null: uniform wind")
    gusts: Annotated[tuple[Gust, ...], FromList] = Field(default=(), description="gusts at given times")
    turbulence: Turbulence | None = Field(default=None, description="turbulence of the wind; null for none")
