"""The table ``[stage]`` of a scene: the position of the film on the stage that moves the probe."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import Key, Section
from pvdf_fem.scene.outlines.outline import rotate


class Stage(Section):
    """Position of the film on the stage that moves the probe, from `pvdf-fem calibrate`.

    `calibrate` and `locate` read and print positions on the stage. The position of a scene's probe
    is on the film.
    """

    x_mm: Annotated[float, Key("mm", (-1e5, 1e5))] = 0.0
    """Position of the film's centre along x, in the frame of the stage."""
    y_mm: Annotated[float, Key("mm", (-1e5, 1e5))] = 0.0
    """Position of the film's centre along y, in the frame of the stage."""
    rotation_deg: Annotated[float, Key("degrees", (-3600.0, 3600.0))] = 0.0
    """Rotation from the axes of the stage to the axes of the film, counter-clockwise."""

    @property
    def rotation(self) -> Array:
        """Rotation matrix from the axes of the film to the axes of the stage, shape (2, 2)."""
        return rotate(np.eye(2), self.rotation_deg).T

    def to_film(self, positions_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Convert positions and rotations on the stage to those on the film.

        Parameters
        ----------
        positions_mm : array_like, shape (..., 2)
            Positions on the stage in mm.
        rotations_deg : array_like, shape (...)
            Counter-clockwise rotations in degrees, relative to the axes of the stage.

        Returns
        -------
        positions_mm : ndarray, shape (..., 2)
            Positions relative to the film's centre, in the axes of the film.
        rotations_deg : ndarray, shape (...)
            Rotations relative to the axes of the film.
        """
        offsets = np.asarray(positions_mm, dtype=float) - [self.x_mm, self.y_mm]
        rotations = np.asarray(rotations_deg, dtype=float) - self.rotation_deg
        return offsets @ self.rotation, rotations

    def to_stage(self, positions_mm: ArrayLike, rotations_deg: ArrayLike) -> tuple[Array, Array]:
        """Convert positions and rotations on the film to those on the stage.

        Parameters
        ----------
        positions_mm : array_like, shape (..., 2)
            Positions relative to the film's centre in mm, in the axes of the film.
        rotations_deg : array_like, shape (...)
            Counter-clockwise rotations in degrees, relative to the axes of the film.

        Returns
        -------
        positions_mm : ndarray, shape (..., 2)
            Positions on the stage.
        rotations_deg : ndarray, shape (...)
            Rotations relative to the axes of the stage.
        """
        offsets = np.asarray(positions_mm, dtype=float) @ self.rotation.T
        rotations = np.asarray(rotations_deg, dtype=float) + self.rotation_deg
        centre = np.array([self.x_mm, self.y_mm])
        return offsets + centre, rotations
