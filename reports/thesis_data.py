"""The thesis's printed numbers, read from `reports/data/` (see its README)."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

DATA = Path(__file__).parent / "data"

#: Flags of `charges.csv` under which a printed number is wrong or is not the number of its row:
#: such rows are shown, but not counted. The other flags mark a guessed orientation of the probe, a
#: value repeated at an equivalent angle, and an angle 0.005° off; their numbers stand.
DEFECTS = {
    "row_identical_to_table_4.6_0deg": "row copied from Table 4.6",
    "row_identical_to_table_4.5_0deg": "row copied from Table 4.5",
    "outlier_high": "0.7 to 0.8 % above the table's own trend",
    "2N_value_below_trend": "below the table's own trend",
    "angle_disagrees_with_text_and_eq_4.1": "angle misprinted",
}


@dataclass(frozen=True)
class Charge:
    """A printed charge: a row of `charges.csv`."""

    case: str
    source: str
    layout: str
    probe: str
    x_mm: float
    y_mm: float
    rotation_deg: float
    force_N: float
    electrode: str
    charge_pC: float
    flags: tuple[str, ...]

    @property
    def defect(self) -> str:
        """Why the number does not count, or nothing."""
        return "; ".join(DEFECTS[flag] for flag in self.flags if flag in DEFECTS)


@dataclass(frozen=True)
class ContourPoint:
    """Where the thesis found a charge on a line from an electrode: `isocharge_points.csv`."""

    case: str
    electrode: str
    charge_pC: float
    frame: str
    angle_deg: float
    radius_mm: float


@dataclass(frozen=True)
class Mapping:
    """The lines from electrode A of the three-electrode sensor (section 3.1.1, Fig. 3.5)."""

    angles_deg: tuple[float, ...]
    step_mm: float


@dataclass(frozen=True)
class Thesis:
    """The printed numbers that a report compares with."""

    charges: tuple[Charge, ...]
    contours: tuple[ContourPoint, ...]
    mapping: Mapping

    @classmethod
    def read(cls, directory: Path = DATA) -> Thesis:
        """All numbers."""
        mapping = tomllib.loads((directory / "parameters.toml").read_text())["mapping"]
        return cls(
            tuple(_charge(row) for row in _rows(directory / "charges.csv")),
            tuple(_contour_point(row) for row in _rows(directory / "isocharge_points.csv")),
            Mapping(tuple(mapping["angles_reference_A"]["value"]), mapping["radial_step"]["value"]),
        )

    def from_(self, *sources: str) -> list[Charge]:
        """Charges of a table or section; the beginning of its name will do."""
        return [charge for charge in self.charges if charge.source.startswith(sources)]

    def quick(self) -> Thesis:
        """A few of the numbers, for trying things out."""
        return Thesis(
            tuple(charge for charge in self.charges if charge.case in _QUICK),
            tuple(point for point in self.contours if point.angle_deg in (65, 85)),
            Mapping((85.0,), 8.0),
        )

    @cached_property
    def counted(self) -> list[Charge]:
        """The charges that count in a comparison."""
        return [charge for charge in self.charges if not charge.defect]


_QUICK = {
    *("s311_1", "t34_f1.0", "t41_r0", "t41_r90", "t41_r180", "t42_11.176"),
    *("t45_r0_f0.5", "t45_r0_f1", "t45_r90_f1", "t46_r0_f0.5", "t46_r0_f1", "t46_r90_f1"),
}


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def _charge(row: dict[str, str]) -> Charge:
    return Charge(
        row["case_id"],
        row["source"],
        row["layout"],
        row["probe"],
        float(row["x_mm"]),
        float(row["y_mm"]),
        float(row["rotation_deg"]),
        float(row["force_N"]),
        row["electrode"],
        float(row["charge_pC"]),
        tuple(flag for flag in row["flag"].split(";") if flag),
    )


def _contour_point(row: dict[str, str]) -> ContourPoint:
    return ContourPoint(
        row["case_id"],
        row["electrode"],
        float(row["charge_pC"]),
        row["angle_frame"],
        float(row["angle_deg"]),
        float(row["radius_mm"]),
    )
