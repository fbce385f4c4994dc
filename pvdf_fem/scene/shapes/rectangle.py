"""The shape of a rectangle."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import model_validator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import make_validation_error
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon
from pvdf_fem.scene.outlines.outline import Outline, rotate
from pvdf_fem.scene.outlines.polygon import Polygon, make_rectangle_corners
from pvdf_fem.scene.shapes.shape import Shape, make_size_key

#: Bulge of a quarter of a circle: the tangent of a quarter of its angle.
QUARTER_BULGE = np.tan(np.pi / 8.0)


class RectangleShape(Shape):
    """A rectangle about (x, y) with its width along x before the rotation."""

    period_deg = 180.0
    is_mirror_symmetric = True
    shape: Literal["rectangle"] = "rectangle"
    width_mm: Annotated[float, make_size_key(example=14.0)]
    """Width, along x before the rotation."""
    height_mm: Annotated[float, make_size_key(example=7.0)]
    """Height, along y before the rotation."""

    corner_radius_mm: Annotated[float | None, make_size_key(example=1.0)] = None
    """Radius of rounded corners; by default the corners are sharp."""

    @model_validator(mode="after")
    def _reject_too_large_corners(self) -> Self:
        """Refuse corners that are rounder than half of the shorter side."""
        limit_mm = 0.5 * min(self.width_mm, self.height_mm)
        if self.corner_radius_mm is not None and self.corner_radius_mm > limit_mm:
            reason = f"is larger than half of the shorter side; give at most {limit_mm:g} mm"
            raise make_validation_error(reason, key="corner_radius_mm", value=self.corner_radius_mm)
        return self

    @property
    def is_rectangle(self) -> bool:
        """Whether the corners are sharp."""
        return self.corner_radius_mm is None

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Outline:
        """Make the outline about (x, y); see `Shape.make_outline`."""
        centre_mm = np.array([x_mm, y_mm])
        if self.corner_radius_mm is None:
            corners_mm = make_rectangle_corners(self.width_mm, self.height_mm)
            return Polygon((rotate(corners_mm, rotation_deg) + centre_mm) / 1e3)
        ends_mm = self._make_ends_of_sides_mm(self.corner_radius_mm)
        # the sides begin with the lower one, and an arc follows each of them
        bulges = np.tile([0.0, QUARTER_BULGE], 4)
        # a side of a stadium has no length
        next_mm = np.roll(ends_mm, -1, axis=0)
        is_kept = np.abs(next_mm - ends_mm).max(axis=1) > 1e-9 * self.corner_radius_mm
        vertices_mm = rotate(ends_mm[is_kept], rotation_deg) + centre_mm
        return ArcPolygon(vertices_mm / 1e3, bulges[is_kept])

    def _make_ends_of_sides_mm(self, corner_radius_mm: float) -> Array:
        """Make the ends of the straight sides in mm, counter-clockwise, shape (8, 2)."""
        x = 0.5 * self.width_mm
        y = 0.5 * self.height_mm
        inner_x = x - corner_radius_mm
        inner_y = y - corner_radius_mm
        lower = [[-inner_x, -y], [inner_x, -y]]
        right = [[x, -inner_y], [x, inner_y]]
        upper = [[inner_x, y], [-inner_x, y]]
        left = [[-x, inner_y], [-x, -inner_y]]
        return np.array([*lower, *right, *upper, *left])
