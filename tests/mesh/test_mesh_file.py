"""Meshes from files: those that the package wrote, and those that a user makes with gmsh."""

from __future__ import annotations

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
from tests.helpers.discs import graded_mesh

# The probe presses on a third of electrode A.
SCENE = Scene.parse('[probe]\nshape = "circle"\nradius_mm = 4.0\nx_mm = 5.5')
CHARGES = np.array(list(solve(SCENE.with_(**{"numerics.tolerance": 1e-5})).charges_pC.values()))


def charges(path: Path) -> np.ndarray:
    return np.array(list(solve(SCENE, mesh=path).charges_pC.values()))


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


@pytest.mark.parametrize("extension", READERS)
def test_what_the_command_writes_is_read_as_it_was(tmp_path: Path, extension: str) -> None:
    if extension == ".xdmf":
        pytest.importorskip("h5py", reason="meshio writes this format with h5py")
    mesh, path = graded_mesh(SCENE, 1.5, 8.0), tmp_path / f"a{extension}"
    write_mesh(mesh, path)
    found = read_mesh(path, SCENE)
    assert found.nelements == mesh.nelements
    assert {name: len(e) for name, e in found.subdomains.items()} == {
        name: len(e) for name, e in mesh.subdomains.items()
    }
    given = solve(SCENE, mesh=path)
    assert given.stop is Stop.GIVEN_MESH
    expected = solve(SCENE, mesh=mesh)
    for name, charge in expected.charges_pC.items():
        assert given.charges_pC[name] == pytest.approx(charge, rel=1e-8)
        assert given.charge_errors_pC[name] == pytest.approx(
            expected.charge_errors_pC[name], rel=1e-3
        )


@pytest.mark.parametrize(
    ("unit", "version", "names"),
    [(1e-3, 4.1, ("A", "C")), (1.0, 2.2, ()), (1e-3, 2.2, ("A", "B", "C", "D", "probe"))],
)
def test_a_mesh_of_the_user(
    tmp_path: Path, unit: float, version: float, names: tuple[str, ...]
) -> None:
    """In mm or m, with overlapping groups, with some or with none."""
    path = by_gmsh(tmp_path / "a.msh", unit=unit, version=version, names=names)
    mesh = read_mesh(path, SCENE)
    assert set(mesh.subdomains) == {"film", "probe", *map(electrode_patch, "ABCD")}
    np.testing.assert_allclose(charges(path), CHARGES, rtol=1e-3)


@pytest.mark.parametrize(
    ("changes", "options"),
    [
        ({}, {"unit": 10.0}),
        ({"film.radius_mm": 46.0}, {}),
        ({}, {"order": 1}),
        ({}, {"moved": 6.0}),
        ({"probe.radius_mm": 4.1}, {}),
    ],
)
def test_a_mesh_of_another_scene(
    tmp_path: Path, changes: dict[str, float], options: dict[str, Any]
) -> None:
    path = by_gmsh(tmp_path / "a.msh", **options)
    with pytest.raises(MeshFileError, match=r"a\.msh"):
        solve(SCENE.with_(changes), mesh=path)


@pytest.mark.parametrize(
    "change",
    [
        {"probe.x_mm": 5.4},
        {"probe.radius_mm": 4.1},
        {"film.radius_mm": 46.0},
        {"electrodes.ring_radius_mm": 10.1},
        {
            "film.patches": [
                {"shape": "circle", "x_mm": 0, "y_mm": 9, "radius_mm": 2, "thickness_um": 9}
            ]
        },
    ],
)
def test_a_mesh_object_of_another_scene_is_refused_as_its_file_is(
    tmp_path: Path, change: dict[str, object]
) -> None:
    mesh, path, other = graded_mesh(SCENE, 3.0, 12.0), tmp_path / "a.msh", SCENE.with_(**change)
    write_mesh(mesh, path)
    for given in (mesh, path):
        with pytest.raises(MeshFileError) as caught:
            solve(other, mesh=given)
        assert isinstance(caught.value, ValueError)
    assert solve(SCENE.with_(**{"load.force_N": 0.5}), mesh=mesh).stop is Stop.GIVEN_MESH


def grid(points: list[list[float]], **cells: list[list[int]]) -> meshio.Mesh:
    return meshio.Mesh(np.array(points, dtype=float), [*cells.items()])


SQUARE = [[45, 0, 0], [0, 45, 0], [-45, 0, 0], [0, -45, 0], [0, 0, 0]]
FANS = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
CRACK = [*SQUARE, [0, 0, 0], [45, 0, 0]]


def fans(points: list[list[float]], triangles: list[list[int]]) -> meshio.Mesh:
    """Six-node triangles with straight sides."""
    places, middles, nodes = [*points], dict[tuple[int, ...], int](), []
    for corners in triangles:
        nodes.append([*corners])
        for a, b in ((0, 1), (1, 2), (2, 0)):
            side = tuple(sorted((corners[a], corners[b])))
            if side not in middles:
                middles[side] = len(places)
                places.append(np.mean([points[i] for i in side], axis=0).tolist())
            nodes[-1].append(middles[side])
    return grid(places, triangle6=nodes)


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
