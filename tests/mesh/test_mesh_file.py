"""Meshes from files: those that the package wrote, and those that a user makes with gmsh."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.files import FileError
from pvdf_fem.film.space import Space
from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.mesh_file import read_mesh
from pvdf_fem.mesh.subdomains import collect_outlines, make_subdomain_name
from pvdf_fem.solver.history import Stop
from pvdf_fem.solver.solution import Solution
from pvdf_fem.view.files.mesh_files import write_mesh
from tests.helpers.discs import graded_mesh

# The probe presses on a third of electrode A.
SCENE = Scene.parse('[probe]\nshape = "circle"\nradius_mm = 4.0\nx_mm = 5.5')


def write_by_gmsh(path: Path, unit: float, version: float) -> None:
    """What a user makes of `SCENE` in mm times `unit`, with overlapping groups of some patches."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        film = occ.addDisk(0, 0, 0, 45 * unit, 45 * unit)
        tools = [occ.addDisk(5.5 * unit, 0, 0, 4 * unit, 4 * unit)]
        for x, y in ((8.5, -1.5), (-1.5, 8.5), (-11.5, -1.5), (-1.5, -11.5)):
            tools.append(occ.addRectangle(x * unit, y * unit, 0, 3 * unit, 3 * unit))
        _, pieces = occ.fragment([(2, film)], [(2, tool) for tool in tools])
        occ.synchronize()
        for name, piece in zip(("film", "probe", make_subdomain_name("A")), pieces, strict=False):
            gmsh.model.addPhysicalGroup(2, [tag for _, tag in piece], name=name)
        rim = gmsh.model.getBoundary(pieces[0], combined=True, oriented=False)
        gmsh.model.addPhysicalGroup(1, [tag for _, tag in rim], name="rim")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 3 * unit)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


@pytest.fixture(scope="module")
def written() -> Solution:
    return solve(SCENE, mesh=graded_mesh(SCENE, 3.0, 12.0))


@pytest.mark.parametrize("extension", [".msh", ".inp", ".vtu", ".vtk"])
def test_a_mesh_written_by_the_command_is_read_unchanged(
    tmp_path: Path, extension: str, written: Solution
) -> None:
    path = tmp_path / f"a{extension}"
    write_mesh(written.mesh, path)
    given = solve(SCENE, mesh=path)
    assert given.stop is Stop.GIVEN_MESH
    for name, elements in written.mesh.subdomains.items():
        assert len(given.mesh.subdomains[name]) == len(elements)
    assert given.charges_pC == pytest.approx(written.charges_pC, rel=1e-8)
    assert given.charge_errors_pC == pytest.approx(written.charge_errors_pC, rel=1e-3)


@pytest.mark.parametrize(("unit", "version"), [(1e-3, 4.1), (1.0, 2.2)])
def test_a_mesh_by_the_user_is_read_in_m_and_mm(
    tmp_path: Path, unit: float, version: float
) -> None:
    """In m or mm; MSH 2.2 lists an element once for each of its groups."""
    write_by_gmsh(tmp_path / "a.msh", unit, version)
    mesh = read_mesh(tmp_path / "a.msh", SCENE)
    assert set(mesh.subdomains) == {"film", *collect_outlines(SCENE)}
    weights = Space(mesh, 2).weights
    for name, outline in collect_outlines(SCENE).items():
        assert weights[mesh.subdomains[name]].sum() == pytest.approx(outline.area, rel=1e-3)


BESIDE = [{"shape": "circle", "x_mm": 0, "y_mm": 9, "radius_mm": 2, "thickness_um": 9}]


@pytest.mark.parametrize(
    "change",
    [
        {"probe.x_mm": 5.4},
        {"probe.radius_mm": 4.1},
        {"film.radius_mm": 46.0},
        {"electrodes.ring_radius_mm": 10.1},
        {"film.patches": BESIDE},
    ],
)
def test_a_mesh_of_another_scene_is_refused(tmp_path: Path, change: dict[str, object]) -> None:
    mesh, path, other = graded_mesh(SCENE, 3.0, 12.0), tmp_path / "a.msh", SCENE.with_(**change)
    write_mesh(mesh, path)
    for given in (mesh, path):
        with pytest.raises(MeshFileError) as caught:
            solve(other, mesh=given)
        assert isinstance(caught.value, ValueError)


def grid(points: list[list[float]], **cells: list[list[int]]) -> meshio.Mesh:
    return meshio.Mesh(np.array(points, dtype=float), [*cells.items()])


SQUARE = [[45, 0, 0], [0, 45, 0], [-45, 0, 0], [0, -45, 0], [0, 0, 0]]
FANS = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
CRACK = [*SQUARE, [0, 0, 0], [45, 0, 0]]


def fans(points: list[list[float]], triangles: list[list[int]]) -> meshio.Mesh:
    """Six-node triangles with straight sides."""
    places, middles = [*points], dict[tuple[int, ...], int]()
    for a, b in (sorted(side) for t in triangles for side in pairwise([*t, t[0]])):
        if (a, b) not in middles:
            middles[a, b] = len(places)
            places.append(np.mean([points[a], points[b]], axis=0).tolist())
    sides = [[middles[*sorted(side)] for side in pairwise([*t, t[0]])] for t in triangles]
    return grid(places, triangle6=[[*t, *s] for t, s in zip(triangles, sides, strict=True)])


def with_middle(side: int, place: int) -> meshio.Mesh:
    """A mesh in which the midside node of the first triangle's side is another node."""
    mesh = fans(SQUARE, FANS)
    mesh.cells[0].data[0, 3 + side] = place
    return mesh


@pytest.mark.parametrize(
    "mesh",
    [
        grid(SQUARE, quad=[[0, 1, 2, 3]]),
        grid(SQUARE, line=[[0, 1]]),
        grid(SQUARE, triangle=FANS),  # a square
        fans(CRACK, [*FANS[:3], [3, 6, 5]]),
        fans([[*p[:2], p[0]] for p in SQUARE], FANS),  # off the plane
        fans([[np.nan, 0, 0], *SQUARE[1:]], FANS),
        fans(SQUARE, [*FANS, [0, 4, 2]]),  # without an area
        fans(SQUARE, FANS[:3]),  # open
        with_middle(0, 2),  # folded
        with_middle(1, 12),  # not that of the neighbour
    ],
)
def test_meshes_that_are_not_of_a_film_are_refused(tmp_path: Path, mesh: meshio.Mesh) -> None:
    mesh.write(tmp_path / "a.vtu")
    with pytest.raises(MeshFileError, match=r"a\.vtu"):
        read_mesh(tmp_path / "a.vtu", SCENE)


@pytest.mark.parametrize("name", ["a.msh", "a.inp", "a.vtu", "a.stl"])
def test_files_without_a_mesh_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=name):
        read_mesh(tmp_path / name, SCENE)
    (tmp_path / name).write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\nnonsense\n")
    with pytest.raises(MeshFileError, match=name):
        read_mesh(tmp_path / name, SCENE)
