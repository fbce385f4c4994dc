"""Mesh files as other programs read them."""

from __future__ import annotations

import re
from itertools import chain
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
from skfem import MeshTri2

from pvdf_fem import Scene
from pvdf_fem.mesh.subdomains import FILM
from pvdf_fem.view.files.export_error import ExportError
from pvdf_fem.view.files.inp import LABEL_LENGTH, make_labels
from pvdf_fem.view.files.mesh_files import MESH_FORMATS, write_mesh
from pvdf_fem.view.files.mesh_grid import MeshGrid
from tests.helpers.discs import uniform_mesh

# The probe presses on half of the first electrode.
SCENE = Scene(
    electrodes=[
        {"name": "<é & b>", "x_mm": 10.0, "y_mm": 0.0},
        {"name": "C", "x_mm": -10.0, "y_mm": 0.0},
        {"name": "c", "x_mm": 0.0, "y_mm": -10.0},
    ],
    probe={"shape": "rectangle", "x_mm": 3.0},
)


@pytest.fixture(scope="module")
def mesh() -> MeshTri2:
    return uniform_mesh(SCENE, 4.0)


def compute_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Signed areas of triangles, straight between their vertices."""
    a, b, c = points[triangles[:, :3], :2].swapaxes(0, 1)
    return 0.5 * np.linalg.det(np.stack([b - a, c - a], axis=-1))


def find_patch(grid: meshio.Mesh, name: str) -> np.ndarray:
    """Find the triangles of a patch in a file that meshio has read."""
    if grid.field_data:
        tags = []
        for group, (tag, _) in grid.field_data.items():
            names = group.split(" + ") if " " in group else group.split("+")
            if {name, name.replace(" ", "_")} & {*names}:
                tags.append(tag)
        return np.isin(np.concatenate(grid.cell_data["gmsh:physical"]), tags)
    data = grid.cell_data
    encoded = name.replace(" ", "%20").replace("<", "%3C").replace(">", "%3E")
    encoded = encoded.replace("&", "%26").replace("é", "%C3%A9")
    return data[name if name in data else encoded][0] == 1


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["msh", "msh22", "vtu", "vtk"])
def test_meshio_reads_elements_and_patches(mesh, tmp_path, name, order):
    path = tmp_path / f"a{MESH_FORMATS[name].extension}"
    write_mesh(mesh, path, file_format=name, order=order)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    grid = meshio.read(path)
    kind = {1: "triangle", 2: "triangle6"}[order]
    triangles = grid.cells_dict[kind]
    areas = compute_areas(grid.points, triangles)
    assert len(triangles) == mesh.nelements
    assert areas.min() > 0.0
    for patch, expected in (("electrode <é & b>", 9e-6), ("electrode c", 9e-6), ("probe", 98e-6)):
        inside = find_patch(grid, patch)[: len(triangles)]
        assert areas[inside].sum() == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("name", ["msh", "msh22"])
def test_gmsh_reads_valid_elements_and_named_groups_without_a_warning(mesh, tmp_path, name, order):
    path = tmp_path / "a.msh"
    write_mesh(mesh, path, file_format=name, order=order)
    gmsh.initialize(["", "-v", "1"], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.option.setNumber("General.Verbosity", 2)
        gmsh.logger.start()
        gmsh.open(str(path))
        messages = gmsh.logger.get()
        gmsh.logger.stop()
        elements = np.concatenate(gmsh.model.mesh.getElements(2)[1])
        qualities = gmsh.model.mesh.getElementQualities(elements, "minSJ")
        nodes = gmsh.model.mesh.getNodes()[0]
        groups = gmsh.model.getPhysicalGroups()
        names = {gmsh.model.getPhysicalName(*group) for group in groups}
    finally:
        gmsh.finalize()
    assert not [line for line in messages if line.startswith(("Warning", "Error"))]
    assert len(elements) == mesh.nelements
    assert len(nodes) == len(MeshGrid.from_mesh(mesh, order).points)
    assert qualities.min() > 0.1
    electrodes = {"electrode <é & b>", "electrode <é & b> + probe", "electrode C", "electrode c"}
    expected = electrodes | {"film", "probe", "rim"}
    if name == "msh22":
        expected = {group.replace(" + ", "+").replace(" ", "_") for group in expected}
    assert names == expected


@pytest.mark.parametrize("name", ["vtu", "vtk"])
def test_vtk_reads_cells_and_the_names_of_patches(mesh, tmp_path, name):
    pyvista = pytest.importorskip("pyvista", reason="VTK reads what ParaView reads")
    for order, cell_type in ((1, 5), (2, 22)):
        write_mesh(mesh, tmp_path / f"a.{name}", order=order)
        grid = pyvista.read(tmp_path / f"a.{name}")
        assert set(grid.celltypes) == {cell_type}
        assert set(grid.cell_data) == set(mesh.subdomains) - {FILM}
        for patch in grid.cell_data:
            inside = np.flatnonzero(grid.cell_data[patch])
            np.testing.assert_array_equal(inside, np.sort(mesh.subdomains[patch]))


@pytest.mark.parametrize(
    ("element", "nodes"), [("S6", 6), ("m3d6", 6), ("STRI65", 6), ("M3D3", 3), ("S3", 3)]
)
def test_input_files_obey_the_limits_of_calculix(mesh, tmp_path, element, nodes):
    """Numbers of at most 20 characters, at most 16 entries in a line, sets by valid names."""
    write_mesh(mesh, tmp_path / "a.inp", element=element)
    text = (tmp_path / "a.inp").read_text("ascii")
    blocks = {}
    for line in text.splitlines():
        if line.startswith("**"):
            continue
        if line.startswith("*"):
            rows = blocks.setdefault(line, [])
            continue
        entries = line.split(", ")
        assert len(entries) <= 16
        assert max(map(len, entries)) <= 20
        rows.append(entries)
    [points] = (rows for head, rows in blocks.items() if head.startswith("*NODE"))
    grid = MeshGrid.from_mesh(mesh, 1 if nodes == 3 else 2)
    written = np.array([[float(number) for number in row[1:3]] for row in points])
    np.testing.assert_allclose(written, grid.points, rtol=1e-12, atol=1e-17)
    triangles = blocks[f"*ELEMENT, TYPE={element.upper()}, ELSET=film"]
    np.testing.assert_array_equal(np.array(triangles, dtype=int)[:, 1:], grid.triangles + 1)
    sets = {head.split("SET=")[-1]: [*chain(*rows)] for head, rows in blocks.items()}
    labels = make_labels(grid.patches)
    for patch, elements in grid.patches.items():
        assert sorted(map(int, sets[labels[patch]])) == sorted(elements + 1)
    rim = sets["rim"]
    radii = np.hypot(*written[np.array(rim, dtype=int) - 1].T)
    np.testing.assert_allclose(radii, 0.045, rtol=1e-6)
    assert len(rim) == len(grid.rim_nodes)


def test_labels_differ_without_their_case():
    names = [
        "electrode A",
        "electrode a",
        "electrode A_2",
        "electrode é",
        "electrode e",
        "1",
        "rim",
    ]
    names += ["electrode 左", "electrode 右", "electrode " + 90 * "x", "electrode " + 91 * "x"]
    labels = make_labels(names)
    assert list(labels) == names
    assert len({label.lower() for label in labels.values()} | {"rim", "film"}) == len(names) + 2
    assert labels["electrode A"] == "electrode_A"
    for label in labels.values():
        assert re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", label)
        assert len(label) <= LABEL_LENGTH


@pytest.mark.parametrize(
    ("name", "style"),
    [
        ("a.xdmf", {}),
        ("a.stl", {}),
        ("a", {}),
        ("a.msh", {"file_format": "msh3"}),
        ("a.vtu", {"file_format": "msh22"}),
        ("a.msh", {"order": 3}),
        ("a.msh", {"element": "S6"}),
        ("a.inp", {"element": "C3D10"}),
        ("a.inp", {"element": "S6", "order": 1}),
    ],
)
def test_styles_that_are_not_written_are_refused(mesh, tmp_path: Path, name, style):
    with pytest.raises(ExportError):
        write_mesh(mesh, tmp_path / name, **style)
    assert not list(tmp_path.iterdir())
