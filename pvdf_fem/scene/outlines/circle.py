"""Discs: the outline, and its table in scene files."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.ellipse import Ellipse


class Circle(Ellipse):
    """A disc; lengths are in m."""

    def __init__(self, centre: ArrayLike, radius: float) -> None:
        super().__init__(np.asarray(centre), np.array([radius, 0.0]), radius)

    @property
    def radius(self) -> float:
        """Radius in m."""
        return self.second

    @property
    def reach(self) -> float:
        return float(np.linalg.norm(self.centre) + self.radius)

    @property
    def defining_points(self) -> Array:
        return self.centre[None]

    @property
    def size(self) -> float:
        return self.radius

    def transform(self, frame: Array, shift: Array | float = 0.0) -> Circle:
        return Circle(frame @ self.centre + shift, self.radius)
