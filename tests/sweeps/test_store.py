"""Results survive: equal after a reload, refused when the file is not ours, solved once."""

import sqlite3
import subprocess
import sys
from pathlib import Path

import pytest

from pvdf_fem import Scene
from pvdf_fem.sweeps.store import Record, Store, StoreError, key
from pvdf_fem.sweeps.sweep import solve_all

SCENE = Scene().with_(**{"probe.shape": "circle", "numerics.tolerance": 0.05})


def record(status: str = "converged") -> Record:
    return Record(status, "", ("A",), {"material": [[1.0, 2.0]]}, {}, 0.5, 10, 3, ("w",), 0.1)


def test_a_record_comes_back_as_it_was(tmp_path):
    with Store(tmp_path / "s.db") as store:
        store.put([(SCENE, record())])
    with Store(tmp_path / "s.db") as store:
        assert store.get(SCENE) == record()
        assert store.get(SCENE.with_(**{"load.force_N": 1.5})) is None


def test_charges_of_a_record_weigh_both_forces():
    assert record().charges_pC(8.0, 3.0) == {"A": 14.0}


def test_every_scene_key_changes_the_hash():
    others = [{"film.thickness_um": 26.0}, {"numerics.tolerance": 0.04}, {"probe.x_mm": 1e-9}]
    assert len({key(SCENE), *(key(SCENE.with_(**change)) for change in others)}) == 4


def test_every_module_that_solves_changes_the_hash():
    """But for the two that no number depends on."""
    script = (
        "import sys, pvdf_fem.sweeps.records\n"
        "from pvdf_fem.sweeps.store import modules_in\n"
        "modules = {n: m.__file__ for n, m in sys.modules.items() if n.startswith('pvdf_fem')}\n"
        "hashed = set(map(str, modules_in()))\n"
        "print(*sorted(name for name, path in modules.items() if path not in hashed))\n"
    )
    command = [sys.executable, "-c", script]
    root = Path(__file__).parents[2]
    result = subprocess.run(command, cwd=root, capture_output=True, text=True, timeout=120)
    assert (result.stderr, result.stdout.split()) == ("", ["pvdf_fem", "pvdf_fem.files"])


def test_another_program_s_database_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "other.db"
    with sqlite3.connect(path) as rows:
        rows.execute("CREATE TABLE records (key TEXT)")
    rows.close()
    before = path.read_bytes()
    with pytest.raises(StoreError, match="not a store"):
        Store(path)
    assert path.read_bytes() == before


def test_a_damaged_file_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "damaged.db"
    path.write_bytes(b"not a database" * 100)
    with pytest.raises(StoreError, match="not a database"):
        Store(path)
    assert path.read_bytes() == b"not a database" * 100


def test_a_store_with_a_damaged_page_is_refused_and_left_alone(tmp_path):
    path = tmp_path / "s.db"
    with Store(path) as store:
        forces = [0.01 * i for i in range(100)]
        store.put((SCENE.with_(**{"load.force_N": force}), record()) for force in forces)
    whole = path.read_bytes()
    damaged = whole[:8192] + b"\x55" * 4096 + whole[12288:]
    path.write_bytes(damaged)
    with pytest.raises(StoreError, match="damaged"):
        Store(path)
    assert path.read_bytes() == damaged


def test_records_that_come_together_are_kept_all_or_none(tmp_path):
    def broken():
        yield SCENE, record()
        raise RuntimeError

    with Store(tmp_path / "s.db") as store:
        with pytest.raises(RuntimeError):
            store.put(broken())
        assert SCENE not in store
        store.put([(SCENE, record()), (SCENE, record("unstable"))])
        assert store.get(SCENE) == record("unstable")


def test_equal_scenes_are_solved_once_and_stored_ones_not_at_all(tmp_path):
    calls: list[tuple[int, int]] = []
    scenes = [SCENE, SCENE.with_(**{"load.force_N": 2.0}), SCENE]
    with Store(tmp_path / "s.db") as store:
        first = solve_all(scenes, store, processes=1, progress=lambda *n: calls.append(n))
        assert calls == [(0, 2), (1, 2), (2, 2)]
        assert first[0] == first[2] != first[1]
        calls.clear()
        assert solve_all(scenes, store, processes=1, progress=lambda *n: calls.append(n)) == first
        assert calls == [(0, 0)]


def test_a_failed_scene_is_a_record_and_the_rest_goes_on():
    slack = SCENE.with_(**{"film.temperature_change_K": 10.0, "load.force_N": 0.0})
    failed, solved = solve_all([slack, SCENE], processes=1)
    assert (failed.status, failed.forces) == ("unstable", {})
    assert solved.converged
