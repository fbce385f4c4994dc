"""A solution on linear triangles, which VTK, ParaView and pyvista draw, sample and integrate."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.film.membrane import compute_principal_values
from pvdf_fem.view.files.mesh_format import add_third_coordinate, import_meshio
from pvdf_fem.view.files.mesh_grid import MeshGrid
from pvdf_fem.view.triangles.charge_density import compute_charge_densities
from pvdf_fem.view.triangles.contact_fields import compute_contact_fields
from pvdf_fem.view.triangles.film_fields import CornerFields


def make_linear_grid(film: FilmData) -> Any:
    """Make a grid of linear triangles that tile the elements of a solution, with its fields.

    Parameters
    ----------
    film : FilmData
        The solution.

    Returns
    -------
    meshio.Mesh
        Points in m with z = 0, and the fields that `pvdf_fem.view.files.vtu.write_vtu` lists.
    """
    fields = CornerFields.from_film(film)
    tessellation = fields.tessellation
    displacement = tessellation.displacement
    mean_stress = fields.compute_mean_stress()
    densities = compute_charge_densities(fields, mean_stress)
    stress = fields.average_at_points(1e6 * fields.values.stress_MPa)
    stress = fields.shift_to_integrals(stress, mean_stress)
    density = _average_density(fields, mean_stress, densities.total)
    point_data = {
        "displacement_m": displacement,
        "deflection_m": displacement[:, 2].copy(),
        **name_stress_components(stress),
        "principal_stress_Pa": compute_principal_values(stress)[1],
        "charge_density_C_m2": fields.shift_to_integrals(density, densities.total),
    }
    cell_data: dict[str, NDArray[Any]] = {
        **name_stress_components(mean_stress),
        "charge_density_C_m2": densities.total,
        "charge_change_density_C_m2": densities.change,
    }
    if film.contacts:
        contact = compute_contact_fields(fields)
        point_data["contact_pressure_Pa"] = fields.average_at_points(contact.pressure)
        cell_data["contact_traction_Pa"] = contact.traction
    for name, mask in MeshGrid.from_mesh(film.mesh).make_masks().items():
        cell_data[name] = mask[tessellation.elements]
    return import_meshio().Mesh(
        add_third_coordinate(tessellation.points),
        [("triangle", tessellation.corners.astype(np.int32))],
        point_data={name: _shorten(name, values) for name, values in point_data.items()},
        cell_data={name: [_shorten(name, values)] for name, values in cell_data.items()},
    )


def _shorten(name: str, values: NDArray[Any]) -> NDArray[Any]:
    """Return the values of an array with fewer digits if that loses nothing.

    Displacements keep all digits. Stresses and densities get 7 digits, which are more than the
    solution has, and masks one byte: this halves the file.
    """
    if name in ("displacement_m", "deflection_m"):
        return values
    return values.astype(np.float32 if values.dtype.kind == "f" else np.int8)


def _average_density(fields: CornerFields, mean_stress: Array, density: Array) -> Array:
    """Average the charge density at the points in C/m², shape (points,).

    Parameters
    ----------
    fields : CornerFields
        The corners of the triangles, with the stress.
    mean_stress : ndarray, shape (triangles, 3)
        Mean stress of each triangle in Pa.
    density : ndarray, shape (triangles,)
        Density of the total charge in each triangle in C/m².

    Notes
    -----
    The part due to stress is evaluated at the corners; the others are known for triangles only.
    """
    film = fields.film.scene.film
    others = density - film.d31 * mean_stress[:, 0] - film.d32 * mean_stress[:, 1]
    by_stress = 1e-6 * fields.values.charge_density_pC_mm2
    return fields.average_at_points(by_stress) + fields.average_triangles_at_points(others)


def name_stress_components(stress: Array) -> dict[str, Array]:
    """Return S11, S22 and S12 of stresses in Pa, shape (n, 3), by the names of their arrays."""
    s11, s22, s12 = np.moveaxis(stress, -1, 0)
    return {"S11_Pa": s11, "S22_Pa": s22, "S12_Pa": s12}
