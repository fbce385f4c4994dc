"""The records that a report rests on. They are solved once and stay in a store between runs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pvdf_fem import Scene
from pvdf_fem.sweeps.store import Record, Store
from pvdf_fem.sweeps.sweep import Progress, planned, silent, solve_all

#: The observable whose change a charge amplifier sees since it was zeroed: the stress over the
#: electrode's material area.
MATERIAL = "material"


class Results:
    """Records by scene.

    Parameters
    ----------
    folder : Path
        Where records and fields are stored; made if it does not exist.
    processes : int
        Number of processes that solve.
    """

    def __init__(self, folder: Path, processes: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self.processes = folder, processes
        self._records: dict[Scene, Record] = {}

    def __getitem__(self, scene: Scene) -> Record:
        """The record of a scene that was solved."""
        return self._records[scene]

    def solve(self, scenes: Iterable[Scene], progress: Progress = silent) -> None:
        """Solve the scenes that are neither here nor in the store."""
        missing = [scene for scene in dict.fromkeys(scenes) if scene not in self._records]
        with self._store() as store:
            records = solve_all(missing, store, processes=self.processes, progress=progress)
        self._records.update(zip(missing, records, strict=True))

    def missing(self, scenes: Iterable[Scene]) -> int:
        """The number of solves that these scenes still need."""
        with self._store() as store:
            return len(planned(list(scenes), store).blocks)

    @property
    def records(self) -> list[Record]:
        """All records that were needed so far."""
        return list(self._records.values())

    def _store(self) -> Store:
        return Store(self.folder / "results.db")
