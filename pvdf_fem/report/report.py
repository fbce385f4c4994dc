"""Reports: reading a script, computing its scenes and tasks, and writing its page."""

from __future__ import annotations

import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Self

from pvdf_fem.batch.batch import plan_scenes, solve_planned
from pvdf_fem.batch.store import Record, Store
from pvdf_fem.batch.workers import WorkerDied
from pvdf_fem.files import make_directory, replace_file
from pvdf_fem.progress import Progress, show_progress
from pvdf_fem.report.kind import Content, Inputs, Kind
from pvdf_fem.report.page import VERDICT, Entry, make_verdict, render_page, update_other_reports
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.script import ReportPlan, Requirements, load_script
from pvdf_fem.report.task import Rows, Task, compute_key, run_tasks
from pvdf_fem.scene.arguments import coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.view.figures import render_figure, use_style

PAGE = "index.html"
STORE = "solved.db"  #: File with the saved results of solves and tasks.


@dataclass(frozen=True)
class MadeReport:
    """The outcome of making a report.

    Parameters
    ----------
    page : Path
        The HTML file.
    scenes : int
        Number of distinct scenes of the report.
    solved : int
        Number of scenes that had to be solved; the others were already in the store.
    tasks : int
        Number of distinct tasks of the report.
    ran : int
        Number of tasks that had to run; the rows of the others were already in the store.
    failures : tuple of str
        A line for each reason why a figure or table lacks charges or rows.
    """

    page: Path
    scenes: int
    solved: int
    tasks: int
    ran: int
    failures: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether every figure and table has all its charges and rows."""
        return not self.failures


@dataclass(frozen=True)
class Report:
    """A validated report script, from which reports are made.

    Parameters
    ----------
    plan : ReportPlan
        Scene, data, and figures and tables of the script.

    Examples
    --------
    >>> made = Report.load("report.toml").make("report", quick=True)
    >>> print(made)
    """

    plan: ReportPlan

    @classmethod
    def load(cls, path: Path | str, kinds: Mapping[str, type[Kind]] | None = None) -> Self:
        """Read and validate a report script.

        Parameters
        ----------
        path : path
            A TOML file.
        kinds : mapping of str to type[Kind], optional
            Additional kinds of figures by name, as `load_kinds` returns them.

        Raises
        ------
        SceneError
            If the script, its scene or its data are invalid. The exception lists the errors.
        """
        return cls(load_script(coerce("path", path, Path), kinds or {}))

    def make(
        self,
        out: Path | str,
        *,
        quick: bool = False,
        full: bool = False,
        processes: int | None = None,
        progress: Progress | bool | None = None,
    ) -> MadeReport:
        """Solve the scenes, run the tasks and write the page ``index.html``.

        The page is updated whenever a figure is finished. Results are saved beside it in
        ``solved.db``, so that an interrupted report can be continued.

        Parameters
        ----------
        out : path
            Folder for the page, for ``verdict.txt`` with the verdict, and for the folders
            ``data``, ``figures`` and ``scenes``. It is created if necessary.
        quick : bool
            Whether to make a preview, with few scenes and a coarse tolerance.
        full : bool
            Whether to use the values of `full` in each figure and table.
        processes : int, optional
            Number of processes. Default: one per core. With 1, scenes and tasks are computed one
            after the other, which is suitable for timings.
        progress : callable or bool, optional
            A function that is called with the number of finished scenes and tasks and their total,
            or whether to show these numbers in the terminal.

        Returns
        -------
        MadeReport
        """
        out = Path(out)
        make_directory(out, PAGE, *self.plan.files)
        inputs, requirements = self.plan.collect_requirements(quick, full)
        work = _ReportBuilder(out, self.plan, inputs=inputs, requirements=requirements)
        work.write_first_page()
        scenes: dict[Scene, None] = {}
        tasks: dict[str, Task] = {}
        for needed in requirements:
            scenes |= dict.fromkeys(needed.scenes)
            tasks |= {compute_key(task): task for task in needed.tasks}
        scene_list = list(scenes)
        with Store(out / STORE) as store, show_progress("scenes and tasks", progress) as show:
            new_tasks = {}
            for key, task in tasks.items():
                rows = store.get_value(key)
                if rows is None:
                    new_tasks[key] = task
                else:
                    work.add_result(key, rows)
            plan = plan_scenes(scene_list, store)
            total = plan.missing + len(new_tasks)

            def show_scenes(done: float, _: float) -> None:
                show(done, total)

            for index, record in solve_planned(
                plan, store, processes=processes, progress=show_scenes
            ):
                work.add_result(scene_list[index], record)
            finished = run_tasks(new_tasks, store, processes)
            for count, (key, task_rows) in enumerate(finished, start=1):
                work.add_result(key, task_rows)
                show(plan.missing + count, total)
        return MadeReport(
            out / PAGE,
            scenes=len(scene_list),
            solved=plan.missing,
            tasks=len(tasks),
            ran=len(new_tasks),
            failures=tuple(work.failures),
        )

    def refresh(self, out: Path | str) -> None:
        """Update the lines about other reports on the page in `out`, if this page exists."""
        page = Path(out) / PAGE
        with suppress(FileNotFoundError):
            text = page.read_text("utf-8")
            write_if_changed(page, update_other_reports(text, self.plan, Path(out)))


@dataclass
class _PendingItem:
    """A figure or table whose results may still be incomplete.

    Parameters
    ----------
    needed : Requirements
        All scenes and tasks of the item.
    missing : set of Scene or str
        Scenes that are not yet solved, and keys of tasks that have not yet run.
    entry : Entry
        The item's current entry on the page.
    """

    needed: Requirements
    missing: set[Scene | str]
    entry: Entry


class _ReportBuilder:
    """A report in progress, with the results so far and the entries of the page."""

    def __init__(
        self, out: Path, plan: ReportPlan, inputs: Inputs, requirements: Sequence[Requirements]
    ) -> None:
        self.out = out
        self.plan = plan
        self.inputs = inputs
        self.results: dict[Scene | str, Record | Rows | WorkerDied] = {}
        self.failures: list[str] = []
        self.items: dict[str, _PendingItem] = {}
        everything: set[Scene | str] = set()
        for needed in requirements:
            missing: set[Scene | str] = {*needed.scenes, *map(compute_key, needed.tasks)}
            everything |= missing
            self.items[needed.item.name] = _PendingItem(needed, missing, Entry(needed.item))
        self.total = len(everything)

    def write_first_page(self) -> None:
        """Write the scene files and the page, and compose figures that need no computation."""
        for folder in ("data", "figures", "scenes"):
            (self.out / folder).mkdir(exist_ok=True)
        write_if_changed(self.out / "scenes" / "scene.toml", self.plan.scene.to_toml())
        for name, pending in self.items.items():
            scene = self.inputs.change_scene(pending.needed.item.kind.set)
            if scene != self.plan.scene:
                write_if_changed(self.out / "scenes" / f"{name}.toml", scene.to_toml())
        self._write_page()
        for pending in self.items.values():
            if not pending.missing:
                self._compose_item(pending)

    def add_result(self, key: Scene | str, result: Record | Rows | WorkerDied) -> None:
        """Add a result, and compose the items whose results are now complete.

        Parameters
        ----------
        key : Scene or str
            A solved scene, or the key of a task.
        result : Record, list of dict or WorkerDied
            The record of the scene, or the rows or failure of the task.
        """
        self.results[key] = result
        for pending in self.items.values():
            if key in pending.missing:
                pending.missing.remove(key)
                if not pending.missing:
                    self._compose_item(pending)

    def _compose_item(self, pending: _PendingItem) -> None:
        """Compose an item, write its files and the page, and record its failures."""
        item, scenes, tasks = pending.needed
        results = ReportResults(self.results)
        failures = results.describe_failures(scenes, tasks)
        warnings = results.describe_warnings(scenes)
        try:
            with use_style():
                content = item.kind.compose(self.inputs, results)
                svg = ""
                if content.figure is not None:
                    svg = render_figure(content.figure, ".svg").decode()
            pending.entry = Entry(item, content, svg=svg, remarks=(*failures, *warnings))
            self._write_files(pending.entry, content)
        except NothingToShowError as error:
            others = [failure for failure in failures if failure != str(error)]
            pending.entry = Entry(item, error=str(error), remarks=(*others, *warnings))
            failures = [str(error), *others]
        except Exception as error:  # one figure must not stop the others
            traceback.print_exc(file=sys.stderr)
            pending.entry = Entry(item, error=f"{type(error).__name__}: {error}")
            failures = [pending.entry.error]
        self.failures += [f"{item.where} ({item.name}): {failure}" for failure in failures]
        self._write_page()

    def _write_files(self, entry: Entry, content: Content) -> None:
        """Write the data of an item as CSV, and its figure as SVG."""
        name = entry.item.name
        csv = content.frame.to_csv(index=False, lineterminator="\n")
        write_if_changed(self.out / "data" / f"{name}.csv", csv)
        if entry.svg:
            write_if_changed(self.out / "figures" / f"{name}.svg", entry.svg)

    def _write_page(self) -> None:
        """Write the page and the verdict from the results so far."""
        entries = [self.items[item.name].entry for item in self.plan.items]
        page = render_page(
            self.plan,
            entries,
            self.out,
            done=len(self.results),
            total=self.total,
            is_preview=self.inputs.quick,
        )
        write_if_changed(self.out / PAGE, page)
        verdict = make_verdict(entries)
        if verdict:
            preview = "Preview: " if self.inputs.quick else ""
            verdict = f"{preview}{verdict}\n"
        write_if_changed(self.out / VERDICT, verdict)


def write_if_changed(path: Path, text: str) -> None:
    """Write a text to a file, unless the file already has this content."""
    with suppress(FileNotFoundError):
        if path.read_text("utf-8") == text:
            return
    with replace_file(path) as unfinished:
        unfinished.write_text(text, "utf-8")
