"""The shape of any simple polygon."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import make_validation_error
from pvdf_fem.scene.outlines.polygon import find_polygon_defect
from pvdf_fem.scene.shapes.shape import PLACE, PolygonalShape

Vertices = tuple[tuple[float, float], ...]


def _reject_defect(vertices: Vertices) -> Vertices:
    """Refuse vertices that are no simple polygon."""
    if defect := find_polygon_defect(vertices):
        reason = f"{defect}; list the corners of a simple polygon once, in order"
        raise make_validation_error(reason)
    return vertices


class PolygonShape(PolygonalShape):
    """A simple polygon in either orientation; its vertices are relative to (x, y), unrotated."""

    shape: Literal["polygon"] = "polygon"
    vertices_mm: Annotated[
        Vertices,
        Field(min_length=3, max_length=1000),
        replace(PLACE, example=[[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]]),
        AfterValidator(_reject_defect),
    ]
    """Corners [[x, y], ...] of a simple polygon in order."""

    def make_corners_mm(self) -> Array:
        """Make the corners about the origin of the vertices."""
        return np.array(self.vertices_mm)
