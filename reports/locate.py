"""Positions from charges: the thesis's triangulation beside maximum likelihood.

    python reports/locate.py [--out DIR] [--touches N] [--quick] [--processes N]

Writes ``index.html`` with figures (SVG) and tables (CSV): the thesis's scenes, random touches with
exact and noisy charges, and maps of resolution and ambiguity. Models and solved scenes are kept in
``results/`` beside them.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[1]
if str(ROOT) not in sys.path:  # when run as a script, only its own directory is there
    sys.path.insert(0, str(ROOT))

from pvdf_fem import Scene, __version__  # noqa: E402
from pvdf_fem.figures import COLOURS, new_figure, save, style  # noqa: E402
from pvdf_fem.files import make_directory  # noqa: E402
from pvdf_fem.page import Cell, Column, Page, Picture, Section, Table  # noqa: E402
from pvdf_fem.program import ArgumentParser, run_program  # noqa: E402
from pvdf_fem.sensing.locate import locate  # noqa: E402
from pvdf_fem.sensing.response import Response  # noqa: E402
from pvdf_fem.sensing.touch import QUANTITIES  # noqa: E402
from reports.locate_errors import (  # noqa: E402
    FREE,
    LEAST_SIGMA,
    LOCATED,
    NOISES,
    SOUGHT,
    TRIANGULATED,
    TURNED,
    WAYS,
    Errors,
    Listed,
    Trial,
    bounds_mm,
    fractions,
    listed,
    located,
    random_touches,
    triangulated,
)
from reports.locate_maps import (  # noqa: E402
    FORCE_N,
    Place,
    ambiguity_picture,
    judged,
    lattice,
    resolution_picture,
)
from reports.locate_models import (  # noqa: E402
    FORCES_N,
    REACH_MM,
    electrodes_of,
    placed,
    response_of,
    sensor,
)
from reports.options import number_of  # noqa: E402
from reports.results import MATERIAL, Results  # noqa: E402
from reports.thesis_data import Position, Thesis  # noqa: E402

Array = NDArray[np.float64]

#: Relative error of the finite-element charges.
TOLERANCE = 1e-4
SHAPES = {"tri7": "triangle", "rect14x7": "rectangle"}
MAP_NOISE = 0.01
# Electrodes of the random touches and the maps.
LAYOUT = "4"


@dataclass(frozen=True)
class Scope:
    """How much is compared.

    Attributes
    ----------
    touches : int
        Random ones of each probe.
    reach_mm : float
    forces_N : tuple of float
        The domain of the models and of these touches.
    map_across : int
        Places across a map.
    """

    touches: int = 500
    reach_mm: float = REACH_MM
    forces_N: tuple[float, float] = FORCES_N
    map_across: int = 20


FULL, QUICK = Scope(), Scope(8, 7.0, (0.5, 2.0), 4)


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare; returns 0, or 1 if a solve failed."""
    options = _options(arguments)
    return run_program("reports/locate.py", lambda: _compare(options))


def _compare(options: argparse.Namespace) -> int:
    make_directory(options.out, "index.html")
    scope = QUICK if options.quick else FULL
    scope = replace(scope, touches=options.touches or scope.touches)
    thesis = Thesis.read().quick() if options.quick else Thesis.read()
    results = Results(options.out / "results", options.processes)
    models = {
        (probe, film): response_of(
            sensor(thesis, probe, film),
            results.folder,
            options.processes,
            scope.reach_mm,
            scope.forces_N,
        )
        for probe, film in sorted({(p.probe, p.film) for p in thesis.positions})
    }
    touches = {
        probe: random_touches(scope.touches, seed, scope.reach_mm, scope.forces_N)
        for seed, probe in enumerate(SHAPES, start=1)
        if (probe, "biaxial") in models
    }
    scenes = _scenes(thesis, touches)
    with tqdm(total=results.missing(scenes), unit="solve", disable=None) as bar:
        results.solve(scenes, lambda done, total: bar.update(1 if done else 0))
    trials = {
        probe: _trial(thesis, probe, rows, models, results) for probe, rows in touches.items()
    }
    sections = [
        _thesis_section(thesis, models, results),
        *(
            _random_section(probe, trial, scope.touches, options.out, options.processes)
            for probe, trial in trials.items()
        ),
        _map_section(models, scope, options.out, options.processes),
    ]
    for section in sections:
        for table in section.tables:
            table.write_csv(options.out)
    page = Page("Position, force and rotation from charges", _introduction(), sections, _made())
    print(page.write(options.out))
    return 0 if all(results[scene].converged for scene in scenes) else 1


def _introduction() -> list[str]:
    told = "; ".join(f"{way}: {text}" for way, text in WAYS.items())
    return [
        f"Charges come from the finite-element model (follower pressure, {MATERIAL} observable, "
        f"tolerance {TOLERANCE:g}), places from a response model of them. {told}.",
        "Noise is relative, normal and independent between electrodes. The Cramér-Rao bound is the "
        "covariance that no unbiased way can fall below, at the true touch.",
    ]


def _made() -> dict[str, str]:
    return {"pvdf_fem": __version__, "Tolerance": f"{TOLERANCE:g} (relative, each charge)"}


def _scene(thesis: Thesis, probe: str, film: str, touch: Array) -> Scene:
    scene = sensor(thesis, probe, film).with_(**{"numerics.tolerance": TOLERANCE})
    return placed(scene, touch)


def _scenes(thesis: Thesis, touches: dict[str, Array]) -> list[Scene]:
    printed = [_scene(thesis, p.probe, p.film, _touch(p)) for p in thesis.positions]
    drawn = [_scene(thesis, n, "biaxial", row) for n, rows in touches.items() for row in rows]
    return [*printed, *drawn]


def _touch(row: Position) -> Array:
    return np.array([row.x_mm, row.y_mm, row.rotation_deg, row.force_N])


Models = dict[tuple[str, str], Response]


def _trial(thesis: Thesis, probe: str, touches: Array, models: Models, results: Results) -> Trial:
    """Of the touches whose solve converged."""
    names = electrodes_of(LAYOUT)
    scenes = [_scene(thesis, probe, "biaxial", row) for row in touches]
    good = np.array([results[scene].converged for scene in scenes], dtype=bool)
    charges = [_charges(results, scenes[k], names) for k in np.flatnonzero(good)]
    return Trial(models[probe, "biaxial"], names, touches[good], np.array(charges))


def _charges(results: Results, scene: Scene, names: dict[str, str]) -> list[float]:
    film, record = scene.film, results[scene]
    charges = record.charges_pC(film.d31_pC_N, film.d32_pC_N, MATERIAL)
    return [charges[own] for own in names.values()]


# --------------------------------------------------------------------------- the thesis's scenes


def _thesis_section(thesis: Thesis, models: Models, results: Results) -> Section:
    rows = [_thesis_row(thesis, p, models[p.probe, p.film], results) for p in thesis.positions]
    columns = [
        Column("case", "case"),
        Column("place", "place"),
        Column("printed_mm", "printed error (mm)", 3),
        Column("unturned_mm", "unturned", 3, "triangulation (mm)"),
        Column("turned_mm", "turned", 3, "triangulation (mm)"),
        Column("located_mm", "error (mm)", 4, "locate"),
        Column("force_percent", "error of the force (%)", 3, "locate", True),
        Column("deviation_mm", "σ at 1 % noise (mm)", 3, "locate"),
        Column("touches", "likely touches", None, "rotation sought"),
        Column("nearest_mm", "nearest of them (mm)", 3, "rotation sought"),
    ]
    caption = "All positions of the thesis, exact charges."
    table = Table("thesis_scenes", caption, columns, rows)
    errors = np.array([row[5] for row in rows], dtype=float)
    texts = [
        f"Of {len(rows)} scenes locate finds {int(np.isfinite(errors).sum())} with an error of at "
        f"most {np.nanmax(errors):.4f} mm, the force being sought too; the thesis prints "
        f"{sum(np.isnan(p.error_mm) for p in thesis.positions)} as not intersecting.",
    ]
    return Section("thesis-scenes", "The thesis's scenes", texts, [table])


def _thesis_row(thesis: Thesis, row: Position, model: Response, results: Results) -> list[Cell]:
    names, touch = electrodes_of(row.layout), _touch(row)
    charges = _charges(results, _scene(thesis, row.probe, row.film, touch), names)
    trial = Trial(model, names, touch[None], np.array([charges]))
    given = dict(zip(names.values(), charges, strict=True))
    known = {"rotation_deg": row.rotation_deg}
    # three charges and three unknown: several touches may fit; the nearest one is shown
    found = locate(model, given, LEAST_SIGMA, known=known)
    best = min(found.touches, key=lambda one: _distance(one.values, touch))
    sure = judged(model, names, touch[:2], row.rotation_deg, 0.01)[False]
    free = locate(model, given, LEAST_SIGMA, unknown=QUANTITIES)
    return [
        row.case,
        f"{row.probe}, {row.position}",
        row.error_mm,
        float(triangulated(trial, 0.0, False).place_mm[0]),
        float(triangulated(trial, 0.0, True).place_mm[0]),
        _distance(best.values, touch),
        100.0 * (best.force_N / row.force_N - 1.0),
        sure.deviation_mm,
        sum(one.weight > 0.01 for one in free.touches) if len(names) > 3 else "a curve",
        min(_distance(one.values, touch) for one in free.touches),
    ]


def _distance(values: Array, touch: Array) -> float:
    return float(np.hypot(*(values - touch)[:2]))


# -------------------------------------------------------------------------------- random touches


def _random_section(probe: str, trial: Trial, drawn: int, out: Path, processes: int) -> Section:
    jobs: list[tuple[float, str]] = [(noise, way) for noise in NOISES for way in WAYS]
    with_threads = Parallel(processes)
    found: list[Errors] = with_threads(delayed(_by)(trial, noise, way) for noise, way in jobs)
    shape = SHAPES[probe]
    name = f"errors_{shape}"
    _picture(found, trial, out / f"{name}.svg")
    caption = (
        f"{shape}: share of {len(trial.touches)} touches with an error below the abscissa; a curve "
        "that ends below 1 leaves failures. Dotted: Cramér-Rao bound, rotation known."
    )
    count = min(200, len(trial.touches))
    told = listed(trial, count)
    texts = [_sentence(found, trial), _listed_sentence(shape, told)]
    if failed := drawn - len(trial.touches):
        texts.append(f"Left out for want of a solution: {failed} of {drawn} touches.")
    blocks: list[Table | Picture] = [
        Picture(f"{name}.svg", caption),
        _table(name, shape, found, trial),
    ]
    return Section(name, f"Random touches of the {shape}", texts, blocks)


def _by(trial: Trial, noise: float, way: str) -> Errors:
    if way in (TRIANGULATED, TURNED):
        return triangulated(trial, noise, way == TURNED)
    return located(trial, noise, way)


def _sentence(found: Sequence[Errors], trial: Trial) -> str:
    exact = next(e for e in found if e.way == LOCATED and e.noise == 0.0)
    good = (exact.place_mm <= 0.01) & (np.abs(exact.force) <= 0.002)
    noisy = next(e for e in found if e.way == LOCATED and e.noise == 0.01)
    ratio = np.nanmedian(noisy.place_mm) / np.median(bounds_mm(trial, 0.01))
    within, locally = (
        ", ".join(f"{100 * share:.1f} %" for share in each.mean(axis=0))
        for each in (noisy.within, noisy.locally)
    )
    return (
        f"With exact charges and a known rotation, {100 * good.mean():.1f} % of the touches are "
        f"found within 0.01 mm and 0.2 % of the force; {int(np.isnan(exact.place_mm).sum())} are "
        f"not found. With 1 % noise the median error is {ratio:.3f} times that of the Cramér-Rao "
        f"bound, and {within} of the errors of x, y and force are below their stated standard "
        f"deviation (68.3 % if that is right); {locally} are below the one that the likelihood's "
        "curvature at the likeliest touch alone would give."
    )


def _listed_sentence(shape: str, told: Listed) -> str:
    return (
        f"With the rotation of the {shape} unknown and exact charges, the true touch is among "
        f"those listed in {told.found} of {told.touches} cases; in {told.unique} there is no other "
        f"likely one, and in {told.undetermined} a direction is said not to be determined."
    )


def _table(name: str, shape: str, found: Sequence[Errors], trial: Trial) -> Table:
    columns = [
        Column("noise_percent", "noise (%)"),
        Column("way", "way"),
        Column("failed_percent", "failed (%)"),
        Column("median_mm", "median (mm)", 4),
        Column("p90_mm", "90 % (mm)", 3),
        Column("largest_mm", "largest (mm)", 3),
        Column("force_percent", "force (%)", 3),
        Column("bound_mm", "bound (mm)", 4),
        Column("x_percent", "x", 1, "within the stated σ (%)"),
        Column("y_percent", "y", 1, "within the stated σ (%)"),
        Column("within_percent", "force", 1, "within the stated σ (%)"),
    ]
    caption = (
        f"{shape}: errors of the position, percentiles of all touches with failures included; "
        "median error of the force; median by the Cramér-Rao bound."
    )
    return Table(name, caption, columns, list(_error_rows(found, trial)))


def _error_rows(found: Sequence[Errors], trial: Trial) -> Iterator[list[Cell]]:
    for one in found:
        errors = np.where(np.isnan(one.place_mm), np.inf, one.place_mm)
        middle, most = np.quantile(errors, [0.5, 0.9], method="inverted_cdf")
        bound = None
        if one.way in SOUGHT:
            bound = float(np.median(bounds_mm(trial, one.noise, one.way)))
        yield [
            100.0 * one.noise,
            one.way,
            100.0 * float(np.isinf(errors).mean()),
            float(middle) if np.isfinite(middle) else None,
            float(most) if np.isfinite(most) else None,
            float(np.nanmax(one.place_mm)),
            100.0 * float(np.median(np.abs(one.force))) if one.way in (LOCATED, FREE) else None,
            bound,
            *_shares(one),
        ]


def _shares(one: Errors) -> list[Cell]:
    """Percent of the errors of x, y and force within their standard deviations."""
    if not one.within.size:
        return [None, None, None]
    x, y, *others = (100.0 * one.within.mean(axis=0)).tolist()
    return [x, y, others[-1] if others else None]


def _picture(found: Sequence[Errors], trial: Trial, path: Path) -> None:
    shown = (0.0, 0.01, 0.05)
    with style():
        figure = new_figure(170, 80)
        axes = figure.subplots(1, len(shown), sharey=True)
        for ax, noise in zip(axes, shown, strict=True):
            for way, ink in zip(WAYS, COLOURS, strict=False):
                one = next(e for e in found if (e.way, e.noise) == (way, noise))
                ax.plot(*fractions(one.place_mm), color=ink, label=way)
            if noise:
                bound = fractions(bounds_mm(trial, noise, draws=8))
                ax.plot(*bound, ":", color="black", label=f"Cramér-Rao bound of {LOCATED}")
            ax.set(xscale="log", xlim=(1e-2 if noise else 1e-4, 20.0), ylim=(0.0, 1.0))
            ax.set_xlabel("error (mm)")
            ax.set_title("exact charges" if not noise else f"{100 * noise:g} % noise")
        axes[0].set_ylabel("share of the touches")
        figure.legend(*axes[-1].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        save(figure, path)


# ------------------------------------------------------------------------------------------ maps


def _map_section(models: Models, scope: Scope, out: Path, processes: int) -> Section:
    places, names = lattice(scope.reach_mm, scope.map_across), electrodes_of(LAYOUT)
    found: dict[str, list[dict[bool, Place]]] = {
        shape: Parallel(processes)(
            delayed(judged)(models[probe, "biaxial"], names, at, 0.0, MAP_NOISE) for at in places
        )
        for probe, shape in SHAPES.items()
        if (probe, "biaxial") in models
    }
    resolution_picture(places, found, out / "resolution.svg")
    ambiguity_picture(places, found, out / "ambiguity.svg")
    state = f"{FORCE_N:g} N, {100 * MAP_NOISE:g} % noise, probe unturned; squares: electrodes"
    captions = {
        "resolution.svg": "Resolution of the position, by the likelihood's curvature at the true "
        f"touch: {state}.",
        "ambiguity.svg": "Where four charges cannot tell orientation from position: the farthest "
        f"touch with at least 1 % of the likelihood, and the condition of the Jacobian; {state}.",
    }
    texts = [_map_sentence(shape, each) for shape, each in found.items()]
    blocks = [Picture(file, text) for file, text in captions.items()]
    return Section("maps", "Resolution and ambiguity over the film", texts, blocks)


def _map_sentence(shape: str, each: Sequence[dict[bool, Place]]) -> str:
    known, sought = (np.array([one[k].deviation_mm for one in each]) for k in (False, True))
    several = np.array([one[True].likely > 1 for one in each])
    far = np.array([one[True].farthest_mm for one in each])
    lost = np.array([not one[True].determined for one in each])
    return (
        f"{shape}: the median standard deviation of the place is {np.median(known):.3f} mm with "
        f"the rotation known and {np.median(sought):.3f} mm with it sought. With it sought, "
        f"{100 * several.mean():.0f} % of the places have another likely touch, "
        f"{100 * (far > 1.0).mean():.0f} % one farther than 1 mm, and at {100 * lost.mean():.0f} % "
        "a direction is not determined."
    )


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports/locate.py",
        description="Compare the thesis's triangulation with maximum likelihood.",
    )
    parser.add_argument(
        "--out",
        type=Path,
        default=ROOT / "reports" / "out" / "locate",
        metavar="DIR",
        help="output directory",
    )
    parser.add_argument(
        "--touches",
        type=number_of("touches"),
        metavar="N",
        help=f"random touches of each probe (default: {FULL.touches}, quick: {QUICK.touches})",
    )
    parser.add_argument("--quick", action="store_true", help="few scenes, a small domain")
    parser.add_argument(
        "--processes",
        type=number_of("processes"),
        default=os.cpu_count() or 1,
        metavar="N",
        help="default: cores",
    )
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
