"""Errors of a VTU file, as VTK samples and integrates it through pyvista."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem import Solution
from pvdf_fem.arrays import Array


class VtuErrors(NamedTuple):
    """Largest errors of what VTK computes from a file; relative unless the name has a unit."""

    points_missed: int  #: Random points of the film that are in no cell.
    deflection: float  #: At random points, divided by the largest deflection.
    film_area: float
    electrode_areas: float  #: Divided by the area of the electrode's elements in the mesh.
    charges: float  #: Integrals of the cells' charge density, divided by the largest charge.
    charge_changes: float  #: Those of the change, divided by the largest charge.
    charges_of_points: float  #: Integrals of the points' charge density, likewise.
    tip_force: float  #: Integral of the contact traction; zero without tips.
    #: Between neighbouring triangles, if the deflection is drawn as a quarter of the radius.
    largest_turn_deg: float
    bytes: int


def measure_vtu_errors(solution: Solution, path: Path, points: int) -> VtuErrors:
    """Write a solution to a VTU file, and compare what pyvista reads with the solution.

    `points` is the number of random points on the film at which the deflection is sampled.
    """
    import pyvista

    solution.to_vtu(path)
    grid = pyvista.read(path)
    radius = solution.scene.film.radius
    largest = max(1e-3 * solution.deflection_max_mm, 1e-12)

    places = _draw_points(points, radius)
    sampled = pyvista.PolyData(places).sample(grid)
    exact = 1e-3 * solution.at(*(1e3 * places[:, :2].T)).deflection_mm
    deflection = np.abs(sampled["deflection_m"] - exact).max() / largest

    force = sum(contact.force_N for contact in solution.contacts.values())
    integrals = grid.integrate_data().cell_data
    traction = float(integrals["contact_traction_Pa"][0]) if solution.contacts else 0.0
    areas, charges, changes, of_points = _compare_electrodes(solution, grid)
    return VtuErrors(
        points_missed=int((sampled["vtkValidPointMask"] == 0).sum()),
        deflection=float(deflection),
        film_area=abs(grid.area / (np.pi * radius**2) - 1.0),
        electrode_areas=areas,
        charges=charges,
        charge_changes=changes,
        charges_of_points=of_points,
        tip_force=abs(traction / force - 1.0) if solution.contacts else 0.0,
        largest_turn_deg=_measure_largest_turn(grid, 0.25 * radius / largest),
        bytes=path.stat().st_size,
    )


def _draw_points(count: int, radius: float) -> Array:
    """Random points in m, uniform on a disc around the origin, shape (count, 3)."""
    rng = np.random.default_rng(1)
    r = radius * np.sqrt(rng.random(count))
    angle = rng.uniform(0.0, 2.0 * np.pi, count)
    return np.column_stack([r * np.cos(angle), r * np.sin(angle), np.zeros(count)])


def _compare_electrodes(solution: Solution, grid: Any) -> Array:
    """The largest errors of areas, charges, changes, and charges by the data of points."""
    rows = []
    for electrode in solution.scene.electrode_list:
        name = electrode.name
        inside = grid.extract_cells(np.flatnonzero(grid.cell_data[f"electrode {name}"] == 1))
        integrals = inside.integrate_data()
        cells, of_points = integrals.cell_data, integrals.point_data
        meshed = solution.basis.dx[solution.mesh.subdomains[f"electrode {name}"]].sum()
        charge, change = solution.charges_pC[name], solution.charge_changes_pC[name]
        rows.append(
            [
                integrals["Area"][0] / meshed - 1.0,
                1e12 * cells["charge_density_C_m2"][0] - charge,
                1e12 * cells["charge_change_density_C_m2"][0] - change,
                1e12 * of_points["charge_density_C_m2"][0] - charge,
            ]
        )
    errors = np.abs(rows).max(axis=0)
    errors[1:] /= max(abs(charge) for charge in solution.charges_pC.values())
    return errors


def _measure_largest_turn(grid: Any, scale: float) -> float:
    """The largest angle in degrees between neighbouring triangles of the warped film."""
    warped = grid.warp_by_vector("displacement_m", factor=1.0)
    warped.points[:, 2] *= scale
    surface = warped.extract_surface(algorithm="dataset_surface")
    corners = surface.regular_faces
    a, b, c = surface.points[corners].swapaxes(0, 1)
    normals = np.cross(b - a, c - a)
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    sides = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=-1).reshape(-1, 2))
    _, number, count = np.unique(sides, axis=0, return_inverse=True, return_counts=True)
    order = number.argsort(kind="stable")
    first = np.searchsorted(number[order], np.flatnonzero(count == 2))
    pairs = order[np.stack([first, first + 1])] // 3
    cosines = (normals[pairs[0]] * normals[pairs[1]]).sum(axis=1)
    return float(np.degrees(np.arccos(cosines.clip(-1.0, 1.0))).max())
