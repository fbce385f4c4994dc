"""Scenes from the ends of what a file may ask for: what becomes of each, and the laws they obey.

    python reports/extremes.py [--count N] [--checked N] [--seconds S] [--out DIR]

Scenes are drawn with a seed (`reports.extremes_scenes`). Those that end as ``unstable`` because
the film will not carry the compression are solved again as films that wrinkle. The first converged
ones are solved once more to a tenth of the tolerance. Rows are kept, and found again.
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
from pvdf_fem.newton import Status  # noqa: E402
from pvdf_fem.page import Cell, Column, Page, Picture, Section, Table  # noqa: E402
from pvdf_fem.tension_newton import barely_loaded  # noqa: E402
from reports.extremes_figures import draw_scenes, draw_times  # noqa: E402
from reports.extremes_laws import laws  # noqa: E402
from reports.extremes_runs import TIME_LIMIT, Row, rows  # noqa: E402
from reports.extremes_scenes import SEED, scenes  # noqa: E402
from reports.options import number_of  # noqa: E402

FINER = 0.1
#: Results may differ from finer ones by so many times their estimated error.
TRUST = 10.0


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, check, write the page; 0 if nothing crashed and no result was wrong."""
    options = _options(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    given = scenes(options.count)
    first = _kept("drawn", given, options)
    again = [n for n, row in enumerate(first) if row.status == Status.UNSTABLE]
    wrinkling = {"film.bending": False, "film.compression": "tension-field"}
    second = _kept("wrinkling", [given[n].with_(**wrinkling) for n in again], options)
    best_scenes, best = list(given), list(first)
    for n, row in zip(again, second, strict=True):
        best_scenes[n], best[n] = given[n].with_(**wrinkling), row
    checked = [n for n, row in enumerate(best) if row.converged][: options.checked]
    finer = _kept("finer", [_finer(best_scenes[n]) for n in checked], options)
    excess = [_excess(best[n], row) for n, row in zip(checked, finer, strict=True)]
    wrong = [n for n, e in zip(checked, excess, strict=True) if e > TRUST]
    sections = [
        _shares(given, first, best),
        _counts(given, first, best),
        _pictures(given, best, options.out),
        _unfinished(given, best),
        _trust(checked, excess, wrong),
        laws(),
    ]
    for section in sections:
        for table in section.tables:
            table.write_csv(options.out)
    introduction = f"{len(given)} scenes drawn with the seed {SEED}; times are of one thread."
    print(Page("Scenes of extreme proportions", [introduction], sections).write(options.out))
    return 1 if wrong or any(row.status == "crashed" for row in best) else 0


def _finer(scene: Scene) -> Scene:
    return scene.with_(**{"numerics.tolerance": FINER * scene.numerics.tolerance})


def _excess(row: Row, finer: Row) -> float:
    """Largest difference of a charge over its estimated errors; NaN without a finer result."""
    if not finer.converged:
        return np.nan
    charges, better = np.array(row.charges_pC), np.array(finer.charges_pC)
    errors = np.array(row.errors_pC) + np.array(finer.errors_pC)
    floor = 1e-6 * np.abs(better).max()
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


def _unfinished(given: list[Scene], best: list[Row]) -> Section:
    columns = [
        Column("number", "scene", 0),
        Column("film", "film"),
        Column("status", "status"),
        Column("reason", "reason"),
        Column("seconds", "seconds"),
    ]
    cells: list[list[Cell]] = [
        [n, _group(scene), row.status, row.reason.splitlines()[-1], row.seconds]
        for n, (scene, row) in enumerate(zip(given, best, strict=True))
        if not row.converged
    ]
    table = Table("extremes-unfinished", "Scenes without a result.", columns, cells)
    return Section("unfinished", "Without a result", (), [table])


def _trust(checked: list[int], excess: list[float], wrong: list[int]) -> Section:
    known = [e for e in excess if np.isfinite(e)]
    text = f"{len(checked)} results compared with those at a tenth of the tolerance"
    if known:
        text += (
            f", of which {len(known)} could be had: differences are {np.median(known):.2f} times"
            f" the estimated errors in the median, {max(known):.1f} times at the most;"
            f" {len(wrong)} above {TRUST:g} times: {wrong}"
        )
    return Section("errors", "Estimated errors", [text + "."])


def _kept(name: str, wanted: list[Scene], options: argparse.Namespace) -> list[Row]:
    """Rows of scenes; those in the file of earlier runs with the same scenes are not made again."""
    path: Path = options.out / f"extremes-{name}.jsonl"
    known: dict[str, Row] = {}
    for line in path.read_text().splitlines() if path.exists() else []:
        entry = json.loads(line)
        row: dict[str, Any] = entry["row"]
        row |= {name: tuple(value) for name, value in row.items() if isinstance(value, list)}
        known[entry["scene"]] = Row(**row)
    keys = [scene.model_dump_json() for scene in wanted]
    missing = [n for n, key in enumerate(keys) if key not in known]
    with path.open("a", encoding="utf-8") as stream:

        def keep(number: int, row: Row) -> None:
            key = keys[missing[number]]
            known[key] = row
            stream.write(json.dumps({"scene": key, "row": asdict(row)}) + "\n")
            stream.flush()
            print(
                f"{name} {number + 1}/{len(missing)} {row.status} {row.seconds:.1f} s", flush=True
            )

        rows([wanted[n] for n in missing], keep, options.seconds)
    return [known[key] for key in keys]


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="reports/extremes.py", description="Scenes from the ends of every range."
    )
    parser.add_argument("--count", type=number_of("scenes"), default=2000, metavar="N")
    parser.add_argument("--checked", type=number_of("scenes"), default=200, metavar="N")
    parser.add_argument("--seconds", type=float, default=TIME_LIMIT, metavar="S")
    parser.add_argument("--out", type=Path, default=ROOT / "reports" / "out", metavar="DIR")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
