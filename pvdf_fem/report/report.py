"""A report: a script, and the page made from the script."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pvdf_fem.batch.batch import plan_scenes, solve_planned
from pvdf_fem.batch.store import Record, Store
from pvdf_fem.batch.workers import WorkerDied
from pvdf_fem.files import make_directory, replace_file
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.report.kind import Inputs, Kind
from pvdf_fem.report.page import VERDICT, Entry, make_verdict, render_page, update_other_reports
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.script import ReportPlan, Requirements, load_script
from pvdf_fem.report.task import Rows, compute_key, run_tasks
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import render_figure, use_style

PAGE = "index.html"
STORE = "solved.db"


@dataclass(frozen=True)
class MadeReport:
    """What a report has become."""

    page: Path
    scenes: int  #: Distinct scenes of the report.
    solved: int  #: Scenes that were not in the store.
    tasks: int  #: Distinct tasks of the report.
    ran: int  #: Tasks whose rows were not kept.
    failures: tuple[str, ...]  #: Figures and tables that lack charges or rows, with the reasons.

    @property
    def complete(self) -> bool:
        """Whether every figure and table has all its charges and rows."""
        return not self.failures


@dataclass(frozen=True)
class Report:
    """A report script that has no mistakes.

    Examples
    --------
    >>> made = Report.load("report.toml").make("report", quick=True)
    >>> print(made)
    """

    plan: ReportPlan

    @classmethod
    def load(cls, path: Path | str, kinds: Mapping[str, type[Kind]] | None = None) -> Self:
        """The report of a script. `kinds` are further kinds of figures and tables, by name. Raises
        `SceneError` with every mistake in the script, its scene and its data."""
        return cls(load_script(coerce("path", path, Path), kinds or {}))

    def make(
        self,
        out: Path | str,
        *,
        quick: bool = False,
        full: bool = False,
        processes: int = -1,
        progress: Progress | bool | None = None,
    ) -> MadeReport:
        """Solve the scenes, run the tasks and write ``index.html`` in a directory, anew with each
        figure. ``verdict.txt`` beside the page has the verdict.

        What is computed is kept there in ``solved.db``: a report that was stopped goes on. `quick`
        makes a preview, of few scenes to a coarse tolerance; `full` takes the keys in the figures'
        `full`. `processes` is their number, -1 for all cores; with 1 all is computed in turn, for
        timings. `progress` is called with the numbers of scenes and tasks done and in total, or
        says whether these numbers are shown (`pvdf_fem.progress.show_progress`).
        """
        out = Path(out)
        make_directory(out, PAGE, *self.plan.files)
        inputs, needed = self.plan.needs(quick, full)
        work = _Work(out, self.plan, inputs, needed)
        work.begin()
        scenes = list(dict.fromkeys(scene for need in needed for scene in need.scenes))
        tasks = {compute_key(task): task for need in needed for task in need.tasks}
        with Store(out / STORE) as store, show_progress("scenes and tasks", progress) as show:
            stored = {name: rows for name in tasks if (rows := store.kept(name)) is not None}
            missing = {name: task for name, task in tasks.items() if name not in stored}
            todo = plan_scenes(scenes, store)
            total = todo.missing + len(missing)
            for name, rows in stored.items():
                work.add(name, rows)
            how: Any = {"processes": processes, "progress": lambda n, _: show(n, total)}
            for index, record in solve_planned(todo, store, **how):
                work.add(scenes[index], record)
            for count, (name, found) in enumerate(run_tasks(missing, store, processes), start=1):
                work.add(name, found)
                show(todo.missing + count, total)
        failures = tuple(work.failures)
        return MadeReport(out / PAGE, len(scenes), todo.missing, len(tasks), len(missing), failures)

    def refresh(self, out: Path | str) -> None:
        """Write the lines about other reports anew on the page in a directory, if there is one."""
        page = Path(out) / PAGE
        with suppress(FileNotFoundError):
            write(page, update_other_reports(page.read_text("utf-8"), self.plan, Path(out)))


@dataclass
class _Part:
    """A figure or table on the way."""

    need: Requirements
    missing: set[Scene | str]  #: Scenes, and keys of tasks.
    entry: Entry


class _Work:
    """A report in progress: computed results, and the page's content."""

    def __init__(
        self, out: Path, plan: ReportPlan, inputs: Inputs, needed: Sequence[Requirements]
    ) -> None:
        self.out, self.plan, self.inputs = out, plan, inputs
        self.found: dict[Scene | str, Record | Rows | WorkerDied] = {}
        self.failures: list[str] = []
        self.parts = {
            need.item.name: _Part(
                need, {*need.scenes, *map(compute_key, need.tasks)}, Entry(need.item)
            )
            for need in needed
        }
        self.total = len(set[Scene | str]().union(*(of.missing for of in self.parts.values())))

    def begin(self) -> None:
        """Write the page without figures, then with figures that need no computation."""
        for folder in ("data", "figures", "scenes"):
            (self.out / folder).mkdir(exist_ok=True)
        write(self.out / "scenes" / "scene.toml", self.plan.scene.to_toml())
        for name, part in self.parts.items():
            changed = self.inputs.scene_of(part.need.item.kind.set)
            if changed != self.plan.scene:
                write(self.out / "scenes" / f"{name}.toml", changed.to_toml())
        self._show()
        for part in self.parts.values():
            if not part.missing:
                self._compose(part)

    def add(self, wanted: Scene | str, found: Record | Rows | WorkerDied) -> None:
        """Take a scene's record, or a task's rows by key, and compose items that waited only for
        them."""
        self.found[wanted] = found
        for part in self.parts.values():
            if wanted in part.missing:
                part.missing.remove(wanted)
                if not part.missing:
                    self._compose(part)

    def _compose(self, part: _Part) -> None:
        item, solved = part.need.item, ReportResults(self.found)
        remarks = solved.failures(part.need.scenes, part.need.tasks)
        warnings = solved.warnings(part.need.scenes)
        try:
            with use_style():
                content = item.kind.compose(self.inputs, solved)
                svg = render_figure(content.figure, ".svg").decode() if content.figure else ""
            part.entry = Entry(item, content, svg, remarks=(*remarks, *warnings))
            table = content.frame.to_csv(index=False, lineterminator="\n")
            write(self.out / "data" / f"{item.name}.csv", table)
            if svg:
                write(self.out / "figures" / f"{item.name}.svg", svg)
        except NothingToShowError as error:
            others = [remark for remark in remarks if remark != str(error)]
            part.entry = Entry(item, error=str(error), remarks=(*others, *warnings))
            remarks = [str(error), *others]
        except Exception as error:  # of one figure must not take the others with it
            traceback.print_exc(file=sys.stderr)
            part.entry = Entry(item, error=f"{type(error).__name__}: {error}")
            remarks = [part.entry.error]
        self.failures += [f"{item.where} ({item.name}): {remark}" for remark in remarks]
        self._show()

    def _show(self) -> None:
        """Write the page and the verdict with the results so far."""
        entries = [self.parts[item.name].entry for item in self.plan.items]
        state = {"done": len(self.found), "total": self.total, "is_preview": self.inputs.quick}
        write(self.out / PAGE, render_page(self.plan, entries, self.out, **state))
        preview = "Preview: " * self.inputs.quick
        write(self.out / VERDICT, f"{preview}{text}\n" if (text := make_verdict(entries)) else "")


def write(path: Path, text: str) -> None:
    """Write a text, unless the file has it already."""
    with suppress(FileNotFoundError):
        if path.read_text("utf-8") == text:
            return
    with replace_file(path) as unfinished:
        unfinished.write_text(text, "utf-8")
