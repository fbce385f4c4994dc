"""The shape of a simple polygon."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import make_validation_error
from pvdf_fem.scene.outlines.polygon import find_polygon_defect
from pvdf_fem.scene.shapes.shape import COORDINATE, PolygonalShape

Vertices = tuple[tuple[float, float], ...]


def _require_simple_polygon(vertices: Vertices) -> Vertices:
    """Refuse vertices that do not form a simple polygon."""
    if defect := find_polygon_defect(vertices):
        reason = f"{defect}; list the corners of a simple polygon once, in order"
        raise make_validation_error(reason)
    return vertices


class PolygonShape(PolygonalShape):
    """A simple polygon with its vertices relative to (x, y), before the rotation."""

    shape: Literal["polygon"] = "polygon"
    vertices_mm: Annotated[
        Vertices,
        Field(min_length=3, max_length=1000),
        replace(COORDINATE, example=[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]),
        AfterValidator(_require_simple_polygon),
    ]
    """Vertices [[x, y], ...] in order, clockwise or counter-clockwise."""

    def make_corners_mm(self) -> Array:
        """Return the vertices in mm, shape (n, 2)."""
        return np.array(self.vertices_mm)
