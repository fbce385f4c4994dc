"""Numbers as people write them in a scene: strictly numbers, finite, each within its range.

The ranges keep squares and cubes of the values far from overflow; they are no physical limits.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field
from pydantic_core import PydanticCustomError


def refusal(reason: str) -> PydanticCustomError:
    """The exception of a validator; `reason` says what is wrong and what to change."""
    return PydanticCustomError("scene", "{reason}", {"reason": reason})


def within(low: float, high: float, unit: str = "", ends: bool = True) -> AfterValidator:
    """Refuse numbers outside of [low, high], or of the open interval without its ends."""

    def check(value: float) -> float:
        if low < value < high or (ends and value in (low, high)):
            return value + 0  # no negative zero, so that equal scenes have equal JSON
        size = "small" if value <= low else "large"
        reason = "must be positive" if value <= 0 < low else f"is too {size}"
        span = f"from {low:g} to {high:g}" if ends else f"between {low:g} and {high:g}"
        raise refusal(f"{reason}; give a value {span} {unit}".rstrip())

    return AfterValidator(check)


Finite = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Whole = Annotated[int, Field(strict=True)]
Number = Annotated[Finite, within(-1e6, 1e6)]
Coordinate = Annotated[Finite, within(-1e6, 1e6, "mm")]
Length = Annotated[Finite, within(1e-6, 1e6, "mm")]
Modulus = Annotated[Finite, within(1e-6, 1e6, "GPa")]


class Section(BaseModel):
    """A table of a scene file: frozen, its keys fixed."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """A copy with some other values, and nothing cached of the old ones."""
        copy = super().model_copy(update=update, deep=deep)
        for name in copy.__dict__.keys() - type(copy).model_fields.keys():
            del copy.__dict__[name]
        return copy
