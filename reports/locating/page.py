"""The sections of the report on locations: tables, pictures, and sentences with the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from pvdf_fem.output.figures import COLOURS, new_figure, save, style
from pvdf_fem.response.response import Response
from pvdf_fem.touch.locate import locate
from pvdf_fem.touch.touch import QUANTITIES
from reports.common.page import Cell, Column, Picture, Section, Table
from reports.common.results import Results
from reports.common.thesis_data import Position, Thesis
from reports.locating.errors import (
    FREE,
    LEAST_SIGMA,
    LOCATED,
    NOISES,
    SOUGHT,
    TOLD,
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
    triangulated,
)
from reports.locating.maps import (
    FORCE_N,
    Place,
    ambiguity_picture,
    judged,
    lattice,
    resolution_picture,
)
from reports.locating.models import DISC, charges_of, distance_mm, electrodes_of, scene_at

Array = NDArray[np.float64]
#: Response models by probe and film.
Models = dict[tuple[str, str], Response]

SHAPES = {"tri7": "triangle", "rect14x7": "rectangle", DISC: "disc"}
#: A disc's rotation means nothing.
DISC_WAYS = (TRIANGULATED, TOLD, LOCATED)
#: Electrodes of the random touches and the maps.
LAYOUT = "4"
MAP_NOISE = 0.01

# --------------------------------------------------------------------------- the thesis's scenes


def thesis_section(thesis: Thesis, models: Models, results: Results) -> Section:
    """All positions of the thesis, exact charges."""
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
    names, touch = electrodes_of(row.layout), row.touch
    charges = charges_of(results, scene_at(thesis, row.probe, row.film, touch), names)
    trial = Trial(model, names, touch[None], np.array([charges]))
    given = dict(zip(names.values(), charges, strict=True))
    known = {"rotation_deg": row.rotation_deg}
    # three charges and three unknown: several touches may fit; the nearest one is shown
    found = locate(model, given, LEAST_SIGMA, known=known)
    best = min(found.touches, key=lambda one: distance_mm(one.values, touch))
    sure = judged(model, names, touch[:2], row.rotation_deg, 0.01)[False]
    free = locate(model, given, LEAST_SIGMA, unknown=QUANTITIES)
    return [
        row.case,
        f"{row.probe}, {row.position}",
        row.error_mm,
        float(triangulated(trial, 0.0, False).place_mm[0]),
        float(triangulated(trial, 0.0, True).place_mm[0]),
        distance_mm(best.values, touch),
        100.0 * (best.force_N / row.force_N - 1.0),
        sure.deviation_mm,
        sum(one.weight > 0.01 for one in free.touches) if len(names) > 3 else "a curve",
        min(distance_mm(one.values, touch) for one in free.touches),
    ]


# -------------------------------------------------------------------------------- random touches


def random_section(probe: str, trial: Trial, drawn: int, out: Path, processes: int) -> Section:
    """Random touches of one probe, exact and noisy charges."""
    ways = DISC_WAYS if probe == DISC else tuple(WAYS)
    jobs: list[tuple[float, str]] = [(noise, way) for noise in NOISES for way in ways]
    with_threads = Parallel(processes)
    found: list[Errors] = with_threads(delayed(_by)(trial, noise, way) for noise, way in jobs)
    shape = SHAPES[probe]
    name = f"errors_{shape}"
    _picture(found, trial, out / f"{name}.svg")
    caption = (
        f"{shape}: share of {len(trial.touches)} touches with an error below the abscissa; a curve "
        "that ends below 1 leaves failures. Dotted: Cramér-Rao bound, rotation known."
    )
    texts = [_sentence(found, trial)]
    if probe == DISC:
        texts.append("A disc is the same however it is turned, so only the ways that differ stay.")
    if FREE in ways:
        texts.append(_listed_sentence(shape, listed(trial)))
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
        inks = dict(zip(WAYS, COLOURS, strict=False))
        for ax, noise in zip(axes, shown, strict=True):
            for one in (e for e in found if e.noise == noise):
                ax.plot(*fractions(one.place_mm), color=inks[one.way], label=one.way)
            if noise:
                bound = fractions(bounds_mm(trial, noise, draws=8))
                ax.plot(*bound, ":", color="black", label=f"Cramér-Rao bound of {LOCATED}")
            ax.set(xscale="log", xlim=(1e-2 if noise else 1e-6, 20.0), ylim=(0.0, 1.0))
            ax.set_xlabel("error (mm)")
            ax.set_title("exact charges" if not noise else f"{100 * noise:g} % noise")
        axes[0].set_ylabel("share of the touches")
        figure.legend(*axes[-1].get_legend_handles_labels(), loc="outside upper left", ncols=3)
        save(figure, path)


# ------------------------------------------------------------------------------------------ maps


def map_section(models: Models, reach_mm: float, across: int, out: Path, processes: int) -> Section:
    """Resolution and ambiguity over the lattice of `across` places."""
    places, names = lattice(reach_mm, across), electrodes_of(LAYOUT)
    found: dict[str, list[dict[bool, Place]]] = {
        shape: Parallel(processes)(
            delayed(judged)(models[probe, "biaxial"], names, at, 0.0, MAP_NOISE) for at in places
        )
        for probe, shape in SHAPES.items()
        if probe != DISC and (probe, "biaxial") in models
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
