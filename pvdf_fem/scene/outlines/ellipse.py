"""Ellipses: the outline, and the table of a scene file that makes it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.disc import ImageOfDisc
from pvdf_fem.scene.outlines.outline import turn
from pvdf_fem.scene.outlines.shape import SIZE, Shape
from pvdf_fem.scene.quantity import refusal


@dataclass(frozen=True, eq=False)
class Ellipse(ImageOfDisc):
    """An ellipse; lengths are in m, arrays are stored read-only."""

    centre: Array
    first: Array  #: From the centre to the end of one of the axes.
    second: float  #: Length of the other semi-axis.

    def __post_init__(self) -> None:
        for name in ("centre", "first"):
            vector = np.array(getattr(self, name), dtype=float)
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)

    @cached_property
    def axes(self) -> Array:
        x, y = self.first
        across = np.array([-y, x]) * self.second / np.hypot(x, y)
        return np.stack([self.first, across], axis=-1)

    @cached_property
    def perimeter(self) -> float:
        """Length of the outline in m, by the complete elliptic integral of the second kind."""
        from scipy.special import ellipe  # scenes are read without scipy

        short, long = sorted(np.linalg.norm(self.axes, axis=0))
        return float(4.0 * long * ellipe(1.0 - (short / long) ** 2))

    @cached_property
    def reach(self) -> float:
        """Largest distance of a point of the ellipse from the film's centre, in m. At z = exp(it)
        the derivative of |centre + axes (cos t, sin t)|² is a polynomial of degree 4 over z²."""
        p, q = self.centre @ self.axes
        a, b = (self.axes**2).sum(axis=0)
        roots = np.roots([b - a, 2j * q - 2.0 * p, 0.0, 2j * q + 2.0 * p, a - b])
        angles = np.append(np.angle(roots), 0.0)
        return float(np.linalg.norm(self.at(angles), axis=1).max())

    @property
    def lowest(self) -> Array:
        return self.centre - np.linalg.norm(self.axes, axis=1)

    @cached_property
    def landmarks(self) -> Array:
        return self.centre + np.concatenate([self.axes.T, -self.axes.T])

    def mapped(self, frame: Array, shift: Array | float = 0.0) -> Ellipse:
        return Ellipse(frame @ self.centre + shift, frame @ self.first, self.second)


def _is_not_thin(semi_axes: tuple[float, float]) -> tuple[float, float]:
    if max(semi_axes) > 1000.0 * min(semi_axes):  # ends too sharp for the rounding of a mesh
        raise refusal("is too thin; give axes whose ratio is 1000 at the most")
    return semi_axes


class EllipseShape(Shape):
    """An ellipse about (x, y), unrotated with its first axis along x."""

    period_deg = 180.0
    is_mirrored = True
    size_key = "semi_axes_mm"
    shape: Literal["ellipse"] = "ellipse"
    semi_axes_mm: Annotated[
        tuple[float, float], replace(SIZE, example=[3.0, 2.0]), AfterValidator(_is_not_thin)
    ]
    """Semi-axes [a, b], unrotated a along x."""

    @cached_property
    def outline(self) -> Ellipse:
        first, second = self.semi_axes_mm
        centre = np.array([self.x_mm, self.y_mm]) / 1e3
        return Ellipse(centre, turn([first / 1e3, 0.0], self.rotation_deg), second / 1e3)
