"""Export of meshes for other programs, by meshio."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.subdomains import FILM, RIM
from pvdf_fem.view.files.grid import (
    ExportError,
    import_meshio,
    make_grid,
    make_masks,
    write_grid,
)


@dataclass(frozen=True)
class MeshFormat:
    """A file format for six-node triangles with patches.

    Parameters
    ----------
    name : str
        Name of the format in meshio.
    patches : {"arrays", "groups", "sets"}
        How the format stores patches: as cell data of 0 and 1 for each patch; as named groups
        without overlap, one for each combination of patches; or as named sets, which may overlap.
    options : tuple of tuple of str and value
        Names and values of keyword arguments of meshio's writer.
    """

    name: str
    patches: Literal["arrays", "groups", "sets"]
    options: tuple[tuple[str, Any], ...] = ()


#: Formats of `write_mesh` by extension.
FORMATS = {
    ".msh": MeshFormat("gmsh22", "groups", (("binary", False),)),
    ".inp": MeshFormat("abaqus", "sets"),
    ".vtu": MeshFormat("vtu", "arrays"),
    ".vtk": MeshFormat("vtk", "arrays"),
    # data in other forms than XML would need a second file
    ".xdmf": MeshFormat("xdmf", "arrays", (("data_format", "XML"),)),
}


def write_mesh(mesh: MeshTri2, path: str | Path) -> None:
    """Write a mesh with its patches, in the format that the extension of the path chooses.

    Parameters
    ----------
    mesh : MeshTri2
        A mesh of the film with its patches, in m.
    path : path
        The file to write, with an extension in `FORMATS`.

    Raises
    ------
    ExportError
        If the extension is unknown, if two electrodes would get the same name because blanks are
        replaced, or if meshio lacks a library for the format.
    FileError
        If the file cannot be written.

    Notes
    -----
    Points are in m with z = 0, elements are six-node triangles, counter-clockwise. Patches become:

    - ``.msh``: physical groups. An element of an MSH file has only one group, but a probe may press
      on an electrode. Combinations of patches are therefore groups: ``electrode A``, ``probe``,
      ``electrode A + probe``, ``film`` outside patches, and ``rim`` with three-node lines.
    - ``.inp``: element sets of the patches, which may overlap, and the node set ``rim``. Blanks in
      names become underscores.
    - ``.vtu``, ``.vtk``, ``.xdmf``: cell data, 1 inside a patch and 0 outside. Blanks in names
      become underscores in ``.vtk``.
    """
    path = Path(path)
    extension = path.suffix.lower()
    if extension not in FORMATS:
        raise ExportError(
            f"{path}: no format for six-node triangles with patches has the extension "
            f"{path.suffix!r}; choose from {' '.join(FORMATS)}"
        )
    file_format = FORMATS[extension]
    masks: dict[str, Any] = make_masks(mesh)
    if file_format.name in ("abaqus", "vtk"):
        masks = _replace_blanks(masks, path)
    data: dict[str, Any] = {}
    if file_format.patches == "arrays":
        data["cell_data"] = masks
    elif file_format.patches == "sets":
        data["cell_sets"] = {name: [np.flatnonzero(mask)] for name, mask in masks.items()}
        data["point_sets"] = {RIM: np.unique(_find_rim_lines(mesh))}
    grid = make_grid(mesh, **data)
    if file_format.patches == "groups":
        _add_groups(grid, mesh)
    write_grid(grid, path, file_format.name, **dict(file_format.options))


def _add_groups(grid: Any, mesh: MeshTri2) -> None:
    """Add the combinations of patches, and the rim, to a grid as gmsh's physical groups.

    Parameters
    ----------
    grid : meshio.Mesh
        The grid of `mesh`. The lines of the rim are added to its cells, and its cell data and field
        data are replaced.
    mesh : MeshTri2
        The mesh with its patches.
    """
    masks = make_masks(mesh)
    stacked = np.array(list(masks.values())).reshape(len(masks), -1)
    # the distinct combinations of patches, and for each element the index of its combination
    combinations, group = np.unique(stacked, axis=1, return_inverse=True)
    names = []
    for combination in combinations.T:
        patches = [name for name, inside in zip(masks, combination, strict=True) if inside]
        names.append(" + ".join(patches) if patches else FILM)
    rim = _find_rim_lines(mesh)
    rim_tag = len(names) + 1
    tags = [group.ravel() + 1, np.full(len(rim), rim_tag)]
    grid.cells.append(import_meshio().CellBlock("line3", rim))
    grid.cell_data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    # the tag and the dimension of each group
    grid.field_data = {name: np.array([tag, 2]) for tag, name in enumerate(names, start=1)}
    grid.field_data[RIM] = np.array([rim_tag, 1])


def _replace_blanks(masks: dict[str, Any], path: Path) -> dict[str, Any]:
    """Replace the blanks in the names of masks by underscores, and return the masks by new name.

    Parameters
    ----------
    masks : dict of str to ndarray
        The masks by name, which remain unchanged.
    path : Path
        The file to write, for the error message.

    Raises
    ------
    ExportError
        If two names become equal.
    """
    renamed = {re.sub(r"\s", "_", name): mask for name, mask in masks.items()}
    if len(renamed) < len(masks):
        raise ExportError(
            f"{path}: this format does not allow blanks in names, and without them two electrodes "
            "have the same name; rename an electrode"
        )
    return renamed


def _find_rim_lines(mesh: MeshTri2) -> Indices:
    """Return the nodes of the lines along the rim.

    Returns
    -------
    ndarray of int, shape (lines, 3)
        The two ends of each line, then the node in its middle.
    """
    facets = mesh.boundaries[RIM]
    return np.vstack([mesh.facets[:, facets], mesh.dofs.facet_dofs[0, facets]]).T
