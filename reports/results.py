"""The records that a report rests on, solved once and kept between runs.

Scenes that are mirror images or quarter turns of each other are solved once
(`pvdf_fem.sensing.symmetry`); what is solved stays in a store, so that an interrupted report goes
on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from pvdf_fem import Scene
from pvdf_fem.sensing.carried import CarriedField, carried_field
from pvdf_fem.sensing.symmetry import Image, representative
from pvdf_fem.store import Record, Store
from pvdf_fem.sweep import solve_all

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
        self._images: dict[Scene, Image] = {}
        self._records: dict[Scene, Record] = {}

    def __getitem__(self, scene: Scene) -> Record:
        """The record of a scene that was solved."""
        image = self._image(scene)
        return image.record(self._records[image.scene])

    def solve(
        self,
        scenes: Iterable[Scene],
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> None:
        """Solve those of the scenes that are neither here nor in the store."""
        wanted = [one for one in self._distinct(scenes) if one not in self._records]
        with self._store() as store:
            found = solve_all(wanted, store, processes=self.processes, progress=progress)
        self._records.update(zip(wanted, found, strict=True))

    def missing(self, scenes: Iterable[Scene]) -> int:
        """How many solves these scenes still need."""
        with self._store() as store:
            return sum(store.get(scene) is None for scene in self._distinct(scenes))

    def of(self, scenes: Iterable[Scene]) -> Results:
        """The records of some solved scenes only, for another process."""
        some = Results(self.folder, 1)
        some._images = {scene: self._image(scene) for scene in scenes}
        some._records = {i.scene: self._records[i.scene] for i in some._images.values()}
        return some

    def field(self, scene: Scene) -> CarriedField:
        """The stress about the probe of a scene, from `pvdf_fem.sensing.carried`."""
        return carried_field(scene, self.folder)

    @property
    def records(self) -> list[Record]:
        """All that were needed so far."""
        return list(self._records.values())

    def _store(self) -> Store:
        return Store(self.folder / "results.db")

    def _distinct(self, scenes: Iterable[Scene]) -> list[Scene]:
        return list(dict.fromkeys(self._image(scene).scene for scene in scenes))

    def _image(self, scene: Scene) -> Image:
        if scene not in self._images:
            self._images[scene] = representative(scene)
        return self._images[scene]
