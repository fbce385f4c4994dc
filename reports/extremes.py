"""Scenes from the ends of what a file may ask for: what becomes of each, and the laws they obey.

    python -m reports.extremes [--seed N] [--count N] [--checked N] [--seconds S] [--out DIR]
                               [--processes N]

Scenes are drawn with a seed (`robustness.scenes`). Those that end as ``unstable``, at a limit
point or without convergence, where the film may be asked to carry compression, are solved again as
films that wrinkle, without bending.
Some of those with a result are solved once more to a tenth of the tolerance: the first with
bending and the first without, so many of each. Rows are kept, and found again by later runs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.film.bending_effect import bending_joins
from pvdf_fem.solvers.newton import Status
from pvdf_fem.solvers.wrinkling import barely_loaded
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Cell, Column, Page, Picture, Section, Table
from reports.robustness.figures import draw_scenes, draw_times
from reports.robustness.laws import laws
from reports.robustness.runs import CRASHED, DIED, HUNG, TIME_LIMIT, Row, rows
from reports.robustness.scenes import SEED, scenes

FINER = 0.1
#: Results may differ from finer ones by so many times their estimated error.
TRUST = 10.0


@dataclass(frozen=True)
class Drawn:
    """A scene as drawn and its row, and those of the film that wrinkles where it had to."""

    scene: Scene
    first: Row
    final_scene: Scene
    final: Row

    @property
    def group(self) -> str:
        """The film by its temperature."""
        change = self.scene.film.temperature_change_K
        if change > 0.0:
            return "hot, barely loaded" if barely_loaded(self.scene) else "hot"
        return "cold" if change < -1e-6 else "without pretension"


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, check, write the page; 0 if nothing crashed and no result was wrong."""
    options = _options(arguments)
    return run_program("reports.extremes", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    given = scenes(options.count, options.seed)
    first = _kept("drawn", given, options)
    carried = (Status.UNSTABLE, Status.LIMIT, Status.MAX_ITERATIONS)
    again = [
        n
        for n, (scene, row) in enumerate(zip(given, first, strict=True))
        if scene.film.compression == "refuse" and row.status in carried
    ]
    wrinkling = {"film.bending": False, "film.compression": "tension-field"}
    second = _kept("wrinkling", [given[n].with_(**wrinkling) for n in again], options)
    drawn = [Drawn(*each, *each) for each in zip(given, first, strict=True)]
    for n, row in zip(again, second, strict=True):
        drawn[n] = replace(drawn[n], final_scene=given[n].with_(**wrinkling), final=row)
    checked = _to_check(drawn, options.checked)
    finer = _kept("finer", [_finer(drawn[n].final_scene) for n in checked], options)
    excess = [_excess(drawn[n].final, row) for n, row in zip(checked, finer, strict=True)]
    wrong = [n for n, e in zip(checked, excess, strict=True) if e > TRUST]
    sections = [
        _shares(drawn),
        _counts(drawn),
        _pictures(drawn, options.out),
        _unfinished(drawn),
        _trust([drawn[n].final_scene for n in checked], excess, wrong),
        laws(),
    ]
    for section in sections:
        section.write_tables(options.out)
    text = f"{len(drawn)} scenes drawn with the seed {options.seed}; times are of one thread."
    print(Page("Scenes of extreme proportions", [text], sections).write(options.out))
    bad = (CRASHED, DIED, HUNG)
    return 1 if wrong or any({d.first.status, d.final.status} & {*bad} for d in drawn) else 0


def _to_check(drawn: list[Drawn], count: int) -> list[int]:
    """The first results with bending and those without, `count` in all."""
    converged = [n for n, one in enumerate(drawn) if one.final.converged]
    bent = [n for n in converged if bending_joins(drawn[n].final_scene)]
    plain = [n for n in converged if n not in bent]
    some = min(len(bent), max(count // 2, count - len(plain)))
    return sorted(bent[:some] + plain[: count - some])


def _finer(scene: Scene) -> Scene:
    """The same to a finer tolerance, at which ``auto`` might let bending join."""
    tolerance = FINER * scene.numerics.tolerance
    return scene.with_(**{"numerics.tolerance": tolerance, "film.bending": bending_joins(scene)})


def _excess(row: Row, finer: Row) -> float:
    """Largest difference of a charge over its estimated errors; NaN without a finer result."""
    if not finer.converged:
        return np.nan
    charges, better = np.array(row.charges_pC), np.array(finer.charges_pC)
    errors = np.array(row.errors_pC) + np.array(finer.errors_pC)
    floor = max(1e-6 * np.abs(better).max(), np.finfo(float).tiny)
    return float((np.abs(charges - better) / np.maximum(errors, floor)).max())


def _shares(drawn: list[Drawn]) -> Section:
    """Of each group, how many converge as drawn, and how many when films may wrinkle."""
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
    for name in sorted({one.group for one in drawn}):
        these = [one for one in drawn if one.group == name]
        before = sum(one.first.converged for one in these)
        final = [one.final for one in these if one.final.converged]
        most = max((row.iterations for row in final), default=0)
        longest = max(max(one.first.seconds, one.final.seconds) for one in these)
        more, share = len(final) - before, 100.0 * len(final) / len(these)
        cells.append([name, len(these), before, more, share, most, longest])
    text = "A film in compression has no minimum of the energy unless it may wrinkle."
    table = Table("extremes-shares", "How many have a result.", columns, cells)
    return Section("shares", "Results", [text], [table])


def _counts(drawn: list[Drawn]) -> Section:
    found = Counter((one.group, one.first.status, one.final.status) for one in drawn)
    columns = [
        Column("group", "film"),
        Column("drawn", "as drawn"),
        Column("status", "finally"),
        Column("scenes", "scenes", 0),
    ]
    cells: list[list[Cell]] = [[*key, count] for key, count in sorted(found.items())]
    table = Table("extremes-counts", "What became of them.", columns, cells)
    done = [one.final for one in drawn if one.final.converged]
    if not done:
        return Section("counts", "Endings", ["None converged."], [table])
    text = (
        f"Of {len(done)} results: at most {max(row.iterations for row in done)} Newton iterations"
        f" on the last mesh, {max(row.seconds for row in done):.1f} s (median"
        f" {np.median([row.seconds for row in done]):.2f} s), force balance to"
        f" {max(row.force_balance for row in done):.1e}, residual over load"
        f" {max(row.residual for row in done):.1e}. Any scene took at most"
        f" {max(one.final.seconds for one in drawn):.1f} s."
    )
    return Section("counts", "Endings", [text], [table])


def _pictures(drawn: list[Drawn], out: Path) -> Section:
    final = [one.final for one in drawn]
    draw_scenes([one.scene for one in drawn], final, out / "extremes-status.png")
    draw_times(final, out / "extremes-times.png")
    pictures = [
        Picture("extremes-status.png", "Endings by the load and the pretension of the film."),
        Picture("extremes-times.png", "Seconds against unknowns."),
    ]
    return Section("regions", "Where", (), pictures)


def _unfinished(drawn: list[Drawn]) -> Section:
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
            n,
            one.group,
            one.scene.load.kind,
            one.first.status,
            one.final.status,
            one.final.reason.strip().splitlines()[-1],
            one.final.seconds,
        ]
        for n, one in enumerate(drawn)
        if not one.final.converged
    ]
    table = Table("extremes-unfinished", "Scenes without a result.", columns, cells)
    return Section("unfinished", "Without a result", (), [table])


def _trust(checked: list[Scene], excess: list[float], wrong: list[int]) -> Section:
    columns = [
        Column("film", "film"),
        Column("compared", "compared", 0),
        Column("known", "with a result at a tenth of the tolerance", 0),
        Column("median", "difference over estimated error, median", 2),
        Column("largest", "largest", 1),
        Column("above", f"above {TRUST:g}", 0),
    ]
    kinds = {
        "with bending": [bending_joins(scene) for scene in checked],
        "that wrinkles": [scene.film.compression == "tension-field" for scene in checked],
    }
    kinds["any other"] = [not any(chosen) for chosen in zip(*kinds.values(), strict=True)]
    cells: list[list[Cell]] = []
    for kind, chosen in kinds.items():
        those = [e for e, mine in zip(excess, chosen, strict=True) if mine]
        known = [e for e in those if np.isfinite(e)]
        found = [float(np.median(known)), max(known)] if known else [np.nan, np.nan]
        cells.append([kind, len(those), len(known), *found, sum(e > TRUST for e in known)])
    text = f"Scenes that differ by more than {TRUST:g} times their estimated error: {wrong or '-'}."
    caption = "Results beside those at a tenth of the tolerance."
    table = Table("extremes-errors", caption, columns, cells)
    return Section("errors", "Estimated errors", [text], [table])


def _kept(name: str, wanted: list[Scene], options: argparse.Namespace) -> list[Row]:
    """Rows of scenes; those in the file of earlier runs with the same scenes are not made again."""
    path: Path = options.out / f"extremes-{name}.jsonl"
    known = _read(path)
    keys = [scene.model_dump_json() for scene in wanted]
    missing = [n for n, key in enumerate(keys) if key not in known]
    with path.open("a", encoding="utf-8") as stream:

        def keep(number: int, row: Row) -> None:
            key = keys[missing[number]]
            known[key] = row
            stream.write("\n" + json.dumps({"scene": key, "row": asdict(row)}))
            stream.flush()
            print(
                f"{name} {number + 1}/{len(missing)} {row.status} {row.seconds:.1f} s", flush=True
            )

        rows([wanted[n] for n in missing], keep, options.seconds, options.processes)
    return [known[key] for key in keys]


def _read(path: Path) -> dict[str, Row]:
    """Rows by their scenes; the line that an interrupted run left half written is passed over."""
    known: dict[str, Row] = {}
    for line in path.read_text(encoding="utf-8").splitlines() if path.exists() else []:
        try:
            entry = json.loads(line)
        except ValueError:
            continue
        values: dict[str, Any] = entry["row"]
        values |= {key: tuple(value) for key, value in values.items() if isinstance(value, list)}
        known[entry["scene"]] = Row(**values)
    return known


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.extremes", description="Scenes from the ends of every range."
    )
    scenes_wanted = number_of("scenes", 100_000)
    parser.add_argument("--seed", type=number_of("seed", 10**9), default=SEED, metavar="N")
    parser.add_argument("--count", type=scenes_wanted, default=2000, metavar="N")
    parser.add_argument("--checked", type=scenes_wanted, default=200, metavar="N")
    parser.add_argument(
        "--seconds",
        type=number_of("seconds", 86_400),
        default=int(TIME_LIMIT),
        metavar="S",
        help="of processor time, after which a solve is ended",
    )
    add_out(parser, "extremes")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
