"""Scene to mesh: the clamped disc with its electrodes and probe as named patches.

This is the only module that imports gmsh. The outlines are embedded with OpenCASCADE's
``fragment``, so every patch, and every overlap of patches, is a union of elements. Elements are
six-node triangles: rim and circular outlines are curved to second order, with the circles' areas.
Element sizes are smallest along the outlines and grow linearly with the distance from them
(`Sizes`), or follow an error estimate on an earlier mesh (`SizeField`). Of a symmetric scene a part
can be meshed (`symmetry.Part`).

gmsh works on lengths divided by a hundredth of the film's radius, so that its absolute geometric
tolerance means the same for a film of 1 mm and of 1 m.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import gmsh
import numpy as np
from numpy.typing import NDArray
from skfem import MeshTri2

from pvdf_fem.film.bending_effect import bending_joins
from pvdf_fem.mesh.six_node import SIDES, bulge, compression, with_sorted_vertices
from pvdf_fem.mesh.symmetry import WHOLE, Part
from pvdf_fem.scene.outline import Circle, Outline, mapped
from pvdf_fem.scene.scene import Scene

# gmsh's other sources of element sizes, all switched off.
OTHER_SIZES = ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary")
FRONTAL_DELAUNAY = 6
# Of the number of elements along a curve; gmsh's 1e-9 takes most of the meshing time.
CURVE_PRECISION = 1e-2
# Sizes of a `SizeField` grow by no more than this per unit of length.
GROWTH = 0.5
# A curved element is distorted whose area is compressed to less than this part somewhere. The cusp
# between an arc and its own tangent, or another arc that it touches, has 0.15 at any size.
# Between an arc and a corner or an edge that it nearly touches, elements are worse, or fold; they
# are made smaller by the factor, and the scene is meshed again, a few times at the most. Sides
# become straight where that moves them by less than a part of the smallest outline, which changes
# its area by less than 1e-6, and at last wherever else they are distorted, tiny as they are then.
# Films that bend do not bear the cusps.
DISTORTED, DISTORTED_BENT = 0.14, 0.2
SMALLER, ATTEMPTS = 0.4, 6
FLAT = 1e-5
# gmsh's elements are smaller than the sizes that they are asked for by about this.
SPARE = 1.15
# Size of a sliver, as a part of its longest edge; of one that is distorted.
SLIVER, DISTORTED_SLIVER = 0.5, 0.1
# How near to a mirror line a node counts as on it, relative to the film's radius.
ON_LINE = 1e-8
# gmsh has one state for all threads, of which the worker of a cluster may have several.
_ONE_MODEL = threading.Lock()

RIM = "rim"
FILM = "film"
PROBE = "probe"
# Where the first and the second coordinate change sign between a part of the film and its image.
MIRRORS = ("mirror x", "mirror y")


def electrode_patch(name: str) -> str:
    """Name of the mesh subdomain that an electrode covers."""
    return f"electrode {name}"


class MeshError(RuntimeError):
    """gmsh could not mesh a scene; the text names the patches found and expected."""


@dataclass(frozen=True)
class Sizes:
    """Element sizes in metres.

    Attributes
    ----------
    patches : dict
        Element size along the outline of each patch, by patch name; `FILM` is the rim's.
    growth : float
        Increase of the element size per unit of distance from an outline.
    film : float
        Largest element size.
    """

    patches: dict[str, float]
    growth: float
    film: float

    def scaled(self, factor: float) -> Sizes:
        """All element sizes, and so the gradient, times `factor`."""
        patches = {name: size * factor for name, size in self.patches.items()}
        return Sizes(patches, self.growth * factor, self.film * factor)


@dataclass(frozen=True, eq=False)
class SizeField:
    """Element sizes in metres at the vertices of a mesh, linear in its triangles.

    Attributes
    ----------
    mesh : MeshTri2
    sizes : (vertices,)
    """

    mesh: MeshTri2
    sizes: NDArray[np.float64]

    @classmethod
    def of_elements(cls, mesh: MeshTri2, sizes: NDArray[np.float64]) -> SizeField:
        """From a size per element: geometric means at the vertices, lowered where too steep."""
        vertices, count = mesh.t.ravel(), np.bincount(mesh.t.ravel(), minlength=mesh.nvertices)
        total = np.bincount(vertices, np.tile(np.log(sizes), 3), mesh.nvertices)
        at_vertices = np.exp(total / np.maximum(count, 1))
        a, b = mesh.facets
        rise = GROWTH * np.linalg.norm(mesh.p[:, a] - mesh.p[:, b], axis=0)
        while True:
            lowered = at_vertices.copy()
            np.minimum.at(lowered, a, at_vertices[b] + rise)
            np.minimum.at(lowered, b, at_vertices[a] + rise)
            if not (lowered < at_vertices).any():
                return cls(mesh, at_vertices)
            at_vertices = lowered

    def coarsened(self, most: float) -> SizeField:
        """The same field, or a coarser one of about `most` elements."""
        mean = self.sizes[self.mesh.t].mean(axis=0)
        count = float(((SPARE * element_sizes(self.mesh) / mean) ** 2).sum())
        return SizeField(self.mesh, self.sizes * np.sqrt(max(count / most, 1.0)))


def element_sizes(mesh: MeshTri2, sliver: float = SLIVER) -> NDArray[np.float64]:
    """Edge of the equilateral triangle of an element's area, or `sliver` of its longest edge, m.

    The larger one: a sliver's area says nothing of its neighbours, and in the cusp between arcs
    that touch meshes as fine as that would take gmsh minutes.
    """
    corners = mesh.p[:, mesh.t]
    (x0, x1, x2), (y0, y1, y2) = corners
    area = 0.5 * np.abs((x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0))
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=0).max(axis=0)
    return np.maximum(np.sqrt(4.0 / np.sqrt(3.0) * area), sliver * longest)


def outlines(scene: Scene) -> dict[str, Outline]:
    """The outlines that the mesh follows, by patch name: the electrodes, then the probe."""
    found: dict[str, Outline] = {electrode_patch(e.name): e.outline for e in scene.electrode_list}
    if scene.probe is not None:
        found[PROBE] = scene.probe.outline
    return found


def mesh_scene(scene: Scene, sizes: Sizes | SizeField, part: Part = WHOLE) -> MeshTri2:
    """Mesh a scene, or a part of it in the part's axes.

    Parameters
    ----------
    scene : Scene
        The film, its electrodes and the probe.
    sizes : Sizes or SizeField
        Element sizes; patches that `Sizes.patches` does not name get no finer mesh.
    part : Part, optional

    Returns
    -------
    MeshTri2
        Coordinates in metres. Subdomains: ``film``, one ``electrode NAME`` each and ``probe``;
        boundaries: ``rim``, and those of `MIRRORS` that a part has. Outside of the part an
        electrode has no elements.

    Raises
    ------
    MeshError
        When gmsh fails, a patch has got no element, or elements fold although they are straight.
    """
    least = DISTORTED_BENT if bending_joins(scene) else DISTORTED
    smallest = min((shape.perimeter for shape in outlines(scene).values()), default=0.0)
    for _ in range(ATTEMPTS):
        mesh = _straightened(_mesh_once(scene, sizes, part), least, FLAT * smallest)
        bad = compression(mesh) < least
        if not bad.any():
            return mesh
        wanted = SPARE * element_sizes(mesh)
        wanted[bad] = SMALLER * element_sizes(mesh, DISTORTED_SLIVER)[bad]
        sizes = SizeField.of_elements(mesh, wanted)
    mesh = _straightened(mesh, least, np.inf)
    if (bad := compression(mesh) < least).any():
        raise MeshError(f"{bad.sum()} elements fold: an outline nearly touches another")
    return mesh


def _straightened(mesh: MeshTri2, least: float, most: float) -> MeshTri2:
    """Straight sides of the elements compressed to `least`, where that moves them by up to `most`.

    They lie in cusps too narrow for an arc.
    """
    while True:
        points = mesh.doflocs.copy()
        nodes = mesh.dofs.element_dofs[:, compression(mesh) < least]
        for middle, (a, b) in enumerate(SIDES, start=3):
            halfway = 0.5 * (points[:, nodes[a]] + points[:, nodes[b]])
            near = np.linalg.norm(halfway - points[:, nodes[middle]], axis=0) <= most
            points[:, nodes[middle][near]] = halfway[:, near]
        if np.array_equal(points, mesh.doflocs):
            return mesh
        mesh = replace(mesh, doflocs=points)


def _mesh_once(scene: Scene, sizes: Sizes | SizeField, part: Part) -> MeshTri2:
    unit = scene.film.radius / 100.0
    shapes: dict[str, Outline] = {FILM: Circle(np.zeros(2), scene.film.radius)}
    shapes |= {name: mapped(shape, part.frame) for name, shape in outlines(scene).items()}
    shapes |= {electrode_patch(image): shape for image, (_, shape) in part.images.items()}
    with _ONE_MODEL, _gmsh():
        try:
            patches = _fragment(shapes, unit, part)
            for option in OTHER_SIZES:
                gmsh.option.setNumber(f"Mesh.{option}", 0)
            arcs = _arcs(scene.numerics.tolerance)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", arcs)
            gmsh.option.setNumber("Mesh.Algorithm", FRONTAL_DELAUNAY)
            gmsh.option.setNumber("Mesh.LcIntegrationPrecision", CURVE_PRECISION)
            if isinstance(sizes, Sizes):
                sizes = _with_images(sizes, part)
                curves = {
                    name: _outer_curves(patches[name], shapes[name], part)
                    for name in sizes.patches
                    if name in patches
                }
                _grade_from_outlines(curves, sizes, unit)
            else:
                _follow(sizes, unit)
            gmsh.model.mesh.generate(2)
            gmsh.model.mesh.setOrder(2)
        except Exception as error:
            raise MeshError(f"gmsh failed: {error}") from error
        circles = [shape for shape in shapes.values() if isinstance(shape, Circle)]
        return _read({name: patches.get(name) for name in shapes}, unit, circles, part)


def _arcs(tolerance: float) -> int:
    """Least number of quadratic arcs of a circle.

    Measured, with arcs of the right area: 16 change the charges by less than 2e-7 under a disc.
    """
    return int(np.ceil(max(12.0, 16.0 * (1e-5 / tolerance) ** 0.25)))


@contextmanager
def _gmsh() -> Iterator[None]:
    gmsh.initialize(argv=["", "-v", "1"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        yield
    finally:
        gmsh.finalize()


def _fragment(shapes: dict[str, Outline], unit: float, part: Part) -> dict[str, list[int]]:
    """Surfaces of each patch in the part, ``film`` included, after all outlines have cut it."""
    occ, radius = gmsh.model.occ, 100.0
    film = [(2, occ.addDisk(0.0, 0.0, 0.0, radius, radius))]
    names = [name for name in shapes if name != FILM]
    if part.mirrored:
        x, y = (0.0 if axis in part.mirrored else -2.0 * radius for axis in (0, 1))
        box = occ.addRectangle(x, y, 0.0, 2.0 * radius - x, 2.0 * radius - y)
        film, _ = occ.intersect(film, [(2, box)])
        names = [name for name in names if part.covers(shapes[name], shapes[FILM].reach)]
    tools = [(2, _surface(shapes[name], unit)) for name in names]
    every, pieces = occ.fragment(film, tools) if tools else (film, [film])
    inside = set(pieces[0])
    occ.remove([piece for piece in every if piece not in inside], recursive=True)
    occ.synchronize()
    return {
        name: [tag for dimension, tag in piece if (dimension, tag) in inside]
        for name, piece in zip([FILM, *names], pieces, strict=True)
    }


def _surface(outline: Outline, unit: float) -> int:
    occ = gmsh.model.occ
    if isinstance(outline, Circle):
        x, y = outline.centre / unit
        radius = outline.radius / unit
        return int(occ.addDisk(x, y, 0.0, radius, radius))
    points = [occ.addPoint(x, y, 0.0) for x, y in outline.vertices / unit]
    lines = [occ.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
    return int(occ.addPlaneSurface([occ.addCurveLoop(lines)]))


def _outer_curves(surfaces: list[int], shape: Outline, part: Part) -> list[int]:
    """The curves of a patch's outline, without those along which a mirror line cuts it."""
    pairs = gmsh.model.getBoundary([(2, tag) for tag in surfaces], combined=True, oriented=False)
    curves = {abs(tag) for _, tag in pairs}
    for axis in part.mirrored:
        if shape.lowest[axis] < -ON_LINE * shape.reach:
            place = {curve: gmsh.model.occ.getCenterOfMass(1, curve)[axis] for curve in curves}
            curves = {curve for curve in curves if place[curve] > 100.0 * ON_LINE}
    return sorted(curves)


def _with_images(sizes: Sizes, part: Part) -> Sizes:
    """The sizes, and those of electrodes for their images."""
    of = {electrode_patch(image): electrode_patch(name) for image, (name, _) in part.images.items()}
    images = {image: sizes.patches[name] for image, name in of.items() if name in sizes.patches}
    return Sizes(sizes.patches | images, sizes.growth, sizes.film)


def _grade_from_outlines(outer: dict[str, list[int]], sizes: Sizes, unit: float) -> None:
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.film / unit)
    field = gmsh.model.mesh.field
    graded = []
    for name, curves in outer.items():
        size = sizes.patches[name]
        length = max(gmsh.model.occ.getMass(1, curve) for curve in curves)
        distance = field.add("Distance")
        field.setNumbers(distance, "CurvesList", curves)
        field.setNumber(distance, "Sampling", int(np.clip(2 * length * unit / size, 10, 1000)))
        threshold = field.add("Threshold")
        for key, value in {
            "InField": distance,
            "SizeMin": size / unit,
            "SizeMax": sizes.film / unit,
            "DistMin": 0.0,
            "DistMax": max((sizes.film - size) / sizes.growth / unit, 1e-9),
        }.items():
            field.setNumber(threshold, key, value)
        graded.append(threshold)
    if graded:
        smallest = field.add("Min")
        field.setNumbers(smallest, "FieldsList", graded)
        field.setAsBackgroundMesh(smallest)


def _follow(sizes: SizeField, unit: float) -> None:
    mesh = sizes.mesh
    corners = np.zeros((mesh.nelements, 3, 3))
    corners[:, :2] = mesh.p[:, mesh.t].transpose(2, 0, 1) / unit
    values = sizes.sizes[mesh.t.T] / unit
    data = np.hstack([corners.reshape(-1, 9), values])
    view = gmsh.view.add("sizes")
    gmsh.view.addListData(view, "ST", mesh.nelements, data.ravel())
    field = gmsh.model.mesh.field
    background = field.add("PostView")
    field.setNumber(background, "ViewTag", view)
    # Points between the rim and its chords take the size of the nearest triangle.
    field.setNumber(background, "UseClosest", 1)
    field.setAsBackgroundMesh(background)


def _read(
    patches: dict[str, list[int] | None], unit: float, circles: list[Circle], part: Part
) -> MeshTri2:
    """The gmsh model as a scikit-fem mesh, with `circles` of the right area.

    Of `patches` those that are None have no place in the part.
    """
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.empty(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    blocks, spans, count = [], {}, 0
    for _, surface in gmsh.model.getEntities(2):
        _, _, nodes = gmsh.model.mesh.getElements(2, surface)
        block = row[nodes[0]].reshape(-1, 6) if nodes else np.empty((0, 6), dtype=np.int64)
        blocks.append(block)
        spans[surface] = np.arange(count, count + len(block))
        count += len(block)
    none = np.empty(0, dtype=np.int64)
    subdomains = {
        name: np.concatenate([none, *(spans[surface] for surface in surfaces or ())])
        for name, surfaces in patches.items()
    }
    empty = [
        n for n, surfaces in patches.items() if surfaces is not None and not len(subdomains[n])
    ]
    if empty:
        found = [name for name in subdomains if name not in empty]
        raise MeshError(f"patches without elements: {empty}; patches found: {found}")
    points = coordinates.reshape(-1, 3)[:, :2].T * unit
    for axis in part.mirrored:
        points[axis, np.abs(points[axis]) < ON_LINE * 100.0 * unit] = 0.0
    triangles = with_sorted_vertices(np.concatenate(blocks))
    curved = np.zeros(len(tags), dtype=bool)
    for _, curve in gmsh.model.getEntities(1):
        if gmsh.model.getType(1, curve) != "Line":
            curved[row[gmsh.model.mesh.getNodes(1, curve)[0]]] = True
    for circle in circles:
        bulge(points, triangles, circle, curved, 100.0 * unit)
    return named(MeshTri2(points, triangles.T), subdomains, part)


def named(mesh: MeshTri2, subdomains: dict[str, NDArray[np.int64]], part: Part) -> MeshTri2:
    """The mesh of a part with its subdomains, and with its rim and mirror lines as boundaries."""
    rim, boundaries = mesh.boundary_facets(), {}
    for axis in part.mirrored:
        along = (mesh.p[axis, mesh.facets[:, rim]] == 0.0).all(axis=0)
        boundaries[MIRRORS[axis]], rim = rim[along], rim[~along]
    return mesh.with_subdomains(subdomains).with_boundaries({RIM: rim, **boundaries})
