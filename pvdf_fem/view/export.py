"""Solutions and meshes as files for further programs, by meshio."""

from __future__ import annotations

import re
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
from pvdf_fem.mesh.gmsh_mesh import FILM, RIM
from pvdf_fem.problem.contact_result import compute_contact_pressure


class ExportError(FileError):
    """A format cannot hold a solution or a mesh; the text says what to change."""


def write_vtu(film: FilmData, path: str | Path) -> None:
    """Write a solution as an unstructured grid of VTK, on the reference disc in m, for ParaView.

    Point data: ``displacement_m``, which is cubic in between (Warp By Vector shows the deformed
    film); ``deflection_m``; ``S11_Pa``, ``S22_Pa``, ``S12_Pa``, the second Piola-Kirchhoff stress
    as the mean over the elements around a node by area; ``principal_stress_Pa``, its larger
    principal value; and ``contact_pressure_Pa`` of tips. Cell data: the stresses averaged over an
    element, and for each patch an array of 0 and 1 of its name (``electrode A``, ``probe``). Field
    data: ``charge_pC A`` and ``charge_error_pC A`` for every electrode, and as UTF-8 bytes
    ``scene_toml``, the scene, and ``included``. Raises `ExportError` for another ending than
    ``.vtu``, and `FileError` for a file that cannot be written.
    """
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise ExportError(f"{path}: is written as VTU; give a name that ends in .vtu")
    displacement, nodal = _at_nodes(film)
    at = film.in_elements(film.equilibrium.space.basis.X)
    weights = film.equilibrium.space.weights[..., None]
    mean = 1e6 * (at.stress_MPa * weights).sum(axis=1) / weights.sum(axis=1)
    point_data = {"displacement_m": displacement, "deflection_m": displacement[:, 2].copy()}
    point_data |= {**_components(nodal), "principal_stress_Pa": compute_principal_values(nodal)[1]}
    if film.contacts:
        point_data["contact_pressure_Pa"] = _contact_pressure(film)
    cell_data = {**_components(mean), **_masks(film.mesh)}
    grid = _grid(film.mesh, point_data=point_data, cell_data=cell_data)
    grid.field_data = _field_data(film)
    _write(grid, path, "vtu")


def _field_data(film: FilmData) -> dict[str, Array]:
    """Charges with their errors by electrode, and the scene, which meshio reads as numbers only."""
    tables = {"charge_pC": film.charges_pC, "charge_error_pC": film.charge_errors_pC}
    values = {
        f"{key} {name}": np.array([value])
        for key, table in tables.items()
        for name, value in table.items()
    }
    texts = {"scene_toml": film.scene.to_toml(), "included": "\n".join(film.included)}
    told = {key: np.frombuffer(t.encode(), dtype=np.uint8) for key, t in texts.items() if t}
    return {**values, **told}


def _at_nodes(film: FilmData) -> tuple[Array, Array]:
    """Displacement (nodes, 3) and averaged stress (nodes, 3) at the nodes of the mesh."""
    nodes, at = film.mesh.dofs.element_dofs.T, film.in_elements(ElementTriP2.doflocs.T)
    displacement = np.zeros((film.mesh.doflocs.shape[1], 3))
    displacement[nodes] = 1e-3 * at.displacement_mm
    areas = film.equilibrium.space.weights.sum(axis=1)[:, None]
    parts = np.moveaxis(1e6 * at.stress_MPa, -1, 0)
    return displacement, np.stack([_means(nodes, part, areas) for part in parts], axis=-1)


def _contact_pressure(film: FilmData) -> Array:
    """Mean tip pressure in the elements around nodes, zero beside tips, (nodes,)."""
    nodes = film.mesh.dofs.element_dofs.T
    weights = film.equilibrium.space.weights
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    areas = (weights * (pressure > 0.0)).sum(axis=1, keepdims=True)
    total = (weights * pressure).sum(axis=1, keepdims=True)
    return _means(nodes, total / np.where(areas > 0.0, areas, 1.0), areas)


def _means(nodes: Indices, values: Array, areas: Array) -> Array:
    """Means by area about each node, (nodes,), of values in elements, (elements, 6 or 1)."""
    at, weighted = nodes.ravel(), np.broadcast_to(areas * values, nodes.shape)
    around = np.bincount(at, np.broadcast_to(areas, nodes.shape).ravel())
    return np.bincount(at, weighted.ravel()) / np.where(around > 0.0, around, 1.0)


def _components(stress: Array) -> dict[str, Array]:
    return dict(zip(("S11_Pa", "S22_Pa", "S12_Pa"), np.moveaxis(stress, -1, 0), strict=True))


@dataclass(frozen=True)
class MeshFormat:
    """A file format and the way it holds patches."""

    name: str  #: Name that meshio has for the format.
    #: ``arrays`` for 0/1 cell data by patch; ``groups`` for named groups without overlap, one
    #: for each combination of patches; ``sets`` for named sets, which may overlap.
    patches: Literal["arrays", "groups", "sets"]
    #: Keyword arguments for meshio's writer.
    options: tuple[tuple[str, Any], ...] = ()


#: meshio's formats for six-node triangles and patches, by extension.
FORMATS = {
    ".msh": MeshFormat("gmsh22", "groups", (("binary", False),)),
    ".inp": MeshFormat("abaqus", "sets"),
    ".vtu": MeshFormat("vtu", "arrays"),
    ".vtk": MeshFormat("vtk", "arrays"),
    ".xdmf": MeshFormat("xdmf", "arrays", (("data_format", "XML"),)),  # the others: in two files
}


def write_mesh(mesh: MeshTri2, path: str | Path) -> None:
    """Write a mesh from `mesh_scene` in the format for the path's extension (`FORMATS`).

    Points are in m with z = 0, elements six-node triangles, counter-clockwise. Patches become:

    - ``.msh``: physical groups. An element of an MSH file has only one group, but a probe may press
      on an electrode. Combinations of patches are therefore groups: ``electrode A``, ``probe``,
      ``electrode A + probe``, ``film`` outside patches, and ``rim`` with three-node lines.
    - ``.inp``: element sets of the patches, which may overlap, and the node set ``rim``. Blanks in
      names become underscores.
    - ``.vtu``, ``.vtk``, ``.xdmf``: cell data, 1 inside a patch and 0 outside. Blanks in names
      become underscores in ``.vtk``.

    Raises `ExportError` when there is no such format, or meshio lacks a library for it, and
    `FileError` when the file cannot be written.
    """
    path = Path(path)
    if (file_format := FORMATS.get(path.suffix.lower())) is None:
        raise ExportError(
            f"{path}: no format for six-node triangles with patches has the extension "
            f"{path.suffix!r}; choose from {' '.join(FORMATS)}"
        )
    patches = _masks(mesh)
    if file_format.name in ("abaqus", "vtk"):
        patches = _without_blanks(patches, path)
    data: dict[str, Any] = {}
    if file_format.patches == "arrays":
        data["cell_data"] = patches
    elif file_format.patches == "sets":
        data["cell_sets"] = {name: [np.flatnonzero(mask)] for name, mask in patches.items()}
        data["point_sets"] = {RIM: np.unique(_rim(mesh))}
    grid = _grid(mesh, **data)
    if file_format.patches == "groups":
        _add_groups(grid, mesh)
    _write(grid, path, file_format.name, **dict(file_format.options))


def _add_groups(grid: Any, mesh: MeshTri2) -> None:
    """Add gmsh's physical groups: combinations of patches, and the rim."""
    patches = _masks(mesh)
    combinations, group = np.unique(
        np.array([*patches.values()]).reshape(len(patches), -1), axis=1, return_inverse=True
    )
    names = [
        " + ".join(name for name, inside in zip(patches, column, strict=True) if inside) or FILM
        for column in combinations.T
    ]
    rim = _rim(mesh)
    tags = [group.ravel() + 1, np.full(len(rim), len(names) + 1)]
    grid.cells.append(_meshio().CellBlock("line3", rim))
    grid.cell_data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
    dimensions = {name: (tag, 2) for tag, name in enumerate(names, start=1)}
    dimensions[RIM] = (len(names) + 1, 1)
    grid.field_data = {name: np.array(value) for name, value in dimensions.items()}


def _masks(mesh: MeshTri2) -> dict[str, NDArray[np.int32]]:
    """Masks of the patches by name, (elements,): 1 in the patch and 0 elsewhere."""
    masks = {}
    for name, elements in mesh.subdomains.items():
        if name != FILM:
            masks[name] = np.zeros(mesh.nelements, dtype=np.int32)
            masks[name][elements] = 1
    return masks


def _without_blanks(patches: dict[str, Any], path: Path) -> dict[str, Any]:
    renamed = {re.sub(r"\s", "_", name): mask for name, mask in patches.items()}
    if len(renamed) < len(patches):
        raise ExportError(
            f"{path}: this format has no blanks in names, and without them two electrodes have "
            "one name; rename an electrode"
        )
    return renamed


def _rim(mesh: MeshTri2) -> Indices:
    """Nodes of the rim's three-node lines, (lines, 3)."""
    facets = mesh.boundaries[RIM]
    return np.vstack([mesh.facets[:, facets], mesh.dofs.facet_dofs[0, facets]]).T


def _meshio() -> Any:
    import meshio  # takes a quarter of a second

    return meshio


def _grid(mesh: MeshTri2, **data: Any) -> Any:
    """The mesh as meshio's; `cell_data` has one array for each name."""
    points = np.column_stack([mesh.doflocs.T, np.zeros(mesh.doflocs.shape[1])])
    cell_data = {name: [values] for name, values in data.pop("cell_data", {}).items()}
    triangles = [("triangle6", _counter_clockwise(mesh))]
    return _meshio().Mesh(points, triangles, cell_data=cell_data, **data)


def _counter_clockwise(mesh: MeshTri2) -> Indices:
    """Nodes of the elements, (elements, 6): the vertices, then the middles of the sides."""
    nodes = np.asarray(mesh.dofs.element_dofs.T)
    a, b, c = mesh.doflocs.T[nodes[:, :3]].swapaxes(0, 1)
    (x1, y1), (x2, y2) = (b - a).T, (c - a).T
    return np.where((x1 * y2 < x2 * y1)[:, None], nodes[:, [0, 2, 1, 5, 4, 3]], nodes)


def _write(grid: Any, path: Path, name: str, **options: Any) -> None:
    if name == "vtu":  # meshio writes names into the XML as they are
        grid.cell_data = {_xml(key): values for key, values in grid.cell_data.items()}
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


def _xml(name: str) -> str:
    return escape(name).encode("ascii", "xmlcharrefreplace").decode()


def _add_field_data(path: Path, arrays: dict[str, Array]) -> None:
    """Add arrays to a VTU file in VTK's form; meshio reads but does not write these arrays."""
    types = {"f": "Float64", "u": "UInt8"}
    texts = [
        f'<DataArray type="{types[array.dtype.kind]}" Name="{_xml(name)}" format="ascii"'
        f' NumberOfTuples="{array.size}">{" ".join(map(str, array.tolist()))}</DataArray>'
        for name, array in arrays.items()
    ]
    grid = "<UnstructuredGrid>"
    added = "\n".join([grid, "<FieldData>", *texts, "</FieldData>"])
    path.write_text(path.read_text("utf-8").replace(grid, added, 1), "utf-8")
