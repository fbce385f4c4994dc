"""The rectangle at the centre of the four-electrode sensor: its charges as cosine series."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem import Scene
from reports.chapters.force_and_angle.force_law import rest_charge_pC
from reports.common.comparison import Comparison, compare, select, sound
from reports.common.results import Results
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene
from reports.thesis_methods.cosine_series import CosineSeries, Reading, sign_of
from reports.thesis_methods.force_law import MembraneLaw

#: Tables that the series are fitted to.
TABLES = ("Table 4.1", "Table 4.5", "Table 4.6")
#: Number of cosines in a series of the thesis's charges; more would follow their scatter.
COSINE_TERMS = 4
#: Number of terms in the force in a series of the thesis's charges.
FORCE_TERMS = 3


def table_charges(thesis: Thesis) -> list[Charge]:
    """The charges of the tables that the series are fitted to."""
    return thesis.from_(*TABLES)


def table_scenes(thesis: Thesis) -> list[Scene]:
    """The scenes of these charges."""
    return [scene_of(charge) for charge in table_charges(thesis)]


def asymmetry_pC(thesis: Thesis) -> float:
    """Largest difference in pC between charges of Table 4.1 that symmetry makes equal.

    Quarter turns and reflections leave the sensor as it is: the charges of all electrodes at all
    angles are those of A from 0° to 90°. Raises `KeyError` if the data at hand lack the table.
    """
    equivalent: dict[float, list[float]] = {}
    for charge in thesis.from_("Table 4.1"):
        equivalent.setdefault(round(_cosine(charge), 9), []).append(charge.charge_pC)
    if len(equivalent) < 10:
        raise KeyError("Table 4.1")
    return max(max(charges) - min(charges) for charges in equivalent.values())


def readings(comparisons: Iterable[Comparison], y: str) -> list[Reading]:
    """Charges as readings for a series: printed ones if `y` is ``thesis_pC``, else ours.

    Printed charges with a defect, and those copied from an equivalent angle, are left out. Ours
    obey the symmetry of the scene, and only one of equivalent charges is taken.
    """
    if y == "thesis_pC":
        independent = [
            comparison
            for comparison in sound(comparisons)
            if "equal_to_0deg_value" not in comparison.charge.flags
        ]
        return [_reading(comparison, comparison.thesis_pC) for comparison in independent]
    distinct = {
        (round(_cosine(comparison.charge), 9), comparison.charge.force_N): _reading(
            comparison, getattr(comparison, y)
        )
        for comparison in comparisons
        if np.isfinite(getattr(comparison, y))
    }
    return list(distinct.values())


def _reading(comparison: Comparison, charge_pC: float) -> Reading:
    charge = comparison.charge
    return Reading(charge.rotation_deg, charge.force_N, charge.electrode, charge_pC)


def _cosine(charge: Charge) -> float:
    return sign_of(charge.electrode) * math.cos(2 * math.radians(charge.rotation_deg))


def fitted(
    charges: list[Reading], cosine_terms: int, force_terms: int, law: MembraneLaw | None = None
) -> CosineSeries | None:
    """A series through readings; None if there are too few of them."""
    if len({reading.force_N for reading in charges}) < max(force_terms, 2 if law is None else 1):
        return None
    try:
        return CosineSeries.fit(
            charges, cosine_terms=cosine_terms, force_terms=force_terms, law=law
        )
    except ValueError:
        return None


@dataclass(frozen=True)
class Rectangle:
    """Compared charges of the three tables, and the series through them.

    `theirs` is the series of the thesis's charges, `ours` that of our thesis-edge charges; None
    with too few charges.
    """

    comparisons: tuple[Comparison, ...]

    @classmethod
    def of(cls, thesis: Thesis, results: Results) -> Rectangle:
        """Compare the charges of the tables with the records of `table_scenes`."""
        return cls(tuple(compare(table_charges(thesis), results)))

    @cached_property
    def law(self) -> MembraneLaw | None:
        """The membrane law of the thesis's charges against force, with the known charge at rest."""
        charges = readings(self.table("Table 4.5") + self.table("Table 4.6"), "thesis_pC")
        if not charges:
            return None
        rest_pC = rest_charge_pC(thesis_scene("4", "rect14x7"))
        return MembraneLaw.fit(
            [reading.force_N for reading in charges],
            [reading.charge_pC for reading in charges],
            rest_pC,
        )

    @cached_property
    def theirs(self) -> CosineSeries | None:
        """The series through the thesis's charges without a defect."""
        return fitted(readings(self.comparisons, "thesis_pC"), COSINE_TERMS, FORCE_TERMS, self.law)

    @cached_property
    def ours(self) -> CosineSeries | None:
        """The series through our charges."""
        return fitted(readings(self.comparisons, "ours_pC"), cosine_terms=7, force_terms=4)

    def table(self, source: str, **attributes: object) -> list[Comparison]:
        """The comparisons of one table whose charges have these attributes."""
        return select(self.comparisons, source=source, **attributes)
