"""The mesh of a scene from a file, written by ``pvdf-fem mesh`` or by another program.

A file contains plane triangles of three or six nodes. The radius of the film shows its unit.
Subdomains are found by the outlines of the scene, which the mesh must follow; groups in the file
are ignored. Formats are in `pvdf_fem.mesh.files.registry`.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.files.curving import curve_straight_sides
from pvdf_fem.mesh.files.film_triangles import select_film_triangles
from pvdf_fem.mesh.files.outline_fit import (
    find_elements_inside,
    list_outline_errors,
    require_rim,
)
from pvdf_fem.mesh.files.placing import find_placement
from pvdf_fem.mesh.files.registry import read_content
from pvdf_fem.mesh.files.topology import (
    find_border_vertices,
    require_conforming,
    require_one_piece,
)
from pvdf_fem.mesh.six_node import (
    compute_jacobian_ratios,
    repair_distorted_elements,
    sort_vertices,
)
from pvdf_fem.mesh.subdomains import FILM, collect_outlines, name_mesh_parts
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

# Sides inside of an outline are bent along its curved sides where a Jacobian is below this fraction
# of the element's mean, as in `mesh_scene`.
_MIN_JACOBIAN_RATIO = 0.14
# Vertices are on one line if the determinant of two sides is below this fraction of their squared
# lengths, as round-off leaves it.
_FLAT_FRACTION = 1e-12


class GivenMesh(NamedTuple):
    """A mesh of a scene that is given, not made."""

    mesh: MeshTri2  #: With the subdomains of the scene and coordinates in m.
    notes: tuple[str, ...]  #: What was changed, each beginning with the source of the mesh.


def resolve_mesh(mesh: MeshTri2 | str | Path, scene: Scene, slack: float = 1e-3) -> GivenMesh:
    """Resolve a mesh or the path of its file to a mesh with the subdomains of a scene.

    Parameters
    ----------
    mesh : MeshTri2, str or Path
        A mesh of the whole film, or the path of a mesh file. A mesh is not changed.
    scene : Scene
        The scene, whose outlines the mesh must follow.
    slack : float
        Relative tolerance; see `read_mesh`.

    Returns
    -------
    GivenMesh

    Raises
    ------
    MeshFileError
        If the mesh does not fit the scene.
    FileError
        If the file cannot be read.
    ValueError
        If `mesh` is neither a mesh nor a path.
    """
    source = str(mesh) if isinstance(mesh, str | Path) else "mesh"
    try:
        if isinstance(mesh, str | Path):
            film = select_film_triangles(read_content(Path(mesh)))
            given = _make_mesh(film.points, film.triangles, scene=scene, slack=slack)
            notes = film.notes + given.notes
        else:
            coerce("mesh", mesh, MeshTri2)
            given = _make_mesh(mesh.doflocs.T, mesh.dofs.element_dofs.T, scene=scene, slack=slack)
            notes = given.notes
    except MeshFileError as error:
        raise MeshFileError(*(f"{source}: {line}" for line in error.args)) from error.__cause__
    return GivenMesh(given.mesh, tuple(f"{source}: {note}" for note in notes))


def read_mesh(path: str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """Read a mesh file, check that it fits a scene, and name the subdomains of the scene in it.

    Parameters
    ----------
    path : str or Path
        Path of a file with an extension in `pvdf_fem.mesh.files.registry.READERS`.
    scene : Scene
        The scene, whose outlines the mesh must follow.
    slack : float
        Maximum relative difference of the areas of subdomains, and of the film's radius, in the
        mesh and in the scene. Boundaries and centroids of subdomains may deviate by this fraction
        of the square root of the area.

    Returns
    -------
    MeshTri2
        With coordinates in m about the film's centre. Straight sides along curved outlines have
        been curved onto these, and nodes at the same place have been merged.

    Raises
    ------
    MeshFileError
        If the file is not a mesh of triangles of three or six nodes, or does not fit the scene.
    FileError
        If the file cannot be read.
    """
    return resolve_mesh(Path(path), scene, slack).mesh


def _make_mesh(points: Array, triangles: Indices, scene: Scene, slack: float) -> GivenMesh:
    """Make the mesh of a scene from triangles, after checks that they fit it.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        Nodes in any unit of `placing.UNITS_M`.
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle.
    scene : Scene
        The scene, whose outlines the mesh must follow.
    slack : float
        Relative tolerance; see `read_mesh`.

    Returns
    -------
    GivenMesh

    Raises
    ------
    MeshFileError
        If the triangles are not a mesh of the scene.
    """
    film = scene.film
    outlines = {FILM: film.outline, **collect_outlines(scene)}
    require_conforming(triangles)
    require_one_piece(triangles)
    placement = find_placement(points[find_border_vertices(triangles)], film, slack=slack)
    points = placement.apply(points)
    _require_areas(points, triangles)
    curved = curve_straight_sides(points, triangles, outlines=outlines, slack=slack)
    mesh = MeshTri2(curved.points.T, sort_vertices(triangles).T)
    require_rim(mesh, film.outline, slack)
    mesh = _name_parts(mesh, outlines, slack=slack, is_repaired=curved.side_count > 0)
    return GivenMesh(mesh, (*placement.notes, *curved.describe()))


def _require_areas(points: Array, triangles: Indices) -> None:
    """Raise `MeshFileError` if the vertices of a triangle are on one line."""
    corners = points[triangles[:, :3]]
    edges = corners[:, 1:] - corners[:, :1]
    is_flat = np.abs(np.linalg.det(edges)) <= _FLAT_FRACTION * np.square(edges).sum(axis=(1, 2))
    if is_flat.any():
        raise MeshFileError(f"has {is_flat.sum()} triangles without an area; mesh the film again")


def _name_parts(
    mesh: MeshTri2, outlines: dict[str, Outline], slack: float, is_repaired: bool
) -> MeshTri2:
    """Name the subdomains of a mesh, after checks that it follows their outlines.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m about the film's centre.
    outlines : dict of str to Outline
        Outlines of the film and of all subdomains by name.
    slack : float
        Relative tolerance; see `read_mesh`.
    is_repaired : bool
        Whether sides beside curved sides may be bent.

    Returns
    -------
    MeshTri2
        With the subdomains.
    """
    elements_inside = find_elements_inside(mesh, outlines, slack)
    named = name_mesh_parts(mesh, elements_inside, sector=WHOLE_FILM)
    if is_repaired:
        named, _ = repair_distorted_elements(named, _MIN_JACOBIAN_RATIO, max_move=0.0)
    is_folded = compute_jacobian_ratios(named) <= 0.0
    if is_folded.any():
        advice = "move their midside nodes, or use smaller triangles along curved outlines"
        raise MeshFileError(f"has {is_folded.sum()} folded triangles; {advice}")
    errors = list(list_outline_errors(named, outlines, elements_inside, slack=slack))
    if errors:
        raise MeshFileError(*errors)
    return named
