"""The outline of a circle."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.ellipse import Ellipse


class Circle(Ellipse):
    """A circle.

    Parameters
    ----------
    centre : array_like, shape (2,)
        Centre in m.
    radius : float
        Radius in m.
    """

    def __init__(self, centre: ArrayLike, radius: float) -> None:
        super().__init__(np.asarray(centre), np.array([radius, 0.0]), radius)

    @property
    def radius(self) -> float:
        """Radius in m."""
        return self.second

    @property
    def reach(self) -> float:
        """Maximum distance of the circle's points from the film's centre, in m."""
        return float(np.linalg.norm(self.centre) + self.radius)

    @property
    def defining_points(self) -> Array:
        """The centre in m, shape (1, 2)."""
        return self.centre[None]

    @property
    def defining_length(self) -> float:
        """The radius in m."""
        return self.radius

    @property
    def centred_radius(self) -> float | None:
        """The radius in m if the circle is about the film's centre."""
        return None if self.centre.any() else self.radius

    @property
    def hydraulic_radius(self) -> float:
        """The radius in m."""
        return self.radius

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Circle:
        """Return a transformed copy; see `Outline.transform`."""
        return Circle(frame @ self.centre + shift, self.radius)
