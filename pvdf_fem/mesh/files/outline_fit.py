"""Checks that a mesh follows the outlines of a scene."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.subdomains import FILM
from pvdf_fem.scene.outlines.outline import Outline


def require_rim(mesh: MeshTri2, rim: Outline, slack: float) -> None:
    """Raise `MeshFileError` unless the boundary sides of a mesh are on the rim.

    Holes and cracks inside the film have boundary sides off the rim.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m about the film's centre.
    rim : Outline
        Outline of the film.
    slack : float
        Maximum distance from the rim as a fraction of the film's hydraulic radius.
    """
    border = mesh.facets[:, mesh.boundary_facets()]
    ends = mesh.p[:, border].reshape(2, -1).T
    rim_distances = np.abs(rim.compute_signed_distances(ends)).reshape(2, -1).max(axis=0)
    is_off_rim = rim_distances > slack * rim.hydraulic_radius
    if is_off_rim.any():
        raise MeshFileError(
            f"has {is_off_rim.sum()} sides inside the film with only one triangle; give the whole"
            " film, whose parts share the nodes on their outlines (gmsh: BooleanFragments,"
            " Coherence Mesh)"
        )


def find_triangles_inside(
    vertices: Array, centroids: Array, outline: Outline, slack: float
) -> Mask:
    """Find the triangles inside an outline that a mesh follows.

    Parameters
    ----------
    vertices : ndarray, shape (elements, 3, 2)
        Vertices of the triangles in m.
    centroids : ndarray, shape (elements, 2)
        Centroids of the triangles in m.
    outline : Outline
        The outline.
    slack : float
        Vertices within this fraction of the square root of the outline's area are on it.

    Returns
    -------
    ndarray of bool, shape (elements,)

    Notes
    -----
    The centroid of a triangle outside of an arc may be between the arc and its chord. Beside curved
    outlines, the vertex farthest from the outline shows on which side the triangle is.
    """
    is_inside = outline.compute_signed_distances(centroids) < 0.0
    if outline.is_curved:
        distances = outline.compute_signed_distances(vertices.reshape(-1, 2)).reshape(-1, 3)
        farthest = np.abs(distances).argmax(axis=1)[:, None]
        distance = np.take_along_axis(distances, farthest, axis=1)[:, 0]
        is_off = np.abs(distance) > slack * np.sqrt(outline.area)
        is_inside[is_off] = distance[is_off] < 0.0
    return is_inside


def find_elements_inside(
    mesh: MeshTri2, outlines: dict[str, Outline], slack: float
) -> dict[str, Indices]:
    """Find the elements inside each outline.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m about the film's centre.
    outlines : dict of str to Outline
        The outlines by name.
    slack : float
        See `find_triangles_inside`.

    Returns
    -------
    dict of str to ndarray of int
        Indices of the elements, by the name of the outline.
    """
    centroids = mesh.mapping().F(np.full((2, 1), 1.0 / 3.0))[:, :, 0].T
    vertices = mesh.p.T[mesh.t.T]
    elements = {}
    for name, outline in outlines.items():
        is_inside = find_triangles_inside(vertices, centroids, outline=outline, slack=slack)
        elements[name] = np.flatnonzero(is_inside)
    return elements


class _Moments(NamedTuple):
    """Areas and first moments, from which areas and centroids of unions of elements follow."""

    #: Area in m² that each quadrature point stands for, shape (elements, points). The areas of the
    #: points of an element add up to the area of the element.
    point_areas: Array
    first_moments: Array  #: Integrals of x and y over each element in m³, shape (2, elements).


def _compute_moments(mesh: MeshTri2) -> _Moments:
    """Compute the areas of quadrature points and the first moments of elements.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    """
    local, weights = get_quadrature(mesh.elem.refdom, 4)
    mapping = mesh.mapping()
    point_areas = np.abs(mapping.detDF(local)) * weights
    first_moments = (mapping.F(local) * point_areas).sum(axis=-1)
    return _Moments(point_areas, first_moments)


def list_outline_errors(
    mesh: MeshTri2,
    outlines: dict[str, Outline],
    elements_inside: dict[str, Indices],
    slack: float,
) -> Iterator[str]:
    """Yield an error message for each outline that the mesh does not follow.

    A mesh follows an outline if the elements inside it have its area, centroid and boundary.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    outlines : dict of str to Outline
        Outlines of the film and all subdomains by name. Outlines that extend beyond the rim are not
        checked.
    elements_inside : dict of str to ndarray of int
        Elements inside each outline.
    slack : float
        Relative tolerance; see `pvdf_fem.mesh.mesh_file.read_mesh`.

    Yields
    ------
    str
        A line with the area of the outline and that of the elements inside.
    """
    moments = _compute_moments(mesh)
    largest_reach = (1.0 + slack) * outlines[FILM].reach
    for name, outline in outlines.items():
        if outline.reach > largest_reach:
            continue
        elements = elements_inside[name]
        area = float(moments.point_areas[elements].sum())
        facets, count = np.unique(mesh.t2f[:, elements], return_counts=True)
        border_vertices = np.unique(mesh.facets[:, facets[count == 1]])
        distances = outline.compute_signed_distances(mesh.p[:, border_vertices].T)
        offset = np.abs(distances).max(initial=0.0)
        centroid = moments.first_moments[:, elements].sum(axis=1) / max(area, np.finfo(float).tiny)
        offset = max(offset, float(np.linalg.norm(centroid - outline.centroid)))
        size = float(np.sqrt(outline.area))
        if abs(area - outline.area) > slack * outline.area or offset > slack * size:
            x, y = np.round(1e3 * outline.centroid, 9) + 0.0
            yield (
                f"{name}: the mesh does not follow its outline of {1e6 * outline.area:.6g} mm2"
                f" about ({x:.6g}, {y:.6g}) mm: the triangles inside have {1e6 * area:.6g} mm2;"
                " embed the outline in the mesh, or correct the scene"
            )
