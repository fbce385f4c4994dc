"""Results survive: equal after a reload, refused when the file is not ours, solved once."""

import random
import sqlite3
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, suppress
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Barrier

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem import Scene
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.batch.store import Record, Store, StoreError
from tests.helpers.damage import decayed, drawn

SCENE = Scene().with_(**{"probe.shape": "circle", "numerics.tolerance": 0.05})


def record(status: str = "converged") -> Record:
    return Record(status, "", ("A",), {"material": [[1.0, 2.0]]}, {}, 0.5, ("w",), 0.1)


@pytest.mark.parametrize("name", ["s.db", ":memory:", "file:s.db?mode=memory"])
def test_a_record_comes_back_as_it_was(name, tmp_path, monkeypatch):
    """Of the scene alone, whatever key another scene differs in; SQLite takes some names for a
    database in memory, which would be lost."""
    monkeypatch.chdir(tmp_path)
    others = [{"film.thickness_um": 26.0}, {"numerics.tolerance": 0.04}, {"probe.x_mm": 1e-9}]
    with Store(Path(name)) as store:
        store.put([(SCENE, record())])
    with Store(Path(name)) as store:
        assert store.get(SCENE) == record()
        assert [store.get(SCENE.with_(**change)) for change in others] == [None] * 3
    with pytest.raises(StoreError):  # the file is closed
        store.get(SCENE)


def test_every_module_that_solves_changes_the_hash():
    """But for those that no charge depends on."""
    script = (
        "import sys, pvdf_fem.batch.records\n"
        "from pvdf_fem.batch.keys import list_modules\n"
        "modules = {n: m.__file__ for n, m in sys.modules.items() if n.startswith('pvdf_fem')}\n"
        "hashed = set(map(str, list_modules()))\n"
        "print(*sorted(name for name, path in modules.items() if path not in hashed))\n"
    )
    command, root = [sys.executable, "-c", script], Path(__file__).parents[2]
    names = subprocess.run(command, cwd=root, stdout=subprocess.PIPE, text=True).stdout.split()
    without = ["", ".files", ".summary"]
    assert names == [f"pvdf_fem{name}" for name in without]


SCENES = [SCENE.with_(**{"load.force_N": 0.01 * i}) for i in range(40)]


@cache
def stored() -> bytes:
    """The file of a store with records of `SCENES`."""
    with TemporaryDirectory() as folder:
        with Store(Path(folder) / "s.db") as store:
            store.put((scene, record()) for scene in SCENES)
        return (Path(folder) / "s.db").read_bytes()


def changed(path: Path, query: str) -> None:
    """Change a database by hand."""
    with closing(sqlite3.connect(path)) as rows, rows:
        rows.execute(query)


def test_a_row_in_the_place_of_another_is_no_record(tmp_path):
    (tmp_path / "s.db").write_bytes(stored())
    changed(tmp_path / "s.db", "UPDATE records SET record = (SELECT max(record) FROM records)")
    with Store(tmp_path / "s.db") as store:
        assert sum(scene in store for scene in SCENES) == 1


def test_a_file_that_is_no_whole_store_is_refused_and_left_alone(tmp_path):
    changed(tmp_path / "other.db", "CREATE TABLE records (key TEXT)")
    whole = stored()
    (tmp_path / "page.db").write_bytes(whole[:8192] + b"\x55" * 4096 + whole[12288:])
    (tmp_path / "text.db").write_bytes(b"not a database" * 100)
    paths = sorted(tmp_path.glob("*.db"))
    assert [path.name for path in paths] == ["other.db", "page.db", "text.db"]
    for path in paths:
        before = path.read_bytes()
        with pytest.raises(StoreError):
            Store(path)
        assert path.read_bytes() == before


@given(seed=st.integers(0, 2**32 - 1))
@drawn(0.5)
def test_a_damaged_store_is_refused_or_keeps_no_other_record(seed):
    with TemporaryDirectory() as folder:
        (path := Path(folder) / "s.db").write_bytes(decayed(random.Random(seed), stored()))
        with suppress(StoreError), Store(path) as store:
            assert all(store.get(scene) in (None, record()) for scene in SCENES)
            store.put([(SCENES[0], record("unstable"))])
            assert store.get(SCENES[0]) == record("unstable")


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
        how = {"processes": 1, "progress": lambda *n: calls.append(n)}
        first = solve_scenes(scenes, store, **how)
        assert first[0] == first[2] != first[1]
        assert solve_scenes(scenes, store, **how) == first
        assert calls == [(0, 2), (1, 2), (2, 2), (0, 0)]


def test_a_store_that_cannot_be_written_is_read(tmp_path, monkeypatch):
    with Store(tmp_path / "s.db") as store:
        store.put([(SCENE, record())])
    connect = partial(sqlite3.connect, uri=True)
    monkeypatch.setattr(sqlite3, "connect", lambda at, **how: connect(f"file:{at}?mode=ro", **how))
    monkeypatch.setattr("pvdf_fem.batch.batch.make_records", None)  # no solve is lost
    with Store(tmp_path / "s.db") as store:
        assert solve_scenes([SCENE], store, processes=1) == [record()]
        with pytest.raises(StoreError):
            solve_scenes(SCENES, store, processes=1)
        with pytest.raises(StoreError):
            store.put([(SCENE, record())])


def test_programs_may_make_a_store_at_the_same_moment(tmp_path):
    """One found tables without the number of a store, another the file locked; both gave up."""
    together = Barrier(6)

    def opened(path):
        together.wait()
        Store(path).close()

    with ThreadPoolExecutor(6) as programs:
        for number in range(20):
            list(programs.map(opened, [tmp_path / f"{number}.db"] * 6))
