"""Mesh a scene with gmsh: the clamped disc with electrodes, patches and probes as subdomains.

This is the only module that imports gmsh. The outlines are embedded with OpenCASCADE's
``fragment``, and subdomains and their overlaps are unions of elements. Elements are six-node
triangles: the rim and curved outlines are curved to second order, with the areas of the outlines.
Element sizes are smallest along the outlines and grow linearly with the distance from them
(`GradedSizes`), or follow an error estimate on an earlier mesh (`SizeField`). A mesh can cover the
symmetry sector of a scene alone (`symmetry.SymmetrySector`).

In gmsh the film's radius is 100, so that gmsh's absolute geometric tolerance is equally fine for
films of 1 mm and of 1 m.
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
from pvdf_fem.mesh.subdomains import (
    FILM,
    collect_outlines,
    make_subdomain_name,
    name_mesh_parts,
)
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.scene.outlines.outline import EllipseCurve, Line, Outline
from pvdf_fem.scene.scene import Scene

_LOADING_ERROR = ""
try:
    import gmsh
except (ImportError, OSError) as error:  # only meshing needs it
    _LOADING_ERROR = describe_missing_gmsh(error)

# gmsh has one state for all threads, and a worker of a cluster may have several threads.
_GMSH_LOCK = threading.Lock()
if hasattr(os, "register_at_fork"):  # a fork while another thread meshes would copy a closed lock
    os.register_at_fork(
        before=_GMSH_LOCK.acquire,
        after_in_parent=_GMSH_LOCK.release,
        after_in_child=_GMSH_LOCK.release,
    )
_OPTIONS = {
    "General.Terminal": 0,
    "General.Verbosity": 1,
    # errors are exceptions
    "General.AbortOnError": 2,
    "General.NumThreads": 1,
    # other sources of element sizes are switched off
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeExtendFromBoundary": 0,
    # frontal Delaunay
    "Mesh.Algorithm": 6,
    # precision of the number of elements along a curve; gmsh's 1e-9 takes most of the time
    "Mesh.LcIntegrationPrecision": 1e-2,
}
# Radius of the film in gmsh.
_GMSH_RADIUS = 100.0
# Curves and nodes nearer to a mirror line than this share of the film's radius are on the line.
_ON_MIRROR_LINE = 1e-8


class MeshError(RuntimeError):
    """An error of gmsh in a scene; the text names the patches found and expected."""


class GmshInUseError(RuntimeError):
    """An open gmsh session elsewhere in the program, whose options and models would change."""


def mesh_scene(
    scene: Scene,
    sizes: GradedSizes | SizeField,
    sector: SymmetrySector = WHOLE_FILM,
    min_jacobian_ratio: float = 0.14,
    attempts: int = 6,
    contacts: Mapping[str, Outline] = MappingProxyType({}),
    require: Callable[[float], object] = lambda elements: None,
) -> MeshTri2:
    """Mesh a scene, or its symmetry sector in the axes of the sector.

    Parameters
    ----------
    scene : Scene
        The scene.
    sizes : GradedSizes or SizeField
        Element sizes in m. The mesh is not refined along outlines that `GradedSizes` does not name.
    sector : SymmetrySector
        Electrodes and probes outside of it have no elements.
    min_jacobian_ratio : float
        Least Jacobian of an element over its mean. The next mesh is finer at elements below it,
        which lie between an arc and a corner or an edge close to the arc. The cusp between an arc
        and its tangent, or between two arcs that touch, has 0.15 at any element size.
    attempts : int
        Largest number of meshes. Elements that are still distorted in the last mesh get straight
        sides.
    contacts : mapping of str to Outline
        Edges of contacts with tips by the names of probes, in place of the probes' outlines.
    require : callable
        Called before each mesh with the estimated number of its elements; may raise.

    Returns
    -------
    MeshTri2
        With coordinates in m. Subdomains are ``film``, ``electrode NAME`` for every electrode,
        ``film patch 1``, ``film patch 2``, ..., and ``probe`` or ``probe 1``, ``probe 2``, ...;
        boundaries are ``rim`` and the mirror lines of the sector (`MIRRORS`).

    Raises
    ------
    MeshError
        When gmsh fails, a patch has no element, or elements with straight sides fold.
    GmshMissingError
        When gmsh cannot be loaded.
    GmshInUseError
        When gmsh has a session elsewhere in the program.
    """
    outlines = collect_outlines(scene) | dict(contacts)
    shortest = min((outline.perimeter for outline in outlines.values()), default=0.0)
    if isinstance(sizes, GradedSizes):
        film = scene.film.outline
        whole_count = sizes.estimate_element_count(
            film.area, {FILM: film, **outlines}, arcs=_count_arcs(scene.numerics.tolerance)
        )
        require(whole_count / len(sector.signs))
    for _ in range(attempts):
        mesh = _mesh_once(scene, outlines, sizes=sizes, sector=sector)
        # a side moved by this share of the shortest outline changes the area by less than 1e-6
        mesh, is_distorted = straighten_sides(
            mesh, min_jacobian_ratio, largest_move=1e-5 * shortest
        )
        if not is_distorted.any():
            return mesh
        finer_sizes = GMSH_SIZE_RATIO * compute_element_sizes(mesh)
        finer_sizes[is_distorted] = 0.4 * compute_element_sizes(mesh, sliver=0.1)[is_distorted]
        sizes = SizeField.from_element_sizes(mesh, finer_sizes)
        require(sizes.element_count)
    mesh, is_distorted = straighten_sides(mesh, min_jacobian_ratio, largest_move=np.inf)
    if is_distorted.any():
        count = is_distorted.sum()
        raise MeshError(f"{count} elements fold: an outline nearly touches another")
    return mesh


def _mesh_once(
    scene: Scene,
    outlines: dict[str, Outline],
    sizes: GradedSizes | SizeField,
    sector: SymmetrySector,
) -> MeshTri2:
    """Mesh a scene once, with its outlines in the scene's axes."""
    unit = scene.film.radius / _GMSH_RADIUS
    shapes: dict[str, Outline] = {FILM: scene.film.outline}
    for name, outline in outlines.items():
        shapes[name] = outline.transform(sector.frame)
    for name, reflected in sector.reflected_electrodes.items():
        shapes[make_subdomain_name(name)] = reflected.outline
    with _GMSH_LOCK, _open_gmsh():
        try:
            surfaces = _fragment_film(shapes, unit, sector=sector)
            arcs = _count_arcs(scene.numerics.tolerance)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", arcs)
            if isinstance(sizes, GradedSizes):
                sizes = _add_reflected_sizes(sizes, sector)
                curves = {
                    name: _find_outer_curves(surfaces[name], shapes[name], sector=sector)
                    for name in sizes.patches
                    if name in surfaces
                }
                _set_graded_sizes(curves, sizes, unit=unit)
            else:
                _set_size_field(sizes, unit)
            gmsh.model.mesh.generate(2)
            gmsh.model.mesh.setOrder(2)
        except Exception as error:
            raise MeshError(f"gmsh failed: {error}") from error
        curved_outlines = [shape for shape in shapes.values() if shape.is_curved]
        surfaces_by_name = {name: surfaces.get(name) for name in shapes}
        return _read_mesh(surfaces_by_name, unit, curved_outlines=curved_outlines, sector=sector)


def _count_arcs(tolerance: float) -> int:
    """Return the least number of quadratic arcs of a circle for a tolerance of charges.

    Measured with arcs of the right area: 16 of them change the charges by less than 2e-7 under a
    disc.
    """
    return int(np.ceil(max(12.0, 16.0 * (1e-5 / tolerance) ** 0.25)))


@contextmanager
def _open_gmsh() -> Iterator[None]:
    """Open an empty model with our options, in a session of its own."""
    if _LOADING_ERROR:
        raise GmshMissingError(_LOADING_ERROR)
    if gmsh.isInitialized():
        raise GmshInUseError("gmsh has models of this program; call gmsh.finalize() before a solve")
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        for name, value in _OPTIONS.items():
            gmsh.option.setNumber(name, value)
        yield
    finally:
        gmsh.finalize()


def _fragment_film(
    shapes: dict[str, Outline], unit: float, sector: SymmetrySector
) -> dict[str, list[int]]:
    """Cut the film of a sector along all outlines; return the tags of surfaces by name."""
    occ = gmsh.model.occ
    film = [(2, _add_surface(shapes[FILM], unit))]
    names = [name for name in shapes if name != FILM]
    if sector.mirror_axes:
        low_x = 0.0 if 0 in sector.mirror_axes else -2.0 * _GMSH_RADIUS
        low_y = 0.0 if 1 in sector.mirror_axes else -2.0 * _GMSH_RADIUS
        high = 2.0 * _GMSH_RADIUS
        box = occ.addRectangle(low_x, low_y, 0.0, high - low_x, high - low_y)
        film, _ = occ.intersect(film, [(2, box)])
        reach = shapes[FILM].reach
        names = [name for name in names if sector.covers(shapes[name], reach)]
    tools = [(2, _add_surface(shapes[name], unit)) for name in names]
    fragments, pieces = occ.fragment(film, tools) if tools else (film, [film])
    inside = set(pieces[0])
    outside = [fragment for fragment in fragments if fragment not in inside]
    occ.remove(outside, recursive=True)
    occ.synchronize()
    surfaces = {}
    for name, piece in zip([FILM, *names], pieces, strict=True):
        surfaces[name] = [tag for dimension, tag in piece if (dimension, tag) in inside]
    return surfaces


def _add_surface(outline: Outline, unit: float) -> int:
    """Add the surface within an outline to the model; return its tag."""
    occ = gmsh.model.occ
    points = [occ.addPoint(x, y, 0.0) for x, y in outline.corners / unit]
    curves = []
    for number, piece in enumerate(outline.boundary):
        if isinstance(piece, Line):
            curves.append(occ.addLine(points[number], points[(number + 1) % len(points)]))
        else:
            curves.append(_add_ellipse(piece, unit))
    return int(occ.addPlaneSurface([occ.addCurveLoop(curves)]))


def _add_ellipse(curve: EllipseCurve, unit: float) -> int:
    """Add an ellipse to the model; return its tag."""
    x, y = curve.centre / unit
    lengths = np.linalg.norm(curve.axes, axis=0) / unit
    major = int(lengths.argmax())  # gmsh expects the major axis first
    return int(
        gmsh.model.occ.addEllipse(
            x,
            y,
            0.0,
            lengths[major],
            lengths[1 - major],
            zAxis=[0.0, 0.0, 1.0],
            xAxis=[*curve.axes[:, major], 0.0],
        )
    )


def _find_outer_curves(surfaces: list[int], shape: Outline, sector: SymmetrySector) -> list[int]:
    """Find the curves along an outline, without those along a mirror line that cuts it."""
    pairs = gmsh.model.getBoundary([(2, tag) for tag in surfaces], combined=True, oriented=False)
    curves = {abs(tag) for _, tag in pairs}
    for axis in sector.mirror_axes:
        is_cut = shape.lower_left[axis] < -_ON_MIRROR_LINE * shape.reach
        if is_cut:
            place = {curve: gmsh.model.occ.getCenterOfMass(1, curve)[axis] for curve in curves}
            limit = _GMSH_RADIUS * _ON_MIRROR_LINE
            curves = {curve for curve in curves if place[curve] > limit}
    return sorted(curves)


def _add_reflected_sizes(sizes: GradedSizes, sector: SymmetrySector) -> GradedSizes:
    """Give the reflections of electrodes the element sizes of the electrodes."""
    reflected_sizes = {}
    for name, reflected in sector.reflected_electrodes.items():
        size = sizes.patches.get(make_subdomain_name(reflected.electrode))
        if size is not None:
            reflected_sizes[make_subdomain_name(name)] = size
    return replace(sizes, patches=sizes.patches | reflected_sizes)


def _set_graded_sizes(curves: dict[str, list[int]], sizes: GradedSizes, unit: float) -> None:
    """Set element sizes that grow with the distance from the curves of outlines."""
    gmsh.option.setNumber("Mesh.MeshSizeMax", sizes.film / unit)
    field = gmsh.model.mesh.field
    thresholds = []
    for name, outline_curves in curves.items():
        size = sizes.patches[name]
        longest = max(gmsh.model.occ.getMass(1, curve) for curve in outline_curves)
        distance = field.add("Distance")
        field.setNumbers(distance, "CurvesList", outline_curves)
        sampling = int(np.clip(2 * longest * unit / size, 10, 1000))
        field.setNumber(distance, "Sampling", sampling)
        threshold = field.add("Threshold")
        width = (sizes.film - size) / sizes.growth / unit
        field.setNumber(threshold, "InField", distance)
        field.setNumber(threshold, "SizeMin", size / unit)
        field.setNumber(threshold, "SizeMax", sizes.film / unit)
        field.setNumber(threshold, "DistMin", 0.0)
        field.setNumber(threshold, "DistMax", max(width, 1e-9))
        thresholds.append(threshold)
    if thresholds:
        smallest = field.add("Min")
        field.setNumbers(smallest, "FieldsList", thresholds)
        field.setAsBackgroundMesh(smallest)


def _set_size_field(sizes: SizeField, unit: float) -> None:
    """Set the element sizes of a field on an earlier mesh."""
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
    # points between the rim and its chords take the size of the nearest triangle
    field.setNumber(background, "UseClosest", 1)
    field.setAsBackgroundMesh(background)


def _read_mesh(
    surfaces: dict[str, list[int] | None],
    unit: float,
    curved_outlines: list[Outline],
    sector: SymmetrySector,
) -> MeshTri2:
    """Read the model of gmsh as a mesh.

    Parameters
    ----------
    surfaces : dict of str to list of int or None
        Tags of surfaces by the name of their subdomain; None for one outside of the sector.
    unit : float
        Unit of gmsh's lengths in m.
    curved_outlines : list of Outline
        The outlines with curved pieces.
    sector : SymmetrySector
        Nodes next to its mirror lines are moved onto them.

    Returns
    -------
    MeshTri2
    """
    tags, coordinates, _ = gmsh.model.mesh.getNodes()
    row = np.empty(int(tags.max()) + 1, dtype=np.int64)
    row[tags] = np.arange(len(tags))
    triangles, elements_of_surface = _read_triangles(row)
    subdomains = {}
    for name, surface_tags in surfaces.items():
        parts = [elements_of_surface[tag] for tag in surface_tags or ()]
        subdomains[name] = np.concatenate([np.empty(0, dtype=np.int64), *parts])
    expected = [name for name, surface_tags in surfaces.items() if surface_tags is not None]
    empty = [name for name in expected if not len(subdomains[name])]
    if empty:
        present = [name for name in subdomains if name not in empty]
        raise MeshError(f"patches without elements: {empty}; patches found: {present}")
    points = coordinates.reshape(-1, 3)[:, :2].T * unit
    for axis in sector.mirror_axes:
        is_on_line = np.abs(points[axis]) < _ON_MIRROR_LINE * _GMSH_RADIUS * unit
        points[axis, is_on_line] = 0.0
    is_curved = np.zeros(len(tags), dtype=bool)
    for _, curve in gmsh.model.getEntities(1):
        if gmsh.model.getEntityType(1, curve) != "Line":
            curve_tags, _, _ = gmsh.model.mesh.getNodes(1, curve)
            is_curved[row[curve_tags]] = True
    for outline in curved_outlines:
        bulge_arcs(
            points, triangles, outline=outline, is_curved=is_curved, radius=_GMSH_RADIUS * unit
        )
    return name_mesh_parts(MeshTri2(points, triangles.T), subdomains, sector=sector)


def _read_triangles(row: Indices) -> tuple[Indices, dict[int, Indices]]:
    """Read the nodes of the triangles (elements, 6), and the elements of each surface by tag."""
    blocks = []
    elements_of_surface = {}
    count = 0
    for _, surface in gmsh.model.getEntities(2):
        _, _, nodes = gmsh.model.mesh.getElements(2, surface)
        block = row[nodes[0]].reshape(-1, 6) if nodes else np.empty((0, 6), dtype=np.int64)
        blocks.append(block)
        elements_of_surface[surface] = np.arange(count, count + len(block))
        count += len(block)
    return sort_vertices(np.concatenate(blocks)), elements_of_surface
