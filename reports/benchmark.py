"""Medians of the run times of the fixed scenes, and their ratios to an earlier run.

    python -m reports.benchmark [--save FILE.json] [--against FILE.json] [--rounds N]

Prints one line for each scene and tolerance: the median seconds of a solve on one thread (imports
not included) in units of one factorisation of a fixed matrix, which makes machines comparable, and,
with ``--against``, the ratio to those of a file that ``--save`` wrote before a change.
"""

from __future__ import annotations

import os

# All codes run on one thread, which numpy reads from the environment when it is imported.
for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"

import argparse  # noqa: E402
import json  # noqa: E402
import math  # noqa: E402
import statistics  # noqa: E402
import sys  # noqa: E402
import time  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from functools import partial  # noqa: E402
from pathlib import Path  # noqa: E402

from pvdf_fem import Solution, solve  # noqa: E402
from pvdf_fem.cli.program import ArgumentParser, InputError, run_program  # noqa: E402
from pvdf_fem.files import read_text, replacing, require_writable  # noqa: E402
from pvdf_fem.film.equilibrium import Equilibrium  # noqa: E402
from pvdf_fem.mesh.gmsh_mesh import mesh_scene, outlines  # noqa: E402
from pvdf_fem.mesh.size_field import Sizes  # noqa: E402
from pvdf_fem.solvers.newton import factorise  # noqa: E402
from pvdf_fem.solvers.seed import seed  # noqa: E402
from pvdf_fem.solvers.status import Status  # noqa: E402
from reports.common.options import number_of  # noqa: E402
from reports.speed.cases import CASES, cases_named  # noqa: E402

#: Tolerances of the charges at which every scene is timed.
TOLERANCES = (1e-3, 1e-5)


def main(arguments: Sequence[str] | None = None) -> int:
    """Time all scenes, print and save the medians; returns 1 if a solve did not converge."""
    options = _options(arguments)
    return run_program("reports.benchmark", lambda: _benchmark(options))


def _benchmark(options: argparse.Namespace) -> int:
    earlier = _medians(options.against) if options.against else {}
    if options.save:
        require_writable(options.save, options.against)
    unknowns, unit = yardstick(options.rounds)
    print(f"one factorisation of {unknowns} unknowns, SuperLU: {unit:.3f} s")
    medians, failed = {}, []
    for case in CASES:
        if options.case and case.name not in options.case:
            continue
        for tolerance in TOLERANCES:
            name = f"{case.name}, {tolerance:g}"
            seconds, status = _timed(
                partial(solve, case.scene.with_(**{"numerics.tolerance": tolerance})),
                options.rounds,
            )
            if status is not Status.CONVERGED:
                failed.append(name)
                print(f"{name:<20} {status}")
                continue
            medians[name] = seconds / unit
            print(_line(name, seconds, medians[name], earlier.get(name)))
    for text in _summary(medians, earlier):
        print(text)
    if options.save:
        with replacing(options.save) as part:
            part.write_text(json.dumps({"unit_seconds": unit, "medians": medians}, indent=1))
    return 1 if failed else 0


def _medians(path: Path, most_bytes: int = 1_000_000) -> dict[str, float]:
    """The medians in a saved file of at most `most_bytes`."""
    text = read_text(path, most_bytes, "a file that --save wrote")
    try:
        saved = json.loads(text)["medians"]
        if all(isinstance(v, float) and math.isfinite(v) and v > 0 for v in saved.values()):
            return dict(saved)
    except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
        pass
    raise InputError(f"{path}: has no medians; give a file that --save wrote")


def yardstick(
    rounds: int, patch_m: float = 1.3e-3, growth: float = 0.35, film_m: float = 6.0e-3
) -> tuple[int, float]:
    """Unknowns of a fixed tangent, and the median seconds of its factorisation.

    The default edge lengths `patch_m` on outlines and `film_m` elsewhere, with the growth between
    them, give about 5,500 unknowns at order 2.
    """
    [case] = cases_named(["triangle"])
    sizes = Sizes(dict.fromkeys(outlines(case.scene), patch_m), growth, film_m)
    equilibrium = Equilibrium(case.scene, mesh_scene(case.scene, sizes), 2)
    tangent = equilibrium.tangent(equilibrium.state(seed(equilibrium)))
    seconds = []
    for _ in range(max(rounds, 3)):
        start = time.perf_counter()
        factorise(tangent)
        seconds.append(time.perf_counter() - start)
    return equilibrium.unknowns.count, statistics.median(seconds)


def _timed(
    run: Callable[[], Solution], rounds: int, long_seconds: float = 5.0
) -> tuple[float, Status]:
    """Median seconds of `rounds` solves, or of fewer when one takes more than `long_seconds`."""
    seconds = []
    for _ in range(rounds):
        solution = run()
        if solution.status is not Status.CONVERGED:
            return 0.0, solution.status
        seconds.append(solution.seconds["total"])
        if seconds[-1] > long_seconds:
            break
    return statistics.median(seconds), Status.CONVERGED


def _line(name: str, seconds: float, units: float, before: float | None) -> str:
    ratio = f"  {units / before:6.2f} times the earlier" if before else ""
    return f"{name:<20} {seconds:8.3f} s {units:8.2f} factorisations{ratio}"


def _summary(medians: dict[str, float], earlier: dict[str, float]) -> list[str]:
    sentences = []
    for tolerance in TOLERANCES:
        names = [name for name in medians if name.endswith(f", {tolerance:g}")]
        if not names:
            continue
        median = statistics.median(medians[name] for name in names)
        ratios = [medians[name] / earlier[name] for name in names if name in earlier]
        mean = f", {statistics.geometric_mean(ratios):.2f} times the earlier" if ratios else ""
        sentences.append(f"{tolerance:g}: median {median:.2f} factorisations{mean}")
    return sentences


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.benchmark", description="Median run times of a fixed set of scenes."
    )
    parser.add_argument("--save", type=Path, metavar="FILE", help="write the medians (JSON)")
    parser.add_argument("--against", type=Path, metavar="FILE", help="compare with saved medians")
    parser.add_argument(
        "--rounds", type=number_of("rounds"), default=5, metavar="N", help="default: 5"
    )
    names = [case.name for case in CASES]
    parser.add_argument(
        "--case", action="append", choices=names, help="only this scene; repeatable"
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
