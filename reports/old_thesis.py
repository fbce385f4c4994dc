"""The thesis report: the sensor computed again, beside the numbers of A. Mirbagheri's thesis.

    python -m reports.thesis [--out DIR] [--only FIGURE | --section NAME] [--quick] [--quiet]
                             [--processes N]

The report is ``thesis.html`` with figures (SVG) and tables (CSV) beside it; a section of its own is
``NAME.html``. ``index.html`` leads to them and to all other reports whose directories are below.
Every scene is stored in ``results/`` there as soon as it is solved: a report that was interrupted
goes on, and a second run neither solves nor draws again what has not changed. The page is written
anew every few seconds.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from platform import python_version

from joblib import Parallel, delayed, parallel_config
from tqdm import tqdm

from pvdf_fem import Scene, __version__
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.files import FileError, make_directory, printable, require_writable
from reports.chapters import (
    contact,
    contours,
    drawings,
    experiments,
    findings,
    mapping,
    scenes,
    shear,
    spheres,
    summary,
    thickness,
    unexplained,
)
from reports.chapters.film_placement.chapter import FILM_PLACEMENT_CHAPTER
from reports.chapters.force_and_angle import (
    angle,
    force,
    force_law,
    orientation,
    recovery,
    surface,
)
from reports.chapters.positions import positions
from reports.chapters.transducer.chapter import TRANSDUCER_CHAPTER
from reports.common.chapter import Chapter
from reports.common.figures import preview
from reports.common.options import add_out, add_processes
from reports.common.page import Page, Section
from reports.common.results import Results
from reports.common.section_cache import cached_section
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import TOLERANCE
from reports.front.catalogue import DEFAULT, REPORTS
from reports.front.landing import LANDING, write_landing
from reports.front.sensor import SENSOR_CHAPTER

#: All chapters in the order of the page.
CHAPTERS: tuple[Chapter, ...] = (
    SENSOR_CHAPTER,
    summary.SUMMARY_CHAPTER,
    findings.FINDINGS_CHAPTER,
    drawings.DRAWINGS_CHAPTER,
    scenes.SCENES_CHAPTER,
    mapping.FIGURE_3_5_CHAPTER,
    mapping.FIGURE_3_7_CHAPTER,
    mapping.FIGURE_3_17_CHAPTER,
    mapping.FIGURE_3_18_CHAPTER,
    mapping.OTHER_MAPPINGS_CHAPTER,
    contours.FIGURE_3_9_CHAPTER,
    positions.TRIANGLE_POSITIONS_CHAPTER,
    positions.RECTANGLE_POSITIONS_CHAPTER,
    contours.FIGURE_3_16_CHAPTER,
    contours.TRIANGLE_MAP_CHAPTER,
    contours.RECTANGLE_MAP_CHAPTER,
    positions.UNIAXIAL_POSITIONS_CHAPTER,
    positions.TWO_NEWTON_POSITIONS_CHAPTER,
    force.TRIANGLE_FORCE_CHAPTER,
    thickness.THICKNESS_CHAPTER,
    force.RECTANGLE_FORCE_CHAPTER,
    force_law.FORCE_LAW_CHAPTER,
    orientation.ROTATION_CHAPTER,
    angle.ANGLE_CHAPTER,
    surface.SURFACE_CHAPTER,
    recovery.RECOVERY_CHAPTER,
    experiments.MEASURED_POSITIONS_CHAPTER,
    positions.EXPERIMENT_POSITIONS_CHAPTER,
    FILM_PLACEMENT_CHAPTER,
    contact.CONTACT_CHAPTER,
    shear.SHEAR_CHAPTER,
    spheres.SPHERES_CHAPTER,
    TRANSDUCER_CHAPTER,
    experiments.CHARGE_PARTS_CHAPTER,
    experiments.CIRCUIT_CHAPTER,
    summary.MESH_CHAPTER,
    unexplained.UNEXPLAINED_CHAPTER,
    summary.ALL_CHAPTER,
)
CHAPTERS += (summary.contents_chapter(CHAPTERS),)
PACKAGES = ("gmsh", "matplotlib", "numpy", "scikit-fem", "scipy")
INTRODUCTION = (
    "A. Mirbagheri, “Design, Modeling, Fabrication and Testing of a Membrane Piezoelectric "
    "Tactile Sensor with Four Sensing Elements”, computed again with pvdf_fem. Nothing is "
    "fitted: film, probes and forces are those of the thesis.",
    "Unless a column says otherwise, the pressure follows the deformed film and a charge "
    "is the thesis-edge observable: stresses averaged along the electrode's edges, as the "
    "thesis's post-processor does. Differences are ours minus the thesis's, in percent of "
    "the thesis's.",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns 0, or 1 if a chapter or a solve failed."""
    options = _options(arguments)
    return run_program("reports.thesis", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    file = f"{options.section or DEFAULT}.html"
    make_directory(options.out, file)
    require_writable(options.out / LANDING)
    thesis = Thesis.read().quick() if options.quick else Thesis.read()
    results = Results(options.out / "results", options.processes)
    chapters = _chosen(options.only, options.section)
    report = Report(thesis, results, options.out, chapters, file, is_preview=options.quick)
    with _progress(report.missing + len(report.chapters), options.quiet) as bar:
        report.solve(bar)
        report.make(bar)
    write_landing(options.out)
    if not options.quiet:
        print(f"{options.out / file}: {report.outcome}")
    return 0 if report.complete else 1


def _chosen(only: Sequence[str], section: str | None) -> tuple[Chapter, ...]:
    """The chapter `section`, or those that show a figure or table in `only`; all without both."""
    if section:
        return tuple(chapter for chapter in CHAPTERS if chapter.name == section)
    return tuple(
        chapter
        for chapter in CHAPTERS
        if not only or any({shown, shown.split()[-1]} & set(only) for shown in chapter.shows)
    )


class Report:
    """The sections that are made so far, the results that they share, and their page."""

    def __init__(
        self,
        thesis: Thesis,
        results: Results,
        out: Path,
        chapters: Sequence[Chapter],
        file: str,
        *,
        is_preview: bool,
    ) -> None:
        self.thesis, self.results, self.out, self.chapters = thesis, results, out, chapters
        self.file, self.is_preview = file, is_preview
        self.sections: dict[str, Section] = {}
        self.scenes = {chapter.name: chapter.scenes(thesis) for chapter in chapters}
        self._start = time.perf_counter()

    @property
    def missing(self) -> int:
        """Number of solves that no earlier run has left."""
        return self.results.missing(self._all_scenes)

    @property
    def _all_scenes(self) -> list[Scene]:
        return [scene for scenes in self.scenes.values() for scene in scenes]

    @property
    def complete(self) -> bool:
        """Whether all sections are there and every solve converged."""
        sections = [self.sections.get(chapter.name) for chapter in self.chapters]
        return all(section is not None and not section.state for section in sections)

    @property
    def outcome(self) -> str:
        """A line that says which sections are incomplete, and how long the report took."""
        incomplete = [section.title for section in self.sections.values() if section.state]
        seconds = f"{time.perf_counter() - self._start:.0f} s"
        if incomplete:
            return f"{seconds}; incomplete: {', '.join(incomplete)}"
        return f"complete in {seconds}"

    def solve(self, bar: tqdm[None]) -> None:
        """Solve what is missing; the store has each record as soon as it is solved."""
        bar.set_description("solving")
        self.results.solve(self._all_scenes, lambda solved, total: bar.update(1 if solved else 0))

    def make(self, bar: tqdm[None], page_every_s: float = 5.0) -> None:
        """Make all sections, and write the page at intervals of `page_every_s` and at the end."""
        bar.set_description("drawing")
        self._write_page()
        written = time.perf_counter()
        tasks = (
            delayed(_section)(
                chapter,
                self.scenes[chapter.name],
                self.thesis,
                records,
                self.out,
                is_preview=self.is_preview,
            )
            for chapter in sorted(
                self.chapters, key=lambda chapter: -len(self.scenes[chapter.name])
            )
            for records in [self.results.of(self.scenes[chapter.name])]
        )
        with parallel_config("loky", inner_max_num_threads=1):
            pool = Parallel(self.results.processes, return_as="generator_unordered", batch_size=1)
            sections = pool(tasks)
        for section in sections:
            self.sections[section.name] = section
            bar.update()
            if time.perf_counter() > written + page_every_s:
                self._write_page()
                written = time.perf_counter()
        self._write_page()

    def _write_page(self) -> None:
        sections = [
            self.sections.get(chapter.name)
            or Section(chapter.name, chapter.title, note="not computed yet")
            for chapter in self.chapters
        ]
        whole = REPORTS[DEFAULT]
        title = whole.title if self.file == whole.page else sections[0].title
        made = self._provenance()
        page = Page(title, INTRODUCTION, sections, made, self.is_preview, LANDING)
        page.write(self.out, self.file)

    def _provenance(self) -> dict[str, str]:
        records = self.results.records
        solving_s = sum(record.seconds for record in records)
        return {
            "pvdf_fem": __version__,
            **{package: version(package) for package in PACKAGES},
            "Python": python_version(),
            "Cores": f"{os.cpu_count()}, {self.results.processes} processes of one thread",
            "Tolerance": f"{TOLERANCE:g} (relative, each charge)",
            "Scenes": f"{len(records)}, {solving_s:.0f} s of computing, kept between runs",
            "Time": f"{time.perf_counter() - self._start:.0f} s",
        }


def _section(
    chapter: Chapter,
    scenes: Sequence[Scene],
    thesis: Thesis,
    results: Results,
    out: Path,
    *,
    is_preview: bool,
) -> Section:
    """The section of a chapter, with its files; an exception becomes the section's error."""

    def make() -> Section:
        with preview(is_preview):
            content = chapter.compose(thesis, results, out)
        section = Section(
            chapter.name,
            chapter.title,
            content.paragraphs,
            content.blocks,
            note=_failures(results, scenes),
        )
        section.write_tables(out)
        return section

    try:
        return cached_section(chapter.name, scenes, thesis, results, out, make)
    except Exception as error:
        if isinstance(error, FileError):
            print(printable(str(error)), file=sys.stderr)
        else:
            traceback.print_exc()
        return Section(chapter.name, chapter.title, error=f"{type(error).__name__}: {error}")


def _failures(results: Results, scenes: Sequence[Scene]) -> str:
    """Number and reasons of the scenes' failed solves; empty without any."""
    records = [results[scene] for scene in dict.fromkeys(scenes)]
    failed = [record for record in records if not record.converged]
    if not failed:
        return ""
    reasons = sorted({f"{record.status} ({record.reason})" for record in failed})
    return f"{len(failed)} of {len(records)} solves failed: {'; '.join(reasons)}"


@contextmanager
def _progress(total: int, quiet: bool) -> Iterator[tqdm[None]]:
    """A bar with the remaining time on standard error, if that is a terminal."""
    silent = quiet or not sys.stderr.isatty()
    with tqdm(total=total, unit="step", disable=silent, dynamic_ncols=True) as bar:
        yield bar


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.thesis",
        description="Compute the thesis's sensor and compare it with the thesis's numbers.",
    )
    add_out(parser)
    part = parser.add_mutually_exclusive_group()
    part.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="FIGURE",
        type=_shown,
        help="only what shows this figure or table of the thesis, 3.16 or 'Table 4.1'; repeatable",
    )
    part.add_argument(
        "--section",
        metavar="NAME",
        type=_named,
        help="only this section, on a page of its own; an anchor of the page, such as shear",
    )
    parser.add_argument("--quick", action="store_true", help="only a few of the scenes")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    add_processes(parser)
    return parser.parse_args(arguments)


def _named(text: str) -> str:
    """The name of a chapter, as a type for `argparse`."""
    names = [chapter.name for chapter in CHAPTERS]
    if text not in names:
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is not one of {', '.join(names)}")
    return text


def _shown(text: str) -> str:
    """A figure or table that a chapter shows, as a type for `argparse`."""
    names = {shown for chapter in CHAPTERS for shown in chapter.shows}
    if text not in names and not any(shown.split()[-1] == text for shown in names):
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is not one of {', '.join(sorted(names))}")
    return text


if __name__ == "__main__":
    # Imported by its name, the module gives functions that other processes find.
    sys.exit(import_module("reports.thesis").main())
