"""The film in the frame of the stage that positions the probe."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.quantity import Coordinate, Number, Section


class Stage(Section):
    """Where the film's centre is on the stage, and how far the film's axes are turned there.

    Touches that are read or told, as by `calibrate` and `locate`, are places on the stage. A
    scene's probe is a place on the film.
    """

    x_mm: Coordinate = 0.0
    y_mm: Coordinate = 0.0
    rotation_deg: Number = 0.0

    @property
    def turn(self) -> Array:
        """Orthogonal matrix (2, 2) from the film's axes to those of the stage."""
        return turn(np.eye(2), self.rotation_deg).T

    def to_film(self, places_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Places (..., 2) and rotations (...) on the film of those on the stage."""
        places = (np.asarray(places_mm, dtype=float) - [self.x_mm, self.y_mm]) @ self.turn
        return places, np.asarray(rotations_deg, dtype=float) - self.rotation_deg

    def to_stage(self, places_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Places (..., 2) and rotations (...) on the stage of those on the film."""
        places = np.asarray(places_mm, dtype=float) @ self.turn.T + [self.x_mm, self.y_mm]
        return places, np.asarray(rotations_deg, dtype=float) + self.rotation_deg
