"""Positions from charges: the thesis's triangulation beside maximum likelihood.

    python -m reports.locate [--out DIR] [--touches N] [--quick] [--processes N]

Writes ``index.html`` with figures (SVG) and tables (CSV): the thesis's scenes, random touches with
exact and noisy charges, and maps of resolution and ambiguity. Models and solved scenes are kept in
``results/`` beside them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from pvdf_fem import Scene, __version__
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.files import make_directory
from reports.common.figures import preview
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Page
from reports.common.results import MATERIAL, Results
from reports.locating.errors import WAYS, Trial, random_touches
from reports.locating.models import (
    DISC,
    FORCES_N,
    REACH_MM,
    TOLERANCE,
    Position,
    charges_of,
    electrodes_of,
    printed_positions,
    response_of,
    scene_at,
    sensor,
)
from reports.locating.page import (
    LAYOUT,
    SHAPES,
    Models,
    map_section,
    random_section,
    thesis_section,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Scope:
    """How much is compared.

    Attributes
    ----------
    touches : int
        Number of random touches of each probe.
    reach_mm : float
        Radius of the disc on which models and random touches lie.
    forces_N : tuple of float
        Smallest and largest force of models and random touches.
    map_across : int
        Number of places across a map.
    """

    touches: int = 500
    reach_mm: float = REACH_MM
    forces_N: tuple[float, float] = FORCES_N
    map_across: int = 20


FULL = Scope()
QUICK = Scope(touches=8, reach_mm=7.0, forces_N=(0.5, 2.0), map_across=4)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare the ways and write the page; returns 0, or 1 if a solve failed."""
    options = _options(arguments)
    with preview(options.quick):
        return run_program("reports.locate", lambda: _compare(options))


def _compare(options: argparse.Namespace) -> int:
    make_directory(options.out, "index.html")
    scope = QUICK if options.quick else FULL
    scope = replace(scope, touches=options.touches or scope.touches)
    positions = printed_positions()[:: 16 if options.quick else 1]
    results = Results(options.out / "results", options.processes)
    models = _models(positions, results, scope)
    touches = {
        probe: random_touches(scope.touches, seed, scope.reach_mm, scope.forces_N)
        for seed, probe in enumerate(SHAPES, start=1)
        if (probe, "biaxial") in models
    }
    scenes = _scenes(positions, touches)
    with tqdm(total=results.missing(scenes), unit="solve", disable=None) as bar:
        results.solve(scenes, lambda solved, total: bar.update(1 if solved else 0))
    trials = {probe: _trial(probe, rows, models, results) for probe, rows in touches.items()}
    sections = [
        thesis_section(positions, models, results),
        *(
            random_section(probe, trial, scope.touches, options.out, options.processes)
            for probe, trial in trials.items()
        ),
        map_section(models, scope.reach_mm, scope.map_across, options.out, options.processes),
    ]
    for section in sections:
        section.write_tables(options.out)
    provenance = {"pvdf_fem": __version__, "Tolerance": f"{TOLERANCE:g} (relative, each charge)"}
    title = "Position, force and rotation from charges"
    page = Page(title, _introduction(), sections, provenance, options.quick)
    print(page.write(options.out))
    return 0 if all(results[scene].converged for scene in scenes) else 1


def _models(positions: Sequence[Position], results: Results, scope: Scope) -> Models:
    """Response models of the thesis's probes and films, and of the disc on biaxial film."""
    sensors = {(position.probe, position.film) for position in positions}
    return {
        (probe, film): response_of(
            sensor(probe, film),
            results.folder,
            results.processes,
            scope.reach_mm,
            scope.forces_N,
        )
        for probe, film in sorted(sensors | {(DISC, "biaxial")})
    }


def _introduction() -> list[str]:
    ways = "; ".join(f"{way}: {text}" for way, text in WAYS.items())
    return [
        f"Charges come from the finite-element model (follower pressure, {MATERIAL} observable, "
        f"tolerance {TOLERANCE:g}), places from a response model of them. {ways}.",
        "Noise is relative, normal and independent between electrodes. The Cramér-Rao bound is the "
        "covariance that no unbiased way can fall below, at the true touch.",
    ]


def _scenes(positions: Sequence[Position], touches: dict[str, Array]) -> list[Scene]:
    printed = [scene_at(p.probe, p.film, p.touch) for p in positions]
    random_scenes = [scene_at(n, "biaxial", row) for n, rows in touches.items() for row in rows]
    return [*printed, *random_scenes]


def _trial(probe: str, touches: Array, models: Models, results: Results) -> Trial:
    """The touches whose solve converged, with their charges."""
    names = electrodes_of(LAYOUT)
    scenes = [scene_at(probe, "biaxial", row) for row in touches]
    converged = np.array([results[scene].converged for scene in scenes], dtype=bool)
    charges = [charges_of(results, scenes[k], names) for k in np.flatnonzero(converged)]
    return Trial(models[probe, "biaxial"], names, touches[converged], np.array(charges))


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.locate",
        description="Compare the thesis's triangulation with maximum likelihood.",
    )
    add_out(parser, "locate")
    parser.add_argument(
        "--touches",
        type=number_of("touches"),
        metavar="N",
        help=f"random touches of each probe (default: {FULL.touches}, quick: {QUICK.touches})",
    )
    parser.add_argument("--quick", action="store_true", help="few scenes, a small domain")
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
