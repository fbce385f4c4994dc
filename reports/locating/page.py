"""The sections of the report on locations: tables, pictures, and sentences with the numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from pvdf_fem.output.figures import COLOURS, new_figure, style
from pvdf_fem.response.model import QUANTITIES
from pvdf_fem.response.response import Response
from pvdf_fem.touch.locate import locate
from reports.common.figures import save
from reports.common.page import Cell, Column, Picture, Section, Table
from reports.common.results import Results
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
    PlaceQuality,
    ambiguity_picture,
    judged,
    lattice,
    resolution_picture,
)
from reports.locating.models import (
    DISC,
    Position,
    charges_of,
    distance_mm,
    electrodes_of,
    scene_at,
)

Array = NDArray[np.float64]
#: Response models by probe and film.
Models = dict[tuple[str, str], Response]

SHAPES = ("triangle", "rectangle", DISC)
#: Ways that differ for a disc, whose rotation means nothing.
DISC_WAYS = (TRIANGULATED, TOLD, LOCATED)
#: Layout of the electrodes for random touches and maps.
LAYOUT = "four"
#: Relative standard deviation of the charges in the maps.
MAP_NOISE = 0.01

# --------------------------------------------------------------------------- the thesis's scenes


def thesis_section(positions: Sequence[Position], models: Models, results: Results) -> Section:
    """Section on all positions of the thesis, with exact charges."""
    rows = [_thesis_row(p, models[p.probe, p.film], results) for p in positions]
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
        f"{sum(np.isnan(p.error_mm) for p in positions)} as not intersecting.",
    ]
    return Section("thesis-scenes", "The thesis's scenes", texts, [table])


def _thesis_row(row: Position, model: Response, results: Results) -> list[Cell]:
    names, touch = electrodes_of(row.layout), np.array(row.touch)
    charges = charges_of(results, scene_at(row.probe, row.film, touch), names)
    trial = Trial(model, names, touch[None], np.array([charges]))
    measured = dict(zip(names.values(), charges, strict=True))
    x, y, rotation, force = row.touch
    known_values = {"rotation_deg": rotation}
    # With three charges and three unknowns several touches may fit; the nearest one is shown.
    location = locate(model, measured, LEAST_SIGMA, known=known_values)
    nearest = min(location.touches, key=lambda candidate: distance_mm(candidate.values, touch))
    quality = judged(model, names, touch[:2], rotation, 0.01)[False]
    any_rotation = locate(model, measured, LEAST_SIGMA, unknown=QUANTITIES)
    return [
        row.case,
        f"{row.probe}, {x:g}, {y:g} mm, {rotation:g}°",
        row.error_mm,
        float(triangulated(trial, 0.0, False).place_mm[0]),
        float(triangulated(trial, 0.0, True).place_mm[0]),
        distance_mm(nearest.values, touch),
        100.0 * (nearest.force_N / force - 1.0),
        quality.deviation_mm,
        sum(candidate.weight > 0.01 for candidate in any_rotation.touches)
        if len(names) > 3
        else "a curve",
        min(distance_mm(candidate.values, touch) for candidate in any_rotation.touches),
    ]


# -------------------------------------------------------------------------------- random touches


def random_section(
    probe: str, trial: Trial, touch_count: int, out: Path, processes: int
) -> Section:
    """Section on random touches of one probe, with exact and noisy charges."""
    ways = DISC_WAYS if probe == DISC else tuple(WAYS)
    jobs: list[tuple[float, str]] = [(noise, way) for noise in NOISES for way in ways]
    with_threads = Parallel(processes)
    errors: list[Errors] = with_threads(delayed(_by)(trial, noise, way) for noise, way in jobs)
    name = f"errors_{probe}"
    _picture(errors, trial, out / f"{name}.svg")
    caption = (
        f"{probe}: share of {len(trial.touches)} touches with an error below the abscissa; a curve "
        "that ends below 1 leaves failures. Dotted: Cramér-Rao bound, rotation known."
    )
    texts = [_sentence(errors, trial)]
    if probe == DISC:
        texts.append("A disc is the same however it is turned, so only the ways that differ stay.")
    if FREE in ways:
        texts.append(_listed_sentence(probe, listed(trial)))
    if failed := touch_count - len(trial.touches):
        texts.append(f"Left out for want of a solution: {failed} of {touch_count} touches.")
    blocks: list[Table | Picture] = [
        Picture(f"{name}.svg", caption),
        _table(name, probe, errors, trial),
    ]
    return Section(name, f"Random touches of the {probe}", texts, blocks)


def _by(trial: Trial, noise: float, way: str) -> Errors:
    if way in (TRIANGULATED, TURNED):
        return triangulated(trial, noise, way == TURNED)
    return located(trial, noise, way)


def _sentence(errors: Sequence[Errors], trial: Trial) -> str:
    exact = next(e for e in errors if e.way == LOCATED and e.noise == 0.0)
    accurate = (exact.place_mm <= 0.01) & (np.abs(exact.force) <= 0.002)
    noisy = next(e for e in errors if e.way == LOCATED and e.noise == 0.01)
    ratio = np.nanmedian(noisy.place_mm) / np.median(bounds_mm(trial, 0.01))
    within, locally = (
        ", ".join(f"{100 * share:.1f} %" for share in flags.mean(axis=0))
        for flags in (noisy.within, noisy.locally)
    )
    return (
        f"With exact charges and a known rotation, {100 * accurate.mean():.1f} % of the touches "
        f"are found within 0.01 mm and 0.2 % of the force; {int(np.isnan(exact.place_mm).sum())} "
        f"are not found. With 1 % noise the median error is {ratio:.3f} times that of the "
        f"Cramér-Rao bound, and {within} of the errors of x, y and force are below their stated "
        f"standard deviation (68.3 % if that is right); {locally} are below the one that the "
        "likelihood's curvature at the likeliest touch alone would give."
    )


def _listed_sentence(shape: str, counts: Listed) -> str:
    return (
        f"With the rotation of the {shape} unknown and exact charges, the true touch is among "
        f"those listed in {counts.found} of {counts.touches} cases; in {counts.unique} there is "
        f"no other likely one, and in {counts.undetermined} a direction is said not to be "
        "determined."
    )


def _table(name: str, shape: str, errors: Sequence[Errors], trial: Trial) -> Table:
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
    return Table(name, caption, columns, list(_error_rows(errors, trial)))


def _error_rows(all_errors: Sequence[Errors], trial: Trial) -> Iterator[list[Cell]]:
    for way_errors in all_errors:
        distances = np.where(np.isnan(way_errors.place_mm), np.inf, way_errors.place_mm)
        median, ninetieth = np.quantile(distances, [0.5, 0.9], method="inverted_cdf")
        bound = None
        if way_errors.way in SOUGHT:
            bound = float(np.median(bounds_mm(trial, way_errors.noise, way_errors.way)))
        yield [
            100.0 * way_errors.noise,
            way_errors.way,
            100.0 * float(np.isinf(distances).mean()),
            float(median) if np.isfinite(median) else None,
            float(ninetieth) if np.isfinite(ninetieth) else None,
            float(np.nanmax(way_errors.place_mm)),
            100.0 * float(np.median(np.abs(way_errors.force)))
            if way_errors.way in (LOCATED, FREE)
            else None,
            bound,
            *_shares(way_errors),
        ]


def _shares(errors: Errors) -> list[Cell]:
    """Percent of the errors of x, y and force within their standard deviations."""
    if not errors.within.size:
        return [None, None, None]
    x, y, *further = (100.0 * errors.within.mean(axis=0)).tolist()
    return [x, y, further[-1] if further else None]


def _picture(errors: Sequence[Errors], trial: Trial, path: Path) -> None:
    noises = (0.0, 0.01, 0.05)
    with style():
        figure = new_figure(170, 80)
        axes = figure.subplots(1, len(noises), sharey=True)
        inks = dict(zip(WAYS, COLOURS, strict=False))
        for ax, noise in zip(axes, noises, strict=True):
            for way_errors in (e for e in errors if e.noise == noise):
                ax.plot(
                    *fractions(way_errors.place_mm),
                    color=inks[way_errors.way],
                    label=way_errors.way,
                )
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
    """Section with maps of resolution and ambiguity, `across` places wide."""
    places, names = lattice(reach_mm, across), electrodes_of(LAYOUT)
    qualities: dict[str, list[dict[bool, PlaceQuality]]] = {
        probe: Parallel(processes)(
            delayed(judged)(models[probe, "biaxial"], names, at, 0.0, MAP_NOISE) for at in places
        )
        for probe in SHAPES
        if probe != DISC and (probe, "biaxial") in models
    }
    resolution_picture(places, qualities, out / "resolution.svg")
    ambiguity_picture(places, qualities, out / "ambiguity.svg")
    state = f"{FORCE_N:g} N, {100 * MAP_NOISE:g} % noise, probe unturned; squares: electrodes"
    captions = {
        "resolution.svg": "Resolution of the position, by the likelihood's curvature at the true "
        f"touch: {state}.",
        "ambiguity.svg": "Where four charges cannot tell orientation from position: the farthest "
        f"touch with at least 1 % of the likelihood, and the condition of the Jacobian; {state}.",
    }
    texts = [_map_sentence(shape, at_places) for shape, at_places in qualities.items()]
    blocks = [Picture(file, text) for file, text in captions.items()]
    return Section("maps", "Resolution and ambiguity over the film", texts, blocks)


def _map_sentence(shape: str, at_places: Sequence[dict[bool, PlaceQuality]]) -> str:
    with_rotation, without_rotation = (
        np.array([quality[k].deviation_mm for quality in at_places]) for k in (False, True)
    )
    several = np.array([quality[True].likely > 1 for quality in at_places])
    distances = np.array([quality[True].farthest_mm for quality in at_places])
    undetermined = np.array([not quality[True].determined for quality in at_places])
    return (
        f"{shape}: the median standard deviation of the place is {np.median(with_rotation):.3f} "
        f"mm with the rotation known and {np.median(without_rotation):.3f} mm with it sought. "
        f"With it sought, {100 * several.mean():.0f} % of the places have another likely touch, "
        f"{100 * (distances > 1.0).mean():.0f} % one farther than 1 mm, and at "
        f"{100 * undetermined.mean():.0f} % a direction is not determined."
    )
