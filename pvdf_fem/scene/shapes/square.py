"""The shape of a square."""

from __future__ import annotations

from typing import Annotated, Literal

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.polygon import make_rectangle_corners
from pvdf_fem.scene.shapes.shape import PolygonalShape, make_size_key


class SquareShape(PolygonalShape):
    """A square about (x, y) with its sides along x and y before the rotation."""

    period_deg = 90.0
    is_mirror_symmetric = True
    shape: Literal["square"] = "square"
    side_mm: Annotated[float, make_size_key(example=3.0)]
    """Length of a side."""

    @property
    def is_rectangle(self) -> bool:
        """Whether it is a rectangle: it is."""
        return True

    def make_corners_mm(self) -> Array:
        """Make the corners in mm relative to the centre, shape (4, 2)."""
        return make_rectangle_corners(self.side_mm, self.side_mm)
