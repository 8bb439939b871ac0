"""Building blocks of the scenario schema: sections, quantities with units, vectors."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

BREAKING_FORCES = {
    "minimum": "minimum breaking force, for the rope safety factor",
    "calculated": "sum of the breaking forces of all wires, which some rules compare",
    "tested": "breaking force of a sample in a test, which some rules compare",
}
OF_KIND = "unit of the kind"  # of a quantity that depends on the kind of sensor

FromList = BeforeValidator(lambda value: tuple(value) if isinstance(value, list) else value)
Vector = Annotated[tuple[float, float], FromList]  # of a plane, or two numbers of another kind
# along the track and upwards; in space along it, to its left, and upwards
Place = Annotated[tuple[float, ...], FromList, Field(min_length=2, max_length=3)]


def _printable(text: str) -> str:
    """Refuse a text with control characters, which a terminal would execute."""
    if not text.replace("\n", "").isprintable():
        raise ValueError("it cannot be printed")
    return text


def _one_line(text: str) -> str:
    if "\n" in text:
        raise ValueError("it has several lines")
    return text


Description = Annotated[str, AfterValidator(_printable)]
OneLine = Annotated[str, AfterValidator(_printable), AfterValidator(_one_line)]
Tensor = Annotated[tuple[float, ...], FromList, Field(min_length=3, max_length=6)]


def quantity(unit: str, description: str, default: Any = ..., **bounds: Any) -> Any:
    """Schema field for a number or a vector with its unit.

    Args:
        unit: SI unit, "-" for a plain number.
        description: meaning, without the unit, which is added.
        default: default value; a field without one has to be given.
        **bounds: `gt`, `ge`, `lt` and `le`, as pydantic has them.

    Returns:
        The pydantic field.
    """
    return Field(default, description=f"{description} ({unit})", json_schema_extra={"unit": unit}, **bounds)


def strength(kind: Literal["minimum", "calculated", "tested"]) -> Any:
    """Schema field for a breaking force of a rope, null where it is not known."""
    return quantity("N", BREAKING_FORCES[kind], None, gt=0)


def in_space(vector: tuple[float, ...]) -> tuple[float, ...]:
    """Vector of three numbers from x, z or x, y, z."""
    return vector if len(vector) == 3 else (vector[0], 0.0, vector[1])


class Section(BaseModel):
    """Section of a scenario: no unknown keys, no type conversion, finite numbers only."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
