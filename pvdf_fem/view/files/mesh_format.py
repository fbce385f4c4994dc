"""The base class of mesh file formats."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.view.files.mesh_grid import MeshGrid

#: Names of triangles and lines in meshio, by order.
MESHIO_TRIANGLES = {1: "triangle", 2: "triangle6"}
MESHIO_LINES = {1: "line", 2: "line3"}


class MeshFormat(ABC):
    """A file format for a mesh with patches."""

    #: Extension of its files.
    extension: ClassVar[str]
    #: Order of each type of element that a file can name, by its name in the file; empty if files
    #: name no types. The first type of an order is its default.
    element_orders: ClassVar[dict[str, int]] = {}

    @abstractmethod
    def write(self, grid: MeshGrid, path: Path, element: str | None) -> None:
        """Write a mesh to a file, which is new or may be replaced.

        Parameters
        ----------
        grid : MeshGrid
            The mesh with its patches, in m.
        path : Path
            The file.
        element : str or None
            One of `element_orders` with the order of the grid; None if there are none.
        """

    def choose_element(self, order: int) -> str | None:
        """Choose the default type of elements of an order.

        Parameters
        ----------
        order : int
            1 or 2.

        Returns
        -------
        str or None
            A key of `element_orders`; None if files name no types.
        """
        for element, element_order in self.element_orders.items():
            if element_order == order:
                return element
        return None


def add_third_coordinate(points: Array) -> Array:
    """Add z = 0 to points of the plane.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
        The points.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    return np.column_stack([points, np.zeros(len(points))])


def import_meshio() -> Any:
    """Import and return meshio, only when it is needed: this takes a quarter of a second."""
    import meshio

    return meshio
