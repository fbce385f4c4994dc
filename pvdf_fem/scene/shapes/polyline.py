"""The shape of a closed line of straight sides and circular arcs."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from pvdf_fem.scene.keys import Affects, Key, make_validation_error
from pvdf_fem.scene.outlines.arc_polygon import ArcPolygon, find_arc_polygon_defect
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.shapes.shape import COORDINATE, Shape


class PolylineShape(Shape):
    """A closed line of straight sides and circular arcs, as drawings have it.

    The vertices are relative to (x, y), before the rotation.
    """

    shape: Literal["polyline"] = "polyline"
    vertices_mm: Annotated[
        tuple[tuple[float, float], ...],
        Field(min_length=2, max_length=1000),
        replace(COORDINATE, example=[[-2.0, -1.0], [2.0, -1.0], [2.0, 1.0], [-2.0, 1.0]]),
    ]
    """Ends [[x, y], ...] of the sides in order, clockwise or counter-clockwise."""
    bulges: Annotated[
        tuple[float, ...], Key("", (-100.0, 100.0), Affects.OUTLINE, example=[0.0, 1.0, 0.0, 1.0])
    ]
    """Bulge of the side that begins at each vertex, as in DXF files: the tangent of a quarter of
    its angle, positive for a counter-clockwise arc, 1 for a half circle, 0 for a straight side."""

    @model_validator(mode="after")
    def _require_simple_outline(self) -> Self:
        """Refuse another number of bulges than vertices, and sides that cross or touch."""
        if len(self.bulges) != len(self.vertices_mm):
            reason = f"must have a number for each of the {len(self.vertices_mm)} vertices"
            advice = "give 0 for each straight side"
            raise make_validation_error(f"{reason}; {advice}", key="bulges", value=self.bulges)
        if defect := find_arc_polygon_defect(self.vertices_mm, self.bulges):
            reason = f"{defect}; list the ends of the sides of a simple outline once, in order"
            raise make_validation_error(reason, key="vertices_mm", value=self.vertices_mm)
        return self

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> ArcPolygon:
        """Make the outline from rotated and moved vertices; see `Shape.make_outline`."""
        rotated = rotate(np.array(self.vertices_mm), rotation_deg)
        return ArcPolygon((rotated + np.array([x_mm, y_mm])) / 1e3, np.array(self.bulges))
