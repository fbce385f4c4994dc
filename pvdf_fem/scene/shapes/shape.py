"""The base of shapes: the form and the sizes of an outline, without a place.

A shape is a class in a file of its own beside this one, with its size keys and its outline, and a
line in `pvdf_fem.scene.registry`. Electrodes, patches and probes have a shape, and add a place and
keys of their own (`pvdf_fem.scene.placed`).
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.keys import Affects, Key, Section
from pvdf_fem.scene.outlines.outline import Outline, rotate
from pvdf_fem.scene.outlines.polygon import Polygon

#: A size in the plane of the film.
SIZE = Key("mm", (1e-4, 1e5), Affects.OUTLINE)
#: A coordinate in the plane of the film.
PLACE = Key("mm", (-1e5, 1e5), Affects.OUTLINE)


def make_size_key(example: Any) -> Key:
    """Make the key of a size in the plane of the film, with a value for the example scene."""
    return replace(SIZE, example=example)


class Shape(Section):
    """A form with its sizes; its reference point is the origin."""

    shape: str
    """The shape, which has sizes of its own."""

    #: The smallest rotation that maps the shape onto itself, in degrees; 0 if every rotation does.
    period_deg: ClassVar[float] = 360.0
    #: Whether the unrotated shape is its own mirror image about the y axis.
    is_mirror_symmetric: ClassVar[bool] = False
    #: Whether the unrotated shape is a rectangle with sides along x and y.
    is_rectangle: ClassVar[bool] = False

    @classmethod
    def list_sizes(cls) -> tuple[str, ...]:
        """Return the size keys, the one that scales the whole shape first."""
        return tuple(name for name in cls.model_fields if name != "shape")

    @abstractmethod
    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Outline:
        """Make the outline with the reference point at a place.

        Parameters
        ----------
        x_mm, y_mm : float
            Place of the reference point in mm.
        rotation_deg : float
            Counter-clockwise rotation about the reference point.

        Returns
        -------
        Outline
            In m.
        """

    @property
    def outline(self) -> Outline:
        """Outline in m about the origin, with its area, centroid, corners and boundary pieces."""
        return self.make_outline(0.0, 0.0, 0.0)


class PolygonalShape(Shape):
    """A shape with straight sides."""

    @abstractmethod
    def make_corners_mm(self) -> Array:
        """Make the corners (n, 2) in mm of the unrotated shape about its reference point."""

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Polygon:
        """Make the outline with the reference point at a place; see `Shape.make_outline`."""
        rotated = rotate(self.make_corners_mm(), rotation_deg)
        return Polygon((rotated + np.array([x_mm, y_mm])) / 1e3)
