"""A report: a script, and the page that is made of it."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Self

from pvdf_fem.files import make_directory, replacing
from pvdf_fem.output.figures import content_of, style
from pvdf_fem.reporting.kind import Content, Inputs, Kind, NothingToShow
from pvdf_fem.reporting.page import Entry, page_of
from pvdf_fem.reporting.script import Item, Plan, load
from pvdf_fem.reporting.solved import Solved
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.store import Record, Store
from pvdf_fem.sweeps.sweep import Progress, planned, records, silent

PAGE = "index.html"
STORE = "solved.db"


@dataclass(frozen=True)
class Made:
    """What a report has become."""

    page: Path
    scenes: int  #: Distinct scenes of the report.
    solved: int  #: Scenes that were not in the store.
    failures: tuple[str, ...]  #: Figures and tables that lack charges, with the reasons.

    @property
    def complete(self) -> bool:
        """Whether every figure and table has all its charges."""
        return not self.failures


@dataclass(frozen=True)
class Report:
    """A report script that has no mistakes."""

    plan: Plan

    @classmethod
    def load(cls, path: Path | str, kinds: Mapping[str, type[Kind]] | None = None) -> Self:
        """The report of a script. `kinds` are further kinds of figures and tables, by name. Raises
        `SceneError` with all mistakes of the script, its scene and its data."""
        return cls(load(Path(path), kinds or {}))

    def make(
        self,
        out: Path | str,
        *,
        quick: bool = False,
        processes: int = -1,
        progress: Progress = silent,
    ) -> Made:
        """Solve the scenes and write ``index.html`` in a directory, anew with each figure.

        What is solved is kept there in ``solved.db``: a report that was stopped goes on. `quick`
        makes a preview, of few scenes to a coarse tolerance; `processes` is their number, -1 for
        all cores. `progress` is called with two numbers of scenes: how many are solved, and how
        many had to be.
        """
        out = Path(out)
        make_directory(out, PAGE, *self.plan.files)
        inputs, needed = self.plan.needs(quick)
        work = _Work(out, self.plan, inputs, needed)
        work.begin()
        scenes = list(dict.fromkeys(scene for _, scenes in needed for scene in scenes))
        with Store(out / STORE) as store:
            todo = planned(scenes, store)
            for index, record in records(todo, store, processes=processes, progress=progress):
                work.add(scenes[index], record)
        return Made(out / PAGE, len(scenes), todo.missing, tuple(work.failures))


@dataclass
class _Work:
    """A report on the way: what is solved, and what is on the page."""

    out: Path
    plan: Plan
    inputs: Inputs
    needed: Sequence[tuple[Item, list[Scene]]]
    known: dict[Scene, Record] = field(default_factory=dict)
    entries: dict[str, Entry] = field(default_factory=dict)
    failures: list[str] = field(default_factory=list)

    def begin(self) -> None:
        """Write the page without any figure, then with those that need no solve."""
        for folder in ("data", "figures", "scenes"):
            (self.out / folder).mkdir(exist_ok=True)
        self._write(self.out / "scenes" / "scene.toml", self.plan.scene.to_toml())
        self.missing: dict[str, set[Scene]] = {}
        self.waiting: dict[Scene, list[tuple[Item, list[Scene]]]] = {}
        for item, scenes in self.needed:
            changed = self.inputs.scene_of(item.kind.set)
            if changed != self.plan.scene:
                self._write(self.out / "scenes" / f"{item.name}.toml", changed.to_toml())
            self.entries[item.name] = Entry(item)
            self.missing[item.name] = set(scenes)
            for scene in self.missing[item.name]:
                self.waiting.setdefault(scene, []).append((item, scenes))
        self._show()
        for item, scenes in self.needed:
            if not scenes:
                self._compose(item, scenes)

    def add(self, scene: Scene, record: Record) -> None:
        """Take the record of a scene, and compose what waited for it alone."""
        self.known[scene] = record
        for item, scenes in self.waiting[scene]:
            self.missing[item.name].discard(scene)
            if not self.missing[item.name]:
                self._compose(item, scenes)

    def _compose(self, item: Item, scenes: list[Scene]) -> None:
        solved = Solved(self.known)
        remarks = [f"{n} without charges: {why}" for why, n in solved.failures(scenes).items()]
        entry = self.entries[item.name]
        try:
            with style():
                content = item.kind.compose(self.inputs, solved)
            entry = self._drawn(item, content, remarks)
        except NothingToShow as error:
            entry = replace(entry, error=str(error), remarks=tuple(remarks))
            remarks = [str(error), *remarks]
        except Exception as error:  # of one figure must not take the others with it
            traceback.print_exc(file=sys.stderr)
            entry = replace(entry, error=f"{type(error).__name__}: {error}")
            remarks = [entry.error]
        self.entries[item.name] = entry
        self.failures += [f"{item.where} ({item.name}): {remark}" for remark in remarks]
        self._show()

    def _drawn(self, item: Item, content: Content, remarks: Sequence[str]) -> Entry:
        """Write a figure and its CSV file."""
        table = content.frame.to_csv(index=False, lineterminator="\n")
        self._write(self.out / "data" / f"{item.name}.csv", table)
        svg = ""
        if content.figure is not None:
            svg = content_of(content.figure, ".svg").decode()
            self._write(self.out / "figures" / f"{item.name}.svg", svg)
        return Entry(item, content, svg, remarks=tuple(remarks))

    def _show(self) -> None:
        """Write the page as far as it is."""
        entries = [self.entries[item.name] for item in self.plan.items]
        total = len(self.waiting)
        page = page_of(self.plan, entries, len(self.known), total, self.inputs.quick)
        self._write(self.out / PAGE, page)

    def _write(self, path: Path, text: str) -> None:
        with suppress(FileNotFoundError):
            if path.read_text("utf-8") == text:
                return
        with replacing(path) as unfinished:
            unfinished.write_text(text, "utf-8")
