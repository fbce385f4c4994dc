"""Scenes from the ends of all ranges of a scene file: how each ends, and laws that they obey.

    python -m reports.extremes [--seed N] [--scenes N] [--checked N] [--seconds S] [--out DIR]
                               [--processes N]

Scenes are drawn with a seed (`reports.robustness.scenes`). A scene that ends as ``unstable`` or
without convergence is solved again as a film that wrinkles, without bending.
Some of the scenes with a result are solved once more to a tenth of the tolerance, half of them
with bending and half without. Endings are kept in the output folder as they are made, and later
runs find them there. 300 scenes take about ten minutes on two cores.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.film.models import film_model
from pvdf_fem.solvers.status import Status
from pvdf_fem.solvers.wrinkling import barely_loaded
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Cell, Column, Page, Picture, Section, Table
from reports.robustness.figures import draw_scenes, draw_times
from reports.robustness.laws import laws
from reports.robustness.runs import CRASHED, DIED, HUNG, TIME_LIMIT, Ending, kept_endings
from reports.robustness.scenes import SEED, scenes

#: A result is wrong if it differs from the finer one by more than this multiple of their errors.
TRUST = 10.0
#: Statuses after which the film may only lack the freedom to wrinkle.
WRINKLING = {"film.bending": False, "film.compression": "tension-field"}
COMPRESSED = (Status.UNSTABLE, Status.MAX_ITERATIONS)


@dataclass(frozen=True)
class DrawnScene:
    """A scene with its ending, and the scene and ending that stand for it in the end.

    The last two are the same as the first two, unless the scene was solved again as a film that
    wrinkles.
    """

    scene: Scene
    first: Ending
    final_scene: Scene
    final: Ending

    @property
    def group(self) -> str:
        """The kind of film by its temperature."""
        change = self.scene.film.temperature_change_K
        assert change is not None  # random scenes are stretched by cooling
        if change > 0.0:
            return "hot, barely loaded" if barely_loaded(self.scene) else "hot"
        return "cold" if change < -1e-6 else "without pretension"


@dataclass(frozen=True)
class Recheck:
    """A result beside the same scene's result at a tenth of the tolerance.

    Attributes
    ----------
    number : int
        Number of the scene.
    scene : Scene
    excess : float
        Largest difference of a charge over its estimated errors; NaN without a finer result.
    """

    number: int
    scene: Scene
    excess: float


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, check and write the page; returns 0 if nothing crashed and no result was wrong."""
    options = _options(arguments)
    return run_program("reports.extremes", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    drawn = _drawn(options)
    rechecks = _rechecks(drawn, options)
    sections = [
        _shares(drawn),
        _counts(drawn),
        _pictures(drawn, options.out),
        _unfinished(drawn),
        _trust(rechecks),
        laws(),
    ]
    for section in sections:
        section.write_tables(options.out)
    text = f"{len(drawn)} scenes drawn with the seed {options.seed}; times are of one thread."
    print(Page("Scenes of extreme proportions", [text], sections).write(options.out))
    wrong = any(recheck.excess > TRUST for recheck in rechecks)
    statuses = {
        status for outcome in drawn for status in (outcome.first.status, outcome.final.status)
    }
    return 1 if wrong or statuses & {CRASHED, DIED, HUNG} else 0


def _drawn(options: argparse.Namespace) -> list[DrawnScene]:
    """Solve all scenes, and as films that wrinkle those that may only lack that freedom."""
    asked = scenes(options.scenes, options.seed)
    endings = _endings("drawn", asked, options)
    drawn = [
        DrawnScene(*pair, *pair)  # until it is solved again
        for pair in zip(asked, endings, strict=True)
    ]
    compressed = [
        number
        for number, (scene, ending) in enumerate(zip(asked, endings, strict=True))
        if scene.film.compression == "refuse" and ending.status in COMPRESSED
    ]
    wrinkling = [asked[number].with_(**WRINKLING) for number in compressed]
    endings = _endings("wrinkling", wrinkling, options)
    for number, scene, ending in zip(compressed, wrinkling, endings, strict=True):
        drawn[number] = replace(drawn[number], final_scene=scene, final=ending)
    return drawn


def _endings(name: str, asked: list[Scene], options: argparse.Namespace) -> list[Ending]:
    """Endings of scenes, kept in a file of the output folder."""
    path = options.out / f"extremes-{name}.jsonl"
    return kept_endings(path, asked, options.seconds, options.processes)


def _rechecks(drawn: list[DrawnScene], options: argparse.Namespace) -> list[Recheck]:
    """Solve some scenes with a result again, to a finer tolerance."""
    count = max(1, options.scenes // 10) if options.checked is None else options.checked
    numbers = _to_check(drawn, count)
    finer = _endings("finer", [_finer(drawn[number].final_scene) for number in numbers], options)
    return [
        Recheck(number, drawn[number].final_scene, _excess(drawn[number].final, ending))
        for number, ending in zip(numbers, finer, strict=True)
    ]


def _to_check(drawn: list[DrawnScene], count: int) -> list[int]:
    """Numbers of the first results with bending and of the first without, `count` in all."""
    converged = [number for number, outcome in enumerate(drawn) if outcome.final.converged]
    bent = [number for number in converged if film_model(drawn[number].final_scene).bends]
    flexible = [number for number in converged if number not in bent]
    bent_count = min(len(bent), max(count // 2, count - len(flexible)))
    return sorted(bent[:bent_count] + flexible[: count - bent_count])


def _finer(scene: Scene) -> Scene:
    """The scene to a tenth of its tolerance, with bending only if it joined before."""
    tolerance = 0.1 * scene.numerics.tolerance
    return scene.with_(**{"numerics.tolerance": tolerance, "film.bending": film_model(scene).bends})


def _excess(ending: Ending, finer: Ending) -> float:
    """Largest difference of a charge over its estimated errors; NaN without a finer result."""
    if not finer.converged:
        return np.nan
    charges, better = np.array(ending.charges_pC), np.array(finer.charges_pC)
    errors = np.array(ending.errors_pC) + np.array(finer.errors_pC)
    floor = max(1e-6 * np.abs(better).max(), np.finfo(float).tiny)
    return float((np.abs(charges - better) / np.maximum(errors, floor)).max())


def _shares(drawn: list[DrawnScene]) -> Section:
    """Tell how many films of each group converge as drawn, and how many when they may wrinkle."""
    columns = [
        Column("group", "film"),
        Column("scenes", "scenes", 0),
        Column("drawn", "converged as drawn", 0),
        Column("wrinkling", "and as a film that wrinkles", 0),
        Column("share", "of all (%)", 1),
        Column("iterations", "most iterations", 0),
        Column("seconds", "longest, s", 1),
    ]
    cells: list[list[Cell]] = []
    for name in sorted({outcome.group for outcome in drawn}):
        group = [outcome for outcome in drawn if outcome.group == name]
        as_drawn = sum(outcome.first.converged for outcome in group)
        results = [outcome.final for outcome in group if outcome.final.converged]
        iterations = max((ending.iterations for ending in results), default=0)
        seconds = max(max(outcome.first.seconds, outcome.final.seconds) for outcome in group)
        share = 100.0 * len(results) / len(group)
        wrinkling = len(results) - as_drawn
        cells.append([name, len(group), as_drawn, wrinkling, share, iterations, seconds])
    text = "A film in compression has no minimum of the energy unless it may wrinkle."
    table = Table("extremes-shares", "How many have a result.", columns, cells)
    return Section("shares", "Results", [text], [table])


def _counts(drawn: list[DrawnScene]) -> Section:
    counts = Counter(
        (outcome.group, outcome.first.status, outcome.final.status) for outcome in drawn
    )
    columns = [
        Column("group", "film"),
        Column("drawn", "as drawn"),
        Column("status", "finally"),
        Column("scenes", "scenes", 0),
    ]
    cells: list[list[Cell]] = [[*key, count] for key, count in sorted(counts.items())]
    table = Table("extremes-counts", "What became of them.", columns, cells)
    results = [outcome.final for outcome in drawn if outcome.final.converged]
    if not results:
        return Section("counts", "Endings", ["None converged."], [table])
    text = (
        f"Of {len(results)} results: at most {max(r.iterations for r in results)} Newton iterations"
        f" on the last mesh, {max(r.seconds for r in results):.1f} s (median"
        f" {np.median([r.seconds for r in results]):.2f} s), force balance to"
        f" {max(r.force_balance for r in results):.1e}, residual over load"
        f" {max(r.residual for r in results):.1e}. Any scene took at most"
        f" {max(outcome.final.seconds for outcome in drawn):.1f} s."
    )
    return Section("counts", "Endings", [text], [table])


def _pictures(drawn: list[DrawnScene], out: Path) -> Section:
    final = [outcome.final for outcome in drawn]
    draw_scenes([outcome.scene for outcome in drawn], final, out / "extremes-status.png")
    draw_times(final, out / "extremes-times.png")
    pictures = [
        Picture("extremes-status.png", "Endings by the load and the pretension of the film."),
        Picture("extremes-times.png", "Seconds against unknowns."),
    ]
    return Section("regions", "Where", (), pictures)


def _unfinished(drawn: list[DrawnScene]) -> Section:
    columns = [
        Column("number", "scene", 0),
        Column("film", "film"),
        Column("load", "load"),
        Column("drawn", "as drawn"),
        Column("status", "finally"),
        Column("reason", "reason"),
        Column("seconds", "seconds"),
    ]
    cells: list[list[Cell]] = [
        [
            number,
            outcome.group,
            outcome.scene.load.kind,
            outcome.first.status,
            outcome.final.status,
            outcome.final.reason.strip().splitlines()[-1],
            outcome.final.seconds,
        ]
        for number, outcome in enumerate(drawn)
        if not outcome.final.converged
    ]
    table = Table("extremes-unfinished", "Scenes without a result.", columns, cells)
    return Section("unfinished", "Without a result", (), [table])


def _trust(rechecks: list[Recheck]) -> Section:
    columns = [
        Column("film", "film"),
        Column("compared", "compared", 0),
        Column("known", "with a result at a tenth of the tolerance", 0),
        Column("median", "difference over estimated error, median", 2),
        Column("largest", "largest", 1),
        Column("above", f"above {TRUST:g}", 0),
    ]
    excesses: dict[str, list[float]] = {"with bending": [], "that wrinkles": [], "any other": []}
    for recheck in rechecks:
        excesses[_kind(recheck.scene)].append(recheck.excess)
    cells: list[list[Cell]] = []
    for kind, values in excesses.items():
        finite = [value for value in values if np.isfinite(value)]
        spread = [float(np.median(finite)), max(finite)] if finite else [np.nan, np.nan]
        cells.append([kind, len(values), len(finite), *spread, sum(v > TRUST for v in finite)])
    wrong = [recheck.number for recheck in rechecks if recheck.excess > TRUST]
    text = f"Scenes that differ by more than {TRUST:g} times their estimated errors: {wrong}."
    text = text if wrong else f"No scene is off by more than {TRUST:g} times its estimated error."
    caption = "Results beside those at a tenth of the tolerance."
    table = Table("extremes-errors", caption, columns, cells)
    return Section("errors", "Estimated errors", [text], [table])


def _kind(scene: Scene) -> str:
    if film_model(scene).bends:
        return "with bending"
    return "that wrinkles" if scene.film.compression == "tension-field" else "any other"


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.extremes", description="Scenes from the ends of every range."
    )
    number = number_of("scenes", 100_000)
    parser.add_argument("--seed", type=number_of("seed", 10**9), default=SEED, metavar="N")
    parser.add_argument(
        "--scenes",
        "--count",
        type=number,
        default=2000,
        metavar="N",
        help="number of scenes that are drawn (default: 2000)",
    )
    parser.add_argument(
        "--checked",
        type=number,
        metavar="N",
        help="number of results that are compared with finer ones (default: a tenth of the scenes)",
    )
    parser.add_argument(
        "--seconds",
        type=number_of("seconds", 86_400),
        default=int(TIME_LIMIT),
        metavar="S",
        help=f"processor time after which a solve is ended (default: {TIME_LIMIT:g})",
    )
    add_out(parser, "extremes")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
