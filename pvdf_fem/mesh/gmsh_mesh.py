"""From a scene to its mesh: the clamped disc with its electrodes and probe as named patches.

No further module imports gmsh. The outlines are embedded with OpenCASCADE's
``fragment``, and patches and their overlaps are unions of elements. Elements are
six-node triangles: rim and curved outlines are curved to second order, with the outlines' areas.
Element sizes are smallest along the outlines and grow linearly with the distance from them
(`GradedSizes`), or follow an error estimate on an earlier mesh (`SizeField`). A mesh can
cover the symmetry sector of a scene alone (`symmetry.SymmetrySector`).

In gmsh the film's radius is 100: gmsh's absolute geometric tolerance is equally fine for films of 1
mm and 1 m.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Indices
from pvdf_fem.mesh.gmsh_libraries import GmshMissingError, describe_missing_gmsh
from pvdf_fem.mesh.six_node import bulge_arcs, sort_vertices, straighten_sides
from pvdf_fem.mesh.size_field import GMSH_SIZE_RATIO, GradedSizes, SizeField, compute_element_sizes
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.scene.outlines.circle import Circle
from pvdf_fem.scene.outlines.outline import EllipseCurve, Line, Outline
from pvdf_fem.scene.scene import Scene

_NOT_LOADED = ""
try:
    import gmsh
except (ImportError, OSError) as error:  # everything but meshing does without
    _NOT_LOADED = describe_missing_gmsh(error)

#: gmsh has a single state for the threads, and a cluster's worker may have several threads.
_ONE_MODEL = threading.Lock()
if hasattr(os, "register_at_fork"):  # forks while another thread meshes would copy a lock for ever
    os.register_at_fork(
        before=_ONE_MODEL.acquire,
        after_in_parent=_ONE_MODEL.release,
        after_in_child=_ONE_MODEL.release,
    )
_OPTIONS = {
    "General.Terminal": 0,
    "General.Verbosity": 1,
    # errors are exceptions
    "General.AbortOnError": 2,
    "General.NumThreads": 1,
    # further sources of element sizes are switched off
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeExtendFromBoundary": 0,
    # frontal Delaunay
    "Mesh.Algorithm": 6,
    # precision in the number of elements along a curve; gmsh's 1e-9 takes most of the time
    "Mesh.LcIntegrationPrecision": 1e-2,
}

RIM = "rim"
FILM = "film"
PROBE = "probe"
#: Where the first and the second coordinate change sign between a part of the film and its image.
MIRRORS = ("mirror x", "mirror y")


def make_subdomain_name(name: str) -> str:
    """Name of the mesh subdomain below an electrode."""
    return f"electrode {name}"


class MeshError(RuntimeError):
    """gmsh could not mesh a scene; the text names the patches found and expected."""


class GmshInUseError(RuntimeError):
    """A gmsh session is open elsewhere in the program; its options and models would change."""


def collect_outlines(scene: Scene) -> dict[str, Outline]:
    """The outlines that the mesh follows, by name: of electrodes, the film's patches, probes."""
    shapes = {make_subdomain_name(e.name): e.outline for e in scene.electrode_list}
    shapes |= {name: layer.patch.outline for name, layer in scene.film.layers.items()}
    return shapes | {touch.patch: touch.outline for touch in scene.loaded_probes}


def mesh_scene(
    scene: Scene,
    sizes: GradedSizes | SizeField,
    part: SymmetrySector = WHOLE_FILM,
    least_jacobian: float = 0.14,
    attempts: int = 6,
    contacts: Mapping[str, Outline] = MappingProxyType({}),
    require: Callable[[float], object] = lambda elements: None,
) -> MeshTri2:
    """Mesh a scene, or a part of it in the part's axes, with coordinates in m.

    Patches that `Sizes.patches` does not name get no finer mesh; the outlines `contacts`, edges of
    contacts with tips, take the place of the probes'. Up to `attempts` meshes are made. A further
    mesh is finer at elements with a Jacobian below `least_jacobian` times its mean, between an arc
    and a corner or edge close to the arc. Remaining bad elements in the last mesh get straight
    sides. The cusp between an arc and its tangent, or between two arcs that touch, has 0.15 at any
    element size. Before a mesh `require` is called with the estimated number of its elements, and
    may raise.

    Subdomains are ``film``, ``electrode NAME`` for every electrode, ``film patch 1``, ``film patch
    2``, ..., and ``probe`` or ``probe 1``, ``probe 2``, ...; boundaries are ``rim`` and the part's
    mirror lines in `MIRRORS`. Outside of the part an electrode or a probe has no elements. Raises
    `MeshError` when gmsh fails, a patch has got no element, or elements fold although they are
    straight, `GmshMissingError` when gmsh cannot be loaded, and `GmshInUseError`.
    """
    shapes = collect_outlines(scene) | dict(contacts)
    smallest = min((shape.perimeter for shape in shapes.values()), default=0.0)
    if isinstance(sizes, GradedSizes):
        film, arcs = Circle(np.zeros(2), scene.film.radius), _arcs(scene.numerics.tolerance)
        require(sizes.elements(film.area, {FILM: film, **shapes}, arcs) / len(part.signs))
    for _ in range(attempts):
        # a side moved by this part of the smallest outline changes the area by less than 1e-6
        mesh, distorted = straighten_sides(
            _mesh_once(scene, shapes, sizes, part), least_jacobian, 1e-5 * smallest
        )
        if not distorted.any():
            return mesh
        next_sizes = GMSH_SIZE_RATIO * compute_element_sizes(mesh)
        next_sizes[distorted] = 0.4 * compute_element_sizes(mesh, sliver=0.1)[distorted]
        sizes = SizeField.from_element_sizes(mesh, next_sizes)
        require(sizes.elements)
    mesh, distorted = straighten_sides(mesh, least_jacobian, np.inf)
    if distorted.any():
        raise MeshError(f"{distorted.sum()} elements fold: an outline nearly touches another")
    return mesh


def _mesh_once(
    scene: Scene, outer: dict[str, Outline], sizes: GradedSizes | SizeField, part: SymmetrySector
) -> MeshTri2:
    unit = scene.film.radius / 100.0
    shapes: dict[str, Outline] = {FILM: Circle(np.zeros(2), scene.film.radius)}
    shapes |= {name: shape.transform(part.frame) for name, shape in outer.items()}
    shapes |= {
        make_subdomain_name(image): shape for image, (_, shape) in part.reflected_electrodes.items()
    }
    with _ONE_MODEL, _gmsh():
        try:
            patches = _fragment(shapes, unit, part)
            arcs = _arcs(scene.numerics.tolerance)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", arcs)
            if isinstance(sizes, GradedSizes):
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
        smooth = [shape for shape in shapes.values() if not len(shape.corners)]
        return _read({name: patches.get(name) for name in shapes}, unit, smooth, part)


def _arcs(tolerance: float) -> int:
    """Least number of quadratic arcs in a circle. Measured, with arcs of the right area: 16 change
    the charges by less than 2e-7 under a disc."""
    return int(np.ceil(max(12.0, 16.0 * (1e-5 / tolerance) ** 0.25)))


@contextmanager
def _gmsh() -> Iterator[None]:
    """An empty model with our options, in a session of its own."""
    if _NOT_LOADED:
        raise GmshMissingError(_NOT_LOADED)
    if gmsh.isInitialized():
        raise GmshInUseError("gmsh has models of this program; call gmsh.finalize() before a solve")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
        yield
    finally:
        gmsh.finalize()


def _fragment(
    shapes: dict[str, Outline], unit: float, part: SymmetrySector
) -> dict[str, list[int]]:
    """Surfaces for every patch in the part, ``film`` included, after the cuts by outlines."""
    occ, radius = gmsh.model.occ, 100.0
    film = [(2, _surface(shapes[FILM], unit))]
    names = [name for name in shapes if name != FILM]
    if part.mirror_axes:
        x, y = (0.0 if axis in part.mirror_axes else -2.0 * radius for axis in (0, 1))
        box = occ.addRectangle(x, y, 0.0, 2.0 * radius - x, 2.0 * radius - y)
        film, _ = occ.intersect(film, [(2, box)])
        names = [name for name in names if part.covers(shapes[name], shapes[FILM].reach)]
    tools = [(2, _surface(shapes[name], unit)) for name in names]
    fragments, pieces = occ.fragment(film, tools) if tools else (film, [film])
    inside = set(pieces[0])
    occ.remove([fragment for fragment in fragments if fragment not in inside], recursive=True)
    occ.synchronize()
    return {
        name: [tag for dimension, tag in piece if (dimension, tag) in inside]
        for name, piece in zip([FILM, *names], pieces, strict=True)
    }


def _surface(outline: Outline, unit: float) -> int:
    occ = gmsh.model.occ
    points = [occ.addPoint(x, y, 0.0) for x, y in outline.corners / unit]
    curves = [
        occ.addLine(points[i], points[(i + 1) % len(points)])
        if isinstance(piece, Line)
        else _ellipse(piece, unit)
        for i, piece in enumerate(outline.boundary)
    ]
    return int(occ.addPlaneSurface([occ.addCurveLoop(curves)]))


def _ellipse(curve: EllipseCurve, unit: float) -> int:
    x, y = curve.centre / unit
    lengths = np.linalg.norm(curve.axes, axis=0) / unit
    major = int(lengths.argmax())  # gmsh wants the major axis first
    a, b = lengths[major], lengths[1 - major]
    direction, upwards = [*curve.axes[:, major], 0.0], [0.0, 0.0, 1.0]
    return int(gmsh.model.occ.addEllipse(x, y, 0.0, a, b, zAxis=upwards, xAxis=direction))


def _outer_curves(
    surfaces: list[int], shape: Outline, part: SymmetrySector, on_line: float = 1e-8
) -> list[int]:
    """The curves along a patch's outline, without cuts by a mirror line: curves nearer to the line
    than the part `on_line` of the film's radius."""
    pairs = gmsh.model.getBoundary([(2, tag) for tag in surfaces], combined=True, oriented=False)
    curves = {abs(tag) for _, tag in pairs}
    for axis in part.mirror_axes:
        if shape.lower_left[axis] < -on_line * shape.reach:
            place = {curve: gmsh.model.occ.getCenterOfMass(1, curve)[axis] for curve in curves}
            curves = {curve for curve in curves if place[curve] > 100.0 * on_line}
    return sorted(curves)


def _with_images(sizes: GradedSizes, part: SymmetrySector) -> GradedSizes:
    """The sizes, with electrode sizes also for electrode images."""
    patches = {
        make_subdomain_name(image): sizes.patches[make_subdomain_name(name)]
        for image, (name, _) in part.reflected_electrodes.items()
        if make_subdomain_name(name) in sizes.patches
    }
    return replace(sizes, patches=sizes.patches | patches)


def _grade_from_outlines(outer: dict[str, list[int]], sizes: GradedSizes, unit: float) -> None:
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.film / unit)
    field = gmsh.model.mesh.field
    graded = []
    for name, curves in outer.items():
        size, growth = sizes.patches[name], sizes.growth
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
            "DistMax": max((sizes.film - size) / growth / unit, 1e-9),
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
    patches: dict[str, list[int] | None],
    unit: float,
    smooth: list[Outline],
    part: SymmetrySector,
    on_line: float = 1e-8,
) -> MeshTri2:
    """The gmsh model as a mesh; a patch without a list of surfaces has no place in the part. Nodes
    nearer to a mirror line than the part `on_line` of the film's radius are on the line."""
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.empty(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    triangles, surface_elements = _triangles(row)
    none = np.empty(0, dtype=np.int64)
    subdomains = {
        name: np.concatenate([none, *(surface_elements[surface] for surface in surfaces or ())])
        for name, surfaces in patches.items()
    }
    expected = [name for name, surfaces in patches.items() if surfaces is not None]
    if empty := [name for name in expected if not len(subdomains[name])]:
        present = [name for name in subdomains if name not in empty]
        raise MeshError(f"patches without elements: {empty}; patches found: {present}")
    points = coordinates.reshape(-1, 3)[:, :2].T * unit
    for axis in part.mirror_axes:
        points[axis, np.abs(points[axis]) < on_line * 100.0 * unit] = 0.0
    curved = np.zeros(len(tags), dtype=bool)
    for _, curve in gmsh.model.getEntities(1):
        if gmsh.model.getEntityType(1, curve) != "Line":
            curved[row[gmsh.model.mesh.getNodes(1, curve)[0]]] = True
    for outline in smooth:
        bulge_arcs(points, triangles, outline, curved, 100.0 * unit)
    return name_mesh_parts(MeshTri2(points, triangles.T), subdomains, part)


def _triangles(row: Indices) -> tuple[Indices, dict[int, Indices]]:
    """Nodes of the triangles, (elements, 6), and the elements in each surface, by gmsh's tag."""
    blocks, surface_elements, count = [], {}, 0
    for _, surface in gmsh.model.getEntities(2):
        _, _, nodes = gmsh.model.mesh.getElements(2, surface)
        block = row[nodes[0]].reshape(-1, 6) if nodes else np.empty((0, 6), dtype=np.int64)
        blocks.append(block)
        surface_elements[surface] = np.arange(count, count + len(block))
        count += len(block)
    return sort_vertices(np.concatenate(blocks)), surface_elements


def name_mesh_parts(
    mesh: MeshTri2, subdomains: dict[str, Indices], part: SymmetrySector
) -> MeshTri2:
    """The mesh of a part with its subdomains, and with its rim and mirror lines as boundaries."""
    rim, boundaries = mesh.boundary_facets(), {}
    for axis in part.mirror_axes:
        along = (mesh.p[axis, mesh.facets[:, rim]] == 0.0).all(axis=0)
        boundaries[MIRRORS[axis]], rim = rim[along], rim[~along]
    return mesh.with_subdomains(subdomains).with_boundaries({RIM: rim, **boundaries})
