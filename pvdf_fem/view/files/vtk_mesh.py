"""Meshes in VTK's formats: cells with an array of 0 and 1 for each patch."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from urllib.parse import quote
from xml.sax.saxutils import escape

from pvdf_fem.view.files.mesh_format import (
    MESHIO_TRIANGLES,
    MeshFormat,
    add_third_coordinate,
    import_meshio,
)
from pvdf_fem.view.files.mesh_grid import MeshGrid


class VtuMesh(MeshFormat):
    """An unstructured grid in XML; the patches are cell data, 1 inside and 0 outside."""

    extension = ".vtu"

    def write(self, grid: MeshGrid, path: Path, element: str | None) -> None:
        """Write the mesh by meshio, which does not escape names for XML."""
        masks = grid.make_masks()
        arrays = {escape_xml(name): mask for name, mask in masks.items()}
        make_meshio_grid(grid, arrays).write(path, file_format="vtu")


class VtkMesh(MeshFormat):
    """VTK's legacy format, whose names have blanks and other characters as ``%20``.

    VTK, and so ParaView and pyvista, decode them.
    """

    extension = ".vtk"

    def write(self, grid: MeshGrid, path: Path, element: str | None) -> None:
        """Write the mesh by meshio in version 4.2, which all versions of VTK read."""
        masks = grid.make_masks()
        arrays = {quote(name, safe=""): mask for name, mask in masks.items()}
        make_meshio_grid(grid, arrays).write(path, file_format="vtk42")


def escape_xml(name: str) -> str:
    """Escape markup and characters outside of ASCII for an XML file.

    Parameters
    ----------
    name : str
        Such as ``electrode Ä``.

    Returns
    -------
    str
    """
    return escape(name).encode("ascii", "xmlcharrefreplace").decode()


def make_meshio_grid(grid: MeshGrid, cell_data: dict[str, Any]) -> Any:
    """Convert a grid to one of meshio.

    Parameters
    ----------
    grid : MeshGrid
        The mesh.
    cell_data : dict of str to ndarray, shape (elements,)
        Values of the triangles by name.

    Returns
    -------
    meshio.Mesh
    """
    triangles = [(MESHIO_TRIANGLES[grid.order], grid.triangles)]
    lists = {name: [values] for name, values in cell_data.items()}
    points = add_third_coordinate(grid.points)
    return import_meshio().Mesh(points, triangles, cell_data=lists)
