"""Linear triangles that tile the curved elements of a solution.

Programs that draw or sample fields, such as VTK and matplotlib, interpolate linearly in triangles.
Elements have curved sides and shape functions up to degree 4. Each element is therefore subdivided
into as many linear triangles as the film's outline and its displacement need.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.electrodes.film_data import FilmData
from pvdf_fem.view.triangles.curved_sides import place_on_curved_sides
from pvdf_fem.view.triangles.element_points import interpolate_displacement
from pvdf_fem.view.triangles.subdivision import LIMITS, SubdivisionLimits, Triangles, subdivide


@dataclass(frozen=True, eq=False)
class Tessellation:
    """Linear triangles of the undeformed film, which conform across elements.

    The triangles of an element tile it, so that patches are unions of triangles. The whole film
    lies inside the polygon of all triangles, and a patch away from the rim has exactly the area
    that it has in the mesh.
    """

    points: Array  #: Corners of the triangles in m, shape (points, 2).
    displacement: Array  #: Displacement of the points in m, shape (points, 3).
    corners: Indices  #: Points of each triangle, counter-clockwise, shape (triangles, 3).
    elements: Indices  #: Element that each triangle is a part of, shape (triangles,).
    #: Local coordinates of the corners in this element, shape (triangles, 3, 2).
    local: Array

    @property
    def areas(self) -> Array:
        """Areas of the triangles in m², shape (triangles,)."""
        return compute_signed_areas(self.points[self.corners])


def tessellate(film: FilmData, limits: SubdivisionLimits = LIMITS) -> Tessellation:
    """Subdivide the elements of a solution into linear triangles.

    Parameters
    ----------
    film : FilmData
        The solution.
    limits : SubdivisionLimits, optional
        The accuracy of the triangles.

    Returns
    -------
    Tessellation
    """
    triangles = subdivide(film, limits)
    points, moved, owners = place_on_curved_sides(triangles, film.mesh, film.scene.film.outline)
    displacement = triangles.displacement.copy()
    if len(moved):
        displacement[moved] = interpolate_displacement(
            film, elements=owners.elements, local=owners.local
        )
    return _orient(triangles, points, displacement)


def _orient(triangles: Triangles, points: Array, displacement: Array) -> Tessellation:
    """Make a tessellation from triangles whose points were moved, counter-clockwise.

    Parameters
    ----------
    triangles : Triangles
        The triangles before their points were moved.
    points : ndarray, shape (points, 2)
        New places of the points in m.
    displacement : ndarray, shape (points, 3)
        Displacement there in m.
    """
    is_clockwise = compute_signed_areas(points[triangles.corners]) < 0.0
    order = np.where(is_clockwise[:, None], [0, 2, 1], [0, 1, 2])
    return Tessellation(
        points=points,
        displacement=displacement,
        corners=np.take_along_axis(triangles.corners, order, axis=1),
        elements=triangles.elements,
        local=np.take_along_axis(triangles.local, order[..., None], axis=1),
    )


def compute_signed_areas(corners: Array) -> Array:
    """Compute the areas of triangles, negative for clockwise ones.

    Parameters
    ----------
    corners : ndarray, shape (..., 3, 2)
        Corners of the triangles.

    Returns
    -------
    ndarray, shape (...)
    """
    x1, y1 = np.moveaxis(corners[..., 1, :] - corners[..., 0, :], -1, 0)
    x2, y2 = np.moveaxis(corners[..., 2, :] - corners[..., 0, :], -1, 0)
    return np.asarray(0.5 * (x1 * y2 - x2 * y1))
