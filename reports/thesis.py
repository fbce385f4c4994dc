"""The thesis report: the sensor computed again, beside the numbers of A. Mirbagheri's thesis.

    python -m reports.thesis [--out DIR] [--only FIGURE] [--quick] [--quiet] [--processes N]

Writes ``index.html`` with its figures (SVG) and tables (CSV) into one directory. Every solved
scene is kept in ``results/`` there as soon as it is solved: a report that was interrupted goes on,
and a second run neither solves nor draws again what has not changed. The page is written anew
every few seconds.
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
from pvdf_fem.files import FileError, make_directory, printable
from reports.chapters.contact import CONTACT_PART
from reports.chapters.contours import (
    FIGURE_3_9_PART,
    FIGURE_3_16_PART,
    RECTANGLE_MAP_PART,
    TRIANGLE_MAP_PART,
)
from reports.chapters.drawings import DRAWINGS_PART
from reports.chapters.experiments import (
    CHARGE_PARTS_PART,
    CIRCUIT_PART,
    MEASURED_POSITIONS_PART,
)
from reports.chapters.findings import FINDINGS_PART
from reports.chapters.force_and_angle.angle import ANGLE_PART
from reports.chapters.force_and_angle.force import (
    RECTANGLE_FORCE_PART,
    TRIANGLE_FORCE_PART,
)
from reports.chapters.force_and_angle.force_law import FORCE_LAW_PART
from reports.chapters.force_and_angle.orientation import ROTATION_PART
from reports.chapters.force_and_angle.recovery import RECOVERY_PART
from reports.chapters.force_and_angle.surface import SURFACE_PART
from reports.chapters.mapping import (
    FIGURE_3_5_PART,
    FIGURE_3_7_PART,
    FIGURE_3_17_PART,
    FIGURE_3_18_PART,
    OTHER_MAPPINGS_PART,
)
from reports.chapters.positions.positions import (
    EXPERIMENT_POSITIONS_PART,
    RECTANGLE_POSITIONS_PART,
    TRIANGLE_POSITIONS_PART,
    TWO_NEWTON_POSITIONS_PART,
    UNIAXIAL_POSITIONS_PART,
)
from reports.chapters.summary import ALL_PART, MESH_PART, SUMMARY_PART
from reports.chapters.thickness import THICKNESS_PART
from reports.common.kept import kept
from reports.common.options import add_out, add_processes
from reports.common.page import Page, Section
from reports.common.part import Part
from reports.common.results import Results
from reports.common.tables import SCENES_PART
from reports.common.thesis_data import Thesis
from reports.common.thesis_scene import TOLERANCE

#: In the order of the page.
PARTS = (
    SUMMARY_PART,
    FINDINGS_PART,
    DRAWINGS_PART,
    SCENES_PART,
    FIGURE_3_5_PART,
    FIGURE_3_7_PART,
    FIGURE_3_17_PART,
    FIGURE_3_18_PART,
    OTHER_MAPPINGS_PART,
    FIGURE_3_9_PART,
    TRIANGLE_POSITIONS_PART,
    RECTANGLE_POSITIONS_PART,
    FIGURE_3_16_PART,
    TRIANGLE_MAP_PART,
    RECTANGLE_MAP_PART,
    UNIAXIAL_POSITIONS_PART,
    TWO_NEWTON_POSITIONS_PART,
    TRIANGLE_FORCE_PART,
    THICKNESS_PART,
    RECTANGLE_FORCE_PART,
    FORCE_LAW_PART,
    ROTATION_PART,
    ANGLE_PART,
    SURFACE_PART,
    RECOVERY_PART,
    MEASURED_POSITIONS_PART,
    EXPERIMENT_POSITIONS_PART,
    CONTACT_PART,
    CHARGE_PARTS_PART,
    CIRCUIT_PART,
    MESH_PART,
    ALL_PART,
)
#: Between two versions of the page while it is made.
PAGE_SECONDS = 5.0
PACKAGES = ("gmsh", "matplotlib", "numpy", "scikit-fem", "scipy")


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns 0, or 1 if a part or a solve failed."""
    options = _options(arguments)
    return run_program("reports.thesis", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    make_directory(options.out, "index.html")
    thesis = Thesis.read().quick() if options.quick else Thesis.read()
    results = Results(options.out / "results", options.processes)
    report = Report(thesis, results, options.out, _chosen(options.only))
    with _progress(report.missing + len(report.parts), options.quiet) as bar:
        report.solve(bar)
        report.make(bar)
    if not options.quiet:
        print(f"{options.out / 'index.html'}: {report.outcome}")
    return 0 if report.complete else 1


def _chosen(only: Sequence[str]) -> tuple[Part, ...]:
    """The parts that show the wanted figures or tables; all if none are wanted."""
    wanted = set(only)
    return tuple(
        part
        for part in PARTS
        if not wanted or any({shown, shown.split()[-1]} & wanted for shown in part.shows)
    )


class Report:
    """The sections made so far, and the results that they share."""

    def __init__(self, thesis: Thesis, results: Results, out: Path, parts: Sequence[Part]) -> None:
        self.thesis, self.results, self.out, self.parts = thesis, results, out, parts
        self.sections: dict[str, Section] = {}
        self.scenes = {part.name: part.scenes(thesis) for part in parts}
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
        made = [self.sections.get(part.name) for part in self.parts]
        return all(section is not None and not section.state for section in made)

    @property
    def outcome(self) -> str:
        """How it ended, in a line."""
        bad = [section.title for section in self.sections.values() if section.state]
        seconds = f"{time.perf_counter() - self._start:.0f} s"
        return f"{seconds}; incomplete: {', '.join(bad)}" if bad else f"complete in {seconds}"

    def solve(self, bar: tqdm[None]) -> None:
        """Solve what is missing; each record is kept as soon as it is there."""
        bar.set_description("solving")
        self.results.solve(self._all_scenes, lambda done, total: bar.update(1 if done else 0))

    def make(self, bar: tqdm[None]) -> None:
        """Make all sections, and write the page every few seconds and at the end."""
        bar.set_description("drawing")
        self._write_page()
        written = time.perf_counter()
        tasks = (
            delayed(_section)(part, self.scenes[part.name], self.thesis, known, self.out)
            for part in sorted(self.parts, key=lambda part: -len(self.scenes[part.name]))
            for known in [self.results.of(self.scenes[part.name])]
        )
        with parallel_config("loky", inner_max_num_threads=1):
            pool = Parallel(self.results.processes, return_as="generator_unordered", batch_size=1)
            made = pool(tasks)
        for section in made:
            self.sections[section.name] = section
            bar.update()
            if time.perf_counter() > written + PAGE_SECONDS:
                self._write_page()
                written = time.perf_counter()
        self._write_page()

    def _write_page(self) -> None:
        sections = [
            self.sections.get(part.name) or Section(part.name, part.title, note="not computed yet")
            for part in self.parts
        ]
        introduction = [
            "A. Mirbagheri, “Design, Modeling, Fabrication and Testing of a Membrane Piezoelectric "
            "Tactile Sensor with Four Sensing Elements”, computed again with pvdf_fem. Nothing is "
            "fitted: film, probes and forces are those of the thesis.",
            "Unless a column says otherwise, the pressure follows the deformed film and a charge "
            "is the thesis-edge observable: stresses averaged along the electrode's edges, as the "
            "thesis's post-processor does. Differences are ours minus the thesis's, in percent of "
            "the thesis's.",
        ]
        title = "A membrane PVDF tactile sensor: this work beside the thesis"
        Page(title, introduction, sections, self._provenance()).write(self.out)

    def _provenance(self) -> dict[str, str]:
        records = self.results.records
        solving = sum(record.seconds for record in records)
        return {
            "pvdf_fem": __version__,
            **{package: version(package) for package in PACKAGES},
            "Python": python_version(),
            "Cores": f"{os.cpu_count()}, {self.results.processes} processes of one thread",
            "Tolerance": f"{TOLERANCE:g} (relative, each charge)",
            "Scenes": f"{len(records)}, {solving:.0f} s of computing, kept between runs",
            "Time": f"{time.perf_counter() - self._start:.0f} s",
        }


def _section(
    part: Part, scenes: Sequence[Scene], thesis: Thesis, results: Results, out: Path
) -> Section:
    """A section with its files written; an exception becomes its error."""

    def make() -> Section:
        content = part.compose(thesis, results, out)
        note = _failures(results, scenes)
        section = Section(part.name, part.title, content.paragraphs, content.blocks, note=note)
        section.write_tables(out)
        return section

    try:
        return kept(part.name, scenes, thesis, results, out, make)
    except Exception as error:
        if isinstance(error, FileError):
            print(printable(str(error)), file=sys.stderr)
        else:
            traceback.print_exc()
        return Section(part.name, part.title, error=f"{type(error).__name__}: {error}")


def _failures(results: Results, scenes: Sequence[Scene]) -> str:
    found = {scene: results[scene] for scene in scenes}
    failed = [record for record in found.values() if not record.converged]
    if not failed:
        return ""
    reasons = sorted({f"{record.status} ({record.reason})" for record in failed})
    return f"{len(failed)} of {len(found)} solves failed: {'; '.join(reasons)}"


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
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="FIGURE",
        type=_shown,
        help="only what shows this figure or table of the thesis, 3.16 or 'Table 4.1'; repeatable",
    )
    parser.add_argument("--quick", action="store_true", help="only a few of the scenes")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    add_processes(parser)
    return parser.parse_args(arguments)


def _shown(text: str) -> str:
    known = {shown for part in PARTS for shown in part.shows}
    if text not in known and not any(shown.split()[-1] == text for shown in known):
        raise argparse.ArgumentTypeError(f"{text[:60]!r} is not one of {', '.join(sorted(known))}")
    return text


if __name__ == "__main__":
    # by its own name, so that other processes find its functions
    sys.exit(import_module("reports.thesis").main())
