"""One solve for all scenes whose films deform alike: which these are, and their charges."""

from __future__ import annotations

import pytest

from pvdf_fem import Replaced, Scene, solve
from pvdf_fem.batch.batch import plan_scenes, solve_scenes
from pvdf_fem.batch.plan import plan_solves
from pvdf_fem.scene.outlines.outline import rotate
from pvdf_fem.solver.adaptive import solve_outputs
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution

TRIANGLE = Scene().with_(
    **{
        "probe": {"shape": "triangle", "x_mm": 3.0, "y_mm": -7.5, "rotation_deg": 200.0},
        "film.d31_pC_N": 18.0,
        "film.d32_pC_N": 2.0,
        "numerics.tolerance": 2e-3,
    }
)
L_SHAPE = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]]
L_SHAPED = Replaced(shape="polygon", vertices_mm=L_SHAPE)
CENTRED = Replaced(shape="rectangle")
MIRRORED = {"probe.x_mm": -3.0, "probe.rotation_deg": -200.0}
TURNED = {"probe.x_mm": 7.5, "probe.y_mm": 3.0, "probe.rotation_deg": 290.0}
X, Y = rotate([3.0, -7.5], 37.0).tolist()
ASKEW = {"probe.x_mm": X, "probe.y_mm": Y, "probe.rotation_deg": 237.0}
COUPLED = {"film.coupling": True, "readout": {"kind": "voltage"}}
STIFFER_ALONG_X = {"film.youngs_modulus_GPa": [3.0, 2.0]}


def solves(*scenes: Scene) -> int:
    return len(plan_solves(scenes).blocks)


@pytest.mark.parametrize(
    ("base", "change", "count"),
    [
        ({}, {"electrodes.ring_radius_mm": 14.0}, 1),
        ({}, {"film.d31_pC_N": 1.0, "film.density_kg_m3": 900.0}, 1),
        ({}, {"numerics.observable": "thesis-edge"}, 1),
        ({}, {"film.thickness_um": 50.0, "load.force_N": 2.0}, 1),
        ({}, {"film.thermal_expansion_per_K": 55e-6, "film.temperature_change_K": -2.0}, 1),
        ({}, MIRRORED, 1),
        ({}, TURNED, 1),
        ({}, ASKEW, 1),
        ({}, {"probe.x_mm": -3.0}, 2),
        ({}, {"film.pretension_N_m": 25.0 / 3.0}, 1),
        ({}, {"film.pretension_N_m": 50 / 3.0, "film.thickness_um": 50.0, "load.force_N": 2.0}, 1),
        ({}, {"film.pretension_N_m": 25 / 3.0, "film.thickness_um": 50.0, "load.force_N": 2.0}, 2),
        ({}, {"film.pretension_N_m": [8.0, 9.0]}, 2),
        ({"film.pretension_N_m": 9.0}, ASKEW, 1),
        ({"film.pretension_N_m": [9.0, 8.0]}, MIRRORED, 1),
        ({"film.pretension_N_m": [9.0, 8.0]}, TURNED, 2),
        ({"film.pretension_N_m": [9.0, 8.0]}, ASKEW, 2),
        (STIFFER_ALONG_X, MIRRORED, 1),
        (STIFFER_ALONG_X, TURNED, 2),
        ({"film.shear_modulus_GPa": 1.0}, TURNED, 1),
        ({"film.shear_modulus_GPa": 1.0}, ASKEW, 2),
        ({"probe": L_SHAPED}, {"probe.rotation_deg": 45.0}, 1),
        ({"probe": CENTRED}, {"probe.rotation_deg": 33.0}, 1),
        ({"probe": None}, {"load.force_N": 3.0, "film.thickness_um": 9.0}, 1),
        (COUPLED, MIRRORED, 2),
    ],
)
def test_scenes_join_when_their_films_deform_alike(base, change, count):
    scene = TRIANGLE.with_(**base)
    assert solves(scene, scene.with_(**change)) == count


def test_the_plan_tells_how_many_solves_there_are():
    forces = [{"film.thickness_um": h, "load.force_N": h / 25.0} for h in (25.0, 50.0)]
    rings = [{"electrodes.ring_radius_mm": r} for r in (8.0, 12.0)]
    scenes = [TRIANGLE.with_(**f, **r, **m) for f in forces for r in rings for m in ({}, MIRRORED)]
    shared = plan_solves([*scenes, scenes[0]])
    assert (shared.missing, len(shared.blocks)) == (8, 1)
    assert [line.split()[0] for line in str(shared).splitlines()] == ["9", "8", "1"]


@pytest.mark.parametrize("observable", ["material", "thesis-edge"])
def test_joined_scenes_have_the_charges_and_warnings_of_separate_solves(observable):
    """Thick, turned by an odd angle, mirrored, another spacing, tightened instead of cooled."""
    scene = TRIANGLE.with_(**{"numerics.observable": observable})
    changes = [
        {"film.thickness_um": 500.0, "load.force_N": 20.0},
        {**ASKEW, "film.thickness_um": 50.0, "load.force_N": 2.0},
        {**MIRRORED, "electrodes.ring_radius_mm": 6.0},
        {"film.pretension_N_m": 50.0 / 3.0, "film.thickness_um": 50.0, "load.force_N": 2.0},
    ]
    scenes = [scene.with_(**change) for change in changes]
    assert len(plan_scenes(scenes).blocks) == 1
    alone = [solve(scene) for scene in scenes]
    for solution, record in zip(alone, solve_scenes(scenes, processes=1), strict=True):
        for name, charge in solution.charges_pC.items():
            assert record.charge_errors_pC(18.0, 2.0, observable)[name] <= 2e-3 * charge
            shared = record.charges_pC(18.0, 2.0, observable)[name]
            assert shared == pytest.approx(charge, rel=2e-3)
        assert record.warnings == solution.warnings
    assert alone[0].warnings != alone[1].warnings


def test_images_of_a_scene_share_its_mesh():
    """Electrodes that lie on those of the first scene need no other mesh than its own."""
    scene = TRIANGLE.with_(**{"numerics.tolerance": 0.02})
    first, turned = solve_scenes([scene, scene.with_(**TURNED)], processes=1)
    assert first.charges_pC(18.0, 2.0) == solve(scene).charges_pC
    # B of the turned scene lies where A of the first was, and its axes have changed places
    charge = first.charges_pC(2.0, 18.0)["A"]
    assert turned.charges_pC(18.0, 2.0)["B"] == pytest.approx(charge, rel=1e-12)


def test_scenes_that_miss_the_tolerance_together_are_solved_alone(monkeypatch):
    counts = []

    def solved(problem):
        counts.append(len(problem.scene.electrode_list))
        if not problem.scene.electrode_list:
            return Solution(problem, Status.TOLERANCE, "", seconds={"total": 0.0})
        return solve_outputs(problem)

    monkeypatch.setattr("pvdf_fem.batch.records.solve_outputs", solved)
    scene = TRIANGLE.with_(**{"numerics.tolerance": 0.05})
    alone = solve_scenes([scene, scene.with_(**{"electrodes.layout": "three"})], processes=1)
    assert counts == [0, 4, 3]
    assert [record.status for record in alone] == ["converged"] * 2
