"""The records that a report rests on, solved once and kept between runs.

What is solved stays in a store, so that an interrupted report goes on where it was.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pvdf_fem import Scene
from pvdf_fem.maps.carried import CarriedField, carried_field
from pvdf_fem.sweeps.store import Record, Store
from pvdf_fem.sweeps.sweep import Progress, planned, silent, solve_all

#: The charges that the thesis's post-processor computes, and those of the electrode's material.
THESIS_EDGE = "thesis-edge"
MATERIAL = "material"


class Results:
    """Records by scene.

    Parameters
    ----------
    folder : Path
        Where records and fields are kept; made if it does not exist.
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
        """Solve those of the scenes that are neither here nor in the store."""
        wanted = [one for one in dict.fromkeys(scenes) if one not in self._records]
        with self._store() as store:
            found = solve_all(wanted, store, processes=self.processes, progress=progress)
        self._records.update(zip(wanted, found, strict=True))

    def missing(self, scenes: Iterable[Scene]) -> int:
        """How many solves these scenes still need."""
        with self._store() as store:
            return len(planned(list(scenes), store).blocks)

    def of(self, scenes: Iterable[Scene]) -> Results:
        """The records of some solved scenes only, for another process."""
        some = Results(self.folder, 1)
        some._records = {scene: self._records[scene] for scene in scenes}
        return some

    def field(self, scene: Scene) -> CarriedField:
        """The stress about the probe of a scene, from `pvdf_fem.maps.carried`."""
        return carried_field(scene, self.folder)

    @property
    def records(self) -> list[Record]:
        """All that were needed so far."""
        return list(self._records.values())

    def _store(self) -> Store:
        return Store(self.folder / "results.db")
