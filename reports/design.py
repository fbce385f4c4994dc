"""The design study: what position, force and charge a sensor resolves, by its parameters.

    python -m reports.design [--out DIR] [--quick] [--quiet] [--processes N]

Writes ``index.html`` with figures (SVG) and tables (CSV): position error and charge sensitivity
against number, spacing, size and shape of the electrodes, thickness, pretension and poling of the
film; maps over the film; a recommended design. Solved scenes are kept in ``results/`` beside them.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable, Sequence

from tqdm import tqdm

from pvdf_fem import __version__
from pvdf_fem.cli.program import ArgumentParser, InputError, run_program
from pvdf_fem.files import make_directory
from reports.common.figures import preview
from reports.common.options import add_out, add_processes
from reports.common.page import Page
from reports.common.results import Results
from reports.design_study import page
from reports.design_study.budget import budget
from reports.design_study.checks import checks
from reports.design_study.choice import recommend
from reports.design_study.sensor import Lattice, Sensor
from reports.design_study.study import (
    THESIS,
    Axes,
    Study,
    light,
    poled,
    rings,
    shapes,
    thicknesses,
)

Solve = Callable[[Sequence[Sensor]], None]


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the report; returns 0, or 1 if a solve failed."""
    options = _options(arguments)
    return run_program("reports.design", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    start = time.perf_counter()
    make_directory(options.out, "index.html")
    results = Results(options.out / "results", options.processes)
    study = Study(results, Lattice.quick(), Axes.quick()) if options.quick else Study(results)
    hidden = options.quiet or not sys.stderr.isatty()
    with preview(options.quick), tqdm(unit="scene", disable=hidden, dynamic_ncols=True) as bar:
        report_page = _page(study, _solver(study, bar), options)
    records = results.records
    failed = sum(not record.converged for record in records)
    seconds = sum(record.seconds for record in records)
    report_page.provenance.update(
        {
            "Scenes": f"{len(records)}, {seconds:.0f} s of computing, kept between runs",
            "Failed": str(failed),
            "Time": f"{time.perf_counter() - start:.0f} s",
        }
    )
    path = report_page.write(options.out)
    if not options.quiet:
        print(path)
    return 1 if failed else 0


def _page(study: Study, solve: Solve, options: argparse.Namespace) -> Page:
    solve(_sensors(study))
    try:
        recommended = recommend(study, solve)
    except ValueError as error:
        raise InputError(str(error)) from error
    out, compared = options.out, {"the thesis's": THESIS}
    if not options.quick:
        compared["recommended"] = recommended.sensor
    sections = [
        page.recommendation(recommended, out),
        page.maps(study, recommended.sensor, out),
        page.number_of_electrodes(study, out),
        page.film(study, recommended, out),
        page.future_work(study, recommended),
        budget(study, compared, quick=options.quick),
        checks(study, recommended, quick=options.quick),
    ]
    for section in sections:
        section.write_tables(out)
    provenance = {"pvdf_fem": __version__, "Tolerance": f"{study.lattice.tolerance:g} (relative)"}
    title = "What a sensor's design does"
    return Page(title, page.introduction(study), sections, provenance, options.quick)


def _sensors(study: Study) -> list[Sensor]:
    """All sensors that are compared before one is recommended."""
    films = thicknesses(study.axes)
    sensors = [sensor for count in study.axes.counts for sensor in rings(study, count)]
    sensors += [*films, *map(light, films), *shapes().values(), *poled().values()]
    return list(dict.fromkeys(sensors))


def _solver(study: Study, bar: tqdm[None]) -> Solve:
    """Make a function that does what `Study.solve` does and shows its progress on a bar."""

    def solve(sensors: Sequence[Sensor]) -> None:
        before = bar.n

        def tell(solved: int, total: int) -> None:
            bar.total = before + total
            bar.update(before + solved - bar.n)

        study.solve(sensors, tell)

    return solve


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.design",
        description="Position error and charge sensitivity by the sensor's design.",
    )
    add_out(parser, "design")
    parser.add_argument("--quick", action="store_true", help="few designs, a coarse lattice")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
