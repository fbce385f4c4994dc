"""Files of VTK in all of its encodings, and files of meshio."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest

from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.files.library_process import LibraryError, read_by_library
from pvdf_fem.mesh.mesh_file import resolve_mesh
from tests.mesh.files.film_files import SCENE, get_triangles, require_film

# VTK's numbers of cell types
LINEAR = 5
QUADRATIC = 22
LAGRANGE = 69
BEZIER = 76


def make_grid(cell_type: int) -> Any:
    """The film as an unstructured grid of pyvista."""
    pyvista = pytest.importorskip("pyvista")
    points, nodes = get_triangles(1 if cell_type == LINEAR else 2)
    cells = np.column_stack([np.full(len(nodes), nodes.shape[1]), nodes])
    types = np.full(len(nodes), cell_type, dtype=np.uint8)
    return pyvista.UnstructuredGrid(cells.ravel(), types, points)


@pytest.mark.parametrize("mode", ["Ascii", "Binary", "Appended"])
@pytest.mark.parametrize("compressor", ["None", "ZLib", "LZ4", "LZMA"])
@pytest.mark.parametrize("cell_type", [LINEAR, LAGRANGE])
def test_every_encoding_of_vtu_is_read(
    tmp_path: Path, mode: str, compressor: str, cell_type: int
) -> None:
    grid = make_grid(cell_type)
    from vtkmodules.vtkIOXML import vtkXMLUnstructuredGridWriter

    writer = vtkXMLUnstructuredGridWriter()
    writer.SetInputData(grid)
    getattr(writer, f"SetDataModeTo{mode}")()
    writer.SetEncodeAppendedData(compressor == "LZMA")
    getattr(writer, f"SetCompressorTypeTo{compressor}")()
    if compressor == "ZLib":
        writer.SetHeaderTypeToUInt32()
    if cell_type == LINEAR:
        writer.SetByteOrderToBigEndian()
    writer.SetFileName(str(tmp_path / "a.vtu"))
    writer.Write()
    notes = require_film(tmp_path / "a.vtu").notes
    assert len(notes) == (cell_type == LINEAR)


@pytest.mark.parametrize("is_binary", [True, False])
@pytest.mark.parametrize("cell_type", [LINEAR, QUADRATIC, LAGRANGE])
def test_legacy_files_of_vtk_are_read(tmp_path: Path, cell_type: int, is_binary: bool) -> None:
    make_grid(cell_type).save(tmp_path / "a.vtk", binary=is_binary)
    require_film(tmp_path / "a.vtk")


def test_surfaces_of_vtk_are_read(tmp_path: Path) -> None:
    surface = make_grid(LINEAR).extract_surface(algorithm=None)
    for name in ("a.vtp", "a.vtk", "a.stl"):
        surface.save(tmp_path / name)
        require_film(tmp_path / name)


def test_parts_without_common_nodes_are_merged(tmp_path: Path) -> None:
    for cell_type in (LINEAR, QUADRATIC):
        grid = make_grid(cell_type)
        is_left = grid.cell_centers().points[:, 0] < 0.0
        halves = [grid.extract_cells(np.flatnonzero(side)) for side in (is_left, ~is_left)]
        halves[0].merge(halves[1], merge_points=False).save(tmp_path / "a.vtu")
        notes = require_film(tmp_path / "a.vtu").notes
        assert "duplicate nodes were merged" in notes[0]


def bend(grid: Any) -> Any:
    """The film as a dome."""
    points = grid.points.copy()
    points[:, 2] = 1e-3 * points[:, 0] ** 2
    grid.points = points
    return grid


def add_another(grid: Any) -> Any:
    """Two films."""
    return grid.merge(grid.translate((100.0, 0.0, 0.0)), merge_points=False)


def stretch(grid: Any) -> Any:
    """A damaged file, in which one node of many is far away."""
    points = grid.points.copy()
    points[7] = [1e60, -1e70, 0.0]
    grid.points = points
    return grid


def halve(grid: Any) -> Any:
    """A half of the film."""
    return grid.extract_cells(np.flatnonzero(grid.cell_centers().points[:, 0] < 0.0))


@pytest.mark.parametrize(
    ("cell_type", "change", "reason"),
    [
        (LINEAR, bend, "not flat"),
        (LINEAR, add_another, "2 pieces"),
        (LINEAR, stretch, "without an area"),
        (QUADRATIC, halve, "whole film"),
        (BEZIER, lambda grid: grid, "Bezier"),
    ],
)
def test_other_grids_are_refused_with_the_reason(
    tmp_path: Path, cell_type: int, change: Callable[[Any], Any], reason: str
) -> None:
    change(make_grid(cell_type)).save(tmp_path / "a.vtu")
    with pytest.raises(MeshFileError, match=reason):
        resolve_mesh(tmp_path / "a.vtu", SCENE)


@pytest.mark.parametrize("extension", ["med", "xdmf"])
def test_files_with_hdf5_are_read_by_meshio(tmp_path: Path, extension: str) -> None:
    pytest.importorskip("h5py")
    points, nodes = get_triangles(2)
    path = tmp_path / f"a.{extension}"
    meshio.Mesh(points, [("triangle6", nodes)]).write(path)
    require_film(path)


def test_a_missing_library_is_named_with_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python finds packages that play the missing ones before the installed ones."""
    for name, module in (("h5py", "h5py"), ("vtkmodules", "vtkmodules")):
        (tmp_path / f"{name}.py").write_text(
            f"raise ModuleNotFoundError('No module named {module}', name={module!r})"
        )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (tmp_path / "a.xdmf").write_text(
        '<Xdmf Version="3.0"><Domain><Grid><Topology TopologyType="Triangle"><DataItem Format="HDF"'
        ' DataType="Int" Dimensions="1 3">a.h5:/a</DataItem></Topology></Grid></Domain></Xdmf>'
    )
    (tmp_path / "a.vtu").write_text("<VTKFile/>")
    with pytest.raises(MeshFileError, match=r"h5py for meshio is not installed .*pip install h5py"):
        resolve_mesh(tmp_path / "a.xdmf", SCENE)
    with pytest.raises(MeshFileError, match=r"vtk is not installed .*pvdf-fem\[view\]"):
        resolve_mesh(tmp_path / "a.vtu", SCENE)


def test_a_file_in_the_folder_of_the_user_is_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a script gmsh.py, which many users have."""
    (tmp_path / "meshio.py").write_text("raise SystemExit('imported')")
    points, nodes = get_triangles(1)
    meshio.Mesh(points, [("triangle", nodes)]).write(tmp_path / "a.vtu")
    monkeypatch.chdir(tmp_path)
    content = read_by_library("meshio", Path("a.vtu"))
    assert len(content.triangles) == len(nodes)
    with pytest.raises(LibraryError, match=r"meshio .* cannot read it"):
        read_by_library("meshio", Path("meshio.py"))
