"""Meshes from files: those that the package wrote, and those that a user makes with gmsh."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import gmsh
import meshio
import numpy as np
import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.files import FileError
from pvdf_fem.mesh.gmsh_mesh import electrode_patch
from pvdf_fem.mesh.mesh_file import READERS, MeshFileError, read_mesh
from pvdf_fem.output.export import write_mesh
from pvdf_fem.solution.history import Stop
from pvdf_fem.solution.solution import Solution
from tests.helpers.discs import graded_mesh, values

# The probe presses on a third of electrode A.
SCENE = Scene.parse('[probe]\nshape = "circle"\nradius_mm = 4.0\nx_mm = 5.5')
CHARGES = [1352.523, 695.802, 570.650, 695.802]  #: pC, at a tolerance of 1e-5.


def by_gmsh(
    path: Path,
    *,
    unit: float = 1.0,
    version: float = 4.1,
    order: int = 2,
    size: float = 3.0,
    names: tuple[str, ...] = ("A", "B", "C", "D", "probe"),
    moved: float = 0.0,
) -> Path:
    """What a user makes of `SCENE` in mm times `unit`, with groups of some of its patches."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        film = (2, occ.addDisk(0, 0, 0, 45 * unit, 45 * unit))
        tools = {"probe": (2, occ.addDisk(5.5 * unit, 0, 0, 4 * unit, 4 * unit))}
        for name, (x, y) in dict(A=(10 + moved, 0), B=(0, 10), C=(-10, 0), D=(0, -10)).items():
            side = 3 * unit
            corner = x * unit - side / 2, y * unit - side / 2
            tools[name] = (2, occ.addRectangle(*corner, 0, side, side))
        _, pieces = occ.fragment([film], [*tools.values()])
        occ.synchronize()
        for name, parts in zip(["film", *tools], pieces, strict=True):
            if name in ("film", *names):
                patch = name if name in ("film", "probe") else electrode_patch(name)
                gmsh.model.addPhysicalGroup(2, [tag for _, tag in parts], name=patch)
        rim = gmsh.model.getBoundary(pieces[0], combined=True, oriented=False)
        gmsh.model.addPhysicalGroup(1, [tag for _, tag in rim], name="rim")
        gmsh.option.setNumber("Mesh.MeshSizeMax", size * unit)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


@pytest.fixture(scope="module")
def written() -> Solution:
    return solve(SCENE, mesh=graded_mesh(SCENE, 1.5, 8.0))


@pytest.mark.parametrize("extension", READERS)
def test_what_the_command_writes_is_read_as_it_was(
    tmp_path: Path, extension: str, written: Solution
) -> None:
    if extension == ".xdmf":
        pytest.importorskip("h5py", reason="meshio writes this format with h5py")
    path = tmp_path / f"a{extension}"
    write_mesh(written.mesh, path)
    given = solve(SCENE, mesh=path)
    assert given.stop is Stop.GIVEN_MESH
    for name, elements in written.mesh.subdomains.items():
        assert len(given.mesh.subdomains[name]) == len(elements)
    assert given.charges_pC == pytest.approx(written.charges_pC, rel=1e-8)
    assert given.charge_errors_pC == pytest.approx(written.charge_errors_pC, rel=1e-3)


@pytest.mark.parametrize(
    ("unit", "version", "names"),
    [(1e-3, 4.1, ("A", "C")), (1.0, 2.2, ()), (1e-3, 2.2, ("A", "B", "C", "D", "probe"))],
)
def test_a_mesh_of_the_user(
    tmp_path: Path, unit: float, version: float, names: tuple[str, ...]
) -> None:
    """In mm or m, with overlapping groups, with some or with none."""
    path = by_gmsh(tmp_path / "a.msh", unit=unit, version=version, names=names)
    solution = solve(SCENE, mesh=path)
    assert set(solution.mesh.subdomains) == {"film", "probe", *map(electrode_patch, "ABCD")}
    assert values(solution.charges_pC) == pytest.approx(CHARGES, rel=1e-3)


@pytest.mark.parametrize("options", [{"unit": 10.0}, {"order": 1}, {"moved": 6.0}])
def test_a_mesh_of_another_film(tmp_path: Path, options: dict[str, Any]) -> None:
    path = by_gmsh(tmp_path / "a.msh", **options)
    with pytest.raises(MeshFileError, match=r"a\.msh"):
        read_mesh(path, SCENE)


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
def test_a_mesh_of_another_scene_is_refused_as_its_file_is(
    tmp_path: Path, change: dict[str, object]
) -> None:
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


@pytest.mark.parametrize(
    "mesh",
    [
        grid(SQUARE, quad=[[0, 1, 2, 3]]),
        grid(SQUARE, line=[[0, 1]]),
        fans(CRACK, [*FANS[:3], [3, 6, 5]]),
        fans([[*p[:2], p[0]] for p in SQUARE], FANS),  # off the plane
        fans([[np.nan, 0, 0], *SQUARE[1:]], FANS),
        fans(SQUARE, [*FANS, [0, 4, 2]]),  # without an area
        fans(SQUARE, FANS[:3]),  # open
    ],
)
def test_no_mesh_of_a_film(tmp_path: Path, mesh: meshio.Mesh) -> None:
    mesh.write(tmp_path / "a.vtu")
    with pytest.raises(MeshFileError, match=r"a\.vtu"):
        read_mesh(tmp_path / "a.vtu", SCENE)


def test_folded_triangles_and_midside_nodes_that_are_not_shared(tmp_path: Path) -> None:
    write_mesh(graded_mesh(SCENE, 1.5, 8.0), tmp_path / "a.vtu")
    folded, torn = (meshio.read(tmp_path / "a.vtu") for _ in range(2))
    corner, middle = folded.cells[0].data[0, [2, 3]]
    folded.points[middle] = folded.points[corner]
    torn.cells[0].data[0, 3] = torn.cells[0].data[5, 4]
    for damaged in (folded, torn):
        damaged.write(tmp_path / "b.vtu")
        with pytest.raises(MeshFileError, match=r"b\.vtu"):
            read_mesh(tmp_path / "b.vtu", SCENE)


@pytest.mark.parametrize("name", ["a.msh", "a.inp", "a.vtu", "a.stl"])
def test_no_mesh_at_all(tmp_path: Path, name: str) -> None:
    with pytest.raises(FileError, match=name):
        read_mesh(tmp_path / name, SCENE)
    (tmp_path / name).write_text("$MeshFormat\n4.1 0 8\n$EndMeshFormat\nnonsense\n")
    with pytest.raises(MeshFileError, match=name):
        read_mesh(tmp_path / name, SCENE)
