"""Input decks of Abaqus and CalculiX: element types, layout of lines, parts and instances."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pvdf_fem.arrays import Array
from pvdf_fem.mesh.files.abaqus_deck.reader import AbaqusReader
from pvdf_fem.mesh.files.content import MeshFileError
from pvdf_fem.mesh.mesh_file import resolve_mesh
from tests.mesh.files.film_files import SCENE, get_triangles, require_film

NODES = "*NODE\n1, 0, 0, 0\n2, 1, 0\n3, 0, 1, 0\n4, .5\n5, 5.D-1, 0.5d0, 0\n 60, 0, 5e-1, 0\n"
THREE_NODES = "CPS3 cps3 CPE3 CPE3H CPEG3 CAX3 CGAX3 M3D3 SFM3D3 S3 S3R s3rs STRI3 DS3 R3D3 DC2D3"
SIX_NODES = "CPS6 CPS6M CPE6 cpe6m CPE6H CAX6 CAX6M M3D6 m3d6 SFM3D6 S6 STRI65 stri65 DS6 DC2D6"
PLACES = [[0, 0], [1, 0], [0, 1], [0.5, 0], [0.5, 0.5], [0, 0.5]]


def number(index: int) -> int:
    """The number of a node: with gaps, and not in the order of the lines."""
    return 10 * index + 7


def write_rows(points: Array) -> str:
    """The data lines of ``*NODE``, from the last node to the first."""
    rows = [
        f"{number(index)}, {x!r}, {y!r}, {z!r}" for index, (x, y, z) in enumerate(points.tolist())
    ]
    return "\n".join(reversed(rows)) + "\n"


def write_elements(nodes: np.ndarray, per_line: int) -> str:
    """The data lines of ``*ELEMENT`` with at most some numbers on a line."""
    lines = []
    for element, row in enumerate(nodes.tolist(), start=1):
        numbers = [element, *(number(node) for node in row)]
        parts = [numbers[start : start + per_line] for start in range(0, len(numbers), per_line)]
        lines.append(",\n".join(", ".join(map(str, part)) for part in parts))
    return "\n".join(lines) + "\n"


def read(tmp_path: Path, text: str) -> tuple[Array, np.ndarray]:
    """The coordinates in the plane of the vertices and midside nodes of all triangles."""
    path = tmp_path / "deck.inp"
    path.write_text(text)
    content = AbaqusReader().read(path)
    return content.points[content.triangles], content.points[content.triangles6]


@pytest.mark.parametrize("element_type", THREE_NODES.split())
def test_three_node_elements_are_triangles(tmp_path: Path, element_type: str) -> None:
    three, six = read(tmp_path, f"{NODES}*Element, Type={element_type}, ELSET=all\n7, 1, 2, 3\n")
    np.testing.assert_array_equal(three[0, :, :2], PLACES[:3])
    assert not len(six)


@pytest.mark.parametrize("element_type", SIX_NODES.split())
def test_six_node_elements_are_triangles(tmp_path: Path, element_type: str) -> None:
    line = "\n7, 1, 2,\n3, 4, 5,\n60"
    three, six = read(tmp_path, f"{NODES}*ELEMENT ,\n ELSET=all, TYPE = {element_type}{line}\n")
    np.testing.assert_array_equal(six[0, :, :2], PLACES)
    assert not len(three)


@pytest.mark.parametrize(
    ("element_type", "line"), [("C3D10", "1"), ("S8R", "1"), ("CPS4", "1"), ("U1", "1")]
)
def test_other_elements_are_refused_by_name(tmp_path: Path, element_type: str, line: str) -> None:
    path = tmp_path / "deck.inp"
    path.write_text(f"{NODES}*ELEMENT, TYPE={element_type}\n{line}\n")
    with pytest.raises(MeshFileError, match=f"1 {element_type}"):
        resolve_mesh(path, SCENE)


@pytest.mark.parametrize("order", [1, 2])
def test_a_deck_with_all_its_keywords_is_read(tmp_path: Path, order: int) -> None:
    points, nodes = get_triangles(order)
    (tmp_path / "nodes.txt").write_text("** comment\n" + write_rows(points))
    (tmp_path / "mesh.inp").write_text(
        f"*Element, type={'S3R' if order == 1 else 'STRI65'}, elset=FILM\n"
        + write_elements(nodes, per_line=4)
    )
    deck = (
        "** a film\n*HEADING\nTension of 1, 2, 3\n*NODE, NSET=all,\nINPUT=nodes.txt\n"
        "*NODE\n999999, 1e9, 0, 0\n"  # in no element
        "*INCLUDE, INPUT=mesh.inp\n"
        "*ELEMENT, TYPE=T3D2, ELSET=rim\n5000, 7, 17\n*ELEMENT, TYPE=MASS\n5001, 7\n"
        "*NSET, NSET=even, GENERATE\n7, 107, 10\n*SHELL SECTION, ELSET=FILM, MATERIAL=PVDF\n25e-3\n"
        "*NODE PRINT, NSET=all\nU\n*STEP\n*STATIC\n*END STEP\n"
    )
    (tmp_path / "a.inp").write_bytes(deck.replace("\n", "\r\n").encode())
    require_film(tmp_path / "a.inp")


def test_an_instance_is_moved_and_turned_as_abaqus_does(tmp_path: Path) -> None:
    """First the translation, then the rotation about the line through two points."""
    part = f"*PART, NAME=Half\n{NODES}*ELEMENT, TYPE=S3\n1, 1, 2, 3\n*END PART\n"
    instance = "*INSTANCE, NAME=a, PART=half\n1, 0, 0\n1, 0, 0, 1, 0, 5, 90\n*END INSTANCE\n"
    other = "*INSTANCE, NAME=b, PART=HALF\n*END INSTANCE\n"
    assembly = f"*ASSEMBLY, NAME=x\n{instance}{other}*NODE\n1, 9, 9, 9\n*END ASSEMBLY\n"
    three, _ = read(tmp_path, part + assembly)
    turned = [[1, 0], [1, 1], [0, 0]]
    np.testing.assert_allclose(three[:, :, :2], [turned, PLACES[:3]], atol=1e-12)


def test_two_instances_of_half_a_film_are_joined_at_the_nodes_that_both_have(
    tmp_path: Path,
) -> None:
    points, nodes = get_triangles(2)
    is_left = points[nodes].mean(axis=1)[:, 0] < 0.0
    text = ""
    for name, is_half in (("left", is_left), ("right", ~is_left)):
        elements = write_elements(nodes[is_half], per_line=16)
        text += f"*PART, NAME={name}\n*NODE\n{write_rows(points + np.array([0.0, 3.0, 1.0]))}"
        text += f"*ELEMENT, TYPE=M3D6\n{elements}*END PART\n"
    text += "*ASSEMBLY, NAME=film\n"
    for name in ("left", "right"):
        text += f"*INSTANCE, NAME={name}-1, PART={name}\n0., -3., 0.\n*END INSTANCE\n"
    (tmp_path / "a.inp").write_text(f"{text}*END ASSEMBLY\n")
    (note,) = require_film(tmp_path / "a.inp").notes
    assert "duplicate nodes were merged" in note


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"{NODES}*ELEMENT, TYPE=S3\n1, 1, 2, 9\n", "node 9"),
        (f"{NODES}*ELEMENT, TYPE=S3\n1, 1, 2, 3, 4\n", "line 9: has 4 nodes"),
        (f"{NODES}*ELEMENT, TYPE=S3\n1, 1, 2\n", "cut off"),
        (f"{NODES}*ELEMENT\n1, 1, 2, 3\n", "TYPE="),
        ("*NODE\n1, 0, zero\n", "line 2: 'zero' is not a number"),
        ("*NODE\n1, 0, inf\n", "line 2: 'inf' is not a number"),
        ("*NODE\n1e300, 0, 0\n", "line 2: 1e.300 is not the number of a node"),
        ("*NODE\n1.5, 0, 0\n", "line 2: 1.5 is not the number of a node"),
        (f"{NODES}*ELEMENT, TYPE=S3\n1, 1, 2, 3.5\n", "line 9: 3.5 is not the number of a node"),
        (f"{NODES}*NGEN\n1, 2\n", "NGEN"),
        ("*NODE, SYSTEM=C\n1, 45, 0\n", "NODE"),
        ("*SYSTEM\n1, 2, 3\n", "SYSTEM"),
        ("*INCLUDE, INPUT=missing.inp\n", "missing.inp"),
        ("*INCLUDE, INPUT=deck.inp\n", "include each other"),
        ("*INSTANCE, NAME=a, PART=none\n1, 2, 3\n*END INSTANCE\n", "NONE"),
        (NODES, "no surface elements"),
        ("5 2 0 0 0\n1 0 0 0\n", "no surface elements"),  # the format of AVS
        ("", "no surface elements"),
    ],
)
def test_wrong_decks_are_refused_with_the_place(tmp_path: Path, text: str, reason: str) -> None:
    path = tmp_path / "deck.inp"
    path.write_text(text)
    with pytest.raises(MeshFileError, match=reason):
        resolve_mesh(path, SCENE)
