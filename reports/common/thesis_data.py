"""The thesis's printed numbers, read from `reports/data/` (see its README)."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass, replace
from functools import cached_property
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.maps.polynomial import Polynomial, Product, read_polynomials

DATA = Path(__file__).parents[1] / "data"

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
    """Where the thesis found a charge on a line from an electrode: `isocharge_points.csv`.

    `frame` is the electrode that the line starts from; the contour of C is that of B at the charge
    of C, mirrored at the y axis.
    """

    contour: str
    case: str
    electrode: str
    charge_pC: float
    frame: str
    angle_deg: float
    radius_mm: float
    x_mm: float
    y_mm: float


@dataclass(frozen=True)
class Position:
    """A recovered position of a probe, simulated or measured: `positioning_errors.csv`.

    `error_mm` is NaN where the contours did not intersect.
    """

    source: str
    row: int
    kind: str
    film: str
    layout: str
    probe: str
    position: str
    x_mm: float
    y_mm: float
    rotation_deg: float
    force_N: float
    error_mm: float

    @property
    def case(self) -> str:
        """Name: table, row and number of electrodes."""
        return f"{self.source} row {self.row}, {self.layout} electrodes"

    @property
    def touch(self) -> NDArray[np.float64]:
        """Where the probe presses, (4,): x and y in mm, rotation in degrees, force in N."""
        return np.array([self.x_mm, self.y_mm, self.rotation_deg, self.force_N])


@dataclass(frozen=True)
class TriangulationPoint:
    """A point of a triangulation, NaN where none is printed: `triangulation.csv`.

    `item` names three electrodes, or is ``average`` or ``target``.
    """

    case: str
    source: str
    probe: str
    rotation_deg: float
    force_N: float
    item: str
    x_mm: float
    y_mm: float
    error_mm: float
    status: str


@dataclass(frozen=True)
class AngleEstimate:
    """An angle recovered from a charge of A, and its check run: `angle_estimates.csv`."""

    source: str
    force_N: float
    equation: str
    charge_pC: float
    angle_table_deg: float
    angle_text_deg: float
    check_charge_pC: float
    error_stated_percent: float
    flags: tuple[str, ...]

    @property
    def case(self) -> str:
        """Name: table and charge."""
        return f"{self.source}, {self.charge_pC:g} pC"


@dataclass(frozen=True)
class ChargeRange:
    """Charges of A that the thesis takes for one force: `lookup.csv` (Table 4.4)."""

    least_pC: float
    largest_pC: float
    force_N: float


@dataclass(frozen=True)
class ThesisFigure:
    """A figure of the thesis: `figures.csv`."""

    number: str
    section: str
    kind: str
    shows: str


@dataclass(frozen=True)
class Thesis:
    """The printed numbers that a report compares with.

    Attributes
    ----------
    parameters : dict
        Tables of `parameters.toml`; a number is ``parameters["circuit"]["load_resistance"]
        ["value"]``.
    polynomials, products : dict
        By the number of the equation.
    angles_deg : dict
        Directions of the lines of the mapping scheme from electrodes A and B of three.
    step_mm : float
        Step on those lines.
    """

    charges: tuple[Charge, ...]
    contours: tuple[ContourPoint, ...]
    positions: tuple[Position, ...]
    triangulation: tuple[TriangulationPoint, ...]
    angle_estimates: tuple[AngleEstimate, ...]
    charge_ranges: tuple[ChargeRange, ...]
    figures: tuple[ThesisFigure, ...]
    parameters: dict[str, Any]
    polynomials: dict[str, Polynomial]
    products: dict[str, Product]
    angles_deg: dict[str, tuple[float, ...]]
    step_mm: float

    @classmethod
    def read(cls, directory: Path = DATA) -> Thesis:
        """All numbers."""
        parameters = tomllib.loads((directory / "parameters.toml").read_text(encoding="utf-8"))
        mapping = parameters["mapping"]
        polynomials, products = read_polynomials(directory / "polynomials.toml")
        return cls(
            tuple(map(_charge, _rows(directory / "charges.csv"))),
            tuple(map(_contour_point, _rows(directory / "isocharge_points.csv"))),
            tuple(map(_position, _rows(directory / "positioning_errors.csv"))),
            tuple(map(_triangulation_point, _rows(directory / "triangulation.csv"))),
            tuple(map(_angle_estimate, _rows(directory / "angle_estimates.csv"))),
            tuple(map(_charge_range, _rows(directory / "lookup.csv"))),
            tuple(map(_figure, _rows(directory / "figures.csv"))),
            parameters,
            polynomials,
            products,
            {name: tuple(mapping[f"angles_reference_{name}"]["value"]) for name in "AB"},
            mapping["radial_step"]["value"],
        )

    def from_(self, *sources: str) -> list[Charge]:
        """Charges of a table or section; the beginning of its name will do."""
        return [charge for charge in self.charges if charge.source.startswith(sources)]

    def quick(self) -> Thesis:
        """A few of the numbers, for trying things out."""
        return replace(
            self,
            charges=tuple(charge for charge in self.charges if charge.case in _QUICK),
            contours=tuple(p for p in self.contours if p.angle_deg in _QUICK_ANGLES_DEG),
            positions=tuple(p for p in self.positions if p.case in _QUICK),
            triangulation=tuple(p for p in self.triangulation if p.case in _QUICK),
            angles_deg={"A": (85.0,), "B": (150.0,)},
            step_mm=8.0,
        )

    @cached_property
    def counted(self) -> list[Charge]:
        """The charges that count in a comparison."""
        return [charge for charge in self.charges if not charge.defect]


_QUICK = {
    *("Table 3.1 row 1, 3 electrodes", "Table 5.1 row 2, 4 electrodes", "s312_1"),
    *("s311_1", "t34_f1.0", "t41_r0", "t41_r90", "t41_r180", "t42_11.176"),
    *("t45_r0_f0.5", "t45_r0_f1", "t45_r90_f1", "t46_r0_f0.5", "t46_r0_f1", "t46_r90_f1"),
}

_QUICK_ANGLES_DEG = (65.0, 85.0, 150.0)


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
        row["contour_id"],
        row["case_id"],
        row["electrode"],
        float(row["charge_pC"]),
        row["angle_frame"][0],
        float(row["angle_deg"]),
        float(row["radius_mm"]),
        float(row["x_mm"]),
        float(row["y_mm"]),
    )


def _position(row: dict[str, str]) -> Position:
    return Position(
        row["source"],
        int(row["row"]),
        row["kind"],
        row["film"],
        row["layout"],
        row["probe"],
        row["position"],
        float(row["x_mm"]),
        float(row["y_mm"]),
        float(row["rotation_deg"]),
        float(row["force_N"]),
        nan if row["error_mm"] == "not_intersecting" else float(row["error_mm"]),
    )


def _triangulation_point(row: dict[str, str]) -> TriangulationPoint:
    return TriangulationPoint(
        row["case_id"],
        row["source"],
        row["probe"],
        float(row["rotation_deg"]),
        float(row["force_N"]),
        row["item"],
        _number(row["x_mm"]),
        _number(row["y_mm"]),
        _number(row["error_mm"]),
        row["status"],
    )


def _angle_estimate(row: dict[str, str]) -> AngleEstimate:
    return AngleEstimate(
        row["source"],
        float(row["force_N"]),
        row["equation"],
        float(row["assumed_charge_pC"]),
        _number(row["angle_table_deg"]),
        _number(row["angle_text_deg"]),
        _number(row["check_charge_table_pC"]),
        _number(row["charge_error_stated_percent"]),
        tuple(flag for flag in row["flag"].split(";") if flag),
    )


def _charge_range(row: dict[str, str]) -> ChargeRange:
    return ChargeRange(
        float(row["charge_min_pC"]), float(row["charge_max_pC"]), float(row["force_N"])
    )


def _figure(row: dict[str, str]) -> ThesisFigure:
    return ThesisFigure(row["figure"], row["section"], row["kind"], row["shows"])


def _number(text: str) -> float:
    return float(text) if text else nan
