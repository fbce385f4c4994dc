"""The table ``[model]`` of a scene: the domain of the response that locates touches."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, field_validator

from pvdf_fem.scene.keys import Key, Section, make_validation_error


def _replace_auto(value: Any) -> Any:
    """Return None for ``"auto"``, and any other value unchanged."""
    return None if value == "auto" else value


class ResponseDomain(Section):
    """Domain and tolerance of the response for `pvdf-fem locate`, `track` and `explore`."""

    reach_mm: Annotated[float | None, Key("mm", (1e-3, 1e5), example=12.0)] = None
    """Maximum distance of a touch (the probe's centroid) from the film's centre; by default 12, but
    at most 0.6 of the film's radius, and at least the probe's width away from the rim."""
    force_range_N: Annotated[tuple[float, float], Key("N", (1e-9, 1e6))] = (0.1, 5.0)
    """Minimum and maximum force."""
    tolerance: Annotated[
        float | None, BeforeValidator(_replace_auto), Key("", (1e-6, 1.0), example="auto")
    ] = None
    """Maximum error bound of the response, as a fraction of a charge. auto: a tenth of the relative
    noise of the readings."""

    @field_validator("force_range_N")
    @classmethod
    def _require_increasing_forces(cls, value: tuple[float, float]) -> tuple[float, float]:
        """Refuse a pair of forces that does not increase."""
        minimum, maximum = value
        if minimum >= maximum:
            reason = "must be an increasing pair; give the minimum and the maximum force"
            raise make_validation_error(reason)
        return value
