"""The report's chapters on experiments and contact, and its drawings."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pvdf_fem.mesh.gmsh_mesh import electrode_patch, mesh_scene, outlines
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.sweeps.store import Record
from reports.chapters.contact import CONTACT_CHAPTER, CORNER_DEG, rectangle, rotations_deg
from reports.chapters.drawings import DRAWINGS, DRAWINGS_CHAPTER, edge_vertices
from reports.chapters.experiments import (
    CHARGE_PARTS_CHAPTER,
    CIRCUIT_CHAPTER,
    MEASURED_POSITIONS_CHAPTER,
    frequency_of,
    largest_stress_MPa,
    thesis_circuit,
)
from reports.common.chapter import Content
from reports.common.page import Table
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import scene_of, thesis_scene

DATA = Thesis.read()


class Solved(dict):
    """Records of scenes with made-up charges: X and Y of each electrode."""

    def __init__(self, charge_pC: float = 800.0, status: str = "converged") -> None:
        super().__init__()
        half = 0.5e-3 * charge_pC / 8.0
        names = ("A", "B", "C", "D")
        forces = [[1e3 * half, 1e3 * half]] * 4
        observables = {key: forces for key in ("material", "thesis-edge")}
        solved = observables if status == "converged" else {}
        self.record = Record(status, "", names, solved, {}, 1.0, (), 0.1)

    def __getitem__(self, scene: object) -> Record:
        return self.record


def table(content: Content, name: str) -> Table:
    [match] = [b for b in content.blocks if isinstance(b, Table) and b.name == name]
    return match


def test_numbers_of_the_circuit(tmp_path: Path) -> None:
    content = CIRCUIT_CHAPTER.compose(DATA, Solved(), tmp_path)  # type: ignore[arg-type]
    assert (tmp_path / "circuit.svg").is_file()
    ours = {str(row[0]): row[2] for row in table(content, "circuit").rows}
    assert ours["reactance at 20 Hz (MΩ)"] == pytest.approx(226.96, abs=0.01)
    assert ours["frequency of the printed reactance (Hz)"] == pytest.approx(15.0, abs=0.01)
    assert ours["load in series: factor, printed reactance"] == pytest.approx(0.518, abs=5e-4)
    assert ours["load in series: factor at 20 Hz"] == pytest.approx(0.413, abs=5e-4)
    assert ours["load in parallel: factor at 20 Hz"] == pytest.approx(0.911, abs=5e-4)
    assert ours["load in parallel: phase at 20 Hz (°)"] == pytest.approx(24.4, abs=0.05)
    text = " ".join(content.paragraphs)
    assert "34.4 % less" in text
    assert "52 % higher on an open circuit" in text
    assert "38 % at 20 Hz" in text


def test_frequency_of_a_reactance_is_its_inverse() -> None:
    circuit = thesis_circuit(DATA)
    assert frequency_of(circuit, circuit.reactance(20.0)) == pytest.approx(20.0)


def test_measured_positions_meet_the_simulated_ones_of_the_same_place() -> None:
    content = MEASURED_POSITIONS_CHAPTER.compose(DATA, Solved(), Path())  # type: ignore[arg-type]
    rows = table(content, "measured_positions").rows
    pairs = {(row[2], row[4]) for row in rows if row[4] is not None}
    # the pairs that the data's README lists
    assert pairs == {(0.372, 0.368), (1.411, 0.574), (1.89, 0.146), (0.521, 0.03)}
    assert {row[0] for row in rows} == {p.case for p in DATA.positions if p.kind == "experimental"}
    text = " ".join(content.paragraphs)
    assert "2 are larger (film: uniaxial; up to 3.158 mm)" in text
    assert "5 of the 9 measured errors" in text


def test_first_modes_and_static_charges(tmp_path: Path) -> None:
    content = CHARGE_PARTS_CHAPTER.compose(DATA, Solved(48.0), tmp_path)  # type: ignore[arg-type]
    modes = {row[0]: row for row in table(content, "first_mode").rows}
    assert modes["no force"][2] == pytest.approx(117.06, abs=0.02)
    assert modes["about 1 N"][2] == pytest.approx(554.4, rel=2e-3)
    assert modes["about 1 N"][3] == pytest.approx(1.0013, abs=1e-4)
    assert modes["no force"][4] == pytest.approx(69.304, rel=2e-3)
    assert modes["no force"][5] == pytest.approx(1.0909, abs=1e-3)
    pyro = table(content, "static_charges").rows[2]
    assert pyro[1] == pytest.approx(225.0)
    text = " ".join(content.paragraphs)
    assert "21.4 MPa at the electrode" in text  # half of 3074.7 pC / (8 pC/N · 9 mm²)
    assert largest_stress_MPa(scene_of(DATA.counted[0]), pitch_mm=2.0) > 5.0


def test_failed_solves_leave_gaps_in_the_contact_chapter(tmp_path: Path) -> None:
    failed = Solved(status="unstable")
    content = CONTACT_CHAPTER.compose(DATA, failed, tmp_path)  # type: ignore[arg-type]
    assert "nothing is concluded" in " ".join(content.paragraphs)
    rows = table(content, "contact").rows
    assert rows[0][1] == 815.4188
    assert math.isnan(rows[0][4])
    assert {row[-1] for row in table(content, "contact_triangle").rows} == {"unstable"}
    charge_parts = CHARGE_PARTS_CHAPTER.compose(DATA, failed, tmp_path)  # type: ignore[arg-type]
    assert "nan" not in " ".join(charge_parts.paragraphs)


def test_rotations_of_the_contact_chapter() -> None:
    rotations = rotations_deg(DATA)
    assert rotations == sorted(90.0 - r for r in rotations)  # A at t is B at 90° − t
    corner = rectangle(CORNER_DEG, "pressure").probe
    assert corner is not None
    nearest = min(abs(np.degrees(np.arctan2(y, x))) for x, y in corner.outline.vertices)
    assert nearest == pytest.approx(0.0, abs=1e-9)
    assert len(set(CONTACT_CHAPTER.scenes(DATA.quick()))) <= 6


def test_every_drawing_of_chapters_2_to_4_is_there_or_has_a_reason(tmp_path: Path) -> None:
    kinds = {"drawing", "mesh", "screen shot"}
    cases = {"3.8", "3.13", "3.14"}  # scenes with charges, which other parts show
    expected = {
        figure.number
        for figure in DATA.figures
        if figure.kind in kinds and figure.number[0] in "234" and figure.number not in cases
    }
    assert set(DRAWINGS) == expected
    assert DRAWINGS_CHAPTER.scenes(DATA) == []
    content = DRAWINGS_CHAPTER.compose(DATA.quick(), Solved(), tmp_path)  # type: ignore[arg-type]
    for file_or_reason in DRAWINGS.values():
        assert (tmp_path / file_or_reason.split(":")[0]).is_file() or file_or_reason.startswith(
            "not reproduced: "
        )
    rows = {row[0]: row for row in table(content, "meshes").rows}
    assert rows["sizes of the thesis"][3] == 16
    assert 13_000 <= int(str(rows["sizes of the thesis"][2])) <= 16_000


def test_edge_vertices_lie_on_the_outline() -> None:
    scene = thesis_scene("4", "tri7")
    mesh = mesh_scene(scene, Sizes(dict.fromkeys(outlines(scene), 1e-3), 0.3, 8e-3))
    nodes = edge_vertices(mesh, electrode_patch("B"))
    x, y = 1e3 * mesh.p[:, nodes] - [[0.0], [10.0]]
    np.testing.assert_allclose(np.maximum(abs(x), abs(y)), 1.5, rtol=1e-9)
    assert len(nodes) >= 12
