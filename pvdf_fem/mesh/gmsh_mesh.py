"""Mesh a scene with gmsh: the clamped film with electrodes, patches and probes as subdomains.

This module alone uses gmsh in the program's own process. The outlines are embedded by OpenCASCADE's
``fragment``, so that subdomains and their intersections are unions of elements. Elements are
six-node triangles, whose curved sides give them the areas of the outlines. Element sizes are
smallest along the outlines and grow linearly with the distance from them (`GradedSizes`), or follow
an error estimate on an earlier mesh (`SizeField`). A mesh may cover only a symmetry sector of a
scene (`symmetry.SymmetrySector`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from types import MappingProxyType

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.mesh import six_node
from pvdf_fem.mesh.gmsh_libraries import GmshInUseError, GmshMissingError, describe_missing_gmsh
from pvdf_fem.mesh.gmsh_lock import GMSH_LOCK
from pvdf_fem.mesh.gmsh_outlines import add_surface
from pvdf_fem.mesh.size_field import (
    GMSH_SIZE_RATIO,
    GradedSizes,
    PointSize,
    SizeField,
    compute_element_sizes,
    count_arcs,
)
from pvdf_fem.mesh.subdomains import (
    FILM,
    add_reflected_sizes,
    collect_outlines,
    make_subdomain_name,
    name_mesh_parts,
)
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene

_LOADING_ERROR = ""
try:
    import gmsh
except (ImportError, OSError) as error:  # reported when a mesh is needed
    _LOADING_ERROR = describe_missing_gmsh(error)

_OPTIONS = {
    "General.Terminal": 0,
    "General.Verbosity": 1,
    "General.AbortOnError": 2,  # raise exceptions
    "General.NumThreads": 1,
    # no other sources of element sizes
    "Mesh.MeshSizeFromPoints": 0,
    "Mesh.MeshSizeExtendFromBoundary": 0,
    "Mesh.Algorithm": 6,  # frontal Delaunay
    # tolerance of the integral that gives the number of elements on a curve: with gmsh's default
    # 1e-9 this integral takes most of the time
    "Mesh.LcIntegrationPrecision": 1e-2,
}
# Film's reach in gmsh's units, so that gmsh's absolute tolerance is relative to the film's size.
_GMSH_RADIUS = 100.0
# Curves and nodes closer to a mirror line than this fraction of the film's reach count as on it.
_ON_MIRROR_LINE = 1e-8


class MeshError(RuntimeError):
    """gmsh cannot mesh a scene."""


def mesh_scene(
    scene: Scene,
    sizes: GradedSizes | SizeField,
    sector: SymmetrySector = WHOLE_FILM,
    min_jacobian_ratio: float = 0.14,
    attempts: int = 6,
    contacts: Mapping[str, Outline] = MappingProxyType({}),
    check_element_count: Callable[[float], object] = lambda count: None,
) -> MeshTri2:
    """Mesh the film of a scene, or a symmetry sector of it.

    Parameters
    ----------
    scene : Scene
        The scene, whose outlines the mesh follows.
    sizes : GradedSizes or SizeField
        Element sizes in m. Along outlines that `GradedSizes` does not name, there is no refinement.
    sector : SymmetrySector
        The sector to mesh, by default the whole film. Subdomains of electrodes, probes and patches
        outside of it are empty.
    min_jacobian_ratio : float
        Minimum Jacobian of an element, as a fraction of the element's mean. Elements below it are
        distorted; they lie between an arc and a corner or side close to the arc. If they cannot be
        repaired, the next mesh is finer there. In the cusp between an arc and its tangent, or
        between two arcs that touch, the ratio is 0.15 at any size.
    attempts : int
        Maximum number of meshes. Elements still distorted in the last one get straight sides.
    contacts : mapping of str to Outline
        Boundaries of the contact areas of tips, by the names of the probes' subdomains; they
        replace the outlines of these probes.
    check_element_count : callable
        Called with the estimated number of elements before each mesh, except before a first mesh
        with a `SizeField`; it may raise an exception to prevent the meshing.

    Returns
    -------
    MeshTri2
        With coordinates in m, in the axes of the sector. Subdomains are ``film``,
        ``electrode NAME`` for every electrode, ``film patch 1``, ``film patch 2``, ..., and
        ``probe`` or ``probe 1``, ``probe 2``, .... Boundaries are ``rim`` and the mirror lines of
        the sector (`MIRRORS`).

    Raises
    ------
    MeshError
        If gmsh fails, a subdomain in the sector has no element, or elements remain distorted.
    GmshMissingError
        If gmsh cannot be loaded.
    GmshInUseError
        If another part of the program has a gmsh session.
    """
    outlines = collect_outlines(scene) | dict(contacts)
    shortest = min((outline.perimeter for outline in outlines.values()), default=0.0)
    if isinstance(sizes, GradedSizes):
        film = scene.film.outline
        whole_count = sizes.estimate_element_count(
            film.area, {FILM: film, **outlines}, arcs=count_arcs(scene.numerics.tolerance)
        )
        check_element_count(whole_count / len(sector.signs))
    for _ in range(attempts):
        mesh = _mesh_once(scene, outlines, sizes=sizes, sector=sector)
        # moving a node by this fraction of the shortest outline changes its area by less than 1e-6
        mesh, is_distorted = six_node.repair_distorted_elements(
            mesh, min_jacobian_ratio, max_move=1e-5 * shortest
        )
        if not is_distorted.any():
            return mesh
        finer_sizes = GMSH_SIZE_RATIO * compute_element_sizes(mesh)
        finer_sizes[is_distorted] = 0.4 * compute_element_sizes(mesh, sliver=0.1)[is_distorted]
        sizes = SizeField.from_element_sizes(mesh, finer_sizes)
        check_element_count(sizes.element_count)
    mesh, is_distorted = six_node.repair_distorted_elements(mesh, min_jacobian_ratio, np.inf)
    if is_distorted.any():
        reason = f"{is_distorted.sum()} elements are folded, since two outlines nearly touch"
        raise MeshError(f"{reason}; move them apart")
    return mesh


def _mesh_once(
    scene: Scene,
    outlines: dict[str, Outline],
    sizes: GradedSizes | SizeField,
    sector: SymmetrySector,
) -> MeshTri2:
    """Make a mesh of a scene in one gmsh session, without repair of distorted elements.

    Parameters
    ----------
    scene : Scene
        The scene, for its film and its tolerance.
    outlines : dict of str to Outline
        Outlines in the scene's axes by the names of their subdomains.
    sizes : GradedSizes or SizeField
        Element sizes in m.
    sector : SymmetrySector
        The sector to mesh.

    Returns
    -------
    MeshTri2
        With coordinates in m, in the axes of the sector.
    """
    unit = scene.film.reach / _GMSH_RADIUS
    shapes: dict[str, Outline] = {FILM: scene.film.outline.transform(sector.frame)}
    for name, outline in outlines.items():
        shapes[name] = outline.transform(sector.frame)
    for name, reflected in sector.reflected_electrodes.items():
        shapes[make_subdomain_name(name)] = reflected.outline
    with GMSH_LOCK, _open_gmsh():
        try:
            surfaces = _fragment_film(shapes, unit, sector=sector)
            arcs = count_arcs(scene.numerics.tolerance)
            gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", arcs)
            if isinstance(sizes, GradedSizes):
                sizes = add_reflected_sizes(sizes, sector)
                curves = {
                    name: _find_outer_curves(surfaces[name], shapes[name], sector=sector)
                    for name in sizes.patches
                    if name in surfaces
                }
                _set_graded_sizes(curves, sizes, unit=unit, frame=sector.frame)
            else:
                _set_size_field(sizes, unit)
            gmsh.model.mesh.generate(2)
            gmsh.model.mesh.setOrder(2)
        except Exception as error:
            raise MeshError(f"gmsh failed: {error}") from error
        curved_outlines = [shape for shape in shapes.values() if shape.is_curved]
        surfaces_by_name = {name: surfaces.get(name) for name in shapes}
        return _read_mesh(surfaces_by_name, unit, curved_outlines=curved_outlines, sector=sector)


@contextmanager
def _open_gmsh() -> Iterator[None]:
    """Open a gmsh session with the options `_OPTIONS`, and close it at the end.

    Raises GmshMissingError if gmsh cannot be loaded, and GmshInUseError if a session is open.
    """
    if _LOADING_ERROR:
        raise GmshMissingError(_LOADING_ERROR)
    if gmsh.isInitialized():
        raise GmshInUseError("gmsh is in use by this program; call gmsh.finalize() before a solve")
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
    """Add the film of a sector to gmsh's model, cut along all outlines.

    Parameters
    ----------
    shapes : dict of str to Outline
        Outlines of the film and of all subdomains, in the axes of the sector.
    unit : float
        Unit of gmsh's lengths in m.
    sector : SymmetrySector
        The sector. Parts of the film and of subdomains outside of it are removed.

    Returns
    -------
    dict of str to list of int
        Tags of the surfaces of each subdomain that lies at least partly in the sector.
    """
    occ = gmsh.model.occ
    film = [(2, add_surface(occ, shapes[FILM], unit))]
    names = [name for name in shapes if name != FILM]
    if sector.mirror_axes:
        low_x = 0.0 if 0 in sector.mirror_axes else -2.0 * _GMSH_RADIUS
        low_y = 0.0 if 1 in sector.mirror_axes else -2.0 * _GMSH_RADIUS
        high = 2.0 * _GMSH_RADIUS
        box = occ.addRectangle(low_x, low_y, 0.0, high - low_x, high - low_y)
        film, _ = occ.intersect(film, [(2, box)])
        reach = shapes[FILM].reach
        names = [name for name in names if sector.covers(shapes[name], reach)]
    tools = [(2, add_surface(occ, shapes[name], unit)) for name in names]
    fragments, pieces = occ.fragment(film, tools) if tools else (film, [film])
    inside = set(pieces[0])
    outside = [fragment for fragment in fragments if fragment not in inside]
    occ.remove(outside, recursive=True)
    occ.synchronize()
    surfaces = {}
    for name, piece in zip([FILM, *names], pieces, strict=True):
        surfaces[name] = [tag for dimension, tag in piece if (dimension, tag) in inside]
    return surfaces


def _find_outer_curves(surfaces: list[int], shape: Outline, sector: SymmetrySector) -> list[int]:
    """Find the curves of gmsh's model that lie on an outline.

    Parameters
    ----------
    surfaces : list of int
        Tags of the surfaces inside the outline.
    shape : Outline
        The outline in the axes of the sector.
    sector : SymmetrySector
        If a mirror line of the sector cuts the outline, curves on that line are excluded.

    Returns
    -------
    list of int
        Tags of the curves.
    """
    pairs = gmsh.model.getBoundary([(2, tag) for tag in surfaces], combined=True, oriented=False)
    curves = {abs(tag) for _, tag in pairs}
    for axis in sector.mirror_axes:
        is_cut = shape.lower_left[axis] < -_ON_MIRROR_LINE * shape.reach
        if is_cut:
            centre = {curve: gmsh.model.occ.getCenterOfMass(1, curve)[axis] for curve in curves}
            limit = _GMSH_RADIUS * _ON_MIRROR_LINE
            curves = {curve for curve in curves if centre[curve] > limit}
    return sorted(curves)


def _set_graded_sizes(
    curves: dict[str, list[int]], sizes: GradedSizes, unit: float, frame: Array
) -> None:
    """Set element sizes in gmsh's model that grow with the distance from outlines and points.

    Parameters
    ----------
    curves : dict of str to list of int
        Tags of the curves on each outline, by a key of ``sizes.patches``.
    sizes : GradedSizes
        Element sizes in m.
    unit : float
        Unit of gmsh's lengths in m.
    frame : ndarray, shape (2, 2)
        Rotation matrix from the axes of the scene to the axes of the mesh.
    """
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
    balls = [_add_point_size(one, sizes, unit=unit, frame=frame) for one in sizes.points]
    if thresholds or balls:
        smallest = field.add("Min")
        field.setNumbers(smallest, "FieldsList", [*thresholds, *balls])
        field.setAsBackgroundMesh(smallest)


def _add_point_size(one: PointSize, sizes: GradedSizes, unit: float, frame: Array) -> int:
    """Add a field of sizes that grow with the distance from a point; return its tag.

    The parameters are those of `_set_graded_sizes`, and the point with its size.
    """
    field = gmsh.model.mesh.field
    x, y = frame @ one.point / unit
    ball = field.add("Ball")
    field.setNumber(ball, "XCenter", x)
    field.setNumber(ball, "YCenter", y)
    field.setNumber(ball, "Radius", 0.0)
    field.setNumber(ball, "VIn", one.size / unit)
    field.setNumber(ball, "VOut", sizes.film / unit)
    field.setNumber(ball, "Thickness", (sizes.film - one.size) / sizes.growth / unit)
    return int(ball)


def _set_size_field(sizes: SizeField, unit: float) -> None:
    """Set element sizes in gmsh's model that are given at the vertices of an earlier mesh."""
    mesh = sizes.mesh
    corners = np.zeros((mesh.nelements, 3, 3))
    corners[:, :2] = mesh.p[:, mesh.t].transpose(2, 0, 1) / unit
    values = sizes.sizes[mesh.t.T] / unit
    # "ST" is a scalar on triangles: x, y and z of the three corners, then the three values
    data = np.hstack([corners.reshape(-1, 9), values])
    view = gmsh.view.add("sizes")
    gmsh.view.addListData(view, "ST", mesh.nelements, data.ravel())
    field = gmsh.model.mesh.field
    background = field.add("PostView")
    field.setNumber(background, "ViewTag", view)
    # use the nearest triangle for points between the rim and its chords, outside of all triangles
    field.setNumber(background, "UseClosest", 1)
    field.setAsBackgroundMesh(background)


def _read_mesh(
    surfaces: dict[str, list[int] | None],
    unit: float,
    curved_outlines: list[Outline],
    sector: SymmetrySector,
) -> MeshTri2:
    """Read gmsh's mesh, and name its parts; raise MeshError if a subdomain has no element.

    Parameters
    ----------
    surfaces : dict of str to list of int or None
        Tags of the surfaces of each subdomain; None, without an error, if it is outside the sector.
    unit : float
        Unit of gmsh's lengths in m.
    curved_outlines : list of Outline
        The outlines with curved pieces, whose areas the elements get.
    sector : SymmetrySector
        The meshed sector. Nodes close to its mirror lines are moved onto them.

    Returns
    -------
    MeshTri2
        With coordinates in m.
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
        raise MeshError(f"subdomains without elements: {empty}; with elements: {present}")
    points = coordinates.reshape(-1, 3)[:, :2].T * unit
    radius = _GMSH_RADIUS * unit
    for axis in sector.mirror_axes:
        is_on_line = np.abs(points[axis]) < _ON_MIRROR_LINE * _GMSH_RADIUS * unit
        points[axis, is_on_line] = 0.0
    is_inside_curve = np.zeros(len(tags), dtype=bool)
    for _, curve in gmsh.model.getEntities(1):
        if gmsh.model.getEntityType(1, curve) != "Line":
            curve_tags, _, _ = gmsh.model.mesh.getNodes(1, curve)
            is_inside_curve[row[curve_tags]] = True
    for outline in curved_outlines:
        six_node.move_midside_nodes_to_arcs(
            points, triangles, outline=outline, is_inside_curve=is_inside_curve, radius=radius
        )
    return name_mesh_parts(MeshTri2(points, triangles.T), subdomains, sector=sector)


def _read_triangles(row: Indices) -> tuple[Indices, dict[int, Indices]]:
    """Read the triangles of all surfaces from gmsh; ``row[tag]`` is the index of a node.

    Returns
    -------
    triangles : ndarray of int, shape (elements, 6)
        Indices of the nodes of each triangle, with vertices sorted by index.
    elements_of_surface : dict of int to ndarray of int
        Indices of the triangles in each surface, by the surface's tag in gmsh.
    """
    blocks = []
    elements_of_surface = {}
    count = 0
    for _, surface in gmsh.model.getEntities(2):
        _, _, nodes = gmsh.model.mesh.getElements(2, surface)
        block = row[nodes[0]].reshape(-1, 6) if nodes else np.empty((0, 6), dtype=np.int64)
        blocks.append(block)
        elements_of_surface[surface] = np.arange(count, count + len(block))
        count += len(block)
    return six_node.sort_vertices(np.concatenate(blocks)), elements_of_surface
