"""The thesis report: the sensor computed again, beside the numbers of A. Mirbagheri's thesis.

    python reports/thesis.py [--out DIR] [--quick] [--quiet] [--processes N]

Writes ``index.html`` with its figures (SVG) and tables (CSV) into one directory. The page is
written anew after each part, so what is computed stays, whatever happens to the rest.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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
from reports.simulation import Outcome, Simulation, simulate_all  # noqa: E402
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
    report = Report(thesis, options.out, options.processes)
    with _progress(report.simulation_count, options.quiet) as bar:
        for part in report.by_size:
            report.make(part, bar)
    if not options.quiet:
        print(f"{options.out / 'index.html'}: {report.outcome}")
    return 0 if report.complete else 1


class Report:
    """The sections made so far, and the outcomes that they share."""

    def __init__(self, thesis: Thesis, out: Path, processes: int) -> None:
        self.thesis, self.out, self.processes = thesis, out, processes
        self.outcomes: dict[Simulation, Outcome] = {}
        self.sections: dict[str, Section] = {}
        self._start = time.perf_counter()

    @property
    def simulation_count(self) -> int:
        """Number of different simulations in all parts."""
        return len({one for part in PARTS for one in part.simulations(self.thesis)})

    @property
    def by_size(self) -> list[Part]:
        """The parts, those with the fewest simulations first, so that results come early."""
        return sorted(PARTS, key=lambda part: len(set(part.simulations(self.thesis))))

    @property
    def complete(self) -> bool:
        """Whether all sections are there and every solve converged."""
        made = [self.sections.get(part.name) for part in PARTS]
        return all(section is not None and not section.state for section in made)

    @property
    def outcome(self) -> str:
        """How it ended, in a line."""
        bad = [section.title for section in self.sections.values() if section.state]
        seconds = f"{time.perf_counter() - self._start:.0f} s"
        return f"{seconds}; incomplete: {', '.join(bad)}" if bad else f"complete in {seconds}"

    def make(self, part: Part, bar: tqdm[None]) -> None:
        """Simulate what a part still needs, make its section, and write the page."""
        bar.set_description(part.title)
        try:
            wanted = part.simulations(self.thesis)
            missing = [one for one in dict.fromkeys(wanted) if one not in self.outcomes]
            for simulation, outcome in simulate_all(missing, self.processes):
                self.outcomes[simulation] = outcome
                bar.update()
            section = self._section(part, wanted)
        except Exception as error:
            traceback.print_exc()
            section = Section(part.name, part.title, error=f"{type(error).__name__}: {error}")
        self.sections[part.name] = section
        self._write_page()

    def _section(self, part: Part, wanted: Sequence[Simulation]) -> Section:
        content = part.compose(self.thesis, self.outcomes, self.out)
        section = Section(
            part.name, part.title, content.paragraphs, content.blocks, note=self._failures(wanted)
        )
        for table in section.tables:
            table.write_csv(self.out)
        return section

    def _failures(self, wanted: Sequence[Simulation]) -> str:
        found = {one: self.outcomes[one] for one in wanted}
        failed = [outcome for outcome in found.values() if not outcome.converged]
        if not failed:
            return ""
        reasons = sorted({f"{outcome.status} ({outcome.reason})" for outcome in failed})
        return f"{len(failed)} of {len(found)} solves failed: {'; '.join(reasons)}"

    def _write_page(self) -> None:
        sections = [
            self.sections.get(part.name) or Section(part.name, part.title, note="not computed yet")
            for part in PARTS
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
        solving = sum(outcome.seconds for outcome in self.outcomes.values())
        return {
            "pvdf_fem": __version__,
            **{package: version(package) for package in PACKAGES},
            "Python": python_version(),
            "Processor cores": f"{os.cpu_count()}, {self.processes} processes of one thread",
            "Tolerance": f"{Scene().numerics.tolerance:g} (relative, each charge)",
            "Simulations": f"{len(self.outcomes)}, {solving:.0f} s of computing",
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
    parser.add_argument("--quick", action="store_true", help="only a few of the scenes")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    parser.add_argument(
        "--processes", type=_count, default=os.cpu_count() or 1, metavar="N", help="default: cores"
    )
    return parser.parse_args(arguments)


def _count(text: str) -> int:
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number of processes; give 1 or more")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
