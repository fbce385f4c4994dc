"""The table ``[stage]`` of a scene: the film on the stage that positions the probe."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.outlines.outline import rotate


class Stage(Section):
    """Where the film lies on the stage that positions the probe, from `pvdf-fem calibrate`.

    Touches that `calibrate` and `locate` read and print are places on the stage. A scene's probe is
    a place on the film.
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
        """Convert places and rotations on the stage to those on the film.

        Parameters
        ----------
        places_mm : ndarray, shape (..., 2)
            Places in mm.
        rotations_deg : ndarray, shape (...)
            Rotations in degrees, counter-clockwise.

        Returns
        -------
        places_mm : ndarray, shape (..., 2)
        rotations_deg : ndarray, shape (...)
        """
        offsets = np.asarray(places_mm, dtype=float) - [self.x_mm, self.y_mm]
        rotations = np.asarray(rotations_deg, dtype=float) - self.rotation_deg
        return offsets @ self.rotation, rotations

    def to_stage(self, places_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Convert places and rotations on the film to those on the stage.

        Parameters
        ----------
        places_mm : ndarray, shape (..., 2)
            Places in mm.
        rotations_deg : ndarray, shape (...)
            Rotations in degrees, counter-clockwise.

        Returns
        -------
        places_mm : ndarray, shape (..., 2)
        rotations_deg : ndarray, shape (...)
        """
        offsets = np.asarray(places_mm, dtype=float) @ self.rotation.T
        rotations = np.asarray(rotations_deg, dtype=float) + self.rotation_deg
        centre = np.array([self.x_mm, self.y_mm])
        return offsets + centre, rotations
