"""The outline of a disc."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.ellipse import Ellipse


class Circle(Ellipse):
    """A circle.

    Parameters
    ----------
    centre : ndarray, shape (2,)
        In m.
    radius : float
        In m.
    """

    def __init__(self, centre: ArrayLike, radius: float) -> None:
        super().__init__(np.asarray(centre), np.array([radius, 0.0]), radius)

    @property
    def radius(self) -> float:
        """Radius in m."""
        return self.second

    @property
    def reach(self) -> float:
        """Largest distance of a point of the circle from the film's centre, in m."""
        return float(np.linalg.norm(self.centre) + self.radius)

    @property
    def defining_points(self) -> Array:
        """The centre (1, 2) in m."""
        return self.centre[None]

    @property
    def defining_length(self) -> float:
        """The radius in m."""
        return self.radius

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Circle:
        """Return the circle after a rotation or reflection and a shift; see `Outline.transform`."""
        return Circle(frame @ self.centre + shift, self.radius)
