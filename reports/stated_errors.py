"""Stated errors beside true ones, on scenes of usual proportions.

    python -m reports.stated_errors [--seed N] [--scenes N] [--out DIR] [--processes N]

Draws scenes of two groups, rigid probes and all others (`reports.robustness.usual_scenes`), and
solves each to its tolerance and to a thirtieth of it. The page tells how far charges are from the
finer ones, over the tolerance and over the errors stated. Endings are kept in the output folder, so
that a run goes on where it was. 600 scenes take about an hour of one core.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.arrays import Array
from pvdf_fem.cli.program import ArgumentParser, run_program
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Cell, Column, Page, Picture, Section, Table
from reports.robustness.figures import draw_errors
from reports.robustness.runs import Ending, kept_endings
from reports.robustness.usual_scenes import KINDS, SEED, usual_scene

#: How much finer the tolerance of the comparison is.
FINER = 30.0
#: A charge beyond this multiple of the tolerance, or an error stated below this part, is wrong.
MOST_OVER_TOLERANCE = 1.3
LEAST_STATED = 0.2
#: A difference tells the true error if it is this multiple of the finer result's own error.
TELLING = 2.0


@dataclass(frozen=True, eq=False)
class Comparison:
    """Charges of a scene beside finer ones."""

    scene: Scene
    #: Relative errors and those stated, over the tolerance, (electrodes,).
    true: Array
    stated: Array
    #: Whether the tolerance is relative to the charge, which does not cancel, (electrodes,).
    relative: Array
    #: Whether the finer charge is accurate enough to tell, (electrodes,).
    telling: Array

    @classmethod
    def of(cls, scene: Scene, ending: Ending, finer: Ending) -> Comparison:
        """From two converged endings."""
        charges, better = np.array(ending.charges_pC), np.array(finer.charges_pC)
        differences, units = np.abs(charges - better), scene.numerics.tolerance * np.abs(better)
        warned = [
            any(text.startswith(f"charge {electrode.name}:") for text in ending.warnings)
            for electrode in scene.electrode_list
        ]
        return cls(
            scene,
            differences / units,
            np.array(ending.errors_pC) / units,
            ~np.array(warned),
            differences > TELLING * np.array(finer.errors_pC),
        )

    @property
    def worst(self) -> float:
        """Largest error over the tolerance."""
        return float(self.true[self.relative].max(initial=0.0))

    @property
    def least_stated(self) -> float:
        """Least stated error over the true one."""
        ratios = self.stated[self.telling] / self.true[self.telling]
        return float(ratios.min(initial=np.inf))


def main(arguments: Sequence[str] | None = None) -> int:
    """Solve, compare and write the page; returns 1 if a charge or a stated error is wrong."""
    options = _options(arguments)
    return run_program("reports.stated_errors", lambda: _report(options))


def _report(options: argparse.Namespace) -> int:
    options.out.mkdir(parents=True, exist_ok=True)
    groups = {group: _compared(group, options) for group in KINDS}
    draw_errors(
        {group: [(c.true, c.stated) for c in compared] for group, compared in groups.items()},
        options.out / "stated-errors.png",
    )
    picture = Picture("stated-errors.png", "Every charge: its stated error against the true one.")
    sections = [_table(groups, options), Section("charges", "Charges", (), [picture])]
    for section in sections:
        section.write_tables(options.out)
    text = (
        f"Scenes drawn with the seed {options.seed}; true errors are against {FINER:g} times finer."
    )
    print(Page("Stated and true errors", [text], sections).write(options.out))
    return int(any(_wrong(c) for compared in groups.values() for c in compared))


def _wrong(comparison: Comparison) -> bool:
    too_large = comparison.worst > MOST_OVER_TOLERANCE
    return too_large or comparison.least_stated < LEAST_STATED


def _compared(group: str, options: argparse.Namespace) -> list[Comparison]:
    """The scenes of a group that converge to both tolerances."""
    scenes = [usual_scene(group, number, options.seed) for number in range(options.scenes)]
    finer = [
        scene.with_(**{"numerics.tolerance": scene.numerics.tolerance / FINER}) for scene in scenes
    ]
    first, second = (
        kept_endings(options.out / f"stated-{group}-{name}.jsonl", asked, 600.0, options.processes)
        for name, asked in (("drawn", scenes), ("finer", finer))
    )
    return [
        Comparison.of(scene, ending, better)
        for scene, ending, better in zip(scenes, first, second, strict=True)
        if ending.converged and better.converged
    ]


def _table(groups: dict[str, list[Comparison]], options: argparse.Namespace) -> Section:
    columns = [
        Column("group", "scenes"),
        Column("drawn", "drawn", 0),
        Column("compared", "converged to both", 0),
        Column("median", "worst error over the tolerance, median", 2),
        Column("largest", "largest", 2),
        Column("above", f"above {MOST_OVER_TOLERANCE:g}", 0),
        Column("stated", "least stated error over the true one", 2),
        Column("below", f"below {LEAST_STATED:g}", 0),
    ]
    cells: list[list[Cell]] = []
    for group, compared in groups.items():
        worst = np.array([c.worst for c in compared] or [np.nan])
        stated = np.array([c.least_stated for c in compared] or [np.nan])
        above, below = (worst > MOST_OVER_TOLERANCE).sum(), (stated < LEAST_STATED).sum()
        spread = [float(np.median(worst)), float(worst.max()), int(above)]
        cells.append([group, options.scenes, len(compared), *spread, stated.min(), int(below)])
    caption = "Errors of the worst charge of each scene, and the least of the stated errors."
    return Section("counts", "Counts", (), [Table("stated-errors", caption, columns, cells)])


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.stated_errors", description="Stated errors beside true ones."
    )
    parser.add_argument("--seed", type=number_of("seed", 10**9), default=SEED, metavar="N")
    parser.add_argument(
        "--scenes",
        type=number_of("scenes", 100_000),
        default=300,
        metavar="N",
        help="number of scenes of each group (default: 300)",
    )
    add_out(parser, "stated_errors")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
