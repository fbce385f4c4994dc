"""The shape of a rectangle."""

from __future__ import annotations

from typing import Annotated, Literal

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.polygon import make_rectangle_corners
from pvdf_fem.scene.shapes.shape import PolygonalShape, make_size_key


class RectangleShape(PolygonalShape):
    """A rectangle about (x, y) with its width along x before the rotation."""

    period_deg = 180.0
    is_mirror_symmetric = True
    is_rectangle = True
    shape: Literal["rectangle"] = "rectangle"
    width_mm: Annotated[float, make_size_key(example=14.0)]
    """Width, along x before the rotation."""
    height_mm: Annotated[float, make_size_key(example=7.0)]
    """Height, along y before the rotation."""

    def make_corners_mm(self) -> Array:
        """Make the corners in mm relative to the centre, shape (4, 2)."""
        return make_rectangle_corners(self.width_mm, self.height_mm)
