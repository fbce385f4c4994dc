"""Solutions as VTU files, for VTK, ParaView and pyvista."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.files import replace_file
from pvdf_fem.view.files.export_error import ExportError
from pvdf_fem.view.files.linear_grid import make_linear_grid
from pvdf_fem.view.files.six_node_grid import make_six_node_grid
from pvdf_fem.view.files.vtk_mesh import escape_xml

#: The cells of a VTU file, see `write_vtu`.
VtuCells = Literal["linear", "six-node"]


def write_vtu(film: FilmData, path: str | Path, cells: VtuCells = "linear") -> None:
    """Write a solution as an unstructured grid of VTK.

    Parameters
    ----------
    film : FilmData
        The solution.
    path : path
        File to write, with the extension ``.vtu``.
    cells : {"linear", "six-node"}, optional
        ``"linear"`` writes linear triangles that tile the elements, for VTK. ``"six-node"`` writes
        the curved elements of the mesh, for programs that know them; VTK does not.

    Raises
    ------
    ExportError
        If the path has another extension.
    FileError
        If the file cannot be written.

    Notes
    -----
    The grid is the undeformed film in m.

    Linear triangles: every point of the film is in a triangle, since the polygon along the rim
    encloses the film. Its area is larger by less than 1e-4. Other curved outlines have polygons of
    the same area. The displacement differs from the solution's by at most 5e-4 of its maximum.

    Point data: ``displacement_m`` (Warp By Vector shows the deformed film); ``deflection_m``; the
    second Piola-Kirchhoff stress ``S11_Pa``, ``S22_Pa``, ``S12_Pa``, averaged by area over the
    triangles around a point; ``principal_stress_Pa``, its larger principal value;
    ``charge_density_C_m2``; and ``contact_pressure_Pa`` of indenter tips, per deformed area.

    Cell data are for integrals: value times area, summed over the triangles of a patch, is the
    integral of the solution. ``S11_Pa``, ``S22_Pa`` and ``S12_Pa``; ``charge_density_C_m2``, whose
    integral over an electrode is its charge in C; ``charge_change_density_C_m2``, for the charge
    that the load adds, and zero outside electrodes; ``contact_traction_Pa``, whose integral is the
    force of the tips along z in N; and for each patch (``electrode A``, ``probe``) an array with 1
    inside and 0 outside.

    Six-node triangles have the same arrays apart from those of charges and tractions.

    Field data: ``charge_pC A``, ``charge_error_pC A`` and ``rest_charge_pC A`` for every electrode,
    and as UTF-8 bytes ``scene_toml``, the scene, and ``included``, the included effects.
    """
    path = Path(path)
    if path.suffix.lower() != ".vtu":
        raise ExportError(f"{path}: has no extension .vtu; give a name that ends in .vtu")
    grid = make_linear_grid(film) if cells == "linear" else make_six_node_grid(film)
    # meshio does not escape names
    grid.cell_data = {escape_xml(name): values for name, values in grid.cell_data.items()}
    with replace_file(path) as temporary:
        grid.write(temporary, file_format="vtu")
        _add_field_data(temporary, _make_field_data(film))


def _make_field_data(film: FilmData) -> dict[str, Array]:
    """Return the field data that `write_vtu` describes, as arrays by name.

    Texts are arrays of UTF-8 bytes, and empty texts are left out.
    """
    data: dict[str, Any] = {}
    for name, charge in film.charges_pC.items():
        data[f"charge_pC {name}"] = np.array([charge])
    for name, charge in film.rest_charges_pC.items():
        data[f"rest_charge_pC {name}"] = np.array([charge])
    for name, error in film.charge_errors_pC.items():
        data[f"charge_error_pC {name}"] = np.array([error])
    texts = {"scene_toml": film.scene.to_toml(), "included": "\n".join(film.included)}
    for key, text in texts.items():
        if text:
            data[key] = np.frombuffer(text.encode(), dtype=np.uint8)
    return data


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
            f'<DataArray type="{types[array.dtype.kind]}" Name="{escape_xml(name)}"'
            f' format="ascii" NumberOfTuples="{array.size}">{values}</DataArray>'
        )
    grid = "<UnstructuredGrid>"
    with_data = "\n".join([grid, "<FieldData>", *elements, "</FieldData>"])
    path.write_text(path.read_text("utf-8").replace(grid, with_data, 1), "utf-8")
