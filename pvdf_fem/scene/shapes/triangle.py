"""The shape of an equilateral triangle."""

from __future__ import annotations

from typing import Annotated, Literal

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.polygon import make_triangle_corners
from pvdf_fem.scene.shapes.shape import PolygonalShape, make_size_key


class TriangleShape(PolygonalShape):
    """An equilateral triangle about (x, y), with a corner towards +y before the rotation."""

    period_deg = 120.0
    is_mirror_symmetric = True
    shape: Literal["triangle"] = "triangle"
    side_mm: Annotated[float, make_size_key(example=7.0)]
    """Length of a side."""

    def make_corners_mm(self) -> Array:
        """Make the corners in mm relative to the centroid, shape (3, 2)."""
        return make_triangle_corners(self.side_mm)
