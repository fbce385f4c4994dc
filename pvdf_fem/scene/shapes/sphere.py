"""The shape of a sphere, a rigid tip whose contact area depends on the force."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np

from pvdf_fem.scene.keys import Key
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.shapes.shape import Shape


class SphereShape(Shape):
    """A sphere whose lowest point is above (x, y)."""

    period_deg = 0.0
    is_mirror_symmetric = True
    shape: Literal["sphere"] = "sphere"
    radius_mm: Annotated[float, Key("mm", (1e-4, 1e5), example=5.0)]
    """Radius of the sphere."""

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Circle:
        """Make the outline of the sphere seen from above; the rotation is ignored.

        See `Shape.make_outline`.
        """
        return Circle(np.array([x_mm, y_mm]) / 1e3, self.radius_mm / 1e3)
