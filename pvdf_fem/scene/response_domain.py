"""The table ``[model]`` of a scene: the domain of the response by which touches are located."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import BeforeValidator, field_validator

from pvdf_fem.scene.keys import Key, Section, make_validation_error


def _replace_auto(value: Any) -> Any:
    """Return None for ``"auto"``."""
    return None if value == "auto" else value


class ResponseDomain(Section):
    """Domain of the response for `pvdf-fem locate`, `track` and `explore`."""

    reach_mm: Annotated[float | None, Key("mm", (1e-3, 1e5), example=12.0)] = None
    """Largest distance of the probe's centroid from the film's centre; by default 12, at most 0.6
    of the film's radius and the probe's width away from the rim."""
    force_range_N: Annotated[tuple[float, float], Key("N", (1e-9, 1e6))] = (0.1, 5.0)
    """Least and largest force."""
    tolerance: Annotated[
        float | None, BeforeValidator(_replace_auto), Key("", (1e-6, 1.0), example="auto")
    ] = None
    """Largest error bound of the response, relative to a charge. auto: a tenth of the relative
    noise of readings."""

    @field_validator("force_range_N")
    @classmethod
    def _require_range(cls, value: tuple[float, float]) -> tuple[float, float]:
        least, largest = value
        if least >= largest:
            raise make_validation_error("is not a range; give the least and the largest force")
        return value
