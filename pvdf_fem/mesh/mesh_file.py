"""The mesh for a scene from a file: by ``pvdf-fem mesh``, or the user's own gmsh mesh.

A file holds plane six-node triangles in m or mm about the film's centre; the film's radius tells
which. Patches lie where the scene has them: the triangles inside of an outline are its patch if the
mesh follows the outline. Names of groups in the file count for nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError, open_regular_file
from pvdf_fem.mesh.gmsh_mesh import FILM, collect_outlines, name_mesh_parts
from pvdf_fem.mesh.six_node import SIDES, compute_jacobian_ratios, sort_vertices
from pvdf_fem.mesh.symmetry import WHOLE_FILM
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: Modules in meshio that read a format, by extension.
READERS = {".msh": "gmsh", ".inp": "abaqus", ".vtu": "vtu", ".vtk": "vtk", ".xdmf": "xdmf"}


class MeshFileError(FileError):
    """The given mesh does not fit the scene; each argument is a line about a mistake."""

    def __str__(self) -> str:
        return "\n".join(self.args)


def as_mesh(given: MeshTri2 | str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """A mesh of the whole film, given or from a file, with the patches in a scene; see
    `read_mesh`."""
    if isinstance(given, str | Path):
        return read_mesh(given, scene, slack)
    coerce("mesh", given, MeshTri2)
    try:
        return _mesh(given.doflocs.T, given.dofs.element_dofs.T, scene, slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"mesh: {line}" for line in error.args)) from error.__cause__


def read_mesh(path: str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """The mesh in a file with an extension in `READERS`, with the patches in a scene; see the
    module. Areas of film and patches may differ by the part `slack` from the scene's; outlines and
    centroids may be off by this part of the patch's size (root of the area). Raises `MeshFileError`
    when the mesh is not one of the scene's film, and `FileError` when the file cannot be read."""
    path = Path(path)
    with open_regular_file(path, "a mesh file"):
        pass  # meshio opens it by itself
    try:
        return _mesh(*_triangles(_grid(path)), scene, slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"{path}: {line}" for line in error.args)) from error.__cause__


def _grid(path: Path) -> Any:
    name = READERS.get(path.suffix.lower())
    if name is None:
        raise MeshFileError(f"has no extension of a known format; choose from {' '.join(READERS)}")
    try:
        return import_module(f"meshio.{name}").read(path)  # meshio takes a quarter of a second
    except Exception as error:  # whatever meshio's parsers meet
        reason = f"{type(error).__name__}: {error}"
        raise MeshFileError(f"is no mesh that meshio reads as {name} ({reason})") from error


def _triangles(grid: Any) -> tuple[Array, Indices]:
    """Points (nodes, 2) in the file's unit, and nodes of the triangles, (elements, 6)."""
    types = sorted({block.type for block in grid.cells})
    if "triangle6" not in types or {*types} - {"triangle6", "vertex", "line", "line3"}:
        text = "give six-node triangles (gmsh: Mesh.ElementOrder = 2), and nothing else on the film"
        raise MeshFileError(f"has cells of the types {', '.join(types) or 'none'}; {text}")
    points, every = np.asarray(grid.points, dtype=float), grid.cells_dict["triangle6"]
    if not len(every) or every.min() < 0 or every.max() >= len(points):
        raise MeshFileError("has no triangles, or triangles of nodes that are not there")
    used, places = np.unique(every, return_inverse=True)
    points, places = points[used], places.reshape(every.shape)
    if not np.isfinite(points).all() or np.ptp(points[:, 2:]) > 1e-9 * np.abs(points).max():
        raise MeshFileError("has nodes off the plane z = 0; give a flat film")
    # an element in several groups is listed several times in MSH 2.2
    _, first = np.unique(np.sort(places, axis=1), axis=0, return_index=True)
    return points[:, :2], places[first]


def _mesh(points: Array, triangles: Indices, scene: Scene, slack: float) -> MeshTri2:
    """The scene's mesh from triangles in m or mm."""
    radius, reach = scene.film.radius, float(np.hypot(*points.T).max())
    unit = next((u for u in (1.0, 1e-3) if abs(reach * u / radius - 1.0) <= slack), None)
    if unit is None:
        text = f"give the film of {1e3 * radius:g} mm radius in mm or in m about (0, 0)"
        raise MeshFileError(f"has nodes up to {reach:.6g} from the origin; {text}")
    _require_shared_middles(triangles)
    points = unit * points
    corners = points[triangles[:, :3]]
    edges = corners[:, 1:] - corners[:, :1]
    flat = np.abs(np.linalg.det(edges)) <= 1e-12 * np.square(edges).sum(axis=(1, 2))
    if flat.any():
        raise MeshFileError(f"has {flat.sum()} triangles without an area; mesh the film again")
    mesh = MeshTri2(points.T, sort_vertices(triangles).T)
    _require_disc(mesh, radius, slack)
    if (folded := compute_jacobian_ratios(mesh) <= 0.0).any():
        raise MeshFileError(f"has {folded.sum()} triangles that fold; move their midside nodes")
    shapes = {FILM: Circle(np.zeros(2), radius), **collect_outlines(scene)}
    inside = _inside(mesh, shapes)
    if mistakes := [*_misplaced(mesh, shapes, inside, slack)]:
        raise MeshFileError(*mistakes)
    return name_mesh_parts(mesh, inside, WHOLE_FILM)


def _require_shared_middles(triangles: Indices) -> None:
    ends = np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2)
    middles = triangles[:, 3:].reshape(-1, 1)
    sides = [len(np.unique(s, axis=0)) for s in (ends, middles, np.hstack([ends, middles]))]
    if len(set(sides)) > 1 or np.isin(middles, triangles[:, :3]).any():
        raise MeshFileError("has triangles that do not share the midside node of a common side")


def _require_disc(mesh: MeshTri2, radius: float, slack: float) -> None:
    """Raise for a mesh that has several pieces, holes or cracks."""
    left, right = mesh.f2t[:, mesh.f2t[1] >= 0]
    links = sp.coo_matrix((np.ones(len(left)), (left, right)), shape=(mesh.nelements,) * 2)
    pieces, _ = connected_components(links, directed=False)
    border = mesh.facets[:, mesh.boundary_facets()]
    off = np.abs(np.hypot(*mesh.p[:, border]) - radius).max(axis=0) > slack * radius
    if pieces > 1 or off.any():
        raise MeshFileError(
            f"has {pieces} pieces, and {off.sum()} sides within the film that belong to one "
            "triangle only; let the outlines share their nodes (gmsh: fragment)"
        )


def _inside(mesh: MeshTri2, shapes: dict[str, Outline]) -> dict[str, Indices]:
    """Elements with their centroids inside an outline, by the outline's name."""
    middles = mesh.mapping().F(np.full((2, 1), 1.0 / 3.0))[:, :, 0].T
    return {
        name: np.flatnonzero(shape.compute_signed_distances(middles) < 0.0)
        for name, shape in shapes.items()
    }


def _misplaced(
    mesh: MeshTri2, shapes: dict[str, Outline], inside: dict[str, Indices], slack: float
) -> Iterator[str]:
    """What is wrong with each patch."""
    local, weights = get_quadrature(mesh.elem.refdom, 4)
    mapping = mesh.mapping()
    area = np.abs(mapping.detDF(local)) * weights
    first = (mapping.F(local) * area).sum(axis=-1)
    whole = {n: s for n, s in shapes.items() if s.reach <= (1.0 + slack) * shapes[FILM].reach}
    for name, shape in whole.items():
        elements, size = inside[name], float(np.sqrt(shape.area))
        found = float(area[elements].sum())
        facets, count = np.unique(mesh.t2f[:, elements], return_counts=True)
        corners = np.unique(mesh.facets[:, facets[count == 1]])
        off = np.abs(shape.compute_signed_distances(mesh.p[:, corners].T)).max(initial=0.0)
        centre = first[:, elements].sum(axis=1) / max(found, np.finfo(float).tiny)
        off = max(off, float(np.linalg.norm(centre - shape.centroid)))
        if abs(found - shape.area) > slack * shape.area or off > slack * size:
            x, y = np.round(1e3 * shape.centroid, 9) + 0.0
            yield (
                f"{name}: the mesh does not follow its outline of {1e6 * shape.area:.6g} mm2 about"
                f" ({x:.6g}, {y:.6g}) mm; the triangles in it have {1e6 * found:.6g} mm2"
            )
