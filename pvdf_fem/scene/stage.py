"""Locating touches: the film on the stage, and the wanted model."""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike
from pydantic import BeforeValidator, field_validator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import Key, Section, make_validation_error
from pvdf_fem.scene.outlines.outline import rotate


def _none_for_auto(value: Any) -> Any:
    return None if value == "auto" else value


class Stage(Section):
    """Where the film lies on the stage that positions the probe, from `pvdf-fem calibrate`.

    Touches that are read or told, as by `calibrate` and `locate`, are places on the stage. A
    scene's probe is a place on the film.
    """

    x_mm: Annotated[float, Key("mm", (-1e5, 1e5))] = 0.0
    """The film's centre in the frame of the stage, along x."""
    y_mm: Annotated[float, Key("mm", (-1e5, 1e5))] = 0.0
    """The film's centre in the frame of the stage, along y."""
    rotation_deg: Annotated[float, Key("degrees", (-3600.0, 3600.0))] = 0.0
    """From the axes of the stage to the axes of the film, counter-clockwise."""

    @property
    def rotation(self) -> Array:
        """Orthogonal matrix (2, 2) from the film's axes to the stage's axes."""
        return rotate(np.eye(2), self.rotation_deg).T

    def to_film(self, places_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Places (..., 2) and rotations (...) on the film of those on the stage."""
        places = (np.asarray(places_mm, dtype=float) - [self.x_mm, self.y_mm]) @ self.rotation
        return places, np.asarray(rotations_deg, dtype=float) - self.rotation_deg

    def to_stage(self, places_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Places (..., 2) and rotations (...) on the stage of those on the film."""
        places = np.asarray(places_mm, dtype=float) @ self.rotation.T + [self.x_mm, self.y_mm]
        return places, np.asarray(rotations_deg, dtype=float) + self.rotation_deg


class ResponseDomain(Section):
    """Domain of the model for `pvdf-fem locate`, `track` and `explore`."""

    reach_mm: Annotated[float | None, Key("mm", (1e-3, 1e5), example=12.0)] = None
    """Largest distance of the probe's centroid from the film's centre; by default 12, at most 0.6
    of the film's radius and the probe's width away from the rim."""
    force_range_N: Annotated[tuple[float, float], Key("N", (1e-9, 1e6))] = (0.1, 5.0)
    """Least and largest force."""
    tolerance: Annotated[
        float | None, BeforeValidator(_none_for_auto), Key("", (1e-6, 1.0), example="auto")
    ] = None
    """Largest error bound relative to a charge. auto: a tenth of the relative noise of readings."""

    @field_validator("force_range_N")
    @classmethod
    def _is_a_range(cls, value: tuple[float, float]) -> tuple[float, float]:
        if value[0] >= value[1]:
            raise make_validation_error("is no range; give the least and the largest force")
        return value
