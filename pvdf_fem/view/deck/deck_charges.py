"""Charges of the electrodes from the stresses that a program prints."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.deck.calculix_results import CalculixResults
from pvdf_fem.view.deck.section import make_sections
from pvdf_fem.view.files.mesh_grid import MeshGrid


def compute_deck_charges(
    scene: Scene, grid: MeshGrid, results: CalculixResults
) -> dict[str, float]:
    """Compute the charges of a scene's electrodes from the results of its deck.

    Parameters
    ----------
    scene : Scene
        The scene of the deck.
    grid : MeshGrid
        The mesh of the deck.
    results : CalculixResults
        Displacements and Cauchy stresses.

    Returns
    -------
    dict of str to float
        Charge in pC by the name of the electrode.

    Notes
    -----
    The charge is ∫ d₃₁ S₁₁ + d₃₂ S₂₂ dA over the undeformed electrode with the second
    Piola-Kirchhoff stress S. The program prints the Cauchy stress σ in the axes of space. With the
    deformation gradient F, shape (3, 2), its pseudo-inverse F⁺, and the ratio J of deformed to
    undeformed volume, S = J F⁺ σ F⁺ᵀ. J is √det FᵀF times the stretch √(1 + 2 E₃₃) across the film.
    """
    film = scene.film
    film_stress = np.zeros((len(grid.triangles), 3))
    areas = np.zeros(len(grid.triangles))
    is_read = np.zeros(len(grid.triangles), dtype=bool)
    patches = {}
    for electrode in scene.electrode_list:
        elements = grid.patches[make_subdomain_name(electrode.name)]
        patches[electrode.name] = elements
        is_read[elements] = True
    for section in make_sections(film, grid):
        elements = section.elements[is_read[section.elements]]
        if not len(elements):
            continue
        corners = grid.points[grid.triangles[elements]]
        sides = corners[:, 1:] - corners[:, :1]
        areas[elements] = 0.5 * np.abs(np.linalg.det(sides))
        nodes = grid.triangles[elements].ravel()
        displacements = results.select_displacements(nodes).reshape(-1, 3, 3)
        gradient = _compute_gradient(sides, displacements)
        stress = convert_cauchy_stress(
            results.select_stresses(elements),
            gradient,
            thickness_strain=results.select_thickness_strains(elements),
        )
        film_stress[elements] = section.compute_film_stress(stress, film)
    density = film_stress[:, :2] @ np.array([film.d31, film.d32])
    charges = {}
    for name, elements in patches.items():
        charges[name] = 1e12 * float(density[elements] @ areas[elements])
    return charges


def _compute_gradient(sides: Array, displacements: Array) -> Array:
    """Compute the displacement gradients of triangles, shape (n, 3, 2).

    Parameters
    ----------
    sides : ndarray, shape (n, 2, 2)
        Vectors in m from the first vertex to the others.
    displacements : ndarray, shape (n, 3, 3)
        Displacements of the vertices in m.
    """
    differences = displacements[:, 1:] - displacements[:, :1]
    transposed = np.linalg.solve(sides, differences)
    return np.asarray(transposed.swapaxes(1, 2), dtype=float)


def convert_cauchy_stress(stress: Array, gradient: Array, thickness_strain: Array) -> Array:
    """Convert Cauchy stresses of a membrane to second Piola-Kirchhoff stresses.

    Parameters
    ----------
    stress : ndarray, shape (n, 6)
        Cauchy stress xx, yy, zz, xy, xz, yz in the axes of space.
    gradient : ndarray, shape (n, 3, 2)
        Displacement gradient with respect to x and y.
    thickness_strain : ndarray, shape (n,)
        Green-Lagrange strain across the film.

    Returns
    -------
    ndarray, shape (n, 3)
        S11, S22, S12 in the unit of `stress`.
    """
    F = gradient + np.eye(3)[:, :2]
    xx, yy, zz, xy, xz, yz = stress.T
    rows = [np.stack(row, axis=-1) for row in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))]
    sigma = np.stack(rows, axis=-1)
    inverse = np.linalg.pinv(F)
    area_ratio = np.sqrt(np.linalg.det(F.swapaxes(1, 2) @ F))
    volume_ratio = area_ratio * np.sqrt(1.0 + 2.0 * thickness_strain)
    S = volume_ratio[:, None, None] * (inverse @ sigma @ inverse.swapaxes(1, 2))
    return np.stack([S[:, 0, 0], S[:, 1, 1], S[:, 0, 1]], axis=-1)
