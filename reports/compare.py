"""Your own measured charges beside computed ones of the same scenes.

    python -m reports.compare FILE.csv [--out DIR] [--contact pressure|sliding|stuck]
                              [--processes N]

Writes ``index.html`` with figures (SVG) and a table (CSV). Solved scenes are kept in ``results/``
beside them. The help lists the columns of the file; `reports/data/example_measurements.csv` is one.
"""

from __future__ import annotations

import argparse
import math
import sys
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes
from tqdm import tqdm

from pvdf_fem import Scene, __version__
from pvdf_fem.cli.program import ArgumentParser, InputError, run_program
from pvdf_fem.files import make_directory
from pvdf_fem.output.figures import COLOURS, GREY
from reports.chapters.contact import CONTACTS, pressed
from reports.common.charge_figures import Series, charge_against_force, charge_against_rotation
from reports.common.figures import drawing
from reports.common.measurements import (
    COLUMNS,
    Measurement,
    MeasurementError,
    read_measurements,
)
from reports.common.options import add_out, add_processes
from reports.common.page import Cell, Column, Page, Picture, Section, Table
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_scene import TOLERANCE
from reports.front.landing import publish

#: Readings of our charge that a measured charge is compared with.
READINGS = {
    "material": "charge of the electrode's area",
    "change": "the same less its value without force, which an oscillating force does not show",
    "thesis_edge": "the thesis's averages along the electrode's edges",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare; returns 0, or 1 if a solve failed, or 2 for a file with mistakes."""
    options = _options(arguments)
    return run_program("reports.compare", lambda: _compare(options))


def _compare(options: argparse.Namespace) -> int:
    try:
        measured = read_measurements(options.file)
    except MeasurementError as error:
        raise InputError(*error.problems) from None
    make_directory(options.out, "index.html", options.file)
    results = Results(options.out / "results", options.processes)
    _solve(_scenes(measured, options.contact), results)
    compared = [_beside(measurement, options.contact, results) for measurement in measured]
    turned = [every_degree(rows) for rows in families(compared, "rotation_deg").values()]
    _solve([pressed(row.scene, options.contact) for rows in turned for row in rows], results)
    page = _page(options.file, options.contact, compared, options.out, results)
    print(publish(page, options.out))
    return 0 if all(measurement.status == "converged" for measurement in compared) else 1


def _solve(scenes: Sequence[Scene], results: Results) -> None:
    with tqdm(total=results.missing(scenes), unit="solve", disable=None) as bar:
        results.solve(scenes, lambda solved, total: bar.update(1 if solved else 0))


@dataclass(frozen=True)
class ComparedMeasurement:
    """A measured charge with our charges in pC by their readings; NaN if the solve failed."""

    measured: Measurement
    ours_pC: dict[str, float]
    status: str

    def difference(self, reading: str) -> float:
        """Our charge minus the measured one, in percent of the measured; NaN if that is 0."""
        measured_pC = self.measured.charge_pC
        return 100.0 * (self.ours_pC[reading] / measured_pC - 1.0) if measured_pC else np.nan


def _rest(scene: Scene) -> Scene:
    return scene.with_(**{"probe": None, "numerics.observable": MATERIAL})


def _scenes(measured: Iterable[Measurement], contact: str) -> list[Scene]:
    pressed_scenes = [pressed(measurement.scene, contact) for measurement in measured]
    return pressed_scenes + [_rest(scene) for scene in pressed_scenes]


def _beside(measurement: Measurement, contact: str, results: Results) -> ComparedMeasurement:
    scene = pressed(measurement.scene, contact)
    record, record_at_rest = results[scene], results[_rest(scene)]
    material = record.charge_pC(measurement.electrode, MATERIAL)
    ours = {
        "material": material,
        "change": material - record_at_rest.charge_pC(measurement.electrode, MATERIAL),
        "thesis_edge": record.charge_pC(measurement.electrode, THESIS_EDGE),
    }
    return ComparedMeasurement(measurement, ours, record.status)


# --------------------------------------------------------------------------------------- page


def _page(
    file: Path,
    contact: str,
    compared: Sequence[ComparedMeasurement],
    out: Path,
    results: Results,
) -> Page:
    _overview(compared, out / "comparison.svg")
    caption = (
        "Above: measured charge over the computed one (material); line: equal. Below: measured "
        "less computed in percent of computed, for three readings of a charge."
    )
    blocks: list[Table | Picture] = [Picture("comparison.svg", caption)]
    blocks += _families(compared, out, contact, results)
    press = {"pressure": "a uniform pressure"}.get(contact, f"a rigid probe, {contact}")
    introduction = [
        f"{len(compared)} charges of {len({charge.measured.case for charge in compared})} cases in "
        f"{file.name}, beside those computed for the thesis's sensor under {press}. Nothing is "
        "fitted.",
        *(f"{name.replace('_', '-')}: {text}." for name, text in READINGS.items()),
        *_summary(compared),
    ]
    section = Section("charges", "Charges", [], [*blocks, _table(compared)])
    section.write_tables(out)
    made = {"pvdf_fem": __version__, "Tolerance": f"{TOLERANCE:g} (relative)"}
    return Page("Measured charges beside computed ones", introduction, [section], made)


def _summary(compared: Sequence[ComparedMeasurement]) -> list[str]:
    texts = []
    for reading in READINGS:
        sizes = np.abs([charge.difference(reading) for charge in compared])
        if np.isfinite(sizes).any():
            name = reading.replace("_", "-")
            texts.append(f"{name} {np.nanmedian(sizes):.2f} % (up to {np.nanmax(sizes):.2f} %)")
    failed = sum(charge.status != "converged" for charge in compared)
    failures = [f"{failed} charges have no computed value."] if failed else []
    return [f"Median difference: {', '.join(texts)}.", *failures] if texts else failures


def _table(compared: Sequence[ComparedMeasurement]) -> Table:
    columns = [Column("case", "case"), Column("layout", "electrodes"), Column("probe", "probe")]
    columns += [Column(key, label, None) for key, label in _PLACES.items()]
    columns += [Column("electrode", "electrode"), Column("measured_pC", "measured (pC)")]
    for reading in READINGS:
        group = reading.replace("_", "-")
        columns.append(Column(f"{reading}_pC", "ours (pC)", 1, group))
        columns.append(
            Column(f"{reading}_difference_percent", "ours − measured (%)", 2, group, True)
        )
    columns.append(Column("status", "status"))
    return Table("comparison", "All charges.", columns, [_row(charge) for charge in compared])


_PLACES = {
    "x_mm": "x (mm)",
    "y_mm": "y (mm)",
    "rotation_deg": "rotation (°)",
    "force_N": "force (N)",
}


def _row(compared: ComparedMeasurement) -> list[Cell]:
    measured = compared.measured
    row: list[Cell] = [measured.case, measured.layout, measured.probe]
    row += [float(getattr(measured, key)) for key in _PLACES]
    row += [measured.electrode, measured.charge_pC]
    for reading in READINGS:
        row += [compared.ours_pC[reading], compared.difference(reading)]
    return [*row, compared.status]


# ------------------------------------------------------------------------------------ figures

Curves: TypeAlias = Sequence[Series]
Family: TypeAlias = Sequence[ComparedMeasurement]
#: Draws our curves, measured points, and what belongs to the family that both are of.
Draw: TypeAlias = Callable[[Axes, Curves, Curves, Family], None]


def _overview(compared: Sequence[ComparedMeasurement], path: Path) -> None:
    with drawing(path, 150, 170) as figure:
        above, below = figure.subplots(2)
        for electrode, ink in zip("ABCD", COLOURS, strict=False):
            of_electrode = [charge for charge in compared if charge.measured.electrode == electrode]
            x = [charge.ours_pC["material"] for charge in of_electrode]
            y = [charge.measured.charge_pC for charge in of_electrode]
            if of_electrode:
                above.plot(x, y, "o", mfc="none", mec=ink, label=f"electrode {electrode}")
        above.axline((0.0, 0.0), slope=1.0, color=GREY, lw=0.8)
        above.set(xlabel="computed charge (pC)", ylabel="measured charge (pC)")
        below.axhline(0.0, color=GREY, lw=0.8)
        for reading, ink, marker in zip(READINGS, COLOURS, "os^", strict=False):
            x = [charge.ours_pC[reading] for charge in compared]
            y = [charge.difference(reading) for charge in compared]
            below.plot(x, y, marker, mfc="none", mec=ink, label=reading.replace("_", "-"))
        below.set(xlabel="computed charge (pC)", ylabel="computed − measured (%)")
        for ax in (above, below):
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.0)


def _families(
    compared: Sequence[ComparedMeasurement], out: Path, contact: str, results: Results
) -> list[Picture]:
    """Figures of the rows that differ only in the rotation, or only in the force."""

    def turning(ax: Axes, ours: Curves, theirs: Curves, rows: Family) -> None:
        smooth = [_turned(curve, rows, contact, results) for curve in ours]
        charge_against_rotation(ax, ours, theirs, others="measured", between=smooth)

    def pressing(ax: Axes, ours: Curves, theirs: Curves, rows: Family) -> None:
        charge_against_force(ax, ours, theirs, others="measured")

    pictures = []
    kinds: tuple[tuple[str, str, Draw], ...] = (
        ("rotation_deg", "rotation", turning),
        ("force_N", "force", pressing),
    )
    for varied, name, draw in kinds:
        groups = families(compared, varied)
        for number, (constant, rows) in enumerate(groups.items(), start=1):
            file = f"{name}_{number}.svg"
            _family(rows, varied, draw, out / file)
            constants = ", ".join(f"{key} {value}" for key, value in constant)
            text = f"Charge (material) against {name}; rings: measured. {constants}."
            pictures.append(Picture(file, text))
    return pictures


def families(
    compared: Sequence[ComparedMeasurement], varied: str, least: int = 3
) -> dict[tuple[tuple[str, object], ...], list[ComparedMeasurement]]:
    """Groups of rows that differ in one quantity alone, with at least `least` values of it."""
    constant = [key for key in ("layout", "probe", *_PLACES) if key != varied]
    groups: dict[tuple[tuple[str, object], ...], list[ComparedMeasurement]] = {}
    for charge in compared:
        key = tuple((name, getattr(charge.measured, name)) for name in constant)
        groups.setdefault(key, []).append(charge)
    return {
        key: rows
        for key, rows in groups.items()
        if len({getattr(charge.measured, varied) for charge in rows}) >= least
    }


def every_degree(rows: Sequence[ComparedMeasurement]) -> list[Measurement]:
    """A row for every degree between the rotations of rows that differ in the rotation alone."""
    rotations = [row.measured.rotation_deg for row in rows]
    inside = range(math.ceil(min(rotations)), math.floor(max(rotations)) + 1)
    angles = sorted({*rotations, *map(float, inside)})
    return [replace(rows[0].measured, rotation_deg=angle) for angle in angles]


def _turned(
    ours: Series, rows: Sequence[ComparedMeasurement], contact: str, results: Results
) -> Series:
    """Our charge of the electrode of a series at every degree."""
    turned = every_degree(rows)
    charges = [results[pressed(row.scene, contact)].charge_pC(ours.label) for row in turned]
    return Series(ours.label, np.array([row.rotation_deg for row in turned]), np.array(charges))


def _family(family: Sequence[ComparedMeasurement], varied: str, draw: Draw, path: Path) -> None:
    ours, theirs = [], []
    for electrode in sorted({row.measured.electrode for row in family}):
        rows = [row for row in family if row.measured.electrode == electrode]
        x = np.array([getattr(row.measured, varied) for row in rows])
        y = np.array([row.measured.charge_pC for row in rows])
        theirs.append(Series(electrode, x, y))
        once = {getattr(row.measured, varied): row.ours_pC["material"] for row in rows}
        abscissae = sorted(once)
        ours.append(
            Series(electrode, np.array(abscissae), np.array([once[value] for value in abscissae]))
        )
    with drawing(path, 150, 95) as figure:
        ax: Axes = figure.subplots()
        draw(ax, ours, theirs, family)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    columns = "\n".join(
        textwrap.fill(text, 78, initial_indent=f"  {name:<13} ", subsequent_indent=" " * 16)
        for name, text in COLUMNS.items()
    )
    parser = ArgumentParser(
        prog="reports.compare",
        description="Compare measured charges with computed ones of the same scenes.",
        epilog=f"columns of the file (CSV, UTF-8, decimal points, a header, any order):\n{columns}"
        "\n\nexample: reports/data/example_measurements.csv"
        "\nexit codes: 0 compared, 1 a solve failed, 2 the file has mistakes (each is told)",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("file", type=Path, metavar="FILE.csv", help="measured charges")
    add_out(parser, "measurements")
    parser.add_argument(
        "--contact",
        choices=tuple(CONTACTS),
        default="pressure",
        help="how the probe presses: uniform pressure as in the thesis (default), or rigid, "
        "sliding on the film or stuck to it",
    )
    add_processes(parser)
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
