"""Grids of meshio from meshes of six-node triangles, and files of these grids."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError, replace_file
from pvdf_fem.mesh.subdomains import FILM


class ExportError(FileError):
    """A solution or mesh cannot be written in a file format; the message says what to change."""


def make_masks(mesh: MeshTri2) -> dict[str, NDArray[np.int32]]:
    """Return an array of shape (elements,) for each patch by name, 1 inside and 0 outside.

    The patches are all subdomains of the mesh apart from the whole film.
    """
    masks = {}
    for name, elements in mesh.subdomains.items():
        if name != FILM:
            mask = np.zeros(mesh.nelements, dtype=np.int32)
            mask[elements] = 1
            masks[name] = mask
    return masks


def name_stress_components(stress: Array) -> dict[str, Array]:
    """Return S11, S22 and S12 of stresses in Pa, shape (n, 3), by the names of their arrays."""
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return {"S11_Pa": s11, "S22_Pa": s22, "S12_Pa": s12}


def import_meshio() -> Any:
    """Import and return meshio, only when it is needed: this takes a quarter of a second."""
    import meshio

    return meshio


def make_grid(
    mesh: MeshTri2, cell_data: Mapping[str, NDArray[Any]] | None = None, **data: Any
) -> Any:
    """Convert a mesh to a mesh of meshio, with z = 0 and counter-clockwise elements.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh in m of six-node triangles.
    cell_data : mapping of str to ndarray, shape (elements,), optional
        Values of the elements by name.
    **data
        Additional arguments of `meshio.Mesh`.

    Returns
    -------
    meshio.Mesh
    """
    points = np.column_stack([mesh.doflocs.T, np.zeros(mesh.doflocs.shape[1])])
    triangles = [("triangle6", orient_elements(mesh))]
    cell_lists = {name: [values] for name, values in (cell_data or {}).items()}
    return import_meshio().Mesh(points, triangles, cell_data=cell_lists, **data)


def orient_elements(mesh: MeshTri2) -> Indices:
    """Return the nodes of the elements, with those of clockwise elements in reverse order.

    Returns
    -------
    ndarray of int, shape (elements, 6)
        The vertices counter-clockwise, then the mid-side nodes in the same order.
    """
    nodes = np.asarray(mesh.dofs.element_dofs.T)
    a, b, c = mesh.doflocs.T[nodes[:, :3]].swapaxes(0, 1)
    x1, y1 = (b - a).T
    x2, y2 = (c - a).T
    is_clockwise = x1 * y2 < x2 * y1  # the signed area is negative
    return np.where(is_clockwise[:, None], nodes[:, [0, 2, 1, 5, 4, 3]], nodes)


def write_grid(grid: Any, path: Path, name: str, **options: Any) -> None:
    """Write a grid to a file by meshio; add its field data if it is a VTU file.

    Parameters
    ----------
    grid : meshio.Mesh
        The grid. For a VTU file, the names of its cell data are escaped in place.
    path : Path
        The file to write.
    name : str
        Name of the format in meshio.
    **options
        Keyword arguments of meshio's writer.

    Raises
    ------
    ExportError
        If meshio needs a library that is not installed.
    FileError
        If the file cannot be written.
    """
    if name == "vtu":  # meshio does not escape names for XML
        grid.cell_data = {_escape_xml(key): values for key, values in grid.cell_data.items()}
    try:
        with replace_file(path) as temporary:
            grid.write(temporary, file_format=name, **options)
            if name == "vtu" and grid.field_data:
                _add_field_data(temporary, grid.field_data)
    except ImportError as error:
        raise ExportError(
            f"{path}: meshio writes this format with {error.name}; run `pip install {error.name}`,"
            " or choose another extension"
        ) from error


def _escape_xml(name: str) -> str:
    """Return a name for an XML file, with markup and characters outside of ASCII escaped."""
    return escape(name).encode("ascii", "xmlcharrefreplace").decode()


def _add_field_data(path: Path, arrays: dict[str, Array]) -> None:
    """Insert arrays as field data into an existing VTU file, which meshio reads but cannot write.

    Parameters
    ----------
    path : Path
        The VTU file, which is changed.
    arrays : dict of str to ndarray, shape (n,)
        Arrays of 64-bit floats or of bytes by name.
    """
    # VTK's types by the kind of numpy's
    types = {"f": "Float64", "u": "UInt8"}
    elements = []
    for name, array in arrays.items():
        values = " ".join(map(str, array.tolist()))
        elements.append(
            f'<DataArray type="{types[array.dtype.kind]}" Name="{_escape_xml(name)}"'
            f' format="ascii" NumberOfTuples="{array.size}">{values}</DataArray>'
        )
    grid = "<UnstructuredGrid>"
    with_data = "\n".join([grid, "<FieldData>", *elements, "</FieldData>"])
    path.write_text(path.read_text("utf-8").replace(grid, with_data, 1), "utf-8")
