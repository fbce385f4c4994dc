"""Files that gmsh writes are read with all of its options, or refused with what to change."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.mesh_file import resolve_mesh
from tests.mesh.files.film_files import SCENE, require_film, write_film


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("version", "is_binary"), [(1, 0), (2.2, 0), (2.2, 1), (4.0, 0), (4.1, 0), (4.1, 1)]
)
def test_every_version_of_msh_is_read(
    tmp_path: Path, version: float, is_binary: int, order: int
) -> None:
    options = {"Mesh.MshFileVersion": version, "Mesh.Binary": is_binary}
    write_film(tmp_path / "a.msh", order=order, options=options)
    notes = require_film(tmp_path / "a.msh").notes
    assert len(notes) == (order == 1)  # sides were curved


@pytest.mark.parametrize("version", [2.2, 4.1])
@pytest.mark.parametrize(
    ("option", "parts"),
    [
        ("Mesh.SaveAll", 0),
        ("Mesh.SaveParametric", 0),
        ("Mesh.SaveTopology", 0),
        ("Mesh.SecondOrderIncomplete", 0),
        ("Mesh.SaveGroupsOfNodes", 3),
        ("Mesh.PartitionCreateGhostCells", 3),
    ],
)
def test_options_of_msh_files_do_not_matter(
    tmp_path: Path, option: str, parts: int, version: float
) -> None:
    options = {"Mesh.MshFileVersion": version, option: 1}
    write_film(tmp_path / "a.msh", options=options, parts=parts)
    assert not require_film(tmp_path / "a.msh").notes


def test_other_formats_of_gmsh_are_read(tmp_path: Path) -> None:
    extensions = ["inp", "unv", "bdf", "nas", "med", "mesh", "vtk", "cgns", "stl"]
    paths = [tmp_path / f"a.{extension}" for extension in extensions]
    write_film(*paths)
    paths[1] = paths[1].rename(tmp_path / "capitals.UNV")
    elements = {require_film(path).mesh.nelements for path in paths}
    assert len(elements) == 1


@pytest.mark.parametrize(
    ("unit", "centre", "z", "note"),
    [
        (1e-3, (0, 0), 0, ""),
        (1, (0, 0), 7.5, ""),
        (1 / 25.4, (0, 0), 0, "unit was found to be in"),
        (1e3, (0, 0), 0, "unit was found to be µm"),
        (1, (45, 45), 0, "(45, 45) mm was moved"),
        (1e-3, (-20, 3), 1, "(-0.02, 0.003) m was moved"),
    ],
)
def test_unit_and_place_are_found(
    tmp_path: Path, unit: float, centre: tuple[float, float], z: float, note: str
) -> None:
    write_film(tmp_path / "a.msh", unit=unit, centre=centre, z=z)
    notes = require_film(tmp_path / "a.msh").notes
    assert note in "".join(notes)
    assert len(notes) == bool(note)


def test_clockwise_triangles_are_read(tmp_path: Path) -> None:
    write_film(tmp_path / "a.msh", is_reversed=True)
    require_film(tmp_path / "a.msh")


def test_straight_six_node_triangles_are_curved(tmp_path: Path) -> None:
    write_film(tmp_path / "a.msh", options={"Mesh.SecondOrderLinear": 1})
    assert "straight sides along film, probe" in require_film(tmp_path / "a.msh").notes[0]


@pytest.mark.parametrize(
    ("changes", "advice"),
    [
        ({"options": {"Mesh.RecombineAll": 1}}, "Mesh.RecombineAll = 0"),
        ({"order": 3}, "Mesh.ElementOrder = 2"),
        ({"unit": 1.1}, "49.5"),  # no unit
        ({"parts": 2, "options": {"Mesh.PartitionSplitMeshFiles": 1}}, "give the whole film"),
    ],
)
def test_unsuitable_meshes_are_refused_with_advice(
    tmp_path: Path, changes: dict[str, object], advice: str
) -> None:
    write_film(tmp_path / "a.msh", **changes)
    path = next(tmp_path.glob("*.msh"))
    with pytest.raises(MeshFileError, match=advice):
        resolve_mesh(path, SCENE)


@pytest.mark.parametrize(
    ("name", "text", "advice"),
    [
        ("a.msh", "4 2 4\n0 0 1\n", "savemesh"),
        ("a.msh", '(0 "Fluent")\n', "Fluent"),
        ("a.vol", "mesh3d\n", "Gmsh2 Format"),
        ("a.step", "ISO-10303-21;\n", "gmsh -2 -order 2 a.step"),
        ("a.msh.gz", "\x1f\x8b", "gunzip"),
        ("a.unv", "    -1\n  2411\n", "gmsh"),
    ],
)
def test_files_of_other_programs_are_refused_with_advice(
    tmp_path: Path, name: str, text: str, advice: str
) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(MeshFileError, match=advice):
        resolve_mesh(tmp_path / name, SCENE)


def test_no_file_is_run_as_a_script_of_gmsh(tmp_path: Path) -> None:
    """gmsh runs files with an unknown beginning, and FILE.opt beside a file that it reads."""
    script = f"SystemCall \"{sys.executable} -c \\\"open('{tmp_path}/ran', 'w')\\\"\";\n"
    for extension in ("msh", "unv", "MSH", "Unv", "bdf", "stl", "mesh"):
        path = tmp_path / f"a.{extension}"
        path.write_text(script)
        with pytest.raises(MeshFileError):
            resolve_mesh(path, SCENE)
    write_film(tmp_path / "b.msh")
    (tmp_path / "b.msh.opt").write_text(script)
    require_film(tmp_path / "b.msh")
    assert not (tmp_path / "ran").exists()


def test_a_damaged_file_is_refused_even_where_gmsh_crashes(tmp_path: Path) -> None:
    """gmsh 4.15 ends with a segmentation fault for some of these files."""
    whole = tmp_path / "a.unv"
    write_film(whole)
    content = whole.read_bytes()
    for start in range(3):
        begin = len(content) * (start + 1) // 4
        path = tmp_path / f"b{start}.unv"
        path.write_bytes(content[:begin] + content[begin + 1500 :])
        with pytest.raises(MeshFileError, match=path.name):
            resolve_mesh(path, SCENE)
