"""Files as other programs read them."""

from __future__ import annotations

import importlib.util

import gmsh
import meshio
import numpy as np
import pytest
from numpy.typing import NDArray

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.view.export import FORMATS, write_mesh
from pvdf_fem.view.files.grid import ExportError
from tests.helpers.discs import uniform_mesh
from tests.helpers.files.six_node_areas import compute_areas

NAME = "<é & b>"
# The probe presses on half of the first electrode.
SCENE = Scene(
    electrodes=[{"name": NAME, "x_mm": 10.0, "y_mm": 0.0}, {"name": "C", "x_mm": -10.0, "y_mm": 0}],
    probe={"shape": "rectangle", "x_mm": 3.0},
    load={"kind": "follower"},
)


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(SCENE)


@pytest.mark.parametrize("extension", FORMATS)
def test_every_mesh_format_keeps_the_patches(solution, tmp_path, extension):
    path = tmp_path / f"mesh{extension}"
    if extension == ".xdmf" and not importlib.util.find_spec("h5py"):
        with pytest.raises(ExportError, match="h5py"):
            write_mesh(solution.mesh, path)
        return
    write_mesh(solution.mesh, path)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    grid = meshio.read(path)
    triangles = grid.cells[0].data
    area = compute_areas(grid.points, triangles)
    assert triangles.shape == (solution.mesh.nelements, 6)
    assert area.min() > 0.0
    for name, expected in ((f"electrode {NAME}", 9e-6), ("electrode C", 9e-6), ("probe", 98e-6)):
        inside = _patch(grid, FORMATS[extension].patches, name)
        assert area[inside].sum() == pytest.approx(expected, rel=1e-10)


def _patch(grid: meshio.Mesh, patches: str, name: str) -> NDArray[np.bool_]:
    """Elements of a patch, in a file whose format keeps `patches` in that way."""
    plain = name.replace(" ", "_")
    inside = np.zeros(len(grid.cells[0].data), dtype=bool)
    if patches == "arrays":
        data = grid.cell_data[name if name in grid.cell_data else plain][0]
        return np.asarray(data == 1)
    if patches == "sets":
        inside[grid.cell_sets[plain][0]] = True
        return inside
    for group, (tag, _) in grid.field_data.items():
        if name in group.split(" + "):
            inside |= grid.cell_data["gmsh:physical"][0] == tag
    return inside


def test_mesh_files_have_the_rim(solution, tmp_path):
    for name in ("a.inp", "a.msh"):
        write_mesh(solution.mesh, tmp_path / name)
    grid, lines = meshio.read(tmp_path / "a.inp"), meshio.read(tmp_path / "a.msh").cells[1].data
    on_rim = np.flatnonzero(np.hypot(*grid.points[:, :2].T) > 0.045 * (1 - 1e-6))
    np.testing.assert_array_equal(np.sort(grid.point_sets["rim"]), on_rim)
    assert set(lines.ravel()) == set(on_rim)


def test_gmsh_reads_valid_elements_and_named_groups(solution, tmp_path):
    write_mesh(solution.mesh, tmp_path / "a.msh")
    gmsh.initialize(["", "-v", "1"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "a.msh"))
        _, elements, _ = gmsh.model.mesh.getElements(2)
        assert gmsh.model.mesh.getElementQualities(elements[0], "minSJ").min() > 0.1
        names = {gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
    finally:
        gmsh.finalize()
    electrodes = {f"electrode {NAME}", f"electrode {NAME} + probe", "electrode C"}
    assert names == electrodes | {"film", "probe", "rim"}


def test_unsupported_formats_and_names_are_refused(tmp_path):
    squares = [{"name": name, "x_mm": x, "y_mm": 0.0} for name, x in (("a b", 0), ("a_b", 9))]
    mesh = uniform_mesh(Scene().with_(electrodes=squares), 9.0)
    write_mesh(mesh, tmp_path / "a.msh")
    for name in ("a.inp", "a.stl", "a"):
        with pytest.raises(ExportError):
            write_mesh(mesh, tmp_path / name)
    assert [file.name for file in tmp_path.iterdir()] == ["a.msh"]
