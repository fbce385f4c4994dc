"""Scenes from the ends of what a file may ask for: what becomes of each, and the laws they obey.

    python reports/extremes.py [--seed N] [--count N] [--checked N] [--seconds S] [--out DIR]

Scenes are drawn with a seed (`reports.extremes_scenes`). Those that end as ``unstable`` or at a
limit point, where the film may be asked to carry compression, are solved again as films that
wrinkle, without bending.
Some of those with a result are solved once more to a tenth of the tolerance: the first with
bending and the first without, so many of each. Rows are kept, and found again by later runs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # when run as a script, only its own directory is there
    sys.path.insert(0, str(ROOT))

from pvdf_fem import Scene  # noqa: E402
from pvdf_fem.bending_effect import bending_joins  # noqa: E402
from pvdf_fem.newton import Status  # noqa: E402
from pvdf_fem.page import Cell, Column, Page, Picture, Section, Table  # noqa: E402
from pvdf_fem.program import ArgumentParser, run_program  # noqa: E402
from pvdf_fem.tension_newton import barely_loaded  # noqa: E402
from reports.extremes_figures import draw_scenes, draw_times  # noqa: E402
from reports.extremes_laws import laws  # noqa: E402
from reports.extremes_runs import CRASHED, DIED, HUNG, TIME_LIMIT, Row, rows  # noqa: E402
from reports.extremes_scenes import SEED, scenes  # noqa: E402
from reports.options import number_of  # noqa: E402

FINER = 0.1
#: Results may differ from finer ones by so many times their estimated error.
TRUST = 10.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, check, write the page; 0 if nothing crashed and no result was wrong."""
    options = _options(arguments)
    return run_program("reports/extremes.py", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    given = scenes(options.count, options.seed)
    first = _kept("drawn", given, options)
    again = [n for n, row in enumerate(first) if row.status in (Status.UNSTABLE, Status.LIMIT)]
    wrinkling = {"film.bending": False, "film.compression": "tension-field"}
    second = _kept("wrinkling", [given[n].with_(**wrinkling) for n in again], options)
    best_scenes, best = list(given), list(first)
    for n, row in zip(again, second, strict=True):
        best_scenes[n], best[n] = given[n].with_(**wrinkling), row
    checked = _to_check(best_scenes, best, options.checked)
    finer = _kept("finer", [_finer(best_scenes[n]) for n in checked], options)
    excess = [_excess(best[n], row) for n, row in zip(checked, finer, strict=True)]
    wrong = [n for n, e in zip(checked, excess, strict=True) if e > TRUST]
    sections = [
        _shares(given, first, best),
        _counts(given, first, best),
        _pictures(given, best, options.out),
        _unfinished(given, first, best),
        _trust(best_scenes, checked, excess, wrong),
        laws(),
    ]
    for section in sections:
        for table in section.tables:
            table.write_csv(options.out)
    drawn = f"{len(given)} scenes drawn with the seed {options.seed}; times are of one thread."
    print(Page("Scenes of extreme proportions", [drawn], sections).write(options.out))
    bad = (CRASHED, DIED, HUNG)
    return 1 if wrong or any(row.status in bad for row in [*first, *best]) else 0


def _to_check(given: list[Scene], best: list[Row], count: int) -> list[int]:
    """The first results with bending and those without, `count` in all."""
    converged = [n for n, row in enumerate(best) if row.converged]
    bent = [n for n in converged if bending_joins(given[n])]
    plain = [n for n in converged if n not in bent]
    some = min(len(bent), max(count // 2, count - len(plain)))
    return sorted(bent[:some] + plain[: count - some])


def _finer(scene: Scene) -> Scene:
    return scene.with_(**{"numerics.tolerance": FINER * scene.numerics.tolerance})


def _excess(row: Row, finer: Row) -> float:
    """Largest difference of a charge over its estimated errors; NaN without a finer result."""
    if not finer.converged:
        return np.nan
    charges, better = np.array(row.charges_pC), np.array(finer.charges_pC)
    errors = np.array(row.errors_pC) + np.array(finer.errors_pC)
    floor = max(1e-6 * np.abs(better).max(), np.finfo(float).tiny)
    return float((np.abs(charges - better) / np.maximum(errors, floor)).max())


def _group(scene: Scene) -> str:
    if scene.film.temperature_change_K > 0.0:
        return "hot, barely loaded" if barely_loaded(scene) else "hot"
    return "cold" if scene.film.temperature_change_K < -1e-6 else "without pretension"


def _shares(given: list[Scene], first: list[Row], best: list[Row]) -> Section:
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
    groups = [_group(scene) for scene in given]
    for name in sorted(set(groups)):
        these = [n for n, group in enumerate(groups) if group == name]
        drawn = sum(first[n].converged for n in these)
        finally_ = [n for n in these if best[n].converged]
        most = max((best[n].iterations for n in finally_), default=0)
        longest = max(max(first[n].seconds, best[n].seconds) for n in these)
        more, share = len(finally_) - drawn, 100.0 * len(finally_) / len(these)
        cells.append([name, len(these), drawn, more, share, most, longest])
    text = "A film in compression has no minimum of the energy unless it may wrinkle."
    table = Table("extremes-shares", "How many have a result.", columns, cells)
    return Section("shares", "Results", [text], [table])


def _counts(given: list[Scene], first: list[Row], best: list[Row]) -> Section:
    found: Counter[tuple[str, str, str]] = Counter()
    for scene, before, after in zip(given, first, best, strict=True):
        found[_group(scene), before.status, after.status] += 1
    columns = [
        Column("group", "film"),
        Column("drawn", "as drawn"),
        Column("status", "finally"),
        Column("scenes", "scenes", 0),
    ]
    table = Table(
        "extremes-counts",
        "What became of them.",
        columns,
        [[*key, count] for key, count in sorted(found.items())],
    )
    done = [row for row in best if row.converged]
    if not done:
        return Section("counts", "Endings", ["None converged."], [table])
    text = (
        f"Of {len(done)} results: at most {max(row.iterations for row in done)} Newton iterations"
        f" on the last mesh, {max(row.seconds for row in done):.1f} s (median"
        f" {np.median([row.seconds for row in done]):.2f} s), force balance to"
        f" {max(row.force_balance for row in done):.1e}, residual over load"
        f" {max(row.residual for row in done):.1e}. Any scene took at most"
        f" {max(row.seconds for row in best):.1f} s."
    )
    return Section("counts", "Endings", [text], [table])


def _pictures(given: list[Scene], best: list[Row], out: Path) -> Section:
    draw_scenes(given, best, out / "extremes-status.png")
    draw_times(best, out / "extremes-times.png")
    return Section(
        "regions",
        "Where",
        (),
        [
            Picture("extremes-status.png", "Endings by the load and the pretension of the film."),
            Picture("extremes-times.png", "Seconds against unknowns."),
        ],
    )


def _unfinished(given: list[Scene], first: list[Row], best: list[Row]) -> Section:
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
            _group(scene),
            scene.load.kind,
            before.status,
            row.status,
            row.reason.strip().splitlines()[-1],
            row.seconds,
        ]
        for n, (scene, before, row) in enumerate(zip(given, first, best, strict=True))
        if not row.converged
    ]
    table = Table("extremes-unfinished", "Scenes without a result.", columns, cells)
    return Section("unfinished", "Without a result", (), [table])


def _trust(
    given: list[Scene], checked: list[int], excess: list[float], wrong: list[int]
) -> Section:
    columns = [
        Column("film", "film"),
        Column("compared", "compared", 0),
        Column("known", "with a result at a tenth of the tolerance", 0),
        Column("median", "difference over estimated error, median", 2),
        Column("largest", "largest", 1),
        Column("above", f"above {TRUST:g}", 0),
    ]
    bent = [bending_joins(given[n]) for n in checked]
    kinds = {
        "with bending": bent,
        "that wrinkles": [given[n].film.compression == "tension-field" for n in checked],
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
    return Section(
        "errors", "Estimated errors", [text], [Table("extremes-errors", caption, columns, cells)]
    )


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

        rows([wanted[n] for n in missing], keep, options.seconds)
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
        prog="reports/extremes.py", description="Scenes from the ends of every range."
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
    parser.add_argument(
        "--out",
        type=Path,
        default=ROOT / "reports" / "out" / "extremes",
        metavar="DIR",
        help="output directory",
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
