"""VTU files with linear triangles, as VTK, pyvista and meshio read them."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import meshio
import numpy as np
import pytest
from scipy.spatial import Delaunay

from pvdf_fem import Scene, Solution, solve
from pvdf_fem.files import FileError
from pvdf_fem.solver.nonlinear.status import Status
from tests.helpers.files.vtu_errors import VtuErrors, measure_vtu_errors

NAME = "<é & b>"
#: The probe presses on half of the first electrode; the second is round.
SCENE = Scene(
    electrodes=[
        {"name": NAME, "x_mm": 10.0, "y_mm": 0.0},
        {"name": "C", "shape": "circle", "radius_mm": 2.0, "x_mm": -10.0, "y_mm": 0.0},
    ],
    probe={"shape": "rectangle", "x_mm": 3.0},
    load={"kind": "follower"},
)
HEAT = {"film.d33_pC_N": -20.0, "film.pyroelectric_uC_m2K": -25.0, "film.warming_K": 0.2}
LAYER = {"shape": "circle", "x_mm": 6.0, "y_mm": 4.0, "radius_mm": 5.0, "thickness_um": 10.0}
SPHERE = Scene.example("sphere").with_(**{"numerics.tolerance": 0.02})
#: Scenes that differ in what charges and fields consist of.
SCENES = {
    "follower": SCENE,
    "symmetric": Scene.example("disc"),
    "thesis-edge": Scene.example("four_electrodes").with_(
        **{"numerics.observable": "thesis-edge", "numerics.tolerance": 0.02}
    ),
    "voltages": SCENE.with_(**{"readout": {"kind": "voltage"}, "film.coupling": True}),
    "heat and pressure": SCENE.with_(**HEAT),
    "tension field": SCENE.with_(**{"film.compression": "tension-field"}),
    "bending": SCENE.with_(**{"film.bending": True, "film.thickness_um": 50.0}),
    "layers": SCENE.with_(**{"film.patches": [LAYER]}),
    "uneven pretension": SCENE.with_(**{"film.pretension_N_m": [6.0, 12.0]}),
    "sphere": SPHERE,
    "flat": SCENE.with_(probe=None),
}


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(SCENE)


def read(solution: Solution, folder: Path) -> tuple[meshio.Mesh, dict[str, Any]]:
    """The grid of a VTU file, and its cell data."""
    solution.to_vtu(folder / "a.vtu")
    grid = meshio.read(folder / "a.vtu")
    return grid, {name: values[0] for name, values in grid.cell_data.items()}


def measure_areas(grid: meshio.Mesh) -> Any:
    a, b, c = grid.points[grid.cells[0].data].swapaxes(0, 1)
    return 0.5 * np.cross(b - a, c - a)[:, 2]


@pytest.mark.parametrize("name", SCENES)
def test_vtk_samples_and_integrates_what_was_solved(name, tmp_path):
    pytest.importorskip("pyvista", reason="VTK reads what ParaView reads")
    errors = measure_vtu_errors(solve(SCENES[name]), tmp_path / "a.vtu", points=20_000)
    assert errors.points_missed == 0
    assert errors.deflection < 6e-4
    assert errors.film_area < 6e-5
    assert errors.electrode_areas < 1e-9
    assert errors.charges < 1e-6
    assert errors.charge_changes < 1e-5
    assert errors.charges_of_points < 1e-6
    assert errors.tip_force < 1e-6
    # the slopes of the solution itself jump by up to 6.3 degrees between its elements
    assert errors.largest_turn_deg < 7.0
    assert errors.bytes < 3e6


def test_sums_over_triangles_need_no_vtk(solution, tmp_path):
    """Area times a value of cells gives areas, charges and stress integrals of electrodes."""
    grid, cells = read(solution, tmp_path)
    areas = measure_areas(grid)
    assert areas.min() > 0.0
    assert areas.sum() == pytest.approx(math.pi * 0.045**2, rel=1e-4)
    changes = solution.charge_changes_pC
    for name, charge in solution.charges_pC.items():
        inside = cells[f"electrode {name}"] == 1
        assert 1e12 * (cells["charge_density_C_m2"] * areas)[inside].sum() == pytest.approx(
            charge, rel=1e-6
        )
        change = (cells["charge_change_density_C_m2"] * areas)[inside].sum()
        assert 1e12 * change == pytest.approx(changes[name], rel=1e-6)
        forces = ((cells["S11_Pa"] + cells["S22_Pa"]) * areas)[inside].sum()
        assert 8.0 * forces == pytest.approx(charge, rel=1e-6)
    outside = (cells[f"electrode {NAME}"] + cells["electrode C"]) == 0
    assert not cells["charge_change_density_C_m2"][outside].any()


def test_masks_have_the_exact_areas_of_patches(solution, tmp_path):
    grid, cells = read(solution, tmp_path)
    areas = measure_areas(grid)
    expected = {f"electrode {NAME}": 9e-6, "electrode C": math.pi * 4e-6, "probe": 98e-6}
    for name, area in expected.items():
        assert set(np.unique(cells[name])) == {0, 1}
        assert areas[cells[name] == 1].sum() == pytest.approx(area, rel=1e-9)


def test_principal_stresses_belong_to_the_stresses_of_points(solution, tmp_path):
    data = read(solution, tmp_path)[0].point_data
    tensors = np.stack([data["S11_Pa"], data["S12_Pa"], data["S12_Pa"], data["S22_Pa"]], axis=-1)
    largest = np.linalg.eigvalsh(tensors.reshape(-1, 2, 2))[:, 1]
    np.testing.assert_allclose(data["principal_stress_Pa"], largest, rtol=1e-5)


def test_stresses_at_points_inside_an_element_are_those_of_the_solution(solution, tmp_path):
    grid, _ = read(solution, tmp_path)
    points = 1e3 * grid.points[:, :2]
    is_chosen = np.hypot(*points.T) < 44.0
    for name in ("electrode C", f"electrode {NAME}"):  # shifted by less than 1e-3
        masked = grid.cells[0].data[grid.cell_data[name][0] == 1]
        is_chosen[np.unique(masked)] = False
    found = np.column_stack([grid.point_data[f"S{i}_Pa"] for i in (11, 22, 12)])[is_chosen]
    exact = 1e6 * solution.at(*points[is_chosen].T).stress_MPa
    errors = np.abs(found - exact).max(axis=1) / np.abs(exact).max()
    # stresses jump at the sides of elements, where the file has the mean
    assert np.median(errors) < 1e-6
    assert errors.max() < 0.1


def test_the_contact_pressure_is_that_of_the_tip(tmp_path):
    touched = solve(SPHERE)
    grid, _ = read(touched, tmp_path)
    [contact] = touched.contacts.values()
    pressure = 1e-6 * grid.point_data["contact_pressure_Pa"]
    hull = Delaunay(contact.edge_mm)
    centre = contact.edge_mm.mean(axis=0)
    points = 1e3 * grid.points[:, :2]
    within = hull.find_simplex(centre + 1.15 * (points - centre)) >= 0
    beyond = hull.find_simplex(centre + 0.85 * (points - centre)) < 0
    assert within.sum() > 20
    least, largest = contact.least_pressure_MPa, contact.largest_pressure_MPa
    assert 0.9 * least < pressure[within].min() < pressure[within].max() < 1.1 * largest
    assert not pressure[beyond].any()


def test_the_file_has_charges_and_the_scene(solution, tmp_path):
    """For meshio, and for VTK as ParaView reads it."""
    grid, _ = read(solution, tmp_path)
    charges = {f"charge_pC {name}": [charge] for name, charge in solution.charges_pC.items()}
    charges |= {f"charge_error_pC {name}": [e] for name, e in solution.charge_errors_pC.items()}
    charges |= {f"rest_charge_pC {name}": [q] for name, q in solution.rest_charges_pC.items()}
    assert {name: grid.field_data[name].tolist() for name in charges} == charges
    assert Scene.parse(grid.field_data["scene_toml"].tobytes().decode()) == SCENE
    pyvista = pytest.importorskip("pyvista", reason="VTK reads what ParaView reads")
    vtk = pyvista.read(tmp_path / "a.vtu")
    assert {name: vtk.field_data[name].tolist() for name in charges} == charges
    np.testing.assert_array_equal(vtk.point_data["deflection_m"], grid.point_data["deflection_m"])


def test_unknown_cells_and_extensions_are_refused(solution, tmp_path):
    with pytest.raises(ValueError, match="six-node"):
        solution.to_vtu(tmp_path / "a.vtu", cells="quadratic")
    with pytest.raises(FileError, match=r"\.vtu"):
        solution.to_vtu(tmp_path / "a.vtk")
    assert not list(tmp_path.iterdir())


def draw_scene(rng: np.random.Generator) -> Scene:
    """A random scene of a film with round or square electrodes and patches and any load."""
    kind = rng.choice(["dead", "follower", "rigid", "contact", "tension", "bending", "layers"])
    shape = rng.choice(["circle", "square", "ellipse", "triangle"])
    sizes = {
        "circle": {"radius_mm": rng.uniform(1.0, 5.0)},
        "square": {"side_mm": rng.uniform(2.0, 8.0)},
        "ellipse": {"semi_axes_mm": rng.uniform(1.5, 5.0, 2).tolist()},
        "triangle": {"side_mm": rng.uniform(3.0, 9.0)},
    }
    place = {"x_mm": rng.uniform(-8.0, 8.0), "y_mm": rng.uniform(-8.0, 8.0)}
    probe = {"shape": str(shape), **sizes[shape], **place}
    changes: dict[str, Any] = {"load.force_N": 10.0 ** rng.uniform(-1.5, 0.5)}
    if kind in ("dead", "follower", "rigid"):
        changes["load.kind"] = str(kind)
    elif kind == "contact":
        probe = {"shape": "sphere", "radius_mm": rng.uniform(2.0, 8.0), **place}
        changes["load.force_N"] = rng.uniform(0.1, 1.5)
    elif kind == "tension":
        changes["film.compression"] = "tension-field"
        changes["film.pretension_N_m"] = rng.uniform(1.0, 9.0)
    elif kind == "bending":
        changes["film.bending"] = True
        changes["film.thickness_um"] = rng.uniform(20.0, 80.0)
    else:
        patch = {"shape": "circle", "radius_mm": rng.uniform(2.0, 6.0), "thickness_um": 8.0}
        changes["film.patches"] = [{**patch, "x_mm": -14.0, "y_mm": rng.uniform(-9.0, 9.0)}]
    if rng.random() < 0.5:
        changes["film.d31_pC_N"] = 20.0
        changes["film.d32_pC_N"] = 3.0
    if rng.random() < 0.3:
        changes["film.d33_pC_N"] = -25.0
    electrodes = [
        {"name": "R", "shape": "circle", "radius_mm": rng.uniform(1.0, 4.0), "x_mm": 17.0},
        {"name": "S", "side_mm": rng.uniform(1.0, 4.0), "x_mm": -22.0},
        {"name": "E", "shape": "ellipse", "semi_axes_mm": [6.0, 1.0], "x_mm": 0.0, "y_mm": 20.0},
    ]
    for electrode in electrodes:
        electrode.setdefault("y_mm", rng.uniform(-5.0, 5.0))
    load = {"kind": "contact"} if kind == "contact" else {}
    return Scene(electrodes=electrodes, probe=probe, load=load).with_(**changes)


@pytest.mark.slow
def test_random_scenes_are_right_in_vtk(tmp_path):
    pytest.importorskip("pyvista", reason="VTK reads what ParaView reads")
    rng = np.random.default_rng(46)
    measured: list[VtuErrors] = []
    while len(measured) < 60:
        solution = solve(draw_scene(rng))
        if solution.status is Status.CONVERGED:
            measured.append(measure_vtu_errors(solution, tmp_path / "a.vtu", points=100_000))
    worst = {name: max(getattr(errors, name) for errors in measured) for name in VtuErrors._fields}
    print(worst)
    assert worst["points_missed"] == 0
    assert worst["deflection"] < 1e-3
    assert worst["film_area"] < 1e-4
    assert worst["electrode_areas"] < 1e-6
    for name in ("charges", "charge_changes", "charges_of_points", "tip_force"):
        assert worst[name] < 1e-3
