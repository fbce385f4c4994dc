"""The shape of a circle."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.shapes.shape import Shape, make_size_key


class CircleShape(Shape):
    """A circle about (x, y)."""

    period_deg = 0.0
    is_mirror_symmetric = True
    shape: Literal["circle"] = "circle"
    radius_mm: Annotated[float, make_size_key(example=1.0)]
    """Radius of the circle."""

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Circle:
        """Make the outline about (x, y); the rotation is ignored. See `Shape.make_outline`."""
        return Circle(np.array([x_mm, y_mm]) / 1e3, self.radius_mm / 1e3)
