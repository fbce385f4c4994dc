"""Printed charges beside computed ones: their differences, and selections and series of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from reports.common.charge_figures import Series
from reports.common.page import signed
from reports.common.results import MATERIAL, THESIS_EDGE, Results
from reports.common.thesis_data import Charge
from reports.common.thesis_scene import scene_of

#: Largest allowed median of the differences, in percent.
MEDIAN_LIMIT = 1.0
#: Largest allowed difference of a charge, in percent.
LIMIT = 2.0


@dataclass(frozen=True)
class Comparison:
    """A printed charge with ours: both observables and the estimated discretisation error."""

    charge: Charge
    status: str
    ours_pC: float
    error_pC: float
    material_pC: float

    @property
    def thesis_pC(self) -> float:
        """The printed charge."""
        return self.charge.charge_pC

    @property
    def difference(self) -> float:
        """Ours minus the thesis's, in percent of the thesis's; NaN if the solve failed."""
        return 100.0 * (self.ours_pC / self.thesis_pC - 1.0)

    @property
    def counts(self) -> bool:
        """Whether the printed number has no defect and ours exists."""
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
        record.charge_errors_pC(8.0, 8.0, THESIS_EDGE)[electrode],
        record.charge_pC(electrode, MATERIAL),
    )


# ------------------------------------------------------------------------ selections and series


def select(comparisons: Iterable[Comparison], **attributes: object) -> list[Comparison]:
    """The comparisons whose charge has these values of its attributes."""
    return [
        comparison
        for comparison in comparisons
        if all(getattr(comparison.charge, key) == value for key, value in attributes.items())
    ]


def group_by(comparisons: Iterable[Comparison], key: str) -> dict[str, list[Comparison]]:
    """Comparisons by an attribute of their charges, ascending; angles have the sign of degree."""
    comparisons = list(comparisons)
    values = sorted({getattr(comparison.charge, key) for comparison in comparisons})
    return {_label(key, value): select(comparisons, **{key: value}) for value in values}


def _label(key: str, value: object) -> str:
    return f"{value:g}°" if key == "rotation_deg" else str(value)


def sound(comparisons: Iterable[Comparison]) -> list[Comparison]:
    """The comparisons whose printed number has no defect."""
    return [comparison for comparison in comparisons if not comparison.charge.defect]


def series(comparisons: Iterable[Comparison], label: str, x: str, y: str = "ours_pC") -> Series:
    """Comparisons as a curve over the attribute `x` of their charges.

    `y` is an attribute of a comparison: ``ours_pC``, ``thesis_pC``, ``difference``, ...
    """
    ascending = sorted(comparisons, key=lambda comparison: float(getattr(comparison.charge, x)))
    abscissae = [float(getattr(comparison.charge, x)) for comparison in ascending]
    values = [getattr(comparison, y) for comparison in ascending]
    return Series(label, np.array(abscissae), np.array(values, dtype=float))


def curves(groups: dict[str, list[Comparison]], x: str, y: str = "ours_pC") -> list[Series]:
    """A `series` for each group that is not empty."""
    return [series(group, label, x, y) for label, group in groups.items() if group]


def sound_differences(groups: dict[str, list[Comparison]], x: str) -> list[Series]:
    """Differences of the numbers without defects: a series for each group.

    A group without such numbers has a single NaN, so that the colours of the others stay.
    """
    nothing = np.full(1, np.nan)
    return [
        series(counted, label, x, "difference")
        if (counted := sound(group))
        else Series(label, np.zeros(1), nothing)
        for label, group in groups.items()
    ]


# -------------------------------------------------------------------------------------- verdict


def swings_pC(comparisons: Iterable[Comparison]) -> tuple[float, float]:
    """By how much rotation changes A in Table 4.1, in pC: in the thesis, and here."""
    rows = [row for row in select(comparisons, electrode="A") if row.charge.source == "Table 4.1"]
    if not rows:
        return np.nan, np.nan
    return np.ptp([row.thesis_pC for row in rows]), np.ptp([row.ours_pC for row in rows])


def bias(comparisons: Sequence[Comparison]) -> str:
    """How many of the differences have which sign, and how many charges are independent."""
    counted = [comparison for comparison in comparisons if comparison.counts]
    differences = np.array([comparison.difference for comparison in counted])
    if not differences.size:
        return ""
    # symmetry leaves charges of equivalent scenes equal but for rounding
    distinct = len({round(comparison.ours_pC, 3) for comparison in counted})
    text = (
        f"The differences are not scatter: {(differences < 0.0).sum()} of {len(counted)} are "
        f"negative, and their median with its sign is {signed(float(np.median(differences)), 2)} "
        f"%. Nor are they {len(counted)} independent ones: by symmetry, or since tables print "
        f"charges again, they belong to {distinct} distinct charges."
    )
    theirs, ours = swings_pC(counted)
    if not ours > 0.0:
        return text
    return (
        f"{text} Turning the rectangle at the centre changes the charge of A by {ours:.1f} pC "
        f"here and by {theirs:.1f} pC in Table 4.1, {100.0 * (theirs / ours - 1.0):.0f} % more."
    )


def verdict(comparisons: Sequence[Comparison]) -> str:
    """Median and largest difference against the limits, in words."""
    sizes = np.abs([comparison.difference for comparison in comparisons if comparison.counts])
    failed = sum(not np.isfinite(comparison.ours_pC) for comparison in comparisons)
    remark = (
        f" {failed} charges have no computed value, since their solves failed." if failed else ""
    )
    if not sizes.size:
        return f"No charge could be compared.{remark}"
    met = np.median(sizes) <= MEDIAN_LIMIT and sizes.max() <= LIMIT and not failed
    over = int((sizes > LIMIT).sum())
    return (
        f"{sizes.size} printed charges count. The median difference is {np.median(sizes):.2f} %, "
        f"the largest {sizes.max():.2f} %; {over or 'none'} of them over {LIMIT:g} %. "
        f"The requirement (median at most {MEDIAN_LIMIT:g} %, none over {LIMIT:g} %, no parameter "
        f"fitted) is {'met' if met else 'not met'}.{remark}"
    )
