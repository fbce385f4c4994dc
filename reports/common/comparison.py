"""Printed charges beside computed ones: differences, tables and their summary."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from pvdf_fem.output.figures import Series
from reports.common.page import Cell, Column, Table
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import Charge
from reports.common.thesis_scene import scene_of

#: Largest differences in percent allowed: of the median charge, and of any.
MEDIAN_LIMIT, LIMIT = 1.0, 2.0


@dataclass(frozen=True)
class Comparison:
    """A printed charge with ours: both observables and the estimated discretisation error."""

    charge: Charge
    status: str
    ours_pC: float
    error_pC: float
    material_pC: float

    @property
    def difference(self) -> float:
        """Ours minus the thesis's, in percent of the thesis's; NaN if the solve failed."""
        return 100.0 * (self.ours_pC / self.charge.charge_pC - 1.0)

    @property
    def counts(self) -> bool:
        """Whether both numbers stand."""
        return not self.charge.defect and bool(np.isfinite(self.difference))


def compare(charges: Iterable[Charge], results: Results) -> list[Comparison]:
    """Printed charges beside ours, from the records of their scenes."""
    return [_compare(charge, results) for charge in charges]


def _compare(charge: Charge, results: Results) -> Comparison:
    record, electrode = results[scene_of(charge)], charge.electrode
    return Comparison(
        charge,
        record.status,
        record.charge_pC(electrode, THESIS_EDGE),
        record.charge_error_pC(electrode, THESIS_EDGE),
        record.charge_pC(electrode, MATERIAL),
    )


_COLUMNS = (
    Column("case_id", "case"),
    Column("source", "place in the thesis"),
    Column("electrode", "electrode"),
    Column("rotation_deg", "rotation (°)", None),
    Column("force_N", "force (N)", None),
    Column("thesis_pC", "thesis (pC)"),
    Column("ours_pC", "ours (pC)"),
    Column("difference_percent", "diff. (%)", 2, signed=True),
    Column("estimated_error_pC", "estimated error (pC)", 2, on_page=False),
    Column("material_pC", "material (pC)"),
    Column("status", "status"),
    Column("defect_of_the_thesis", "remark"),
)


def long_table(name: str, caption: str, comparisons: Sequence[Comparison]) -> Table:
    """One row for each charge."""
    return Table(name, caption, _COLUMNS, [_row(one) for one in comparisons])


def _row(one: Comparison) -> list[Cell]:
    charge = one.charge
    return [
        charge.case,
        charge.source,
        charge.electrode,
        charge.rotation_deg,
        charge.force_N,
        charge.charge_pC,
        one.ours_pC,
        one.difference,
        one.error_pC,
        one.material_pC,
        one.status,
        charge.defect,
    ]


def wide_table(
    name: str, caption: str, keys: Sequence[Column], comparisons: Sequence[Comparison]
) -> Table:
    """One row for each scene, the electrodes side by side.

    `keys` are columns of the attributes of `Charge` that tell the scenes apart.
    """
    electrodes = sorted({one.charge.electrode for one in comparisons})
    columns = [*keys]
    for electrode in electrodes:
        group = f"electrode {electrode}"
        columns += [
            Column(f"{electrode}_thesis_pC", "thesis (pC)", 1, group),
            Column(f"{electrode}_ours_pC", "ours (pC)", 1, group),
            Column(f"{electrode}_difference_percent", "diff. (%)", 2, group, signed=True),
            Column(f"{electrode}_material_pC", "material (pC)", 1, group),
        ]
    columns.append(Column("remark", "remark"))
    scenes: dict[tuple[Cell, ...], dict[str, Comparison]] = {}
    for one in comparisons:
        key = tuple(getattr(one.charge, column.key) for column in keys)
        scenes.setdefault(key, {})[one.charge.electrode] = one
    rows = [_wide_row(key, electrodes, scenes[key]) for key in scenes]
    return Table(name, caption, columns, rows)


def _wide_row(
    key: tuple[Cell, ...], electrodes: Sequence[str], found: dict[str, Comparison]
) -> list[Cell]:
    row: list[Cell] = [*key]
    for electrode in electrodes:
        one = found.get(electrode)
        row += (
            [one.charge.charge_pC, one.ours_pC, one.difference, one.material_pC]
            if one
            else [None] * 4
        )
    remarks = {f"{e}: {one.charge.defect}" for e, one in found.items() if one.charge.defect}
    failures = {f"failed: {one.status}" for one in found.values() if not np.isfinite(one.ours_pC)}
    return [*row, "; ".join(sorted(remarks | failures)) or None]


def series(comparisons: Iterable[Comparison], label: str, x: str, y: str = "ours_pC") -> Series:
    """Comparisons as a curve over the attribute `x` of their charges.

    `y` is ``ours_pC``, ``difference``, or ``thesis_pC``.
    """
    chosen = sorted(comparisons, key=lambda one: float(getattr(one.charge, x)))
    values = [one.charge.charge_pC if y == "thesis_pC" else getattr(one, y) for one in chosen]
    abscissae = [float(getattr(one.charge, x)) for one in chosen]
    return Series(label, np.array(abscissae), np.array(values, dtype=float))


def verdict(comparisons: Sequence[Comparison]) -> str:
    """Median and largest difference against the limits, in words."""
    sizes = np.abs([one.difference for one in comparisons if one.counts])
    failed = sum(not np.isfinite(one.ours_pC) for one in comparisons)
    lost = f" {failed} charges have no computed value, since their solves failed." if failed else ""
    if not sizes.size:
        return f"No charge could be compared.{lost}"
    met = np.median(sizes) <= MEDIAN_LIMIT and sizes.max() <= LIMIT and not failed
    over = int((sizes > LIMIT).sum())
    return (
        f"{sizes.size} printed charges count. The median difference is {np.median(sizes):.2f} %, "
        f"the largest {sizes.max():.2f} %; {over or 'none'} of them over {LIMIT:g} %. "
        f"The requirement (median at most {MEDIAN_LIMIT:g} %, none over {LIMIT:g} %, no parameter "
        f"fitted) is {'met' if met else 'not met'}.{lost}"
    )
