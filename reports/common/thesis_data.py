"""The thesis's printed numbers, read from `reports/data/` (see its README)."""

from __future__ import annotations

import csv
import tomllib
from dataclasses import dataclass, replace
from functools import cached_property
from math import nan
from pathlib import Path
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from reports.common.polynomial import PrintedPolynomial, PrintedProduct, read_polynomials

DATA = Path(__file__).parents[1] / "data"

#: Flags of `charges.csv` under which a printed number is wrong or belongs to another row, with the
#: remark that the report shows. Such rows are shown, but do not count. Rows with other flags count:
#: these mark a guessed orientation of the probe, a value repeated at an equivalent angle, and an
#: angle that is 0.005° off.
DEFECTS = {
    "row_identical_to_table_4.6_0deg": "row copied from Table 4.6",
    "row_identical_to_table_4.5_0deg": "row copied from Table 4.5",
    "outlier_high": "0.7 to 0.8 % above the table's own trend",
    "2N_value_below_trend": "below the table's own trend",
    "angle_disagrees_with_text_and_eq_4.1": "angle misprinted",
}


#: Shapes of the probes by their names in the files.
SHAPES = {"tri7": "triangle", "rect14x7": "rectangle", "circle1": "disc"}
#: A number, NaN where the file has none.
OptionalNumber = Annotated[
    float, BeforeValidator(lambda text: nan if text in ("", "not_intersecting") else text)
]
#: Several flags, which the file separates by semicolons.
Flags = Annotated[
    tuple[str, ...], BeforeValidator(lambda text: tuple(flag for flag in text.split(";") if flag))
]


class CsvRow(BaseModel):
    """A row of a file; columns of the file that have no attribute are ignored."""

    model_config = ConfigDict(frozen=True)

    @classmethod
    def read(cls, path: Path) -> tuple[Self, ...]:
        """All rows of a CSV file with a header."""
        with path.open(encoding="utf-8", newline="") as stream:
            return tuple(cls.model_validate(row) for row in csv.DictReader(stream))


class Charge(CsvRow):
    """A printed charge: a row of `charges.csv`."""

    case: str = Field(alias="case_id")
    source: str
    layout: str
    probe: str
    x_mm: float
    y_mm: float
    rotation_deg: float
    force_N: float
    electrode: str
    charge_pC: float
    flags: Flags = Field(alias="flag")

    @property
    def shape(self) -> str:
        """Shape of the probe in words."""
        return SHAPES[self.probe]

    @property
    def defect(self) -> str:
        """Why the number does not count; empty if it does."""
        return "; ".join(DEFECTS[flag] for flag in self.flags if flag in DEFECTS)


class ContourPoint(CsvRow):
    """The place of a charge on a line from an electrode: a row of `isocharge_points.csv`.

    `frame` is the electrode that the line starts from. The thesis takes the contour of B at the
    charge of C, mirrored at the y axis, for the contour of C.
    """

    contour: str = Field(alias="contour_id")
    case: str = Field(alias="case_id")
    electrode: str
    charge_pC: float
    frame: Annotated[str, BeforeValidator(lambda text: text[0])] = Field(alias="angle_frame")
    angle_deg: float
    radius_mm: float
    x_mm: float
    y_mm: float


class Position(CsvRow):
    """A recovered position of a probe, simulated or measured: a row of `positioning_errors.csv`.

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
    error_mm: OptionalNumber

    @property
    def case(self) -> str:
        """Name of the case: table, row and number of electrodes."""
        return f"{self.source} row {self.row}, {self.layout} electrodes"

    @property
    def touch(self) -> NDArray[np.float64]:
        """Where the probe presses, (4,): x and y in mm, rotation in degrees, force in N."""
        return np.array([self.x_mm, self.y_mm, self.rotation_deg, self.force_N])


class TriangulationPoint(CsvRow):
    """A point of a triangulation: a row of `triangulation.csv`. Unprinted numbers are NaN.

    `item` names three electrodes, or is ``average`` or ``target``.
    """

    case: str = Field(alias="case_id")
    source: str
    probe: str
    rotation_deg: float
    force_N: float
    item: str
    x_mm: OptionalNumber
    y_mm: OptionalNumber
    error_mm: OptionalNumber
    status: str


class AngleEstimate(CsvRow):
    """An angle recovered from a charge of A, and its check run: a row of `angle_estimates.csv`."""

    source: str
    force_N: float
    equation: str
    charge_pC: float = Field(alias="assumed_charge_pC")
    angle_table_deg: OptionalNumber
    angle_text_deg: OptionalNumber
    check_charge_pC: OptionalNumber = Field(alias="check_charge_table_pC")
    error_stated_percent: OptionalNumber = Field(alias="charge_error_stated_percent")

    @property
    def case(self) -> str:
        """Name of the estimate: table and charge."""
        return f"{self.source}, {self.charge_pC:g} pC"


class ChargeRange(CsvRow):
    """Charges of A that the thesis takes for one force: a row of `lookup.csv` (Table 4.4)."""

    least_pC: float = Field(alias="charge_min_pC")
    largest_pC: float = Field(alias="charge_max_pC")
    force_N: float


class ThesisFigure(CsvRow):
    """A figure of the thesis: a row of `figures.csv`."""

    number: str = Field(alias="figure")
    section: str
    kind: str
    shows: str


@dataclass(frozen=True)
class Thesis:
    """The printed numbers that a report compares with.

    Attributes
    ----------
    charges, contours, positions, triangulation, angle_estimates, charge_ranges, figures : tuple
        Rows of the CSV files.
    parameters : dict
        Tables of `parameters.toml`; a number is ``parameters["circuit"]["load_resistance"]
        ["value"]``.
    polynomials, products : dict
        Printed polynomials, and products of two, by the number of the equation.
    angles_deg : dict
        Directions of the lines of the mapping scheme from electrodes A and B of three.
    step_mm : float
        Distance of neighbouring places on those lines.
    """

    charges: tuple[Charge, ...]
    contours: tuple[ContourPoint, ...]
    positions: tuple[Position, ...]
    triangulation: tuple[TriangulationPoint, ...]
    angle_estimates: tuple[AngleEstimate, ...]
    charge_ranges: tuple[ChargeRange, ...]
    figures: tuple[ThesisFigure, ...]
    parameters: dict[str, Any]
    polynomials: dict[str, PrintedPolynomial]
    products: dict[str, PrintedProduct]
    angles_deg: dict[str, tuple[float, ...]]
    step_mm: float

    @classmethod
    def read(cls, directory: Path = DATA) -> Thesis:
        """Read all numbers from the files of a directory."""
        parameters = tomllib.loads((directory / "parameters.toml").read_text(encoding="utf-8"))
        mapping = parameters["mapping"]
        polynomials, products = read_polynomials(directory / "polynomials.toml")
        return cls(
            Charge.read(directory / "charges.csv"),
            ContourPoint.read(directory / "isocharge_points.csv"),
            Position.read(directory / "positioning_errors.csv"),
            TriangulationPoint.read(directory / "triangulation.csv"),
            AngleEstimate.read(directory / "angle_estimates.csv"),
            ChargeRange.read(directory / "lookup.csv"),
            ThesisFigure.read(directory / "figures.csv"),
            parameters,
            polynomials,
            products,
            {name: tuple(mapping[f"angles_reference_{name}"]["value"]) for name in "AB"},
            mapping["radial_step"]["value"],
        )

    def from_(self, *sources: str) -> list[Charge]:
        """Charges of tables or sections, given the beginnings of their names."""
        return [charge for charge in self.charges if charge.source.startswith(sources)]

    def quick(self) -> Thesis:
        """A few of the numbers, for a report that takes a minute."""
        return replace(
            self,
            charges=tuple(charge for charge in self.charges if charge.case in _QUICK_CASES),
            contours=tuple(row for row in self.contours if row.angle_deg in _QUICK_ANGLES_DEG),
            positions=tuple(row for row in self.positions if row.case in _QUICK_CASES),
            triangulation=tuple(row for row in self.triangulation if row.case in _QUICK_CASES),
            angles_deg={"A": (85.0,), "B": (150.0,)},
            step_mm=8.0,
        )

    @cached_property
    def counted(self) -> list[Charge]:
        """The charges that count in a comparison, since they have no defect."""
        return [charge for charge in self.charges if not charge.defect]


#: Cases of charges, positions and triangulations in a quick report.
_QUICK_CASES = {
    *("Table 3.1 row 1, 3 electrodes", "Table 5.1 row 2, 4 electrodes", "s312_1"),
    *("s311_1", "t34_f1.0", "t41_r0", "t41_r90", "t41_r180", "t42_11.176"),
    *("t45_r0_f0.5", "t45_r0_f1", "t45_r90_f1", "t46_r0_f0.5", "t46_r0_f1", "t46_r90_f1"),
}

#: Lines of the contour points in a quick report, in degrees.
_QUICK_ANGLES_DEG = (65.0, 85.0, 150.0)
