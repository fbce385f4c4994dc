"""The rectangle at the centre of the four-electrode sensor: its charges as cosine series."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pvdf_fem import Scene
from pvdf_fem.maps.cosine_series import CosineSeries, Reading, sign_of
from pvdf_fem.maps.force_law import MembraneLaw
from reports.chapters.force_and_angle.force_law import rest_charge_pC
from reports.common.comparison import Comparison, compare
from reports.common.results import Results
from reports.common.tables import of, sound
from reports.common.thesis_data import Charge, Thesis
from reports.common.thesis_scene import scene_of, thesis_scene

#: Tables that the series are fitted to.
TABLES = ("Table 4.1", "Table 4.5", "Table 4.6")
#: Terms of the series of the thesis's charges, whose scatter more terms would follow, and of ours.
COSINE_TERMS, FORCE_TERMS = 4, 3
OUR_COSINE_TERMS, OUR_FORCE_TERMS = 7, 4


def table_charges(thesis: Thesis) -> list[Charge]:
    """The charges of the tables that the series are fitted to."""
    return thesis.from_(*TABLES)


def table_scenes(thesis: Thesis) -> list[Scene]:
    """Their scenes."""
    return [scene_of(charge) for charge in table_charges(thesis)]


def readings(found: Iterable[Comparison], y: str) -> list[Reading]:
    """Charges as readings: the thesis's that are independent and stand, or all of ours.

    Ours obey the symmetry, so that equivalent ones are one number; it is taken once.
    """
    if y == "thesis_pC":
        chosen = [o for o in sound(found) if "equal_to_0deg_value" not in o.charge.flags]
        return [_reading(one, one.charge.charge_pC) for one in chosen]
    distinct = {
        (round(_cosine(one.charge), 9), one.charge.force_N): _reading(one, getattr(one, y))
        for one in found
        if np.isfinite(getattr(one, y))
    }
    return list(distinct.values())


def _reading(one: Comparison, charge_pC: float) -> Reading:
    charge = one.charge
    return Reading(charge.rotation_deg, charge.force_N, charge.electrode, charge_pC)


def _cosine(charge: Charge) -> float:
    return sign_of(charge.electrode) * math.cos(2 * math.radians(charge.rotation_deg))


def fitted(
    some: list[Reading], cosine_terms: int, force_terms: int, law: MembraneLaw | None = None
) -> CosineSeries | None:
    """A series through readings; None if they are too few for it."""
    if len({reading.force_N for reading in some}) < max(force_terms, 2 if law is None else 1):
        return None
    try:
        return CosineSeries.fit(some, cosine_terms=cosine_terms, force_terms=force_terms, law=law)
    except ValueError:
        return None


@dataclass(frozen=True)
class Rectangle:
    """Compared charges of the three tables, and the series through them.

    `theirs` is the series of the thesis's charges, `ours` that of our thesis-edge charges; None
    with too few charges.
    """

    found: tuple[Comparison, ...]

    @classmethod
    def of(cls, thesis: Thesis, results: Results) -> Rectangle:
        """From the records of `table_scenes`."""
        return cls(tuple(compare(table_charges(thesis), results)))

    @cached_property
    def law(self) -> MembraneLaw | None:
        """Law of the thesis's charges of Tables 4.5 and 4.6, the charge at rest known."""
        some = readings(self.table("Table 4.5") + self.table("Table 4.6"), "thesis_pC")
        if not some:
            return None
        rest_pC = rest_charge_pC(thesis_scene("4", "rect14x7"))
        return MembraneLaw.fit([r.force_N for r in some], [r.charge_pC for r in some], rest_pC)

    @cached_property
    def theirs(self) -> CosineSeries | None:
        """Series of all of the thesis's charges that stand."""
        return fitted(readings(self.found, "thesis_pC"), COSINE_TERMS, FORCE_TERMS, self.law)

    @cached_property
    def ours(self) -> CosineSeries | None:
        """Series of our charges."""
        return fitted(readings(self.found, "ours_pC"), OUR_COSINE_TERMS, OUR_FORCE_TERMS)

    def table(self, source: str, **wanted: object) -> list[Comparison]:
        """Comparisons of one table."""
        return of(self.found, source=source, **wanted)
