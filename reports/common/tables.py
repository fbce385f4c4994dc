"""Tables of printed charges beside computed ones."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from reports.common.comparison import Comparison
from reports.common.page import Cell, Column, Table

CASE = Column("case", "case", on_page=False)
ROTATION = Column("rotation_deg", "rotation (°)", None)
FORCE = Column("force_N", "force (N)", None)

_COLUMNS = (
    Column("case_id", "case", on_page=False),
    Column("source", "place in the thesis"),
    Column("electrode", "electrode"),
    ROTATION,
    FORCE,
    Column("thesis_pC", "thesis (pC)"),
    Column("ours_pC", "ours (pC)"),
    Column("difference_percent", "diff. (%)", 2, signed=True),
    Column("estimated_error_pC", "estimated error (pC)", 2, on_page=False),
    Column("material_pC", "material (pC)"),
    Column("status", "status"),
    Column("defect_of_the_thesis", "remark"),
)


def long_table(name: str, caption: str, comparisons: Sequence[Comparison]) -> Table:
    """A table with a row for each charge."""
    return Table(name, caption, _COLUMNS, [_row(comparison) for comparison in comparisons])


def _row(comparison: Comparison) -> list[Cell]:
    charge = comparison.charge
    return [
        charge.case,
        charge.source,
        charge.electrode,
        charge.rotation_deg,
        charge.force_N,
        charge.charge_pC,
        comparison.ours_pC,
        comparison.difference,
        comparison.error_pC,
        comparison.material_pC,
        comparison.status,
        charge.defect,
    ]


def wide_table(
    name: str, caption: str, keys: Sequence[Column], comparisons: Sequence[Comparison]
) -> Table:
    """A table with a row for each scene, the electrodes side by side.

    `keys` are columns of the attributes of `Charge` that tell the scenes apart.
    """
    electrodes = sorted({comparison.charge.electrode for comparison in comparisons})
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
    for comparison in comparisons:
        key = tuple(getattr(comparison.charge, column.key) for column in keys)
        scenes.setdefault(key, {})[comparison.charge.electrode] = comparison
    rows = [_wide_row(key, electrodes, scenes[key]) for key in scenes]
    return Table(name, caption, columns, rows)


def _wide_row(
    key: tuple[Cell, ...], electrodes: Sequence[str], by_electrode: dict[str, Comparison]
) -> list[Cell]:
    row: list[Cell] = [*key]
    remarks = set()
    for electrode in electrodes:
        comparison = by_electrode.get(electrode)
        if comparison is None:
            row += [None] * 4
            continue
        row += [comparison.thesis_pC, comparison.ours_pC]
        row += [comparison.difference, comparison.material_pC]
        if comparison.charge.defect:
            remarks.add(f"{electrode}: {comparison.charge.defect}")
        if not np.isfinite(comparison.ours_pC):
            remarks.add(f"failed: {comparison.status}")
    return [*row, "; ".join(sorted(remarks)) or None]
