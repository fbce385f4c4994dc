"""Public functions take a path, tables or a result for a scene, and refuse anything else."""

import pytest

import pvdf_fem
from pvdf_fem import Scene, gradients, modes, respond, solve, sweep, transient

TABLES = {
    "film": {"radius_mm": 12.0, "density_kg_m3": 1780.0},
    "electrodes": {"ring_radius_mm": 6.0},
    "probe": {"shape": "circle"},
    "numerics": {"tolerance": 0.05},
}
SCENE = Scene().with_(TABLES)


@pytest.fixture(scope="module")
def solution():
    return solve(SCENE)


def test_a_path_tables_and_a_solution_are_solved(tmp_path, solution):
    path = tmp_path / "mine.toml"
    path.write_text(SCENE.to_toml(), encoding="utf-8")
    for given in (str(path), path, TABLES, solution):
        assert solve(given).charges_pC == solution.charges_pC


def test_studies_take_a_solution_or_tables(solution):
    assert modes(solution, 1).frequencies_Hz == modes(SCENE, 1).frequencies_Hz
    keys = ["load.force_N"]
    assert gradients(TABLES, keys) == gradients(solution, keys)
    swept = sweep(solution, [{"load.force_N": [1.0]}], processes=1)
    assert swept.charge_pC.sel(force_N=1.0).values == pytest.approx(
        list(solution.charges_pC.values()), rel=0.05
    )
    ours, theirs = (respond(given, [10.0]).charges_pC_N for given in (TABLES, solution))
    assert ours == theirs


@pytest.mark.parametrize("name", ["solve", "modes", "gradients", "respond", "sweep"])
@pytest.mark.parametrize("given", [3.0, None, [1.0]])
def test_what_is_no_scene_is_told(name, given):
    more = {"respond": [[10.0]], "sweep": [[{"load.force_N": [1.0]}]]}.get(name, [])
    with pytest.raises(TypeError, match="scene = "):
        getattr(pvdf_fem, name)(given, *more)


def test_a_course_of_force_is_no_number(solution):
    with pytest.raises(TypeError, match="touch = "):
        transient(solution, 0.1, [0.0, 1.0])


def test_charges_are_given_by_electrode():
    with pytest.raises(ValueError, match=r"^charges = "):
        pvdf_fem.locate(SCENE, [1.0, 2.0, 3.0])
