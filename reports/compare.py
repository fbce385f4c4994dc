"""Your own measured charges beside ours, of the same scenes.

    python -m reports.compare FILE.csv [--out DIR] [--contact pressure|sliding|stuck]
                              [--processes N]

Writes ``index.html`` with figures (SVG) and a table (CSV). Solved scenes are kept in ``results/``
beside them. The help lists the columns of the file; `reports/data/example_measurements.csv` is one.
"""

from __future__ import annotations

import argparse
import sys
import textwrap
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from tqdm import tqdm

from pvdf_fem import Scene, __version__
from pvdf_fem.cli.program import ArgumentParser, InputError, run_program
from pvdf_fem.files import make_directory
from pvdf_fem.output.figures import (
    COLOURS,
    GREY,
    Series,
    charge_against_force,
    charge_against_rotation,
    new_figure,
    save,
    style,
)
from reports.chapters.contact import CONTACTS, pressed
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

#: Our charges that a measured one is compared with.
READINGS = {
    "material": "charge of the electrode's area",
    "change": "the same less its value without force, which an oscillating force does not show",
    "thesis_edge": "the thesis's averages along the electrode's edges",
}
#: Values of a quantity from which on its rows get a figure of their own.
LEAST = 3


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare; returns 0, 1 if a solve failed, 2 for a file with mistakes."""
    options = _options(arguments)
    return run_program("reports.compare", lambda: _compare(options))


def _compare(options: argparse.Namespace) -> int:
    try:
        measured = read_measurements(options.file)
    except MeasurementError as error:
        raise InputError(*error.problems) from None
    make_directory(options.out, "index.html")
    results = Results(options.out / "results", options.processes)
    scenes = _scenes(measured, options.contact)
    with tqdm(total=results.missing(scenes), unit="solve", disable=None) as bar:
        results.solve(scenes, lambda done, total: bar.update(1 if done else 0))
    found = [_beside(one, options.contact, results) for one in measured]
    page = _page(options.file, options.contact, found, options.out)
    print(page.write(options.out))
    return 0 if all(one.status == "converged" for one in found) else 1


@dataclass(frozen=True)
class Beside:
    """A measured charge with ours in pC, by reading; NaN where the solve failed."""

    measured: Measurement
    ours_pC: dict[str, float]
    status: str

    def difference(self, reading: str) -> float:
        """Measured less ours, in percent of ours."""
        return 100.0 * (self.measured.charge_pC / self.ours_pC[reading] - 1.0)


def _rest(scene: Scene) -> Scene:
    return scene.with_(**{"probe": None, "numerics.observable": MATERIAL})


def _scenes(measured: Iterable[Measurement], contact: str) -> list[Scene]:
    pressed_ = [pressed(one.scene, contact) for one in measured]
    return pressed_ + [_rest(scene) for scene in pressed_]


def _beside(one: Measurement, contact: str, results: Results) -> Beside:
    scene = pressed(one.scene, contact)
    record, rest = results[scene], results[_rest(scene)]
    material = record.charge_pC(one.electrode, MATERIAL)
    ours = {
        "material": material,
        "change": material - rest.charge_pC(one.electrode, MATERIAL),
        "thesis_edge": record.charge_pC(one.electrode, THESIS_EDGE),
    }
    return Beside(one, ours, record.status)


# --------------------------------------------------------------------------------------- page


def _page(file: Path, contact: str, found: Sequence[Beside], out: Path) -> Page:
    _overview(found, out / "comparison.svg")
    caption = (
        "Above: measured charge over the computed one (material); line: equal. Below: measured "
        "less computed in percent of computed, for three readings of a charge."
    )
    blocks: list[Table | Picture] = [Picture("comparison.svg", caption)]
    blocks += _families(found, out)
    press = {"pressure": "a uniform pressure"}.get(contact, f"a rigid probe, {contact}")
    introduction = [
        f"{len(found)} charges of {len({one.measured.case for one in found})} cases in "
        f"{file.name}, beside those computed for the thesis's sensor under {press}. Nothing is "
        "fitted.",
        *(f"{name.replace('_', '-')}: {text}." for name, text in READINGS.items()),
        *_summary(found),
    ]
    section = Section("charges", "Charges", [], [*blocks, _table(found)])
    section.write_tables(out)
    made = {"pvdf_fem": __version__, "Tolerance": f"{TOLERANCE:g} (relative)"}
    return Page("Measured charges beside computed ones", introduction, [section], made)


def _summary(found: Sequence[Beside]) -> list[str]:
    texts = []
    for reading in READINGS:
        sizes = np.abs([one.difference(reading) for one in found])
        if np.isfinite(sizes).any():
            name = reading.replace("_", "-")
            texts.append(f"{name} {np.nanmedian(sizes):.2f} % (up to {np.nanmax(sizes):.2f} %)")
    failed = sum(one.status != "converged" for one in found)
    lost = [f"{failed} charges have no computed value."] if failed else []
    return [f"Median difference: {', '.join(texts)}.", *lost] if texts else lost


def _table(found: Sequence[Beside]) -> Table:
    columns = [Column("case", "case"), Column("layout", "electrodes"), Column("probe", "probe")]
    columns += [Column(key, label, None) for key, label in _PLACES.items()]
    columns += [Column("electrode", "electrode"), Column("measured_pC", "measured (pC)")]
    for reading in READINGS:
        group = reading.replace("_", "-")
        columns.append(Column(f"{reading}_pC", "ours (pC)", 1, group))
        columns.append(
            Column(f"{reading}_difference_percent", "measured − ours (%)", 2, group, True)
        )
    columns.append(Column("status", "status"))
    return Table("comparison", "All charges.", columns, [_row(one) for one in found])


_PLACES = {
    "x_mm": "x (mm)",
    "y_mm": "y (mm)",
    "rotation_deg": "rotation (°)",
    "force_N": "force (N)",
}


def _row(one: Beside) -> list[Cell]:
    measured = one.measured
    row: list[Cell] = [measured.case, measured.layout, measured.probe]
    row += [float(getattr(measured, key)) for key in _PLACES]
    row += [measured.electrode, measured.charge_pC]
    for reading in READINGS:
        row += [one.ours_pC[reading], one.difference(reading)]
    return [*row, one.status]


# ------------------------------------------------------------------------------------ figures


def _overview(found: Sequence[Beside], path: Path) -> None:
    with style():
        figure = new_figure(150, 170)
        above, below = figure.subplots(2)
        for electrode, ink in zip("ABCD", COLOURS, strict=False):
            some = [one for one in found if one.measured.electrode == electrode]
            x = [one.ours_pC["material"] for one in some]
            y = [one.measured.charge_pC for one in some]
            if some:
                above.plot(x, y, "o", mfc="none", mec=ink, label=f"electrode {electrode}")
        above.axline((0.0, 0.0), slope=1.0, color=GREY, lw=0.8)
        above.set(xlabel="computed charge (pC)", ylabel="measured charge (pC)")
        below.axhline(0.0, color=GREY, lw=0.8)
        for reading, ink, marker in zip(READINGS, COLOURS, "os^", strict=False):
            x = [one.ours_pC[reading] for one in found]
            y = [one.difference(reading) for one in found]
            below.plot(x, y, marker, mfc="none", mec=ink, label=reading.replace("_", "-"))
        below.set(xlabel="computed charge (pC)", ylabel="measured − computed (%)")
        for ax in (above, below):
            ax.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=4, borderaxespad=0.0)
        save(figure, path)


def _families(found: Sequence[Beside], out: Path) -> list[Picture]:
    """Figures of the rows that differ in the rotation, or in the force, alone."""
    pictures = []
    kinds: tuple[tuple[str, str, Callable[..., None]], ...] = (
        ("rotation_deg", "rotation", charge_against_rotation),
        ("force_N", "force", charge_against_force),
    )
    for varied, name, draw in kinds:
        groups = families(found, varied)
        for number, (constant, some) in enumerate(groups.items(), start=1):
            file = f"{name}_{number}.svg"
            _family(some, varied, draw, out / file)
            told = ", ".join(f"{key} {value}" for key, value in constant)
            text = f"Charge (material) against {name}; rings: measured. {told}."
            pictures.append(Picture(file, text))
    return pictures


def families(
    found: Sequence[Beside], varied: str
) -> dict[tuple[tuple[str, object], ...], list[Beside]]:
    """Groups of rows that differ in one quantity alone, with `LEAST` values of it or more."""
    constant = [key for key in ("layout", "probe", *_PLACES) if key != varied]
    groups: dict[tuple[tuple[str, object], ...], list[Beside]] = {}
    for one in found:
        key = tuple((name, getattr(one.measured, name)) for name in constant)
        groups.setdefault(key, []).append(one)
    return {
        key: some
        for key, some in groups.items()
        if len({getattr(one.measured, varied) for one in some}) >= LEAST
    }


def _family(some: Sequence[Beside], varied: str, draw: Callable[..., None], path: Path) -> None:
    ours, theirs = [], []
    for electrode in sorted({one.measured.electrode for one in some}):
        rows = [one for one in some if one.measured.electrode == electrode]
        x = np.array([getattr(one.measured, varied) for one in rows])
        y = np.array([one.measured.charge_pC for one in rows])
        theirs.append(Series(electrode, x, y))
        once = {getattr(one.measured, varied): one.ours_pC["material"] for one in rows}
        at = sorted(once)
        ours.append(Series(electrode, np.array(at), np.array([once[value] for value in at])))
    with style():
        figure = new_figure(150, 95)
        ax: Axes = figure.subplots()
        draw(ax, ours, theirs, others="measured")
        save(figure, path)


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
