"""Export of solutions for other programs, by meshio."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray
from skfem import ElementTriP2, MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.files import replace_file
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.mesh.subdomains import FILM
from pvdf_fem.problem.contact_result import compute_contact_pressure
from pvdf_fem.view.files.export_error import ExportError
from pvdf_fem.view.files.mesh_grid import orient_elements


def write_vtu(film: FilmData, path: str | Path) -> None:
    """Write a solution as an unstructured grid of VTK, for ParaView.

    Parameters
    ----------
    film : FilmData
        The solution.
    path : path
        File to write, with the extension ``.vtu``.

    Raises
    ------
    ExportError
        If the path has another extension.
    FileError
        If the file cannot be written.

    Notes
    -----
    The grid is the undeformed film in m.

    Point data: ``displacement_m`` (Warp By Vector shows the deformed film); ``deflection_m``; the
    second Piola-Kirchhoff stress ``S11_Pa``, ``S22_Pa``, ``S12_Pa``, averaged by area over the
    elements around a node; ``principal_stress_Pa``, its larger principal value; and
    ``contact_pressure_Pa`` of indenter tips.

    Cell data: the stresses averaged over each element, and for each patch (``electrode A``,
    ``probe``) an array with 1 inside and 0 outside.

    Field data: ``charge_pC A`` and ``charge_error_pC A`` for every electrode, and as UTF-8 bytes
    ``scene_toml``, the scene, and ``included``, the included effects.
    """
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise ExportError(f"{path}: has no extension .vtu; give a name that ends in .vtu")
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
    """Return the field data that `write_vtu` describes, as arrays by name.

    Texts are arrays of UTF-8 bytes, and empty texts are left out.
    """
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
    """Compute S11, S22 and S12 in Pa, averaged over the area of each element.

    Returns
    -------
    ndarray, shape (elements, 3)
    """
    points = film.in_elements(film.equilibrium.space.basis.X)
    weights = film.equilibrium.space.weights[..., None]
    return 1e6 * (points.stress_MPa * weights).sum(axis=1) / weights.sum(axis=1)


def _compute_nodal_values(film: FilmData) -> tuple[Array, Array]:
    """Compute the displacements at the nodes, and the stresses averaged around each node.

    Returns
    -------
    displacement : ndarray, shape (nodes, 3)
        Displacements in m.
    stress : ndarray, shape (nodes, 3)
        Components S11, S22 and S12 in Pa: the mean, weighted by area, of the values that the
        elements around the node have there.
    """
    nodes = film.mesh.dofs.element_dofs.T
    points = film.in_elements(ElementTriP2.doflocs.T)
    displacement = np.zeros((film.mesh.doflocs.shape[1], 3))
    displacement[nodes] = 1e-3 * points.displacement_mm
    areas = film.equilibrium.space.weights.sum(axis=1)[:, None]
    components = np.moveaxis(1e6 * points.stress_MPa, -1, 0)
    averages = [_average_at_nodes(nodes, component, areas) for component in components]
    return displacement, np.stack(averages, axis=-1)


def _compute_nodal_pressure(film: FilmData) -> Array:
    """Compute the mean contact pressure in Pa of the elements around each node.

    Returns
    -------
    ndarray, shape (nodes,)
        The mean over the touching area of these elements, or zero if none of them is touched.
    """
    nodes = film.mesh.dofs.element_dofs.T
    weights = film.equilibrium.space.weights
    pressure = compute_contact_pressure(film.equilibrium, film.state)
    touched_areas = (weights * (pressure > 0.0)).sum(axis=1, keepdims=True)
    forces = (weights * pressure).sum(axis=1, keepdims=True)
    means = forces / np.where(touched_areas > 0.0, touched_areas, 1.0)
    return _average_at_nodes(nodes, means, touched_areas)


def _average_at_nodes(nodes: Indices, values: Array, areas: Array) -> Array:
    """Average the values of the elements around each node, weighted by area.

    Parameters
    ----------
    nodes : ndarray of int, shape (elements, 6)
        Nodes of the elements.
    values : ndarray, shape (elements, 6) or (elements, 1)
        Values of each element at its nodes, or one value of the whole element.
    areas : ndarray, shape (elements, 1)
        Areas of the elements, or of the parts of them that count.

    Returns
    -------
    ndarray, shape (nodes,)
        The averages, which are zero at nodes whose elements have zero area.
    """
    flat_nodes = nodes.ravel()
    weighted = np.broadcast_to(areas * values, nodes.shape).ravel()
    total_areas = np.bincount(flat_nodes, np.broadcast_to(areas, nodes.shape).ravel())
    totals = np.bincount(flat_nodes, weighted)
    return totals / np.where(total_areas > 0.0, total_areas, 1.0)


def _split_components(stress: Array) -> dict[str, Array]:
    """Return S11, S22 and S12 of stresses in Pa, shape (n, 3), by the names of their arrays."""
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return {"S11_Pa": s11, "S22_Pa": s22, "S12_Pa": s12}


def _make_masks(mesh: MeshTri2) -> dict[str, NDArray[np.int32]]:
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


def _import_meshio() -> Any:
    """Import and return meshio, only when it is needed: this takes a quarter of a second."""
    import meshio

    return meshio


def _make_grid(
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
    return _import_meshio().Mesh(points, triangles, cell_data=cell_lists, **data)


def _write_grid(grid: Any, path: Path, name: str, **options: Any) -> None:
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
