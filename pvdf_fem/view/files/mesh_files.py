"""Writing a mesh with its patches to a file for another program."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from skfem import MeshTri2

from pvdf_fem.files import replace_file
from pvdf_fem.view.files.export_error import ExportError
from pvdf_fem.view.files.inp import Inp
from pvdf_fem.view.files.mesh_format import MeshFormat
from pvdf_fem.view.files.mesh_grid import TRIANGLE_NODES, MeshGrid
from pvdf_fem.view.files.msh import Msh22, Msh41
from pvdf_fem.view.files.vtk_mesh import VtkMesh, VtuMesh

#: Formats by name. The first one with the extension of a file is the default.
MESH_FORMATS: dict[str, MeshFormat] = {
    "msh": Msh41(),
    "msh22": Msh22(),
    "inp": Inp(),
    "vtu": VtuMesh(),
    "vtk": VtkMesh(),
}
#: Extensions of files that `write_mesh` can write.
MESH_EXTENSIONS = tuple(dict.fromkeys(form.extension for form in MESH_FORMATS.values()))
#: Advice for extensions that are no longer, or never were, written.
REPLACEMENTS = {
    ".xdmf": "write .vtu, which VTK, ParaView and pyvista open",
    ".vtp": "write .vtu, which VTK, ParaView and pyvista open",
    ".bdf": "write .msh, and convert it by `gmsh x.msh -save -o x.bdf`",
    ".unv": "write .msh, and convert it by `gmsh x.msh -save -o x.unv`",
    ".med": "write .msh, and convert it by `gmsh x.msh -save -o x.med`",
    ".mesh": "write .msh with order 1, which FreeFEM reads by gmshload",
}


class MeshFileStyle(NamedTuple):
    """How a mesh is written to a file."""

    file_format: MeshFormat
    order: int  #: Order of the elements: 1 for three nodes, 2 for six.
    element: str | None  #: Type of the elements that the file names; None if it names none.


def resolve_mesh_style(
    path: str | Path,
    file_format: str | None = None,
    order: int | None = None,
    element: str | None = None,
) -> MeshFileStyle:
    """Choose format, order and type of elements of a mesh file.

    Parameters
    ----------
    path : path
        The file to write; its extension chooses the format.
    file_format : str, optional
        A key of `MESH_FORMATS`, for an extension that has several.
    order : int, optional
        1 or 2; by default that of `element`, or else 2.
    element : str, optional
        Type of the elements in ``.inp`` files, in any case of letters.

    Returns
    -------
    MeshFileStyle

    Raises
    ------
    ExportError
        If the extension has no such format, or if the other values do not go together.
    """
    path = Path(path)
    chosen = MESH_FORMATS[_choose_format_name(path, file_format)]
    if order not in (None, *TRIANGLE_NODES):
        raise ExportError(f"order = {order}: must be 1 for three-node triangles or 2 for six-node")
    if element is None:
        order = order or 2
        return MeshFileStyle(chosen, order, chosen.choose_element(order))
    if not chosen.element_orders:
        reason = f"files {chosen.extension} name no types of elements"
        raise ExportError(f"element = {element}: {reason}; leave it out, or write .inp")
    name = element.upper()
    if name not in chosen.element_orders:
        types = ", ".join(chosen.element_orders)
        raise ExportError(
            f"element = {element}: is not a type that is written; choose from {types}"
        )
    if order not in (None, chosen.element_orders[name]):
        nodes = TRIANGLE_NODES[chosen.element_orders[name]]
        advice = f"leave order {order} out, or choose another type"
        raise ExportError(f"element = {element}: has {nodes} nodes; {advice}")
    return MeshFileStyle(chosen, chosen.element_orders[name], name)


def _choose_format_name(path: Path, file_format: str | None) -> str:
    """Return the name of the format of a path, or raise `ExportError`."""
    extension = path.suffix.lower()
    names = [name for name, form in MESH_FORMATS.items() if form.extension == extension]
    if not names:
        advice = REPLACEMENTS.get(extension, f"choose from {' '.join(MESH_EXTENSIONS)}")
        reason = f"no format of meshes is written with the extension {path.suffix!r}"
        raise ExportError(f"{path}: {reason}; {advice}")
    if file_format is None:
        return names[0]
    if file_format not in MESH_FORMATS:
        raise ExportError(
            f"format = {file_format}: is not known; choose from {', '.join(MESH_FORMATS)}"
        )
    if file_format not in names:
        wanted = MESH_FORMATS[file_format].extension
        raise ExportError(f"format = {file_format}: needs the extension {wanted}; rename {path}")
    return file_format


def write_mesh(
    mesh: MeshTri2,
    path: str | Path,
    *,
    file_format: str | None = None,
    order: int | None = None,
    element: str | None = None,
) -> None:
    """Write a mesh with its patches, in the format that the extension of the path chooses.

    Parameters
    ----------
    mesh : MeshTri2
        A mesh of the film with its patches, in m.
    path : path
        The file to write.
    file_format, order, element
        See `resolve_mesh_style`.

    Raises
    ------
    ExportError
        If the extension or another value cannot be used.
    FileError
        If the file cannot be written.

    Notes
    -----
    Points are in m with z = 0. Elements are counter-clockwise triangles with six nodes; of order 1
    they have three, and their sides are straight. Patches become:

    - ``.msh``: physical groups. Combinations of patches are groups, see `Msh41`.
    - ``.inp``: element sets, which may overlap, and the node set ``rim``. Names have only letters,
      digits, ``_`` and ``-``, see `make_labels`.
    - ``.vtu``, ``.vtk``: cell data, 1 inside a patch and 0 outside.
    """
    path = Path(path)
    style = resolve_mesh_style(path, file_format, order=order, element=element)
    grid = MeshGrid.from_mesh(mesh, style.order)
    with replace_file(path) as temporary:
        style.file_format.write(grid, temporary, style.element)
