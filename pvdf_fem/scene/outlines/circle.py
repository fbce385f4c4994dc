"""Discs: the outline, and the table of a scene file that makes it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Literal

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.outlines.disc import ImageOfDisc
from pvdf_fem.scene.outlines.shape import SIZE, Shape


@dataclass(frozen=True, eq=False)
class Circle(ImageOfDisc):
    """A disc; lengths are in m, the centre is stored read-only."""

    centre: Array
    radius: float

    def __post_init__(self) -> None:
        centre = np.array(self.centre, dtype=float)
        centre.setflags(write=False)
        object.__setattr__(self, "centre", centre)

    @property
    def axes(self) -> Array:
        return self.radius * np.eye(2)

    @property
    def area(self) -> float:
        return float(np.pi * self.radius**2)

    @property
    def perimeter(self) -> float:
        return float(2.0 * np.pi * self.radius)

    @property
    def reach(self) -> float:
        return float(np.linalg.norm(self.centre) + self.radius)

    @property
    def lowest(self) -> Array:
        return self.centre - self.radius

    @property
    def landmarks(self) -> Array:
        return self.centre[None]

    @property
    def size(self) -> float:
        return self.radius

    def mapped(self, frame: Array, shift: Array | float = 0.0) -> Circle:
        return Circle(frame @ self.centre + shift, self.radius)


class CircleShape(Shape):
    """A disc about (x, y)."""

    period_deg = 0.0
    is_mirrored = True
    size_key = "radius_mm"
    shape: Literal["circle"] = "circle"
    radius_mm: Annotated[float, SIZE] = 1.0
    """Radius of the disc."""

    @cached_property
    def outline(self) -> Circle:
        return Circle(np.array([self.x_mm, self.y_mm]) / 1e3, self.radius_mm / 1e3)
