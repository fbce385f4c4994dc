"""The mesh of a scene from a file, written by ``pvdf-fem mesh`` or by the user's own gmsh script.

A file contains plane six-node triangles with the origin at the film's centre. The radius of the
film shows whether its unit is m or mm. Subdomains are found by the outlines of the scene, which the
mesh must follow; groups in the file are ignored.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError, open_regular_file
from pvdf_fem.mesh.six_node import SIDES, compute_jacobian_ratios, sort_vertices
from pvdf_fem.mesh.subdomains import FILM, collect_outlines, name_mesh_parts
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Modules of meshio by the extension of the files that they read.
READERS = {".msh": "gmsh", ".inp": "abaqus", ".vtu": "vtu", ".vtk": "vtk", ".xdmf": "xdmf"}


class MeshFileError(FileError):
    """A mesh is unusable or does not fit the scene; each argument describes one error."""

    def __str__(self) -> str:
        """Return one line for each error."""
        return "\n".join(self.args)


def as_mesh(mesh: MeshTri2 | str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """Convert a mesh or the path of its file to a mesh with the subdomains of a scene.

    Parameters
    ----------
    mesh : MeshTri2, str or Path
        A mesh of the whole film in m or mm, or the path of a mesh file. A mesh is not changed.
    scene : Scene
        The scene, whose outlines the mesh must follow.
    slack : float
        Relative tolerance; see `read_mesh`.

    Returns
    -------
    MeshTri2
        With coordinates in m.

    Raises
    ------
    MeshFileError
        If the mesh does not fit the scene.
    FileError
        If the file cannot be read.
    ValueError
        If `mesh` is neither a mesh nor a path.
    """
    if isinstance(mesh, str | Path):
        return read_mesh(mesh, scene, slack)
    coerce("mesh", mesh, MeshTri2)
    try:
        return _make_mesh(mesh.doflocs.T, mesh.dofs.element_dofs.T, scene=scene, slack=slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"mesh: {line}" for line in error.args)) from error.__cause__


def read_mesh(path: str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """Read a mesh file, check that it fits a scene, and name the subdomains of the scene in it.

    Parameters
    ----------
    path : str or Path
        Path of a file with an extension in `READERS`.
    scene : Scene
        The scene, whose outlines the mesh must follow.
    slack : float
        Maximum relative difference of the areas of subdomains, and of the film's radius, in the
        mesh and in the scene. Boundaries and centroids of subdomains may deviate by this fraction
        of the square root of the area.

    Returns
    -------
    MeshTri2
        With coordinates in m.

    Raises
    ------
    MeshFileError
        If the file is not a mesh of six-node triangles, or does not fit the scene.
    FileError
        If the file cannot be read.
    """
    path = Path(path)
    with open_regular_file(path, "a mesh file"):
        pass  # check only: meshio opens the file itself
    try:
        points, triangles = _extract_triangles(_read_grid(path))
        return _make_mesh(points, triangles, scene=scene, slack=slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"{path}: {line}" for line in error.args)) from error.__cause__


def _read_grid(path: Path) -> Any:
    """Read a mesh file with meshio's reader for its extension, and return a ``meshio.Mesh``.

    Raises
    ------
    MeshFileError
        If the extension is not in `READERS`, or if meshio cannot read the file.
    """
    name = READERS.get(path.suffix.lower())
    if name is None:
        formats = " ".join(READERS)
        raise MeshFileError(f"has none of the supported extensions; choose from {formats}")
    try:
        # only the reader is imported, since the import of all of meshio takes 0.25 s
        return import_module(f"meshio.{name}").read(path)
    except Exception as error:  # meshio's parsers raise exceptions of many types
        reason = f"{type(error).__name__}: {error}"
        raise MeshFileError(f"is not a mesh that meshio reads as {name} ({reason})") from error


def _extract_triangles(grid: Any) -> tuple[Array, Indices]:
    """Extract the six-node triangles of a mesh file.

    Parameters
    ----------
    grid : meshio.Mesh
        Contents of the file.

    Returns
    -------
    points : ndarray, shape (nodes, 2)
        Nodes of the triangles in the unit of the file.
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes; triangles that are listed several times occur once.

    Raises
    ------
    MeshFileError
        If there are cells other than six-node triangles, lines and points, no triangles, missing
        nodes, or nodes off a plane of constant z.
    """
    types = sorted({block.type for block in grid.cells})
    allowed_types = {"triangle6", "vertex", "line", "line3"}
    if "triangle6" not in types or not allowed_types.issuperset(types):
        advice = "give only six-node triangles on the film (gmsh: Mesh.ElementOrder = 2)"
        raise MeshFileError(f"has cells of the types {', '.join(types) or 'none'}; {advice}")
    points = np.asarray(grid.points, dtype=float)
    triangles = grid.cells_dict["triangle6"]
    if not len(triangles) or triangles.min() < 0 or triangles.max() >= len(points):
        raise MeshFileError(
            "has no triangles, or triangles whose nodes are missing; mesh the film again"
        )
    used, numbers = np.unique(triangles, return_inverse=True)
    points = points[used]
    triangles = numbers.reshape(triangles.shape)
    is_flat = bool(np.isfinite(points).all())
    if is_flat:
        thickness = np.ptp(points[:, 2:])
        is_flat = bool(thickness <= 1e-9 * np.abs(points).max())
    if not is_flat:
        raise MeshFileError("has nodes outside of the plane of the film; give a flat film")
    # MSH 2.2 files list an element once for each of its groups
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return points[:, :2], triangles[first]


def _make_mesh(points: Array, triangles: Indices, scene: Scene, slack: float) -> MeshTri2:
    """Make the mesh of a scene from triangles, after checks that they fit it.

    Parameters
    ----------
    points : ndarray, shape (nodes, 2)
        Nodes in m or mm.
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle.
    scene : Scene
        The scene, whose outlines the mesh must follow.
    slack : float
        Relative tolerance; see `read_mesh`.

    Returns
    -------
    MeshTri2
        With coordinates in m.

    Raises
    ------
    MeshFileError
        If the triangles are not a mesh of the scene.
    """
    radius = scene.film.radius
    reach = float(np.hypot(points[:, 0], points[:, 1]).max())
    points = _find_unit(reach, radius, slack=slack) * points
    _require_shared_middles(triangles)
    corners = points[triangles[:, :3]]
    edges = corners[:, 1:] - corners[:, :1]
    is_flat = np.abs(np.linalg.det(edges)) <= 1e-12 * np.square(edges).sum(axis=(1, 2))
    if is_flat.any():
        raise MeshFileError(f"has {is_flat.sum()} triangles without an area; mesh the film again")
    mesh = MeshTri2(points.T, sort_vertices(triangles).T)
    _require_disc(mesh, radius, slack)
    is_folded = compute_jacobian_ratios(mesh) <= 0.0
    if is_folded.any():
        advice = "move their midside nodes"
        raise MeshFileError(f"has {is_folded.sum()} folded triangles; {advice}")
    outlines = {FILM: scene.film.outline, **collect_outlines(scene)}
    elements_inside = _find_elements_inside(mesh, outlines)
    errors = list(_list_outline_errors(mesh, outlines, elements_inside, slack=slack))
    if errors:
        raise MeshFileError(*errors)
    return name_mesh_parts(mesh, elements_inside, sector=WHOLE_FILM)


def _find_unit(reach: float, radius: float, slack: float) -> float:
    """Find the unit of a mesh, m or mm, by comparing its radius with that of the film.

    Parameters
    ----------
    reach : float
        Maximum distance of the nodes from the origin, in the unknown unit.
    radius : float
        Radius of the film in m.
    slack : float
        Maximum relative difference of the radii.

    Returns
    -------
    float
        Size of the unit in m: 1 or 1e-3.

    Raises
    ------
    MeshFileError
        If the radii agree in neither unit.
    """
    for unit in (1.0, 1e-3):
        if abs(reach * unit / radius - 1.0) <= slack:
            return unit
    advice = f"give the film of {1e3 * radius:g} mm radius in mm or in m about (0, 0)"
    raise MeshFileError(f"has nodes up to {reach:.6g} from the origin; {advice}")


def _require_shared_middles(triangles: Indices) -> None:
    """Raise `MeshFileError` unless triangles with a common side share its midside node."""
    ends = np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2)
    middles = triangles[:, 3:].reshape(-1, 1)
    sides = np.hstack([ends, middles])
    counts = {len(np.unique(nodes, axis=0)) for nodes in (ends, middles, sides)}
    if len(counts) > 1 or np.isin(middles, triangles[:, :3]).any():
        reason = "has neighbouring triangles without a common midside node"
        raise MeshFileError(f"{reason}; merge duplicate nodes")


def _require_disc(mesh: MeshTri2, radius: float, slack: float) -> None:
    """Raise `MeshFileError` unless a mesh is one piece whose boundary sides are on the rim.

    Holes and cracks inside the film have boundary sides off the rim.
    """
    left, right = mesh.f2t[:, mesh.f2t[1] >= 0]
    links = sp.coo_matrix((np.ones(len(left)), (left, right)), shape=(mesh.nelements,) * 2)
    pieces, _ = connected_components(links, directed=False)
    border = mesh.facets[:, mesh.boundary_facets()]
    x, y = mesh.p[:, border]
    rim_distances = np.abs(np.hypot(x, y) - radius).max(axis=0)
    is_off_rim = rim_distances > slack * radius
    if pieces > 1 or is_off_rim.any():
        sides = f"{is_off_rim.sum()} sides inside the film with only one triangle"
        advice = "let the outlines share their nodes (gmsh: fragment)"
        raise MeshFileError(f"has {pieces} pieces, and {sides}; {advice}")


def _find_elements_inside(mesh: MeshTri2, outlines: dict[str, Outline]) -> dict[str, Indices]:
    """Find the elements whose centroids are inside each outline, by the name of the outline."""
    centroids = mesh.mapping().F(np.full((2, 1), 1.0 / 3.0))[:, :, 0].T
    elements = {}
    for name, outline in outlines.items():
        elements[name] = np.flatnonzero(outline.compute_signed_distances(centroids) < 0.0)
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


def _list_outline_errors(
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
        Elements whose centroids are inside each outline.
    slack : float
        Relative tolerance; see `read_mesh`.

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
                " embed the outline in the mesh"
            )
