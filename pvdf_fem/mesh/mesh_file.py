"""The mesh for a scene from a file: by ``pvdf-fem mesh``, or the user's own gmsh mesh.

A file contains plane six-node triangles about the film's centre in m or in mm, which the radius of
the film decides. Patches lie where the scene has them: the triangles inside of an outline are its
patch if the mesh follows the outline. Names of groups in the file are ignored.
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

#: Modules of meshio that read a format, by extension.
READERS = {".msh": "gmsh", ".inp": "abaqus", ".vtu": "vtu", ".vtk": "vtk", ".xdmf": "xdmf"}


class MeshFileError(FileError):
    """A mesh that does not fit the scene; each argument is a line about an error."""

    def __str__(self) -> str:
        return "\n".join(self.args)


def as_mesh(mesh: MeshTri2 | str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """Return a mesh of the whole film with the patches of a scene.

    Parameters
    ----------
    mesh : MeshTri2, str or path
        A mesh, or its file.
    scene : Scene
        The scene.
    slack : float
        See `read_mesh`.

    Returns
    -------
    MeshTri2
        In m.

    Raises
    ------
    MeshFileError
        For a mesh that is not one of the scene's film.
    """
    if isinstance(mesh, str | Path):
        return read_mesh(mesh, scene, slack)
    coerce("mesh", mesh, MeshTri2)
    try:
        return _make_mesh(mesh.doflocs.T, mesh.dofs.element_dofs.T, scene=scene, slack=slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"mesh: {line}" for line in error.args)) from error.__cause__


def read_mesh(path: str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """Read a mesh file, and find the patches of a scene in the mesh.

    Parameters
    ----------
    path : str or path
        With an extension in `READERS`.
    scene : Scene
        The scene.
    slack : float
        Relative difference between the areas of film and patches in the mesh and in the scene that
        is allowed. Outlines and centroids may be off by this share of the root of the patch's area.

    Returns
    -------
    MeshTri2
        In m.

    Raises
    ------
    MeshFileError
        For a mesh that is not one of the scene's film.
    FileError
        For a file that cannot be read.
    """
    path = Path(path)
    with open_regular_file(path, "a mesh file"):
        pass  # meshio opens it by itself
    try:
        points, triangles = _extract_triangles(_read_grid(path))
        return _make_mesh(points, triangles, scene=scene, slack=slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"{path}: {line}" for line in error.args)) from error.__cause__


def _read_grid(path: Path) -> Any:
    """Read a file by meshio."""
    name = READERS.get(path.suffix.lower())
    if name is None:
        formats = " ".join(READERS)
        raise MeshFileError(f"has no extension of a known format; choose from {formats}")
    try:
        return import_module(f"meshio.{name}").read(path)  # meshio takes a quarter of a second
    except Exception as error:  # meshio's parsers raise many types
        reason = f"{type(error).__name__}: {error}"
        raise MeshFileError(f"is not a mesh that meshio reads as {name} ({reason})") from error


def _extract_triangles(grid: Any) -> tuple[Array, Indices]:
    """Return points (nodes, 2) in the file's unit, and nodes of the triangles (elements, 6)."""
    types = sorted({block.type for block in grid.cells})
    if "triangle6" not in types or {*types} - {"triangle6", "vertex", "line", "line3"}:
        advice = "give only six-node triangles on the film (gmsh: Mesh.ElementOrder = 2)"
        raise MeshFileError(f"has cells of the types {', '.join(types) or 'none'}; {advice}")
    points = np.asarray(grid.points, dtype=float)
    triangles = grid.cells_dict["triangle6"]
    if not len(triangles) or triangles.min() < 0 or triangles.max() >= len(points):
        raise MeshFileError("has no triangles, or triangles of nodes that are missing")
    used, numbers = np.unique(triangles, return_inverse=True)
    points = points[used]
    triangles = numbers.reshape(triangles.shape)
    if not np.isfinite(points).all() or np.ptp(points[:, 2:]) > 1e-9 * np.abs(points).max():
        raise MeshFileError("has nodes off the plane z = 0; give a flat film")
    # an element in several groups is listed several times in MSH 2.2
    _, first = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return points[:, :2], triangles[first]


def _make_mesh(points: Array, triangles: Indices, scene: Scene, slack: float) -> MeshTri2:
    """Make the scene's mesh from triangles in m or mm."""
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
        raise MeshFileError(f"has {is_folded.sum()} triangles that fold; move their midside nodes")
    outlines = {FILM: scene.film.outline, **collect_outlines(scene)}
    elements_inside = _find_elements_inside(mesh, outlines)
    errors = list(_find_patch_errors(mesh, outlines, elements_inside=elements_inside, slack=slack))
    if errors:
        raise MeshFileError(*errors)
    return name_mesh_parts(mesh, elements_inside, sector=WHOLE_FILM)


def _find_unit(reach: float, radius: float, slack: float) -> float:
    """Find the unit in m in which the nodes reach up to the film's radius."""
    for unit in (1.0, 1e-3):
        if abs(reach * unit / radius - 1.0) <= slack:
            return unit
    advice = f"give the film of {1e3 * radius:g} mm radius in mm or in m about (0, 0)"
    raise MeshFileError(f"has nodes up to {reach:.6g} from the origin; {advice}")


def _require_shared_middles(triangles: Indices) -> None:
    """Raise for triangles that do not share the midside node of a common side."""
    ends = np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2)
    middles = triangles[:, 3:].reshape(-1, 1)
    sides = np.hstack([ends, middles])
    counts = {len(np.unique(nodes, axis=0)) for nodes in (ends, middles, sides)}
    if len(counts) > 1 or np.isin(middles, triangles[:, :3]).any():
        raise MeshFileError("has triangles that do not share the midside node of a common side")


def _require_disc(mesh: MeshTri2, radius: float, slack: float) -> None:
    """Raise for a mesh of several pieces, or with holes or cracks."""
    left, right = mesh.f2t[:, mesh.f2t[1] >= 0]
    links = sp.coo_matrix((np.ones(len(left)), (left, right)), shape=(mesh.nelements,) * 2)
    pieces, _ = connected_components(links, directed=False)
    border = mesh.facets[:, mesh.boundary_facets()]
    off_rim = np.abs(np.hypot(*mesh.p[:, border]) - radius).max(axis=0) > slack * radius
    if pieces > 1 or off_rim.any():
        raise MeshFileError(
            f"has {pieces} pieces, and {off_rim.sum()} sides within the film that belong to only "
            "one triangle; let the outlines share their nodes (gmsh: fragment)"
        )


def _find_elements_inside(mesh: MeshTri2, outlines: dict[str, Outline]) -> dict[str, Indices]:
    """Find the elements with their centroids inside an outline, by the outline's name."""
    centroids = mesh.mapping().F(np.full((2, 1), 1.0 / 3.0))[:, :, 0].T
    elements = {}
    for name, outline in outlines.items():
        elements[name] = np.flatnonzero(outline.compute_signed_distances(centroids) < 0.0)
    return elements


class _Moments(NamedTuple):
    """Areas and first moments of elements."""

    area: Array  #: In m² at quadrature points, (elements, points).
    first: Array  #: Integrals of places over the elements in m³, (2, elements).


def _compute_moments(mesh: MeshTri2) -> _Moments:
    """Compute areas and first moments of the elements."""
    local, weights = get_quadrature(mesh.elem.refdom, 4)
    mapping = mesh.mapping()
    point_areas = np.abs(mapping.detDF(local)) * weights
    first = (mapping.F(local) * point_areas).sum(axis=-1)
    return _Moments(point_areas, first)


def _find_patch_errors(
    mesh: MeshTri2,
    outlines: dict[str, Outline],
    elements_inside: dict[str, Indices],
    slack: float,
) -> Iterator[str]:
    """Find patches whose outlines the mesh does not follow.

    Parameters
    ----------
    mesh : MeshTri2
        With coordinates in m.
    outlines : dict of str to Outline
        Outlines of the film and its patches by name. Those that reach over the rim are left out.
    elements_inside : dict of str to ndarray of int
        Elements inside of each outline.
    slack : float
        See `read_mesh`.

    Yields
    ------
    str
        A line about a patch.
    """
    moments = _compute_moments(mesh)
    largest_reach = (1.0 + slack) * outlines[FILM].reach
    for name, outline in outlines.items():
        if outline.reach > largest_reach:
            continue
        elements = elements_inside[name]
        area = float(moments.area[elements].sum())
        facets, count = np.unique(mesh.t2f[:, elements], return_counts=True)
        border_vertices = np.unique(mesh.facets[:, facets[count == 1]])
        distances = outline.compute_signed_distances(mesh.p[:, border_vertices].T)
        offset = np.abs(distances).max(initial=0.0)
        centroid = moments.first[:, elements].sum(axis=1) / max(area, np.finfo(float).tiny)
        offset = max(offset, float(np.linalg.norm(centroid - outline.centroid)))
        size = float(np.sqrt(outline.area))
        if abs(area - outline.area) > slack * outline.area or offset > slack * size:
            x, y = np.round(1e3 * outline.centroid, 9) + 0.0
            yield (
                f"{name}: the mesh does not follow its outline of {1e6 * outline.area:.6g} mm2"
                f" about ({x:.6g}, {y:.6g}) mm; the triangles in it have {1e6 * area:.6g} mm2"
            )
