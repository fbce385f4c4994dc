"""Profiles in files: a solve is identified by what the file holds, not by its path."""

from __future__ import annotations

import os

import pytest

from pvdf_fem import Scene, solve
from pvdf_fem.batch.batch import plan_scenes, solve_planned, solve_scenes
from pvdf_fem.batch.keys import make_record_key
from pvdf_fem.batch.plan import plan_solves
from pvdf_fem.batch.store import Store
from tests.helpers.refusals import keys, refused

PROFILE = "p.csv"
SCENE = Scene().with_(
    **{
        "film.radius_mm": 20.0,
        "electrodes.ring_radius_mm": 8.0,
        "probe": {"shape": "circle", "radius_mm": 4.0},
        "load.profile": PROFILE,
        "numerics.tolerance": 0.02,
    }
)
OWN = {"x_mm": 9.0, "load": {"kind": "dead", "profile": PROFILE}}
LISTED = SCENE.with_({"load": {"profile": "uniform"}, "probe": [{"shape": "circle"}, OWN]})


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def write(along_x: float = 0.0, along_y: float = 0.0) -> None:
    """A pressure that leans along x and y, in a file whose size and time of change stay."""
    places = [(x, y) for x in (-5.0, 5.0) for y in (-5.0, 5.0)]
    rows = [f"{x},{y},{1.0 + along_x * x + along_y * y:.3f}" for x, y in places]
    with open(PROFILE, "w") as file:
        file.write("\n".join(["x_mm,y_mm,pressure", *rows]))
    os.utime(PROFILE, ns=(10**18, 10**18))


def fresh(scene: Scene) -> list[float]:
    return [*solve(scene).charges_pC.values()]


def assert_solved_afresh(scenes: list[Scene], **how: object) -> None:
    """Charges are those of each scene solved alone, from the file as it is now."""
    for scene, record in zip(scenes, solve_scenes(scenes, **how), strict=True):
        found = [*record.charges_pC(8.0, 8.0).values()]
        assert found == pytest.approx(fresh(scene), rel=1e-9)


@pytest.mark.parametrize("processes", [1, 2])
def test_a_store_sees_that_a_file_has_changed_or_is_another_one(processes, tmp_path, monkeypatch):
    """A relative path means another file elsewhere, also to processes that stay."""
    known = []
    with Store(tmp_path / "s.db") as store:
        for name, lean in (("here", 0.15), ("there", -0.15), ("here", 0.1)):
            tmp_path.joinpath(name).mkdir(exist_ok=True)
            monkeypatch.chdir(tmp_path / name)
            write(lean)
            heavier = SCENE.with_(**{"load.force_N": 2.0})
            assert_solved_afresh([SCENE, heavier], store=store, processes=processes)
            assert SCENE in store
            known += [make_record_key(SCENE), make_record_key(LISTED)]
    assert len(set(known)) == 6


def test_what_reads_another_file_than_was_planned_is_no_record(tmp_path):
    """As a process on another machine would, whose file of this name holds something else."""
    write(0.15)
    with Store(tmp_path / "s.db") as store:
        todo = plan_scenes([SCENE], store)
        write(-0.15)
        ((_, record),) = solve_planned(todo, store, processes=1)
        assert not record.converged
        assert "load.profile" in record.reason
        assert SCENE not in store
        write(0.15)
        assert SCENE not in store


def test_a_solution_says_which_content_was_solved():
    write(0.15)
    solution = solve(SCENE)
    again = Scene.parse(solution.scene.to_toml())
    assert make_record_key(again) == make_record_key(SCENE)
    assert fresh(again) == [*solution.charges_pC.values()]
    write(-0.15)
    assert keys(refused(solve, again)) == ["load.profile"]


def test_a_lopsided_profile_is_not_mirrored():
    """The whole film is solved, and the mirror image of the place shares no solve."""
    write(0.0, 0.15)
    scene = SCENE.with_(**{"probe.x_mm": 3.0})
    mirrored = SCENE.with_(**{"probe.x_mm": -3.0, "probe.rotation_deg": 180.0})
    assert len(plan_solves([scene, mirrored]).blocks) == 2
    assert_solved_afresh([scene, mirrored], processes=1)
    for each in (scene, mirrored):
        charges = fresh(each)
        assert abs(charges[1] - charges[3]) > 0.02 * charges[1]
