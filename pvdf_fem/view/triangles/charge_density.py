"""The density of the charge in triangles, whose integral over an electrode is its charge."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.thickness import compute_element_thickness_charges
from pvdf_fem.film.loads.uneven_strain import UnevenStrain
from pvdf_fem.view.triangles.film_fields import CornerFields


class ChargeDensities(NamedTuple):
    """Charge densities of triangles, shape (triangles,)."""

    total: Array  #: Density of the total charge in C/m², on the whole film.
    #: Density of the charge that the load adds in C/m²; zero outside electrodes.
    change: Array


def compute_charge_densities(fields: CornerFields, mean_stress: Array) -> ChargeDensities:
    """Compute the charge densities of triangles.

    Parameters
    ----------
    fields : CornerFields
        The triangles and the solution.
    mean_stress : ndarray, shape (triangles, 3)
        Mean stress of each triangle in Pa, from `CornerFields.compute_mean_stress`.

    Returns
    -------
    ChargeDensities

    Notes
    -----
    The density is d31 S11 + d32 S22, with the parts due to d33 and to heat. Within an electrode it
    is shifted by a constant so that density times area, summed over its triangles, is the charge
    that the solution has. The shift is round-off for the observable ``material``, apart from the
    voltage of a wrinkling film and of a symmetric one, whose stress is uniform over the electrode.
    For ``thesis-edge``, whose charge is not an integral, it is the difference of both observables.
    The density of the unloaded film, which the change lacks, is the mean over the electrode.
    """
    film = fields.film
    total = mean_stress[:, 0] * film.scene.film.d31 + mean_stress[:, 1] * film.scene.film.d32
    total += _compute_thickness_density(fields) + _compute_heat_density(fields)
    change = np.zeros_like(total)
    areas = fields.tessellation.areas
    for name, triangles in fields.electrodes.items():
        area = areas[triangles].sum()
        mean = 1e-12 * film.charges_pC[name] / area
        total[triangles] += mean - np.average(total[triangles], weights=areas[triangles])
        change[triangles] = total[triangles] - 1e-12 * film.rest_charges_pC[name] / area
    return ChargeDensities(total, change)


def _compute_thickness_density(fields: CornerFields) -> Array:
    """Compute the part of the density due to d33 in C/m², uniform in each element."""
    film = fields.film
    if film.scene.film.d33_pC_N is None:
        return np.zeros(len(fields.rows))
    charges = compute_element_thickness_charges(film.equilibrium, film.state)
    areas = fields.sum_over_elements(np.ones(len(fields.rows)))
    return np.asarray((charges / areas)[fields.tessellation.elements])


def _compute_heat_density(fields: CornerFields) -> Array:
    """Compute the pyroelectric part of the density in C/m² at the centroids of the triangles."""
    scene = fields.film.scene
    warming = np.full(len(fields.rows), scene.film.warming_K or 0.0)
    uneven = UnevenStrain.from_scene(scene)
    if uneven is not None:
        corners = fields.tessellation.points[fields.tessellation.corners]
        warming += uneven.temperature(corners.mean(axis=1))
    return 1e-6 * (scene.film.pyroelectric_uC_m2K or 0.0) * warming
