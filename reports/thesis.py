"""The thesis report: the sensor computed again, beside the numbers of A. Mirbagheri's thesis.

    python reports/thesis.py [--out DIR] [--only FIGURE] [--quick] [--quiet] [--processes N]

Writes ``index.html`` with its figures (SVG) and tables (CSV) into one directory. The page is
written anew after each part, and every solved scene is kept in ``results/`` there: a report that
was interrupted goes on, and a second run does not solve again.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from importlib.metadata import version
from pathlib import Path
from platform import python_version

from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # when run as a script, only its own directory is there
    sys.path.insert(0, str(ROOT))

from pvdf_fem import Scene, __version__  # noqa: E402
from pvdf_fem.page import Page, Section  # noqa: E402
from reports.part import Part  # noqa: E402
from reports.results import Results  # noqa: E402
from reports.thesis_data import Thesis  # noqa: E402
from reports.thesis_mapping import MAPPING_PART  # noqa: E402
from reports.thesis_summary import ALL_PART, MESH_PART, SUMMARY_PART  # noqa: E402
from reports.thesis_tables import (  # noqa: E402
    CHECKS_PART,
    FORCE_PART,
    FORCE_ROTATION_PART,
    ROTATION_PART,
    SCENES_PART,
)

#: In the order of the page.
PARTS = (
    SUMMARY_PART,
    SCENES_PART,
    MAPPING_PART,
    FORCE_PART,
    ROTATION_PART,
    CHECKS_PART,
    FORCE_ROTATION_PART,
    MESH_PART,
    ALL_PART,
)
PACKAGES = ("gmsh", "matplotlib", "numpy", "scikit-fem", "scipy")


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns 0, or 1 if a part or a solve failed."""
    options = _options(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    thesis = Thesis.read().quick() if options.quick else Thesis.read()
    results = Results(options.out / "results", options.processes)
    report = Report(thesis, results, options.out, _chosen(options.only))
    with closing(results), _progress(report.missing, options.quiet) as bar:
        for part in report.by_size:
            report.make(part, bar)
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
        self._start = time.perf_counter()

    @property
    def missing(self) -> int:
        """Number of solves that no earlier run has left."""
        return self.results.missing(
            scene for part in self.parts for scene in part.scenes(self.thesis)
        )

    @property
    def by_size(self) -> list[Part]:
        """The parts, those with the fewest scenes first, so that results come early."""
        return sorted(self.parts, key=lambda part: len(set(part.scenes(self.thesis))))

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

    def make(self, part: Part, bar: tqdm[None]) -> None:
        """Solve what a part still needs, make its section, and write the page."""
        bar.set_description(part.title)
        try:
            scenes = part.scenes(self.thesis)
            self.results.solve(scenes, lambda done, total: bar.update(1 if done else 0))
            section = self._section(part, scenes)
        except Exception as error:
            traceback.print_exc()
            section = Section(part.name, part.title, error=f"{type(error).__name__}: {error}")
        self.sections[part.name] = section
        self._write_page()

    def _section(self, part: Part, scenes: Sequence[Scene]) -> Section:
        content = part.compose(self.thesis, self.results, self.out)
        section = Section(
            part.name, part.title, content.paragraphs, content.blocks, note=self._failures(scenes)
        )
        for table in section.tables:
            table.write_csv(self.out)
        return section

    def _failures(self, scenes: Sequence[Scene]) -> str:
        found = {scene: self.results[scene] for scene in scenes}
        failed = [record for record in found.values() if not record.converged]
        if not failed:
            return ""
        reasons = sorted({f"{record.status} ({record.reason})" for record in failed})
        return f"{len(failed)} of {len(found)} solves failed: {'; '.join(reasons)}"

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
            "Tolerance": f"{Scene().numerics.tolerance:g} (relative, each charge)",
            "Solves": f"{len(records)}, {solving:.0f} s of computing, kept between runs",
            "Time": f"{time.perf_counter() - self._start:.0f} s",
        }


@contextmanager
def _progress(total: int, quiet: bool) -> Iterator[tqdm[None]]:
    """A bar with the remaining time on standard error, if that is a terminal."""
    silent = quiet or not sys.stderr.isatty()
    with tqdm(total=total, unit="solve", disable=silent, dynamic_ncols=True) as bar:
        yield bar


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="reports/thesis.py",
        description="Compute the thesis's sensor and compare it with the thesis's numbers.",
    )
    parser.add_argument(
        "--out", type=Path, default=ROOT / "reports" / "out", metavar="DIR", help="output directory"
    )
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
    parser.add_argument(
        "--processes", type=_count, default=os.cpu_count() or 1, metavar="N", help="default: cores"
    )
    return parser.parse_args(arguments)


def _shown(text: str) -> str:
    known = {shown for part in PARTS for shown in part.shows}
    if text not in known and not any(shown.split()[-1] == text for shown in known):
        raise argparse.ArgumentTypeError(f"{text!r} is not one of {', '.join(sorted(known))}")
    return text


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes; give 1 or more")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
