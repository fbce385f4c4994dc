"""The mesh of a scene from a file: of ``pvdf-fem mesh``, or of the user's own by gmsh.

A file holds plane triangles in m or mm about the film's centre; the film's radius tells which.
Patches lie where the scene has them: the triangles inside of an outline are its patch if the mesh
follows the outline. Names in the file may only agree with that, so a file needs none.

Three-node triangles get midside nodes. These lie on the chords, except along the rim and along
round outlines, where sides are curved to the outline's area as those of `mesh_scene` are.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from skfem import MeshTri2
from skfem.quadrature import get_quadrature

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.files import FileError, reading
from pvdf_fem.mesh.gmsh_mesh import FILM, RIM, named, outlines
from pvdf_fem.mesh.six_node import SIDES, compression, straightened, with_sorted_vertices
from pvdf_fem.mesh.symmetry import WHOLE
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

#: The module of meshio that reads a format, by extension.
READERS = {".msh": "gmsh", ".inp": "abaqus", ".vtu": "vtu", ".vtk": "vtk", ".xdmf": "xdmf"}
UNITS = {"m": 1.0, "mm": 1e-3}  #: Lengths of a file in m.
#: Curved sides may compress an element made of a straight one to this part of its mean Jacobian.
LEAST_JACOBIAN = 0.14


class MeshFileError(FileError):
    """What is given is no mesh of the scene; each argument is a line about a mistake."""

    def __str__(self) -> str:
        return "\n".join(self.args)


@dataclass(frozen=True, eq=False)
class _Contents:
    """What a file holds."""

    points: Array  #: (nodes, 2), in the file's unit.
    triangles: Indices  #: Nodes of the triangles, (elements, 3 or 6).
    groups: dict[str, Indices]  #: Triangles by the names of their groups.
    rim: int  #: Number of lines in the group `RIM`, zero without one.


def mesh_of(given: MeshTri2 | str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """A mesh of the whole film, or that in a file, with the patches of a scene; see `read_mesh`."""
    if isinstance(given, str | Path):
        return read_mesh(given, scene, slack)
    contents = _Contents(given.doflocs.T, given.dofs.element_dofs.T, given.subdomains or {}, 0)
    try:
        return _mesh(contents, scene, slack)
    except MeshFileError as error:
        raise MeshFileError(*(f"mesh: {line}" for line in error.args)) from error.__cause__


def read_mesh(path: str | Path, scene: Scene, slack: float = 1e-3) -> MeshTri2:
    """The mesh in a file, which ends in one of `READERS`, with the patches of a scene; see the
    module. Areas of film and patches may differ by the part `slack` from the scene's; outlines and
    centroids may be off by this part of the patch's size, the root of its area. Raises
    `MeshFileError` when the mesh is not one of the scene's film, and `FileError` when the file
    cannot be read."""
    path = Path(path)
    with reading(path, "a mesh file"):
        pass  # meshio opens it by itself
    try:
        return _mesh(_contents(_grid(path)), scene, slack)
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


def _contents(grid: Any) -> _Contents:
    types = sorted({block.type for block in grid.cells})
    kinds = [kind for kind in types if kind in ("triangle", "triangle6")]
    if len(kinds) != 1 or {*types} - {*kinds, "vertex", "line", "line3"}:
        text = "give triangles with three nodes, or with six, and nothing else on the film"
        raise MeshFileError(f"has cells of the types {', '.join(types) or 'none'}; {text}")
    points, every = np.asarray(grid.points, dtype=float), grid.cells_dict[kinds[0]]
    if not len(every) or every.min() < 0 or every.max() >= len(points):
        raise MeshFileError("has no triangles, or triangles of nodes that are not there")
    used, places = np.unique(every, return_inverse=True)
    points, places = points[used], places.reshape(every.shape)
    if not np.isfinite(points).all() or np.ptp(points[:, 2:]) > 1e-9 * np.abs(points).max():
        raise MeshFileError("has nodes off the plane z = 0; give a flat film")
    # an element in several groups is listed several times in MSH 2.2
    _, first, number = np.unique(
        np.sort(places, axis=1), axis=0, return_index=True, return_inverse=True
    )
    groups = {name: np.unique(number.ravel()[r]) for name, r in _groups(grid, kinds[0]).items()}
    lines = [
        np.sort(grid.cells_dict[kind][rows][:, :2], axis=1)
        for kind in types
        if kind.startswith("line") and (rows := _groups(grid, kind).get(RIM)) is not None
    ]
    rim = len(np.unique(np.concatenate(lines), axis=0)) if lines else 0
    return _Contents(points[:, :2], places[first], groups, rim)


def _groups(grid: Any, kind: str) -> dict[str, Indices]:
    """Numbers of the cells of a kind by the names of their groups."""
    inside = dict(grid.cell_sets)
    if tags := grid.cell_data.get("gmsh:physical"):
        for name, (tag, dimension) in grid.field_data.items():
            tagged = zip(tags, grid.cells, strict=True)
            rows = [np.flatnonzero((t == tag) & (block.dim == dimension)) for t, block in tagged]
            inside.setdefault(name, rows)
    for name, values in grid.cell_data.items():
        if all(np.ndim(v) == 1 and np.isin(v, [0, 1]).all() for v in values):
            inside[name] = [np.flatnonzero(v) for v in values]
    blocks = [i for i, block in enumerate(grid.cells) if block.type == kind]
    starts = np.cumsum([0, *(len(grid.cells[i]) for i in blocks[:-1])])
    return {
        name: np.concatenate(
            [start + np.asarray(rows[i], int) for i, start in zip(blocks, starts, strict=True)]
        )
        for name, rows in inside.items()
        if not name.startswith("gmsh:")
    }


def _mesh(contents: _Contents, scene: Scene, slack: float) -> MeshTri2:
    """The mesh of the scene that a file's contents are."""
    radius, points = scene.film.radius, contents.points
    reach = float(np.hypot(*points.T).max())
    unit = next((u for u in UNITS.values() if abs(reach * u / radius - 1.0) <= slack), None)
    if unit is None:
        text = f"give the film of {1e3 * radius:g} mm radius in mm or in m about (0, 0)"
        raise MeshFileError(f"has nodes up to {reach:.6g} from the origin; {text}")
    straight = contents.triangles.shape[1] == 3
    points, triangles = unit * points, contents.triangles
    if straight:
        points, triangles = _with_middles(points, triangles)
    else:
        _require_shared_middles(triangles)
    corners = points[triangles[:, :3]]
    edges = corners[:, 1:] - corners[:, :1]
    flat = np.abs(np.linalg.det(edges)) <= 1e-12 * np.square(edges).sum(axis=(1, 2))
    if flat.any():
        raise MeshFileError(f"has {flat.sum()} triangles without an area; mesh the film again")
    mesh = MeshTri2(points.T, with_sorted_vertices(triangles).T)
    _require_disc(mesh, contents.rim, radius, slack)
    shapes = {FILM: Circle(np.zeros(2), radius), **outlines(scene)}
    inside = _inside(mesh, shapes)
    if straight:
        by_outline = {shapes[name]: elements for name, elements in inside.items()}
        mesh = _curved(mesh.with_subdomains(inside), by_outline, slack)
    if (folded := compression(mesh) <= 0.0).any():
        raise MeshFileError(f"has {folded.sum()} triangles that fold; move their midside nodes")
    if mistakes := [*_misplaced(mesh, shapes, inside, contents.groups, slack)]:
        names = ", ".join(contents.groups) or "none"
        raise MeshFileError(*mistakes, f"the names of its groups are: {names}")
    return named(mesh, inside, WHOLE)


def _with_middles(points: Array, triangles: Indices) -> tuple[Array, Indices]:
    """Six-node triangles with straight sides."""
    ends, number = np.unique(
        np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2), axis=0, return_inverse=True
    )
    middles = len(points) + number.reshape(-1, 3)
    return np.vstack([points, points[ends].mean(axis=1)]), np.hstack([triangles, middles])


def _require_shared_middles(triangles: Indices) -> None:
    ends = np.sort(triangles[:, SIDES], axis=2).reshape(-1, 2)
    middles = triangles[:, 3:].reshape(-1, 1)
    sides = [len(np.unique(s, axis=0)) for s in (ends, middles, np.hstack([ends, middles]))]
    if len(set(sides)) > 1 or np.isin(middles, triangles[:, :3]).any():
        raise MeshFileError("has triangles that do not share the midside node of a common side")


def _require_disc(mesh: MeshTri2, lines: int, radius: float, slack: float) -> None:
    """Raise for a mesh that has several pieces, holes or cracks, or another rim than its border."""
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
    if lines and lines != border.shape[1]:
        raise MeshFileError(
            f"has {lines} lines in the group {RIM}, and {border.shape[1]} sides on its border;"
            " the whole border is clamped, name all of it or none"
        )


def _inside(mesh: MeshTri2, shapes: dict[str, Outline]) -> dict[str, Indices]:
    """Elements with their centroids inside an outline, by the outline's name."""
    middles = mesh.mapping().F(np.full((2, 1), 1.0 / 3.0))[:, :, 0].T
    return {
        name: np.flatnonzero(shape.signed_distance(middles) < 0.0) for name, shape in shapes.items()
    }


def _border(mesh: MeshTri2, elements: Indices) -> Indices:
    """The sides along the border of a patch: sides of a single element of the patch."""
    facets, count = np.unique(mesh.t2f[:, elements], return_counts=True)
    return np.asarray(facets[count == 1])


def _curved(mesh: MeshTri2, inside: dict[Outline, Indices], slack: float) -> MeshTri2:
    """The mesh of straight triangles, with sides curved along smooth outlines."""
    points = mesh.doflocs.copy()
    for outline, elements in inside.items():
        if len(outline.corners):
            continue
        sides = _border(mesh, elements)
        ends = mesh.p[:, mesh.facets[:, sides]].transpose(1, 2, 0)
        apart = np.abs([outline.signed_distance(end) for end in ends]).max(axis=0, initial=0.0)
        on = apart <= slack * np.sqrt(outline.area)
        points[:, mesh.dofs.facet_dofs[0, sides[on]]] = outline.arc_middles(*ends[:, on]).T
    return straightened(replace(mesh, doflocs=points), LEAST_JACOBIAN, np.inf)


def _misplaced(
    mesh: MeshTri2,
    shapes: dict[str, Outline],
    inside: dict[str, Indices],
    groups: dict[str, Indices],
    slack: float,
) -> Iterator[str]:
    """What is wrong with each patch."""
    local, weights = get_quadrature(mesh.elem.refdom, 4)
    mapping = mesh.mapping()
    area = np.abs(mapping.detDF(local)) * weights
    first = (mapping.F(local) * area).sum(axis=-1)
    whole = {n: s for n, s in shapes.items() if s.reach <= (1.0 + slack) * shapes[FILM].reach}
    for name, shape in whole.items():
        elements, size = inside[name], float(np.sqrt(shape.area))
        if strays := len(np.setdiff1d(_group(groups, name), elements)):
            yield f"{name}: {strays} triangles of this name lie outside of the scene's {name}"
            continue
        found = float(area[elements].sum())
        corners = np.unique(mesh.facets[:, _border(mesh, elements)])
        off = np.abs(shape.signed_distance(mesh.p[:, corners].T)).max(initial=0.0)
        centre = first[:, elements].sum(axis=1) / max(found, np.finfo(float).tiny)
        off = max(off, float(np.linalg.norm(centre - shape.centroid)))
        if abs(found - shape.area) > slack * shape.area or off > slack * size:
            x, y = np.round(1e3 * shape.centroid, 9) + 0.0
            yield (
                f"{name}: the mesh does not follow its outline of {1e6 * shape.area:.6g} mm2 about"
                f" ({x:.6g}, {y:.6g}) mm; the triangles in it have {1e6 * found:.6g} mm2"
            )


def _group(groups: dict[str, Indices], patch: str) -> Indices:
    """Triangles that a file has by the name of a patch, alone or of a combination of patches."""
    plain = re.sub(r"\s", "_", patch)
    found = [rows for name, rows in groups.items() if patch in (name, *name.split(" + "))]
    found = found or [rows for name, rows in groups.items() if name == plain]
    return np.concatenate([np.empty(0, dtype=np.int64), *found])
