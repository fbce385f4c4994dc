"""The base class of shapes: the kind and the sizes of an outline, without its position.

To add a shape, write a class with its size keys and its outline in a file beside this one, and add
a line to `pvdf_fem.scene.registry`. Electrodes, patches and probes combine a shape with a position
and keys of their own (`pvdf_fem.scene.placed`).
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

#: Key of a size in the plane of the film.
SIZE = Key("mm", (1e-4, 1e5), Affects.OUTLINE)
#: Key of a coordinate in the plane of the film.
COORDINATE = Key("mm", (-1e5, 1e5), Affects.OUTLINE)


def make_size_key(example: Any) -> Key:
    """Make the key of a size in the plane of the film, with a value for the example scene file."""
    return replace(SIZE, example=example)


class Shape(Section):
    """A kind of outline with its sizes, relative to a reference point such as its centre."""

    shape: str
    """Name of the shape, which determines its size keys."""

    #: Smallest rotation in degrees that maps the shape onto itself; 0 if every rotation does.
    period_deg: ClassVar[float] = 360.0
    #: Whether the unrotated shape is its own mirror image about the y axis.
    is_mirror_symmetric: ClassVar[bool] = False

    @classmethod
    def list_sizes(cls) -> tuple[str, ...]:
        """Return the names of the size keys; error messages about the size name the first one."""
        return tuple(name for name in cls.model_fields if name != "shape")

    @abstractmethod
    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Outline:
        """Make the outline with the reference point at a point of the film.

        Parameters
        ----------
        x_mm, y_mm : float
            Position of the reference point in mm.
        rotation_deg : float
            Counter-clockwise rotation about the reference point in degrees.

        Returns
        -------
        Outline
            Outline in m.
        """

    @property
    def is_rectangle(self) -> bool:
        """Whether the unrotated shape is a rectangle with sides along x and y."""
        return False

    @property
    def outline(self) -> Outline:
        """Outline in m with the reference point at the origin, without a rotation."""
        return self.make_outline(0.0, 0.0, 0.0)


class PolygonalShape(Shape):
    """A shape with straight sides."""

    @abstractmethod
    def make_corners_mm(self) -> Array:
        """Make the corners in mm before the rotation, relative to the reference point.

        Returns
        -------
        ndarray, shape (n, 2)
        """

    def make_outline(self, x_mm: float, y_mm: float, rotation_deg: float) -> Polygon:
        """Make the outline from the rotated and moved corners; see `Shape.make_outline`."""
        rotated = rotate(self.make_corners_mm(), rotation_deg)
        return Polygon((rotated + np.array([x_mm, y_mm])) / 1e3)
