"""A virtual experiment: the thesis's sources of error propagated into its measured positions.

    python -m reports.experiment [--out DIR] [--samples N] [--processes N]

Tables 5.1 and 5.2 of the thesis: predicted distributions of the position's error beside the
measured errors, and the share of each source. Writes ``index.html`` with figures (SVG) and tables
(CSV). Response models are kept in ``results/`` beside them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from pvdf_fem import __version__
from pvdf_fem.cli.program import ArgumentParser, run_program
from pvdf_fem.files import make_directory
from pvdf_fem.output.figures import COLOURS, GREY, new_figure, style
from pvdf_fem.response.response import Response
from pvdf_fem.touch.locate_many import locate_many
from reports.chapters.experiments import thesis_circuit
from reports.common.figures import save
from reports.common.options import add_out, add_processes, number_of
from reports.common.page import Cell, Column, Page, Picture, Section, Table
from reports.common.results import MATERIAL
from reports.common.thesis_data import SHAPES, Position, Thesis
from reports.common.thesis_scene import scene_of
from reports.front.catalogue import REPORTS
from reports.front.landing import publish
from reports.locating.models import (
    electrodes_of,
    response_of,
    sensor,
    triangulated_mm,
)
from reports.locating.sources import SOURCES, MeasuredScene, Source, changes
from reports.locating.transducer import Job

Array = NDArray[np.float64]

ALL = "all together"
TRIANGULATED = "the thesis's way"
CALIBRATED = "the thesis's way, one factor"
GIVEN = "least squares"
SCALED = "least squares, one factor"
#: Shares of the samples at which the distribution of errors is shown.
_BAND = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True, eq=False)
class Predicted:
    """Errors that one source, or all together, make in a scene's position.

    Attributes
    ----------
    scene : MeasuredScene
    source : str
        Name of the source, or `ALL`.
    errors_mm : dict
        Errors of the samples, (n,), by the way to find the place; NaN where there is no place.
    """

    scene: MeasuredScene
    source: str
    errors_mm: dict[str, Array]

    def root_mean_square(self, way: str) -> float:
        """Root mean square in mm of the samples that have a place; NaN if none has."""
        errors = self.errors_mm[way]
        finite = errors[np.isfinite(errors)]
        return float(np.sqrt(np.mean(finite**2))) if finite.size else np.nan

    def quantiles(self, way: str) -> Array:
        """The error at 5, 25, 50, 75 and 95 % of all samples; infinite among the failures."""
        errors = np.where(np.isnan(self.errors_mm[way]), np.inf, self.errors_mm[way])
        return np.quantile(errors, _BAND, method="inverted_cdf")

    def failed(self, way: str) -> float:
        """Share of the samples without a place."""
        return float(np.isnan(self.errors_mm[way]).mean())

    def is_common(self, way: str) -> bool:
        """Whether the measured error is within the middle 90 % of what is predicted.

        A measured failure is common if at least 5 % of the samples fail.
        """
        measured = self.scene.row.error_mm
        if np.isnan(measured):
            return self.failed(way) >= 0.05
        low, *_, high = self.quantiles(way)
        return bool(low <= measured <= high)


def main(arguments: Sequence[str] | None = None) -> int:
    """Predict errors, compare them with the measured ones and write the page; returns 0."""
    options = _options(arguments)
    return run_program("reports.experiment", lambda: _predict(options))


def _predict(options: argparse.Namespace) -> int:
    make_directory(options.out, "index.html")
    models_folder = options.out / "results"
    models_folder.mkdir(exist_ok=True)
    thesis = Thesis.read()
    rows = [p for p in thesis.positions if p.kind == "experimental"]
    # Builds have workers of their own, which would end those of the block below.
    models = {
        probe: response_of(sensor(thesis, probe), models_folder, options.processes)
        for probe in sorted({row.probe for row in rows})
    }
    with Parallel(options.processes) as parallel:
        scenes = _pressed(thesis, rows, models, parallel)
        jobs = [(scene, number, options.samples) for scene in scenes for number in _NUMBERS]
        predictions = parallel(delayed(_predicted)(*job) for job in tqdm(jobs, disable=None))
    sections = [
        _scene_section(predictions, options.out),
        _source_section(predictions, options.out),
        _verdict_section(predictions),
        _assumptions(),
    ]
    for section in sections:
        section.write_tables(options.out)
    provenance = {"pvdf_fem": __version__, "Samples": f"{options.samples} of each source and scene"}
    page = Page(REPORTS["experiment"].title, _introduction(), sections, provenance)
    print(publish(page, options.out))
    return 0


_NUMBERS = range(len(SOURCES) + 1)


def _introduction() -> list[str]:
    return [
        "Section 6.1 of the thesis names causes of the errors of Tables 5.1 and 5.2. Each is "
        "drawn at random and propagated into charges, and these into a position as the thesis "
        "finds it: by contours of the unturned probe's simulated charges at 1 N. What it does with "
        "a common factor of all charges the thesis leaves open; item 7 of 6.1 speaks of a "
        "calibration factor. So positions are found from the charges as they are, and after one "
        "factor has brought their sum to the simulated one. Least squares with the probe's true "
        "rotation and the force of 1 N stand beside them, of the same charges.",
    ]


def _assumptions() -> Section:
    columns = [Column("source", "source"), Column("place", "thesis"), Column("assumed", "assumed")]
    rows: list[list[Cell]] = [[source.name, source.place, source.assumed] for source in SOURCES]
    caption = "Sources of error, and what is assumed of them where the thesis gives no size."
    return Section("assumed", "What is assumed", (), [Table("assumed", caption, columns, rows)])


def _pressed(
    thesis: Thesis, rows: Sequence[Position], models: Mapping[str, Response], parallel: Parallel
) -> list[MeasuredScene]:
    circuit = thesis_circuit(thesis)
    measured_capacitance = thesis.parameters["circuit"]["capacitance_measured_two_electrodes"][
        "value"
    ]

    def workers(jobs: Sequence[Job]) -> list[Array]:
        return list(parallel(delayed(job)() for job in jobs))

    return [
        MeasuredScene(
            row,
            models[row.probe],
            electrodes_of(row.layout),
            circuit,
            measured_capacitance,
            changes(scene_of(row).with_(**{"numerics.observable": MATERIAL}), workers),
        )
        for row in tqdm(rows, disable=None)
    ]


def _predicted(scene: MeasuredScene, number: int, samples: int) -> Predicted:
    """Errors from source `number`, or from all together if `number` is that of the sources.

    A triangulation takes milliseconds and a least-squares fit microseconds, so that only every
    twentieth sample is triangulated.
    """
    random = np.random.default_rng([number, *scene.row.case.encode()])
    sources: Sequence[Source] = SOURCES if number == len(SOURCES) else SOURCES[number : number + 1]
    factors = np.prod([source.draw(scene, random, samples) for source in sources], axis=0)
    true_charges = scene.charges_pC(scene.row.touch[None])
    charges = true_charges * factors
    first_charges = charges[: max(1, samples // 20)]
    first_scaled = first_charges * (true_charges.sum() / first_charges.sum(axis=1, keepdims=True))
    errors = {
        TRIANGULATED: _triangulated(scene, first_charges),
        CALIBRATED: _triangulated(scene, first_scaled),
        GIVEN: _squares(scene, charges),
        SCALED: _squares(
            scene, charges * (true_charges.sum() / charges.sum(axis=1, keepdims=True))
        ),
    }
    return Predicted(scene, ALL if len(sources) > 1 else sources[0].name, errors)


def _triangulated(scene: MeasuredScene, charges: Array) -> Array:
    places = [
        triangulated_mm(scene.model, scene.electrodes, row, 0.0, scene.row.force_N)
        for row in charges
    ]
    return np.linalg.norm(np.array(places) - scene.row.touch[:2], axis=1)


def _squares(scene: MeasuredScene, charges: Array, sigma: float = 0.01) -> Array:
    """Errors in mm of least squares with the true rotation and the force of 1 N.

    Relative differences have equal weights whatever `sigma` is, which only decides how far the
    search goes on.
    """
    locations = locate_many(
        scene.model,
        charges,
        sigma,
        rotations_deg=np.full(len(charges), scene.row.rotation_deg),
        forces_N=np.full(len(charges), scene.row.force_N),
        electrodes=tuple(scene.electrodes.values()),
        significance=0.0,
    )
    return np.linalg.norm(locations.values[:, :2] - scene.row.touch[:2], axis=1)


# ----------------------------------------------------------------------------------------- page


def _scene_section(predictions: Sequence[Predicted], out: Path) -> Section:
    together = [prediction for prediction in predictions if prediction.source == ALL]
    _distribution_picture(together, out / "distributions.svg")
    columns = [
        Column("case", "case"),
        Column("place", "place"),
        Column("measured_mm", "measured (mm)", 3),
        *(Column(f"q{100 * q:.0f}_mm", f"{100 * q:.0f} % (mm)", 2, "predicted") for q in _BAND),
        Column("failed_percent", "failed (%)", 0, "predicted"),
        Column("common", "measured within the middle 90 %"),
        Column("absolute_failed_percent", "failed without a factor (%)", 0),
    ]
    rows = [_scene_row(prediction) for prediction in together]
    caption = f"Error of the position by {CALIBRATED}, all sources together."
    table = Table("predicted_scenes", caption, columns, rows)
    texts = [
        f"With all sources together {sum(prediction.is_common(way) for prediction in together)} "
        f"of the {len(together)} measured results lie within the middle 90 % of what is predicted "
        f"for {way}; {100 * np.mean([prediction.failed(way) for prediction in together]):.0f} % "
        "of its samples have no place. Of the measured scenes "
        f"{sum(np.isnan(prediction.scene.row.error_mm) for prediction in together)} have none."
        for way in (CALIBRATED, TRIANGULATED)
    ]
    picture = Picture(
        "distributions.svg",
        f"Predicted error of each scene by {CALIBRATED}, all sources together: 5 to 95 % "
        "(line), 25 to 75 % (bar), median; rings: measured. Bars cut off at the right contain "
        "samples whose contours do not cross.",
    )
    return Section("scenes", "Predicted and measured errors", texts, [picture, table])


def _scene_row(prediction: Predicted) -> list[Cell]:
    row: Position = prediction.scene.row
    quantiles = [float(q) if np.isfinite(q) else None for q in prediction.quantiles(CALIBRATED)]
    failed, absolute = (100.0 * prediction.failed(way) for way in (CALIBRATED, TRIANGULATED))
    common = "yes" if prediction.is_common(CALIBRATED) else "no"
    place = f"{SHAPES[row.probe]}, {row.position}"
    return [row.case, place, row.error_mm, *quantiles, failed, common, absolute]


def _distribution_picture(together: Sequence[Predicted], path: Path) -> None:
    top = 8.0
    with style():
        figure = new_figure(160, 95)
        ax = figure.subplots()
        for y, prediction in enumerate(together):
            low, lower, middle, upper, high = np.minimum(prediction.quantiles(CALIBRATED), top)
            ax.plot([low, high], [y, y], color=COLOURS[0], lw=1.0)
            ax.plot([lower, upper], [y, y], color=COLOURS[0], lw=6.0, solid_capstyle="butt")
            ax.plot(middle, y, "|", color="white", ms=7)
            measured = prediction.scene.row.error_mm
            at, text = (top, "lost") if np.isnan(measured) else (measured, "")
            ax.plot(at, y, "o", mfc="none", mec=COLOURS[1], mew=1.4, ms=7, clip_on=False)
            ax.annotate(text, (at, y), (7, -3), textcoords="offset points", annotation_clip=False)
        names = [
            f"{SHAPES[prediction.scene.row.probe]}, {prediction.scene.row.position}"
            for prediction in together
        ]
        ax.set_yticks(range(len(names)), names)
        ax.invert_yaxis()
        ax.set(xlabel="error of the position (mm)", xlim=(0.0, top))
        save(figure, path)


def _source_section(predictions: Sequence[Predicted], out: Path) -> Section:
    columns = [
        Column("source", "source"),
        Column("thesis_mm", "error (mm)", 2, TRIANGULATED),
        Column("failed_percent", "failed (%)", 0, TRIANGULATED),
        Column("factor_mm", "error (mm)", 2, CALIBRATED),
        Column("factor_failed_percent", "failed (%)", 0, CALIBRATED),
        Column("common", "measured in the middle 90 %", 0, CALIBRATED),
        Column("given_mm", "error (mm)", 2, GIVEN),
        Column("given_percent", "share (%)", 0, GIVEN),
        Column("scaled_mm", "error (mm)", 2, SCALED),
        Column("scaled_percent", "share (%)", 0, SCALED),
    ]
    names = [source.name for source in SOURCES]
    rows = [_source_row(name, predictions, names) for name in [*names, ALL]]
    caption = (
        "Each source alone: root mean square error over all scenes, and share of the sum of the "
        "mean squares."
    )
    _share_picture(predictions, names, out / "shares.svg")
    picture = Picture(
        "shares.svg",
        "Root mean square error of each scene from each source alone; least squares "
        "with the charges as they are (bars) and after one factor (rings); line: root mean square "
        "of the measured errors.",
    )
    table = Table("sources", caption, columns, rows)
    return Section("sources", "The share of each source", [], [picture, table])


def mean_square(predictions: Sequence[Predicted], source: str, way: str) -> float:
    """Mean square in mm² of a source's errors over all scenes that have a place."""
    squares = [
        prediction.root_mean_square(way) ** 2
        for prediction in predictions
        if prediction.source == source
    ]
    finite = [square for square in squares if np.isfinite(square)]
    return float(np.mean(finite)) if finite else np.nan


def _source_row(name: str, predictions: Sequence[Predicted], names: Sequence[str]) -> list[Cell]:
    of_source = [prediction for prediction in predictions if prediction.source == name]
    row: list[Cell] = [name]
    for way in (TRIANGULATED, CALIBRATED):
        row.append(float(np.sqrt(mean_square(predictions, name, way))))
        row.append(100.0 * float(np.mean([prediction.failed(way) for prediction in of_source])))
    row.append(sum(prediction.is_common(CALIBRATED) for prediction in of_source))
    for way in (GIVEN, SCALED):
        total = sum(mean_square(predictions, source, way) for source in names)
        square = mean_square(predictions, name, way)
        row += [float(np.sqrt(square)), 100.0 * square / total if name != ALL else None]
    return row


def _share_picture(predictions: Sequence[Predicted], names: Sequence[str], path: Path) -> None:
    measured = _measured(predictions)
    with style():
        figure = new_figure(160, 130)
        ax = figure.subplots()
        ax.set_axisbelow(True)
        for y, name in enumerate(names):
            unscaled, scaled = (
                np.sqrt(mean_square(predictions, name, way)) for way in (GIVEN, SCALED)
            )
            ax.barh(y, unscaled, color=COLOURS[4], height=0.6)
            ax.plot(scaled, y, "o", mfc="none", mec=COLOURS[0], mew=1.4)
        ax.axvline(measured, color=GREY, lw=1.0, ls=(0, (4, 3)))
        ax.annotate("measured", (measured, -0.6), (3, 0), textcoords="offset points", size=8)
        ax.set_yticks(range(len(names)), names)
        ax.invert_yaxis()
        ax.set(xlabel="root mean square error of the position (mm)", xlim=(0.0, None))
        save(figure, path)


def _measured(predictions: Sequence[Predicted]) -> float:
    """Root mean square of the measured errors, mm."""
    errors = {
        prediction.scene.row.case: prediction.scene.row.error_mm for prediction in predictions
    }
    return float(np.sqrt(np.nanmean(np.square(list(errors.values())))))


def _verdict_section(predictions: Sequence[Predicted]) -> Section:
    measured = _measured(predictions)
    texts = [
        f"The root mean square of the measured errors is {measured:.2f} mm. A source explains "
        "them alone if it gives between half and twice as much; less than a quarter cannot "
        "matter, and more than twice says that the source was smaller than assumed here, or that "
        "the experiment corrected for it.",
    ]
    for way in (GIVEN, SCALED):
        texts.append(f"{way.capitalize()}: {'; '.join(_verdicts(predictions, way, measured))}.")
    smallest = np.sqrt(mean_square(predictions, "force fluctuates", CALIBRATED))
    texts.append(
        "The thesis's way has an error of its own, from contours of a probe that is not turned: "
        f"with nearly right charges (only the force fluctuates) it errs by {smallest:.2f} mm."
    )
    return Section("verdict", "Which explanation holds", texts)


def _verdicts(predictions: Sequence[Predicted], way: str, measured: float) -> list[str]:
    """Sources grouped by how much of the measured errors they explain."""
    groups: dict[str, list[str]] = {}
    for source in SOURCES:
        size = float(np.sqrt(mean_square(predictions, source.name, way)))
        groups.setdefault(_judged(size / measured), []).append(f"{source.name} ({size:.2f} mm)")
    return [f"{verdict}: {', '.join(names)}" for verdict, names in groups.items()]


def _judged(ratio: float) -> str:
    if ratio < 0.25:
        return "too small to matter"
    if ratio < 0.5:
        return "a part of it"
    return "explains it alone" if ratio <= 2.0 else "more than was measured"


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = ArgumentParser(
        prog="reports.experiment",
        description="Propagate the thesis's sources of error into its measured positions.",
    )
    add_out(parser, "experiment")
    parser.add_argument(
        "--samples",
        type=number_of("samples", 1_000_000),
        default=2000,
        metavar="N",
        help="of each source and scene; a twentieth of it by triangulation (default: 2000)",
    )
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
