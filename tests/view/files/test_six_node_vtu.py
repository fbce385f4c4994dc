"""Six-node triangles in VTU files, as meshio reads them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.spatial import cKDTree

from pvdf_fem import Scene, Solution, solve
from tests.helpers.discs import uniform_mesh
from tests.helpers.files.six_node_areas import compute_areas

# The probe presses on half of the first electrode.
SCENE = Scene(
    electrodes=[{"name": "A", "x_mm": 10.0, "y_mm": 0.0}, {"name": "C", "x_mm": -10.0, "y_mm": 0}],
    probe={"shape": "rectangle", "x_mm": 3.0},
    load={"kind": "follower"},
)
STRESSES = ("S11_Pa", "S22_Pa", "S12_Pa")


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(SCENE)


def read_vtu(solution: Solution, path: Path) -> tuple[meshio.Mesh, dict[str, Any]]:
    solution.to_vtu(path, cells="six-node")
    grid = meshio.read(path)
    return grid, {name: values[0] for name, values in grid.cell_data.items()}


def test_charges_can_be_integrated_from_the_vtu_file(solution, tmp_path):
    grid, cells = read_vtu(solution, tmp_path / "a.vtu")
    area = compute_areas(grid.points, grid.cells[0].data)
    assert area.min() > 0.0
    assert area.sum() == pytest.approx(np.pi * 0.045**2, rel=1e-4)
    for name, charge in solution.charges_pC.items():
        inside = cells[f"electrode {name}"] == 1
        forces = ((cells["S11_Pa"] + cells["S22_Pa"]) * area)[inside].sum()
        assert 8.0 * forces == pytest.approx(charge, rel=1e-9)


def test_the_vtu_file_has_the_displacement_of_the_solution(solution, tmp_path):
    """Also in the middles of sides, which are no nodes of an order-3 solution."""
    grid, _ = read_vtu(solution, tmp_path / "a.vtu")
    found = grid.point_data["displacement_m"]
    for component in range(3):
        halved, values = solution.basis.refinterp(solution.displacement[:, component], nrefs=1)
        distance, node = cKDTree(grid.points[:, :2]).query(halved.p.T)
        assert distance.max() < 1e-12
        np.testing.assert_allclose(found[node, component], values, atol=1e-15)
    assert np.all(found[np.hypot(*grid.points[:, :2].T) > 0.045 * (1 - 1e-6)] == 0.0)


def test_the_nodal_stress_of_the_vtu_file_is_the_mean_around_a_node(tmp_path):
    """Linear elements have one stress each, so that the mean can be taken from the file."""
    mesh = uniform_mesh(SCENE, 4.0)
    grid, cells = read_vtu(solve(SCENE, mesh=mesh, order=1), tmp_path / "a.vtu")
    triangles, points = grid.cells[0].data, grid.points
    corner, area = triangles[:, :3], compute_areas(points, triangles)
    middles = 0.5 * (points[corner] + points[np.roll(corner, -1, axis=1)])
    curved = np.abs(middles - points[triangles[:, 3:]]).max(axis=(1, 2)) > 1e-9
    # curved elements, on the rim, have no single stress
    inner = np.setdiff1d(np.arange(len(points)), triangles[curved])
    assert inner.size
    for node in inner:
        around = (triangles == node).any(axis=1)
        mean = [np.average(cells[c][around], weights=area[around]) for c in STRESSES]
        found = [grid.point_data[c][node] for c in STRESSES]
        np.testing.assert_allclose(found, mean, rtol=1e-9, atol=1e-6 * mean[0])
        tensor = np.array([[mean[0], mean[2]], [mean[2], mean[1]]])
        largest = np.linalg.eigvalsh(tensor)[1]
        assert grid.point_data["principal_stress_Pa"][node] == pytest.approx(largest, rel=1e-9)
    u = grid.point_data["displacement_m"]
    np.testing.assert_allclose(u[triangles[:, 3]], u[corner[:, :2]].mean(axis=1), atol=1e-15)


def test_the_vtu_file_has_the_contact_pressure_at_nodes_around_the_contact(tmp_path):
    touched = solve(Scene.example("sphere").with_(**{"numerics.tolerance": 0.02}))
    grid, _ = read_vtu(touched, tmp_path / "a.vtu")
    [contact], pressure = touched.contacts.values(), grid.point_data["contact_pressure_Pa"] / 1e6
    away = np.hypot(*(1e3 * grid.points[:, :2] - contact.edge_mm.mean(axis=0)).T)
    within = pressure[away < 0.5 * np.ptp(contact.edge_mm, axis=0).max()]
    assert contact.least_pressure_MPa <= within.min() < within.max() <= contact.largest_pressure_MPa
    assert not pressure[away > 4.0].any()
