"""Solutions and meshes as files for other programs, by meshio."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from skfem import ElementTriP2, MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.files import FileError, replace_file
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.mesh.subdomains import FILM, RIM
from pvdf_fem.problem.contact_result import compute_contact_pressure


class ExportError(FileError):
    """A format cannot hold a solution or a mesh; the text says what to change."""


def write_vtu(film: FilmData, path: str | Path) -> None:
    """Write a solution as an unstructured grid of VTK, for ParaView.

    Parameters
    ----------
    film : FilmData
        The solution.
    path : path
        File whose name ends in ``.vtu``.

    Raises
    ------
    ExportError
        For another ending.
    FileError
        For a file that cannot be written.

    Notes
    -----
    The grid is the reference disc in m.

    Point data: ``displacement_m``, which is cubic in between (Warp By Vector shows the deformed
    film); ``deflection_m``; the second Piola-Kirchhoff stress ``S11_Pa``, ``S22_Pa``, ``S12_Pa`` as
    the mean over the elements around a node by area; ``principal_stress_Pa``, its larger principal
    value; and ``contact_pressure_Pa`` of indenter tips.

    Cell data: the stresses averaged over an element, and for each patch an array of 0 and 1 of its
    name (``electrode A``, ``probe``).

    Field data: ``charge_pC A`` and ``charge_error_pC A`` for every electrode, and as UTF-8 bytes
    ``scene_toml``, the scene, and ``included``, the included effects.
    """
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise ExportError(f"{path}: is written as VTU; give a name that ends in .vtu")
    displacement, stress = _compute_nodal_values(film)
    point_data = {
        "displacement_m": displacement,
        "deflection_m": displacement[:, 2].copy(),
        **_split_components(stress),
        "principal_stress_Pa": compute_principal_values(stress)[1],
    }
    if film.contacts:
        point_data["contact_pressure_Pa"] = _compute_nodal_pressure(film)
    cell_data: dict[str, NDArray[Any]] = dict(_split_components(_compute_mean_stress(film)))
    cell_data |= _make_masks(film.mesh)
    grid = _make_grid(film.mesh, point_data=point_data, cell_data=cell_data)
    grid.field_data = _make_field_data(film)
    _write_grid(grid, path, "vtu")


def _make_field_data(film: FilmData) -> dict[str, Array]:
    """Return charges with their errors by electrode, and texts as the numbers of their bytes."""
    data: dict[str, Any] = {}
    for name, charge in film.charges_pC.items():
        data[f"charge_pC {name}"] = np.array([charge])
    for name, error in film.charge_errors_pC.items():
        data[f"charge_error_pC {name}"] = np.array([error])
    texts = {"scene_toml": film.scene.to_toml(), "included": "\n".join(film.included)}
    for key, text in texts.items():
        if text:
            data[key] = np.frombuffer(text.encode(), dtype=np.uint8)
    return data


def _compute_mean_stress(film: FilmData) -> Array:
    """Return the mean stress (elements, 3) of elements in Pa."""
    points = film.in_elements(film.equilibrium.space.basis.X)
    weights = film.equilibrium.space.weights[..., None]
    return 1e6 * (points.stress_MPa * weights).sum(axis=1) / weights.sum(axis=1)


def _compute_nodal_values(film: FilmData) -> tuple[Array, Array]:
    """Return displacement (nodes, 3) in m and averaged stress (nodes, 3) in Pa at the nodes."""
    nodes = film.mesh.dofs.element_dofs.T
    points = film.in_elements(ElementTriP2.doflocs.T)
    displacement = np.zeros((film.mesh.doflocs.shape[1], 3))
    displacement[nodes] = 1e-3 * points.displacement_mm
    areas = film.equilibrium.space.weights.sum(axis=1)[:, None]
    components = np.moveaxis(1e6 * points.stress_MPa, -1, 0)
    averages = [_average_at_nodes(nodes, component, areas) for component in components]
    return displacement, np.stack(averages, axis=-1)


def _compute_nodal_pressure(film: FilmData) -> Array:
    """Return the mean pressure (nodes,) of tips around nodes in Pa, zero beside tips."""
    nodes = film.mesh.dofs.element_dofs.T
    weights = film.equilibrium.space.weights
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    touched_areas = (weights * (pressure > 0.0)).sum(axis=1, keepdims=True)
    forces = (weights * pressure).sum(axis=1, keepdims=True)
    means = forces / np.where(touched_areas > 0.0, touched_areas, 1.0)
    return _average_at_nodes(nodes, means, touched_areas)


def _average_at_nodes(nodes: Indices, values: Array, areas: Array) -> Array:
    """Average values of elements about each node, weighted by area.

    Parameters
    ----------
    nodes : ndarray of int, shape (elements, 6)
        Nodes of the elements.
    values : ndarray, shape (elements, 6 or 1)
        Values at the nodes of an element, or of the whole element.
    areas : ndarray, shape (elements, 1)
        Areas of the elements.

    Returns
    -------
    ndarray, shape (nodes,)
    """
    flat_nodes = nodes.ravel()
    weighted = np.broadcast_to(areas * values, nodes.shape).ravel()
    total_areas = np.bincount(flat_nodes, np.broadcast_to(areas, nodes.shape).ravel())
    totals = np.bincount(flat_nodes, weighted)
    return totals / np.where(total_areas > 0.0, total_areas, 1.0)


def _split_components(stress: Array) -> dict[str, Array]:
    """Return the components of stresses (n, 3) by name."""
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return {"S11_Pa": s11, "S22_Pa": s22, "S12_Pa": s12}


@dataclass(frozen=True)
class MeshFormat:
    """A file format for six-node triangles with patches.

    Parameters
    ----------
    name : str
        meshio's name of the format.
    patches : {"arrays", "groups", "sets"}
        How the format holds patches: as cell data of 0 and 1 by patch; as named groups without
        overlap, one for each combination of patches; or as named sets, which may overlap.
    options : tuple of (str, value)
        Keyword arguments of meshio's writer.
    """

    name: str
    patches: Literal["arrays", "groups", "sets"]
    options: tuple[tuple[str, Any], ...] = ()


#: Formats by extension.
FORMATS = {
    ".msh": MeshFormat("gmsh22", "groups", (("binary", False),)),
    ".inp": MeshFormat("abaqus", "sets"),
    ".vtu": MeshFormat("vtu", "arrays"),
    ".vtk": MeshFormat("vtk", "arrays"),
    # other forms of data than XML would need a second file
    ".xdmf": MeshFormat("xdmf", "arrays", (("data_format", "XML"),)),
}


def write_mesh(mesh: MeshTri2, path: str | Path) -> None:
    """Write a mesh in the format of the path's extension (`FORMATS`).

    Parameters
    ----------
    mesh : MeshTri2
        A mesh of the film with its patches, in m.
    path : path
        The file.

    Raises
    ------
    ExportError
        For an unknown extension, or where meshio misses a library for the format.
    FileError
        For a file that cannot be written.

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
    masks: dict[str, Any] = _make_masks(mesh)
    if file_format.name in ("abaqus", "vtk"):
        masks = _replace_blanks(masks, path)
    data: dict[str, Any] = {}
    if file_format.patches == "arrays":
        data["cell_data"] = masks
    elif file_format.patches == "sets":
        data["cell_sets"] = {name: [np.flatnonzero(mask)] for name, mask in masks.items()}
        data["point_sets"] = {RIM: np.unique(_find_rim_lines(mesh))}
    grid = _make_grid(mesh, **data)
    if file_format.patches == "groups":
        _add_groups(grid, mesh)
    _write_grid(grid, path, file_format.name, **dict(file_format.options))


def _add_groups(grid: Any, mesh: MeshTri2) -> None:
    """Add gmsh's physical groups to a grid: combinations of patches, and the rim."""
    masks = _make_masks(mesh)
    stacked = np.array(list(masks.values())).reshape(len(masks), -1)
    combinations, group = np.unique(stacked, axis=1, return_inverse=True)
    names = []
    for combination in combinations.T:
        patches = [name for name, inside in zip(masks, combination, strict=True) if inside]
        names.append(" + ".join(patches) if patches else FILM)
    rim = _find_rim_lines(mesh)
    rim_tag = len(names) + 1
    tags = [group.ravel() + 1, np.full(len(rim), rim_tag)]
    grid.cells.append(_import_meshio().CellBlock("line3", rim))
    grid.cell_data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    # the tag and the dimension of each group
    grid.field_data = {name: np.array([tag, 2]) for tag, name in enumerate(names, start=1)}
    grid.field_data[RIM] = np.array([rim_tag, 1])


def _make_masks(mesh: MeshTri2) -> dict[str, NDArray[np.int32]]:
    """Return masks (elements,) of the patches by name: 1 in the patch and 0 elsewhere."""
    masks = {}
    for name, elements in mesh.subdomains.items():
        if name != FILM:
            mask = np.zeros(mesh.nelements, dtype=np.int32)
            mask[elements] = 1
            masks[name] = mask
    return masks


def _replace_blanks(masks: dict[str, Any], path: Path) -> dict[str, Any]:
    """Return masks by names without blanks; `ExportError` where two names become equal."""
    renamed = {re.sub(r"\s", "_", name): mask for name, mask in masks.items()}
    if len(renamed) < len(masks):
        raise ExportError(
            f"{path}: this format has no blanks in names, and without them two electrodes have "
            "one name; rename an electrode"
        )
    return renamed


def _find_rim_lines(mesh: MeshTri2) -> Indices:
    """Return the nodes (lines, 3) of the rim's three-node lines."""
    facets = mesh.boundaries[RIM]
    return np.vstack([mesh.facets[:, facets], mesh.dofs.facet_dofs[0, facets]]).T


def _import_meshio() -> Any:
    """Import meshio, which takes a quarter of a second."""
    import meshio

    return meshio


def _make_grid(
    mesh: MeshTri2, cell_data: Mapping[str, NDArray[Any]] | None = None, **data: Any
) -> Any:
    """Return a mesh as meshio's.

    Parameters
    ----------
    mesh : MeshTri2
        The mesh in m.
    cell_data : mapping of str to ndarray, shape (elements,), optional
        Values of the elements by name.
    **data
        Further data as meshio takes them.
    """
    points = np.column_stack([mesh.doflocs.T, np.zeros(mesh.doflocs.shape[1])])
    triangles = [("triangle6", _orient_elements(mesh))]
    cell_lists = {name: [values] for name, values in (cell_data or {}).items()}
    return _import_meshio().Mesh(points, triangles, cell_data=cell_lists, **data)


def _orient_elements(mesh: MeshTri2) -> Indices:
    """Return the nodes (elements, 6) counter-clockwise: the vertices, then the mid-side nodes."""
    nodes = np.asarray(mesh.dofs.element_dofs.T)
    a, b, c = mesh.doflocs.T[nodes[:, :3]].swapaxes(0, 1)
    x1, y1 = (b - a).T
    x2, y2 = (c - a).T
    is_clockwise = x1 * y2 < x2 * y1
    return np.where(is_clockwise[:, None], nodes[:, [0, 2, 1, 5, 4, 3]], nodes)


def _write_grid(grid: Any, path: Path, name: str, **options: Any) -> None:
    """Write meshio's grid to a file.

    Parameters
    ----------
    grid : meshio.Mesh
        The grid.
    path : Path
        The file.
    name : str
        meshio's name of the format.
    **options
        Arguments of meshio's writer.
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
    """Return a name for XML in ASCII."""
    return escape(name).encode("ascii", "xmlcharrefreplace").decode()


def _add_field_data(path: Path, arrays: dict[str, Array]) -> None:
    """Add arrays to a VTU file; meshio reads field data there, but does not write them."""
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
