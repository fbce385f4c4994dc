"""Fields of a solution at the corners of triangles, averaged at points and in triangles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.electrodes.point_values import PointValues, evaluate_in_pairs
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.view.triangles.tessellation import Tessellation, tessellate

#: Factor on the weights of triangles outside electrodes, so small that they do not count beside
#: one inside.
OUTSIDE = 1e-12


@dataclass(frozen=True, eq=False)
class CornerFields:
    """Fields at the corners of triangles, evaluated in the element that contains each triangle.

    Stresses jump between elements. A point on a side of elements therefore has one value for each
    of the elements there: one row of the arrays below.
    """

    film: FilmData
    tessellation: Tessellation
    elements: Indices  #: Element of each row, shape (n,).
    local: Array  #: Local coordinates of each row in its element, shape (n, 2).
    points: Indices  #: Point of the tessellation of each row, shape (n,).
    rows: Indices  #: Rows of the corners of each triangle, shape (triangles, 3).
    values: PointValues  #: Fields, whose arrays begin with the axis (n,).

    @classmethod
    def from_film(cls, film: FilmData) -> CornerFields:
        """Tessellate a solution, and evaluate its fields at the corners of the triangles."""
        tessellation = tessellate(film)
        elements = np.repeat(tessellation.elements, 3)
        keys = elements * len(tessellation.points) + tessellation.corners.ravel()
        _, first, rows = np.unique(keys, return_index=True, return_inverse=True)
        local = tessellation.local.reshape(-1, 2)[first]
        return cls(
            film,
            tessellation,
            elements=elements[first],
            local=local,
            points=tessellation.corners.ravel()[first],
            rows=rows.reshape(-1, 3),
            values=evaluate_in_pairs(film.equilibrium, film.state, elements[first], local),
        )

    @cached_property
    def electrodes(self) -> dict[str, Indices]:
        """The triangles of each electrode by its name."""
        triangles = {}
        for name in self.film.charges_pC:
            elements = self.film.mesh.subdomains[make_subdomain_name(name)]
            triangles[name] = np.flatnonzero(np.isin(self.tessellation.elements, elements))
        return triangles

    @cached_property
    def _weights(self) -> Array:
        """Weights of triangles in averages at points, shape (triangles,).

        They are the areas. At a point on the outline of an electrode only the triangles inside
        count, so that integrals over the electrode are not affected by jumps of the stress there.
        """
        weights = OUTSIDE * self.tessellation.areas
        for triangles in self.electrodes.values():
            weights[triangles] = self.tessellation.areas[triangles]
        return weights

    def shift_to_integrals(self, at_points: Array, in_triangles: Array) -> Array:
        """Shift values at points so that their integrals over electrodes are those of triangles.

        Parameters
        ----------
        at_points : ndarray, shape (points, ...)
            Values at the points, which are interpolated linearly in triangles.
        in_triangles : ndarray, shape (triangles, ...)
            Mean values of the same field in the triangles.

        Returns
        -------
        ndarray, shape (points, ...)
            The values, with a constant added at all points of an electrode. The constant is the
            mean error of the linear interpolation.
        """
        shifted = at_points.copy()
        for triangles in self.electrodes.values():
            corners = self.tessellation.corners[triangles]
            areas = self.tessellation.areas[triangles]
            errors = in_triangles[triangles] - at_points[corners].mean(axis=1)
            shifted[np.unique(corners)] += np.average(errors, axis=0, weights=areas)
        return shifted

    def average_at_points(self, values: Array) -> Array:
        """Average values of rows at the points, weighted by the areas of the triangles around.

        At the outline of an electrode only the triangles inside count.

        Parameters
        ----------
        values : ndarray, shape (n, ...)
            A value for each row.

        Returns
        -------
        ndarray, shape (points, ...)
        """
        repeated = np.repeat(self._weights, 3)
        totals = np.bincount(self.rows.ravel(), repeated, len(self.points))
        weights = np.asarray(totals, dtype=np.float64)
        return _average(self.points, values, weights, count=len(self.tessellation.points))

    def average_triangles_at_points(self, values: Array) -> Array:
        """Average values of triangles at the points, with the weights of `average_at_points`.

        Parameters
        ----------
        values : ndarray, shape (triangles, ...)
            A value for each triangle.

        Returns
        -------
        ndarray, shape (points, ...)
        """
        repeated = np.repeat(values, 3, axis=0)
        return _average(
            self.tessellation.corners.ravel(),
            repeated,
            np.repeat(self._weights, 3),
            count=len(self.tessellation.points),
        )

    def average_in_triangles(self, values: Array) -> Array:
        """Average values of rows over the corners of each triangle.

        Parameters
        ----------
        values : ndarray, shape (n, ...)
            A value for each row.

        Returns
        -------
        ndarray, shape (triangles, ...)
        """
        return np.asarray(values[self.rows].mean(axis=1))

    def sum_over_elements(self, values: Array) -> Array:
        """Integrate values of triangles over the triangles of each element.

        Parameters
        ----------
        values : ndarray, shape (triangles,)
            A value for each triangle.

        Returns
        -------
        ndarray, shape (elements,)
            Values times m².
        """
        areas = self.tessellation.areas
        totals = np.bincount(self.tessellation.elements, areas * values, self.film.mesh.nelements)
        return np.asarray(totals, dtype=np.float64)

    def compute_mean_stress(self) -> Array:
        """Compute the mean stress of each triangle, with the integrals of the solution.

        Returns
        -------
        ndarray, shape (triangles, 3)
            S11, S22 and S12 in Pa. The mean over the corners is shifted in each element, so that
            stress times area, summed over the element's triangles, is the element's integral by its
            own quadrature: that of the charges.
        """
        film = self.film
        space = film.equilibrium.space
        stress = 1e6 * self.average_in_triangles(self.values.stress_MPa)
        at_quadrature = 1e6 * film.in_elements(space.basis.X).stress_MPa
        integrals = (at_quadrature * space.weights[..., None]).sum(axis=1)
        areas = self.sum_over_elements(np.ones(len(stress)))
        for i in range(3):
            missing = integrals[:, i] - self.sum_over_elements(stress[:, i])
            stress[:, i] += (missing / areas)[self.tessellation.elements]
        return stress


def _average(points: Indices, values: Array, weights: Array, *, count: int) -> Array:
    """Average values at points.

    Parameters
    ----------
    points : ndarray of int, shape (n,)
        The point to which each value belongs.
    values : ndarray, shape (n, ...)
        The values.
    weights : ndarray, shape (n,)
        Weights of the values.
    count : int
        Number of points.

    Returns
    -------
    ndarray, shape (count, ...)
    """
    columns = values.reshape(len(values), -1)
    totals = [np.bincount(points, weights * column, count) for column in columns.T]
    averages = np.stack(totals, axis=-1) / np.bincount(points, weights, count)[:, None]
    return averages.reshape(count, *values.shape[1:])
