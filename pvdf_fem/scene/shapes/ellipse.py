"""The shape of an ellipse."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator

from pvdf_fem.scene.keys import make_validation_error
from pvdf_fem.scene.outlines.ellipse import Ellipse
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.scene.shapes.shape import Shape, make_size_key


def _reject_thin_ellipse(semi_axes: tuple[float, float]) -> tuple[float, float]:
    """Refuse an ellipse whose ends are too sharp to be meshed."""
    if max(semi_axes) > 1000.0 * min(semi_axes):
        raise make_validation_error("is too thin; give axes whose ratio is at most 1000")
    return semi_axes


class EllipseShape(Shape):
    """An ellipse about (x, y) with its first axis along x before the rotation."""

    period_deg = 180.0
    is_mirror_symmetric = True
    shape: Literal["ellipse"] = "ellipse"
    semi_axes_mm: Annotated[
        tuple[float, float],
        make_size_key(example=[3.0, 2.0]),
        AfterValidator(_reject_thin_ellipse),
    ]
    """Semi-axes [a, b]; a is along x before the rotation."""

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Ellipse:
        """Make the outline about (x, y); see `Shape.make_outline`."""
        first, second = self.semi_axes_mm
        centre = np.array([x_mm, y_mm]) / 1e3
        return Ellipse(centre, rotate([first / 1e3, 0.0], rotation_deg), second / 1e3)
