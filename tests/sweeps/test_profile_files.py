"""Profiles in files: a solve is identified by what the file holds, not by its path."""

from __future__ import annotations

import os

import pytest

from pvdf_fem import Scene, SceneError, solve
from pvdf_fem.sweeps.plan import plan
from pvdf_fem.sweeps.store import Store, key
from pvdf_fem.sweeps.sweep import planned, records, solve_all

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


def charges(scene: Scene, store: Store | None = None) -> list[float]:
    (record,) = solve_all([scene], store, processes=1)
    assert record.converged, record.reason
    return [*record.charges_pC(8.0, 8.0).values()]


def fresh(scene: Scene) -> list[float]:
    return [*solve(scene).charges_pC.values()]


def test_a_store_sees_that_a_file_has_changed(tmp_path):
    with Store(tmp_path / "s.db") as store:
        for lean in (0.15, -0.15, 0.15):
            write(lean)
            found = charges(SCENE, store)
            assert found == pytest.approx(fresh(SCENE), rel=1e-9)
            assert (found[0] > 1.01 * found[2]) == (lean > 0.0)
            assert SCENE in store


def test_a_relative_path_that_means_another_file_elsewhere_is_another_scene(tmp_path, monkeypatch):
    keys = []
    with Store(tmp_path / "s.db") as store:
        for name, lean in (("here", 0.15), ("there", -0.15)):
            tmp_path.joinpath(name).mkdir()
            monkeypatch.chdir(tmp_path / name)
            write(lean)
            assert charges(SCENE, store) == pytest.approx(fresh(SCENE), rel=1e-9)
            keys.append(key(SCENE))
    assert keys[0] != keys[1]


def test_processes_that_stay_find_the_file_of_another_folder(tmp_path, monkeypatch):
    scenes = [SCENE, SCENE.with_(**{"load.force_N": 2.0})]
    for name, lean in (("here", 0.15), ("there", -0.15)):
        tmp_path.joinpath(name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        write(lean)
        record, _ = solve_all(scenes, processes=2)
        found = [*record.charges_pC(8.0, 8.0).values()]
        assert found == pytest.approx(fresh(SCENE), rel=1e-9)


def test_a_file_of_one_probe_of_a_list_counts():
    load = {"kind": "dead", "profile": PROFILE}
    probe = {"shape": "circle", "radius_mm": 3.0, "y_mm": 0.0}
    scene = SCENE.with_(load={}, probe=[{**probe, "x_mm": -5.0}, {**probe, "x_mm": 5.0}])
    scene = scene.with_(**{"probe[1].load": load})
    write(0.15)
    before = key(scene)
    write(-0.15)
    assert key(scene) != before


@pytest.mark.parametrize("content", [None, "x_mm,y_mm,pressure\n0,0,a"])
def test_a_file_that_holds_no_profile_is_refused_before_any_solve(content, monkeypatch, tmp_path):
    monkeypatch.setattr("pvdf_fem.mesh.gmsh_mesh.gmsh", None)
    if content:
        tmp_path.joinpath(PROFILE).write_text(content)
    with pytest.raises(SceneError, match=r"load\.profile"):
        solve_all([SCENE.with_(probe=None), SCENE], processes=1)


def test_what_reads_another_file_than_was_planned_is_no_record(tmp_path):
    """As a process on another machine would, whose file of this name holds something else."""
    write(0.15)
    with Store(tmp_path / "s.db") as store:
        todo = planned([SCENE], store)
        write(-0.15)
        ((_, record),) = records(todo, store, processes=1)
        assert not record.converged
        assert "load.profile" in record.reason
        assert SCENE not in store
        write(0.15)
        assert SCENE not in store


def test_a_solution_says_which_content_was_solved():
    write(0.15)
    solution = solve(SCENE)
    again = Scene.parse(solution.scene.to_toml())
    assert key(again) == key(SCENE)
    assert fresh(again) == [*solution.charges_pC.values()]
    write(-0.15)
    with pytest.raises(SceneError, match=r"load\.profile"):
        solve(again)


def test_a_lopsided_profile_is_not_mirrored():
    """The whole film is solved, and the mirror image of the place shares no solve."""
    write(0.0, 0.15)
    scene = SCENE.with_(**{"probe.x_mm": 3.0})
    mirrored = SCENE.with_(**{"probe.x_mm": -3.0, "probe.rotation_deg": 180.0})
    assert len(plan([scene, mirrored]).blocks) == 2
    by_scene = solve_all([scene, mirrored], processes=1)
    for each, record in zip((scene, mirrored), by_scene, strict=True):
        found = [*record.charges_pC(8.0, 8.0).values()]
        assert found == pytest.approx(fresh(each), rel=1e-9)
        assert abs(found[1] - found[3]) > 0.02 * found[1]
