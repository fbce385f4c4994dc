"""Files of one film by gmsh, as users write them, and what must come out of every one."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import gmsh
import numpy as np
import pytest
from skfem import MeshTri2

from pvdf_fem import Scene
from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.mesh_file import GivenMesh, resolve_mesh
from pvdf_fem.mesh.subdomains import FILM, collect_outlines

#: The probe presses on a third of electrode A.
SCENE = Scene.parse('[probe]\nshape = "circle"\nradius_mm = 4.0\nx_mm = 5.5')


def make_film(unit: float = 1.0, centre: tuple[float, float] = (0.0, 0.0), z: float = 0.0) -> None:
    """Add the geometry of `SCENE` in mm times `unit` to gmsh's model, with three groups."""
    occ = gmsh.model.occ
    x0, y0 = centre

    def place(x: float, y: float) -> tuple[float, float, float]:
        return (x0 + x) * unit, (y0 + y) * unit, z * unit

    film = occ.addDisk(*place(0, 0), 45 * unit, 45 * unit)
    tools = [occ.addDisk(*place(5.5, 0), 4 * unit, 4 * unit)]
    for x, y in ((8.5, -1.5), (-1.5, 8.5), (-11.5, -1.5), (-1.5, -11.5)):
        tools.append(occ.addRectangle(*place(x, y), 3 * unit, 3 * unit))
    _, pieces = occ.fragment([(2, film)], [(2, tool) for tool in tools])
    occ.synchronize()
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in pieces[0]], name="film")
    # overlaps with the film: MSH 2.2 lists its elements twice
    gmsh.model.addPhysicalGroup(2, [tag for _, tag in pieces[1]], name="Tüpfel probe")
    rim = gmsh.model.getBoundary(pieces[0], combined=True, oriented=False)
    gmsh.model.addPhysicalGroup(1, [tag for _, tag in rim], name="rim")


def write_film(
    *paths: Path,
    order: int = 2,
    options: dict[str, float] | None = None,
    parts: int = 0,
    is_reversed: bool = False,
    unit: float = 1.0,
    centre: tuple[float, float] = (0.0, 0.0),
    z: float = 0.0,
) -> None:
    """Mesh the film of `SCENE` with gmsh, and write it to files."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        make_film(unit, centre, z=z)
        gmsh.option.setNumber("Mesh.MeshSizeMax", 6 * unit)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 20)
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        for name, value in (options or {}).items():
            gmsh.option.setNumber(name, value)
        gmsh.model.mesh.generate(2)
        if is_reversed:
            gmsh.model.mesh.reverse()
        if parts:
            gmsh.model.mesh.partition(parts)
        for path in paths:
            gmsh.write(str(path))
    finally:
        gmsh.finalize()


class Triangles(NamedTuple):
    """Nodes and triangles in mm."""

    points: Array  #: Shape (nodes, 3).
    nodes: Indices  #: Shape (elements, 3) or (elements, 6).


@cache
def get_triangles(order: int) -> Triangles:
    """The triangles of the film of `SCENE` by gmsh, for files by other libraries."""
    gmsh.initialize(readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        make_film()
        gmsh.option.setNumber("Mesh.MeshSizeMax", 6)
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 20)
        gmsh.option.setNumber("Mesh.ElementOrder", order)
        gmsh.model.mesh.generate(2)
        tags, coordinates, _ = gmsh.model.mesh.getNodes()
        _, _, nodes = gmsh.model.mesh.getElements(2)
    finally:
        gmsh.finalize()
    row = np.argsort(tags)
    indices = row[np.searchsorted(tags[row], nodes[0])]
    return Triangles(coordinates.reshape(-1, 3), indices.reshape(-1, 3 * order))


def require_film(path: Path | MeshTri2, scene: Scene = SCENE) -> GivenMesh:
    """Read a file of the film, and check the area of every subdomain."""
    given = resolve_mesh(path, scene)
    outlines = {FILM: scene.film.outline, **collect_outlines(scene)}
    assert set(given.mesh.subdomains) == set(outlines)
    weights = Space(given.mesh, 2).weights
    for name, outline in outlines.items():
        area = weights[given.mesh.subdomains[name]].sum()
        assert area == pytest.approx(outline.area, rel=2e-4)
    return given
