"""The table `comparison`: readings beside computed charges, and their differences."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Literal, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from pydantic import Field

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.problem.problem import Problem
from pvdf_fem.report.data import SHORT_KEYS, Readings, format_cell
from pvdf_fem.report.kind import ElectrodeKind, Inputs, prefix_errors
from pvdf_fem.report.results import NothingToShowError, ReportResults
from pvdf_fem.report.task import Rows, Task
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver.sensitivity.uncertainty import require_differentiable, uncertainty
from pvdf_fem.view.figures import GREY, HALO, WIDTH_MM, get_line_style, make_figure
from pvdf_fem.view.labels import format_signed, format_significant

NAMED = 1  #: Number of largest differences that are labelled in the figure.
DATA_ERROR_PC = 0.5  #: Error in pC that sets the number of digits of readings in the table.
#: Columns that are not keys or labels of a row.
CHARGE_COLUMNS = ("electrode", "charge_pC", "computed_pC", "error_pC", "difference_percent")


@dataclass(frozen=True)
class ChargeDeviations(Task):
    """Task that computes standard deviations of charges due to the scene's uncertain values."""

    scene: Scene

    def run(self) -> Rows:
        """Return the deviations in pC, a row for each electrode.

        ``total`` is the deviation of the total charge, ``change`` that of the charge's change due
        to the touch.
        """
        result = uncertainty(self.scene)
        rows = []
        for name, total in result.charges_pC.items():
            change = result.charge_changes_pC[name]
            rows.append({"electrode": name, "total": total, "change": change})
        return rows


class ComparedRows(NamedTuple):
    """The readings to compare with, the scenes of their rows, and the electrodes to compare."""

    readings: Readings
    scenes: list[Scene]
    names: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ComparisonData:
    """The data of a comparison.

    Parameters
    ----------
    frame : DataFrame
        A row for each reading: the keys and labels of its scene, `CHARGE_COLUMNS`, and
        ``difference_over_deviation`` for scenes with uncertain values.
    row_names : list of str
        Name of the scene of each row.
    names : tuple of str
        Names of the electrodes that are compared.
    readings : Readings
        All rows of the data.
    """

    frame: pd.DataFrame
    row_names: list[str]
    names: tuple[str, ...]
    readings: Readings

    @property
    def what(self) -> str:
        """The word for the readings on the page, such as "measured"."""
        return self.readings.source.what


class Comparison(ElectrodeKind):
    """Readings in `data` beside computed charges, and a figure of the differences.

    A difference is the computed minus the measured charge, in percent of the measured charge. By
    default `electrodes` are the electrodes with readings. If the scene has `uncertain` values,
    differences are also divided by their standard deviation, which results from these values and
    from the discretisation errors of the computed charges (ASME V&V 20).
    """

    kind: Literal["comparison"]
    data: Annotated[str, Field(min_length=1)]

    stem: ClassVar[str] = "charges"
    rank: ClassVar[int] = 3

    def list_scenes(self, inputs: Inputs) -> list[Scene]:
        """Return the scenes of the rows that have a reading of the electrodes."""
        readings, scenes, names = self._resolve_rows(inputs)
        charges = readings.get_charges(scenes, names, "total")
        return [scenes[row] for row in _find_rows_with_readings(charges)]

    def list_tasks(self, inputs: Inputs) -> Sequence[Task]:
        """Return a task for the deviations of each scene with uncertain values."""
        scenes = list(dict.fromkeys(self.list_scenes(inputs)))
        with prefix_errors("scene"):
            for scene in scenes:
                require_differentiable(Problem.from_scene(scene))
        return [ChargeDeviations(scene) for scene in scenes if scene.uncertain]

    def collect_data(self, inputs: Inputs, results: ReportResults) -> ComparisonData:
        """Collect the readings with computed charges, differences and deviations."""
        readings, scenes, names = self._resolve_rows(inputs)
        reading = self.resolve_reading(inputs)
        all_charges = readings.get_charges(scenes, names, reading)
        rows = _find_rows_with_readings(all_charges)
        scenes = [scenes[row] for row in rows]
        charges = results.make_table(scenes, names, reading, all_charges[rows])
        repeated_rows = np.repeat(rows, len(names))
        frame = readings.key_frame.iloc[repeated_rows].reset_index(drop=True).join(charges)
        if scenes and scenes[0].uncertain:
            deviations = _collect_deviations(scenes, names, results, reading)
            total_deviations = np.hypot(deviations.ravel(), frame.error_pC)
            difference_pC = frame.computed_pC - frame.charge_pC
            frame["difference_over_deviation"] = difference_pC / total_deviations
        has_reading = frame.charge_pC.notna()
        all_names = readings.make_row_names()
        row_names = [all_names[row] for row in repeated_rows[has_reading]]
        frame = frame[has_reading].reset_index(drop=True)
        if not frame.difference_percent.notna().any():
            raise NothingToShowError("none of the scenes has charges")
        return ComparisonData(frame, row_names, names=names, readings=readings)

    def make_axes(self, data: ComparisonData) -> Sequence[Axes]:
        """Return axes for charges, and axes for differences below them."""
        figure = make_figure(WIDTH_MM, 106.0)
        axes: Sequence[Axes] = figure.subplots(
            2, sharex=True, gridspec_kw={"height_ratios": [3.0, 2.0]}
        )
        return axes

    def draw(self, data: ComparisonData, axes: Sequence[Axes]) -> None:
        """Draw computed charges and their differences against the readings."""
        charges, differences = axes
        frame = data.frame
        for number, name in enumerate(data.names):
            rows = frame[frame.electrode == name]
            look = {**get_line_style(number), "linestyle": "none", "markersize": 4.0}
            charges.plot(rows.charge_pC, rows.computed_pC, **look, label=name)
            errors = 100.0 * rows.error_pC / rows.charge_pC.abs()
            differences.errorbar(
                rows.charge_pC, rows.difference_percent, errors, elinewidth=0.7, **look
            )
        mean = frame.charge_pC.mean()
        charges.axline((mean, mean), slope=1.0, color=GREY, linewidth=0.8, zorder=1)
        differences.axhline(0.0, color=GREY, linewidth=0.8)
        _label_largest_differences(differences, data)
        charges.set_ylabel("computed charge (pC)")
        differences.set(xlabel=f"{data.what} charge (pC)", ylabel="difference (%)")
        columns = 2 if len(data.names) > 4 else 1
        charges.legend(loc="upper left", ncols=columns, title="electrode")

    def make_caption(self, data: ComparisonData) -> str:
        """Return a caption with the bias, the median and the largest difference."""
        bias = format_signed(data.frame.difference_percent.median(), 2)
        size = data.frame.difference_percent.abs()
        caption = (
            f"Below: computed minus {data.what} charge, in percent of the latter; bias {bias} %, "
            f"median magnitude {size.median():.2f} %, largest {size.max():.2f} %. Bars: errors of"
            " our solves."
        )
        if "difference_over_deviation" in data.frame:
            is_within = data.frame.difference_over_deviation.abs() <= 2.0
            percent = 100.0 * float(is_within.mean())
            caption += f" Of the differences {percent:.0f} % are within two standard deviations due"
            caption += " to the uncertain values."
        return caption

    def make_table(self, data: ComparisonData) -> pd.DataFrame:
        """Return a table of labels and keys, charges with significant digits, and differences.

        If the data have labels, only the labels and the keys in `SHORT_KEYS` are shown.
        """
        frame = data.frame
        labels = data.readings.source.labels
        columns = [*CHARGE_COLUMNS, "difference_over_deviation"]
        keys = [key for key in frame.columns if key not in columns]
        if labels:
            keys = [key for key in keys if key in labels or key in SHORT_KEYS]
        table = frame[keys].map(format_cell)
        table["electrode"] = frame.electrode
        charges = [format_significant(charge, DATA_ERROR_PC) for charge in frame.charge_pC]
        table[f"{data.what} (pC)"] = charges
        pairs = zip(frame.computed_pC, frame.error_pC, strict=True)
        table["computed (pC)"] = [format_significant(charge, error) for charge, error in pairs]
        table["± (pC)"] = [f"{error:.1g}" for error in frame.error_pC]
        table["diff. (%)"] = [format_signed(value, 2) for value in frame.difference_percent]
        if "difference_over_deviation" in frame:
            ratios = frame.difference_over_deviation
            table["diff. (σ)"] = [format_signed(ratio) for ratio in ratios]
        return table

    def make_claim(self, data: ComparisonData) -> str:
        """Return a claim with the median and the largest difference."""
        size = data.frame.difference_percent.abs()
        return (
            f"the {size.notna().sum()} {data.what} charges and the computed ones differ by "
            f"{size.median():.2g} % in the median and {size.max():.2g} % at most"
        )

    def _resolve_rows(self, inputs: Inputs) -> ComparedRows:
        """Find the readings, the scenes of their rows, and the electrodes to compare.

        Raises
        ------
        SceneError
            If the data have no readings of the electrodes, or if scenes are invalid.
        """
        readings = self.find_readings(inputs)
        assert readings is not None  # `data` is required
        scene = self.resolve_scene(inputs)
        names = self.resolve_electrodes(scene) if self.electrodes else readings.names
        if not any(name in readings.names for name in names):
            reason = "has no readings of the electrodes; add columns with their names"
            raise SceneError([format_error("data", self.data, reason)])
        return ComparedRows(readings, readings.make_scenes(scene), names)


def _find_rows_with_readings(charges: Array) -> Indices:
    """Return the indices of the rows with at least one finite charge.

    Parameters
    ----------
    charges : ndarray, shape (rows, electrodes)
        Charges in pC, NaN where there is no reading.
    """
    return np.flatnonzero(np.isfinite(charges).any(axis=1))


def _collect_deviations(
    scenes: Sequence[Scene], names: Sequence[str], results: ReportResults, reading: str
) -> Array:
    """Collect the standard deviations of charges due to uncertain values.

    Parameters
    ----------
    scenes : sequence of Scene
        Scenes with uncertain values.
    names : sequence of str
        Names of the electrodes.
    results : ReportResults
        Results with the rows of the tasks `ChargeDeviations`.
    reading : {"total", "change"}
        Whether total charges or their changes due to the touch are compared.

    Returns
    -------
    ndarray, shape (scenes, names)
        Standard deviations in pC; NaN for an electrode that a scene does not have.
    """
    deviations = np.full((len(scenes), len(names)), np.nan)
    for i, scene in enumerate(scenes):
        rows = results.get_rows(ChargeDeviations(scene))
        by_name = {row["electrode"]: row[reading] for row in rows}
        for j, name in enumerate(names):
            deviations[i, j] = by_name.get(name, np.nan)
    return deviations


def _label_largest_differences(ax: Axes, data: ComparisonData) -> None:
    """Label the points with the largest differences by the names of their rows."""
    frame = data.frame
    middle = 0.5 * (frame.charge_pC.max() + frame.charge_pC.min())
    for row in frame.difference_percent.abs().nlargest(NAMED).index:
        point = (frame.charge_pC[row], frame.difference_percent[row])
        side, offset = ("right", -6.0) if point[0] > middle else ("left", 6.0)
        label = ax.annotate(data.row_names[row], point, (offset, 0.0), textcoords="offset points")
        label.set(ha=side, va="center", fontsize=7.0, color=GREY, path_effects=[HALO])
