"""What an error costs: charges of fixed scenes, their errors and the run times, beside other codes.

    python -m reports.error_vs_time [--out DIR] [--quick] [--large] [--quiet]

Writes ``index.html`` with figures (SVG) and tables (CSV). Everything runs on one thread. NGSolve
(``pip install 'pvdf-fem[peers]'``) and CalculiX (Debian's calculix-ccx) take part if they are
there; the page tells which are not.
"""

from __future__ import annotations

import os

# All codes run on one thread, which numpy reads from the environment when it is imported.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"

import argparse  # noqa: E402
import platform  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
import traceback  # noqa: E402
from collections.abc import Callable, Iterator, Sequence  # noqa: E402
from contextlib import closing  # noqa: E402
from dataclasses import dataclass, field, replace  # noqa: E402
from datetime import UTC, datetime  # noqa: E402
from importlib.metadata import version  # noqa: E402
from pathlib import Path  # noqa: E402

from tqdm import tqdm  # noqa: E402

from pvdf_fem import __version__  # noqa: E402
from pvdf_fem.cli.program import ArgumentParser, run_program  # noqa: E402
from pvdf_fem.files import make_directory  # noqa: E402
from pvdf_fem.solution.first_sizes import ORDER  # noqa: E402
from reports.common.figures import preview  # noqa: E402
from reports.common.options import add_out  # noqa: E402
from reports.common.page import Page, Picture, Section, Table  # noqa: E402
from reports.speed import figures, tables  # noqa: E402
from reports.speed.cases import BenchmarkCase, Reference, reference  # noqa: E402
from reports.speed.growth import LARGE_FACTOR, Size, measure  # noqa: E402
from reports.speed.peers import Peers  # noqa: E402
from reports.speed.runs import GOAL, OURS, TimedRun, effectivities, our_jobs, timed  # noqa: E402
from reports.speed.stages import STAGES, stages  # noqa: E402
from reports.speed.sweep_cost import SweepCost, sweep_cost  # noqa: E402
from reports.speed.workload import FULL, QUICK, Workload  # noqa: E402

PACKAGES = ("gmsh", "numpy", "scikit-fem", "scipy")


@dataclass
class Measured:
    """What has been measured so far.

    Attributes
    ----------
    references : dict
        References by name of the case.
    runs : list of TimedRun
    sizes : list of Size
    stages : dict
        Seconds by stage, by case and tolerance.
    sweeps : list of SweepCost
    absent, unreferenced : dict
        Why a code takes no part, and why a case has no reference, by name.
    """

    references: dict[str, Reference] = field(default_factory=dict)
    runs: list[TimedRun] = field(default_factory=list)
    sizes: list[Size] = field(default_factory=list)
    stages: dict[str, dict[str, float]] = field(default_factory=dict)
    sweeps: list[SweepCost] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)
    unreferenced: dict[str, str] = field(default_factory=dict)

    def known(self, cases: Sequence[BenchmarkCase]) -> list[BenchmarkCase]:
        """The cases that have a reference."""
        return [case for case in cases if case.name in self.references]

    def of(self, cases: Sequence[BenchmarkCase]) -> list[TimedRun]:
        """The runs of some cases."""
        names = {case.name for case in cases}
        return [run for run in self.runs if run.job.case.name in names]


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure and write the page; returns 1 if one of our own runs or sections failed."""
    options = _options(arguments)
    with preview(options.quick):
        return run_program("reports.error_vs_time", lambda: _measure(options))


def _measure(options: argparse.Namespace) -> int:
    make_directory(options.out, "index.html")
    workload = QUICK if options.quick else FULL
    start = time.perf_counter()
    with closing(Peers()) as peers:
        measured = Measured(absent=dict(peers.absent))
        for _ in _measured(workload, peers, measured, options):
            made = _page(workload, measured, peers, options.out, time.perf_counter() - start)
            page = replace(made, is_preview=options.quick)
            path = page.write(options.out)
    if not options.quiet:
        print(path)
    broken = any(section.error for section in page.sections)
    lost = any(run.job.code == OURS and not run.converged for run in measured.runs)
    return 1 if broken or lost or measured.unreferenced else 0


# ----------------------------------------------------------------------------------- measuring


def _measured(
    workload: Workload, peers: Peers, measured: Measured, options: argparse.Namespace
) -> Iterator[None]:
    """Measure into `measured`; yields whenever there is something new for the page."""
    quiet = options.quiet or not sys.stderr.isatty()
    cases = (*workload.round_cases, *workload.cases)
    for case in tqdm(cases, "references", disable=quiet):
        try:
            measured.references[case.name] = reference(case)
        except Exception as error:
            measured.unreferenced[case.name] = f"{type(error).__name__}: {error}"
    jobs = {
        case.name: [
            *our_jobs(case, workload.factors, workload.tolerances),
            *peers.jobs(case, workload.ngsolve, workload.calculix, close=case.name == "triangle"),
        ]
        for case in measured.known(cases)
    }
    with tqdm(total=sum(map(len, jobs.values())), unit="job", disable=quiet) as bar:
        for case in measured.known(cases):
            bar.set_description(case.name)
            measured.runs += timed(
                jobs[case.name],
                measured.references[case.name],
                rounds=workload.rounds,
                budget=workload.budget,
                tick=bar.update,
            )
            yield
    sizes = (*workload.sizes, LARGE_FACTOR) if options.large else workload.sizes
    measured.sizes += [measure(factor) for factor in tqdm(sizes, "growth", disable=quiet)]
    for case in tqdm(workload.cases, "stages", disable=quiet):
        for tolerance in workload.stage_tolerances:
            scene = case.scene.with_(**{"numerics.tolerance": tolerance})
            if tolerance >= case.tolerances[0] and (seconds := stages(scene)):
                measured.stages[f"{case.name}, {tolerance:g}"] = seconds
    measured.sweeps += [sweep_cost(tolerance, workload.places) for tolerance in workload.sweeps]
    yield


# ------------------------------------------------------------------------------------ sections

Content = tuple[list[str], list[Table | Picture]]
NOTHING: Content = (["Nothing has been measured yet, or every solve failed."], [])


def _made(
    name: str,
    title: str,
    compose: Callable[[Workload, Measured, Path], Content],
    workload: Workload,
    measured: Measured,
    out: Path,
) -> Section:
    try:
        paragraphs, blocks = compose(workload, measured, out)
        section = Section(name, title, paragraphs, blocks)
        section.write_tables(out)
        return section
    except Exception as error:
        traceback.print_exc()
        return Section(name, title, error=f"{type(error).__name__}: {error}")


def _references(workload: Workload, measured: Measured, out: Path) -> Content:
    cases = measured.known((*workload.cases, *workload.round_cases))
    paragraphs = [
        "A scene's reference is a solve to the finer of two tolerances; the difference from the "
        "coarser one is the doubt about it. Errors within the doubt (grey in the figures) mean "
        "nothing.",
        *(f"No reference for {name}: {reason}" for name, reason in measured.unreferenced.items()),
    ]
    return paragraphs, [tables.reference_table(cases, measured.references, measured.runs)]


def _precision(workload: Workload, measured: Measured, out: Path) -> Content:
    cases = measured.known(workload.cases)
    runs = measured.of(cases)
    orders = sorted({*workload.factors, *workload.tolerances})
    blocks: list[Table | Picture] = []
    for abscissa in ("seconds", "unknowns"):
        file = f"{abscissa}.svg"
        figures.work_precision(
            out / file, cases, runs, measured.references, figures.our_looks(orders), abscissa
        )
        blocks.append(Picture(file, f"Error of the worst charge against {abscissa}."))
    paragraphs = [
        "Solid: the mesh follows the error until the tolerance is met; seconds include mesh and "
        "error estimates. Dashed: one family of meshes, scaled, the same for all orders; these "
        "seconds include an estimate too.",
        *tables.goal_sentences(runs),
    ]
    return paragraphs, blocks


def _peers(workload: Workload, measured: Measured, out: Path) -> Content:
    cases = measured.known(workload.cases)
    runs = measured.of(cases)
    looks = figures.peer_looks([(run.job.code, run.job.method) for run in runs])
    figures.work_precision(out / "peers.svg", cases, runs, measured.references, looks, "solving")
    paragraphs = [
        "The same scenes in the same run, one thread, jobs of all codes in turn; imports are left "
        "out. The peers estimate no error, so on uniform meshes this code's estimate is left out; "
        "meshes for a tolerance follow estimates, which are in, and are of a half or a quarter of "
        "the film where the scene is symmetric.",
        "NGSolve: Netgen's curved meshes with this code's first sizes, order 1 as a start, inner "
        "unknowns condensed, its own sparse Cholesky. CalculiX: this code's mesh at a multiple of "
        "the thesis's sizes, a step that cools and one that presses; dead pressures only.",
        *tables.peer_sentences(cases, runs, measured.absent),
    ]
    blocks: list[Table | Picture] = [
        Picture("peers.svg", "Error of the worst charge against seconds."),
        tables.peer_table(cases, runs, tables.peers_of(runs)),
    ]
    return paragraphs, blocks


def _closed_forms(workload: Workload, measured: Measured, out: Path) -> Content:
    cases = measured.known(workload.round_cases)
    runs = measured.of(cases)
    looks = figures.our_looks(sorted({*workload.factors, *workload.tolerances}))
    peers = figures.peer_looks([(r.job.code, r.job.method) for r in runs])
    looks |= {key: look for key, look in peers.items() if key[0] != OURS}
    figures.work_precision(out / "round.svg", cases, runs, measured.references, looks, "seconds")
    paragraphs = [
        "A round electrode about the centre, whose charge the tension's closed form gives: "
        "Hencky's series at vanishing slopes, and a one-dimensional solver of the round film "
        "(Green-Lagrange strains) for the patch.",
        *_missed(runs),
    ]
    return paragraphs, [Picture("round.svg", "Error of the charge against seconds, closed forms.")]


def _missed(runs: Sequence[TimedRun]) -> list[str]:
    to_tolerance = [run for run in runs if GOAL in run.job.method and run.converged]
    ratios = [run.error / run.job.setting for run in to_tolerance]
    if not ratios:
        return []
    met = tables.share_of([ratio <= 1.0 for ratio in ratios])
    return [f"{met} solves to a tolerance met it; the worst error was {max(ratios):.2f} of it."]


def _tolerance(workload: Workload, measured: Measured, out: Path) -> Content:
    cases = measured.known(workload.cases)
    if not measured.of(cases):
        return NOTHING
    runs = [run for run in measured.of(cases) if run.job.method == f"order {ORDER}, {GOAL}"]
    figures.against_tolerance(out / "tolerance.svg", runs)
    caption = "Left: cost of a tolerance. Right: the true error over it; above the line: missed."
    paragraphs = ["The order is the one that a solve takes when none is given."]
    return paragraphs, [Picture("tolerance.svg", caption), tables.tolerance_table(runs)]


def _stages(workload: Workload, measured: Measured, out: Path) -> Content:
    if not measured.stages:
        return NOTHING
    figures.stage_bars(out / "stages.svg", measured.stages)
    total = sum(seconds["total"] for seconds in measured.stages.values())
    shares = ", ".join(
        f"{name} {sum(s[name] for s in measured.stages.values()) / total:.0%}" for name in STAGES
    )
    text = f"Of all seconds below: {shares}. Assembly is that of tangents."
    return [text], [
        Picture("stages.svg", "Seconds by stage, by scene and tolerance."),
        tables.stage_table(measured.stages, STAGES),
    ]


def _sweeps(workload: Workload, measured: Measured, out: Path) -> Content:
    if not measured.sweeps:
        return NOTHING
    paragraphs = [
        "The triangle at places along a line, under several forces, between several rings of "
        "electrodes, on one thread. A solve serves all rings and mirror images.",
        *tables.sweep_sentences(measured.sweeps, measured.of(measured.known(workload.cases))),
    ]
    return paragraphs, [tables.sweep_table(measured.sweeps)]


def _growth(workload: Workload, measured: Measured, out: Path) -> Content:
    if not measured.sizes:
        return NOTHING
    figures.growth(out / "growth.svg", measured.sizes)
    largest = max((size.unknowns for size in measured.sizes), default=0)
    paragraphs = [
        "Each solve has a process of its own. Seconds grow as unknowns to the power of "
        f"{tables.exponent(measured.sizes):.2f}. The largest has {largest} unknowns; a million "
        "takes minutes and most of 20 GiB, and is only solved with --large."
    ]
    return paragraphs, [
        Picture("growth.svg", "Seconds and memory against unknowns, order 2."),
        tables.growth_table(measured.sizes),
    ]


def _effectivity(workload: Workload, measured: Measured, out: Path) -> Content:
    ours = [run for run in measured.of(measured.known(workload.cases)) if run.job.code == OURS]
    ratios = effectivities(ours, measured.references)
    if not ratios:
        return NOTHING
    figures.effectivity(out / "effectivity.svg", ratios)
    paragraphs = [
        "Estimated over true error of every charge. Left out are charges whose true error is "
        "below ten times the doubt about the reference.",
        *tables.effectivity_sentences(ratios),
    ]
    return paragraphs, [
        Picture("effectivity.svg", "Histograms of the effectivity; dashed: 0.3 and 3.")
    ]


def _all_runs(workload: Workload, measured: Measured, out: Path) -> Content:
    return ["Failed runs keep their reason."], [tables.run_table(measured.runs)]


SECTIONS: tuple[tuple[str, str, Callable[[Workload, Measured, Path], Content]], ...] = (
    ("precision", "Error against seconds and unknowns", _precision),
    ("peers", "Other codes", _peers),
    ("closed", "Closed forms", _closed_forms),
    ("tolerance", "Cost of a tolerance", _tolerance),
    ("stages", "Where the time goes", _stages),
    ("sweeps", "A scene of a sweep", _sweeps),
    ("growth", "Growth with the unknowns", _growth),
    ("effectivity", "Effectivity of the error estimate", _effectivity),
    ("references", "References", _references),
    ("runs", "All runs", _all_runs),
)


def _introduction(workload: Workload, measured: Measured, peers: Peers) -> list[str]:
    present = " and ".join(peers.versions) or "no other code"
    return [
        f"{len(workload.cases)} fixed scenes and {len(workload.round_cases)} closed forms, each "
        f"solved by this code in every way it offers, and by {present}: {len(measured.runs)} "
        f"jobs, of which {sum(not run.converged for run in measured.runs)} failed.",
        f"Seconds are medians of up to {workload.rounds} runs on one thread, as many as fit into "
        f"{workload.budget:g} s; mesh included, imports not. An error is that of the worst charge.",
    ]


def _page(workload: Workload, measured: Measured, peers: Peers, out: Path, seconds: float) -> Page:
    sections = [_made(*entry, workload, measured, out) for entry in SECTIONS]
    introduction = _introduction(workload, measured, peers)
    title = "Error against run time"
    return Page(title, introduction, sections, _provenance(peers, seconds))


def _provenance(peers: Peers, seconds: float) -> dict[str, str]:
    load = ", ".join(f"{x:.1f}" for x in os.getloadavg())
    return {
        "Date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "Machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "Load averages at the end": f"{load} (above 1: others were running, times are too long)",
        "pvdf_fem": __version__,
        **{package: version(package) for package in PACKAGES},
        **peers.versions,
        **{name: f"absent: {reason}" for name, reason in peers.absent.items()},
        "Python": platform.python_version(),
        "Time": f"{seconds:.0f} s",
    }


def _processor() -> str:
    listed = Path("/proc/cpuinfo")
    for line in listed.read_text().splitlines() if listed.exists() else []:
        if line.startswith("model name"):
            return line.split(":", 1)[1].strip()
    return platform.processor() or platform.machine()


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.error_vs_time",
        description="Measure errors and run times of fixed scenes, beside other codes.",
    )
    add_out(parser, "error_vs_time")
    parser.add_argument("--quick", action="store_true", help="a few runs of two scenes")
    parser.add_argument("--large", action="store_true", help="one solve of a million unknowns too")
    parser.add_argument("--quiet", action="store_true", help="print nothing but errors")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
