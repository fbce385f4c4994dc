"""The thesis's printed polynomials: their angles, how many there are, and what rounding does."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from reports.common.polynomial import PrintedPolynomial
from reports.common.thesis_data import Thesis
from reports.thesis_methods.force_law import MembraneLaw

THESIS = Thesis.read()
POLYNOMIALS, PRODUCTS = THESIS.polynomials, THESIS.products


def row(table: str, rotation_deg: float, electrode: str) -> tuple[list[float], list[float]]:
    """Forces and charges of an electrode in a table."""
    charges = [
        charge
        for charge in THESIS.from_(table)
        if (charge.rotation_deg, charge.electrode) == (rotation_deg, electrode)
    ]
    return [charge.force_N for charge in charges], [charge.charge_pC for charge in charges]


# ------------------------------------------------------------------------ charge against angle


@pytest.mark.parametrize(
    ("name", "charge", "angle"),
    [
        ("4.1", 810.0, 12.959),
        ("4.1", 800.0, 22.903),
        ("4.1", 785.0, 38.450),
        ("4.1", 775.0, 75.608),
        ("4.3", 510.0, 20.617),
        ("4.3", 502.5, 31.796),
        ("4.3", 495.0, 57.159),
    ],
)
def test_angles_of_tables_4_2_and_4_3(name: str, charge: float, angle: float) -> None:
    assert POLYNOMIALS[name].angles_deg(charge) == pytest.approx((angle,), abs=1e-3)


def test_rounded_coefficients_move_the_angle_by_more_than_5_degrees() -> None:
    (refit,) = POLYNOMIALS["4.1 refit"].angles_deg(775.0)
    assert refit == pytest.approx(81.26, abs=0.01)


def test_where_an_angle_is_unique() -> None:
    """To 180° nearly every charge has two angles; Eq. 4.2 even has three below 90°."""
    counts = POLYNOMIALS["4.2"].multiplicity(0.0, math.pi / 2)
    assert [number for _, _, number in counts] == [1, 3, 1]
    assert counts[1][:2] == pytest.approx((775.277, 775.452), abs=1e-3)
    assert len(POLYNOMIALS["4.2"].angles_deg(775.4)) == 3
    low, high, number = POLYNOMIALS["4.3"].multiplicity(0.0, math.pi / 2)[0]
    assert (low, high) == pytest.approx((493.769, 494.192), abs=1e-3)
    assert number == len(POLYNOMIALS["4.3"].angles_deg(494.0)) == 2
    assert len(POLYNOMIALS["4.1 refit"].angles_deg(800.0, 0.0, 180.0)) == 2


def test_a_polynomial_in_force_has_no_angles() -> None:
    with pytest.raises(ValueError, match="in N"):
        PrintedPolynomial("Q", Polynomial([0.0, 1.0]), "N").angles_deg(1.0)


@pytest.mark.parametrize(("name", "electrode"), [("4.12", "A"), ("4.13", "B")])
def test_errors_of_the_product_form(name: str, electrode: str) -> None:
    def errors(low: float, high: float) -> np.ndarray:
        return np.array(
            [
                PRODUCTS[name].charge_pC(r.rotation_deg, r.force_N) / r.charge_pC - 1
                for r in THESIS.from_("Table 4.5", "Table 4.6")
                if r.electrode == electrode and r.rotation_deg <= 75 and low <= r.force_N <= high
            ]
        )

    assert 0.05 < errors(0.25, 0.25).min() < errors(0.25, 0.25).max() < 0.07
    assert -0.03 < errors(0.5, 1.0).min() < errors(0.5, 1.0).max() < -0.016
    assert np.abs(errors(2.0, 7.5)).max() < 0.015
    at_1_N = [
        float(PRODUCTS[name].charge_pC(r.rotation_deg, 1.0)) - r.charge_pC
        for r in THESIS.from_("Table 4.1")
        if r.electrode == electrode and r.rotation_deg <= 70
    ]
    assert -21.0 < min(at_1_N) < max(at_1_N) < -18.0


# ------------------------------------------------------------------------ charge against force


@pytest.mark.parametrize(("electrode", "limit"), [("A", 0.0014), ("B", 0.010), ("C", 0.0014)])
def test_cubics_of_section_3_4_1_pass_through_table_3_4(electrode: str, limit: float) -> None:
    F, Q = row("Table 3.4", -90.0, electrode)
    assert np.abs(POLYNOMIALS[f"3.4.1_{electrode}"](F) - Q).max() <= limit


@pytest.mark.parametrize(
    ("name", "table", "electrode", "errors"),
    [
        ("4.10", "Table 4.5", "A", [-0.01, -0.01, -0.01, -0.04, -0.05, 0.24, 3.73]),
        ("4.11", "Table 4.6", "B", [0.0, 0.0, 0.0, 0.05, 1.0, 7.4, 78.9]),
        ("4.10 refit", "Table 4.5", "A", [0.0] * 7),
        ("4.11 refit", "Table 4.6", "B", [0.0] * 7),
    ],
)
def test_rounding_of_equations_4_10_and_4_11(
    name: str, table: str, electrode: str, errors: list[float]
) -> None:
    F, Q = row(table, 0.0, electrode)
    assert POLYNOMIALS[name](F) - Q == pytest.approx(errors, abs=0.05)


@pytest.mark.parametrize(
    ("name", "table", "electrode", "excess"),
    [("4.10 refit", "Table 4.5", "A", 0.07), ("4.11 refit", "Table 4.6", "B", 0.07)],
)
def test_interpolations_of_degree_six_overshoot_between_their_points(
    name: str, table: str, electrode: str, excess: float
) -> None:
    smooth = MembraneLaw.fit(*row(table, 0.0, electrode)).charge_pC(6.5)
    assert POLYNOMIALS[name](6.5) / smooth - 1 > excess
    assert len(POLYNOMIALS[name].turning_points(5.0, 7.5)) == 1


def test_equations_of_the_1_mm_film_are_as_curved_as_those_of_25_um() -> None:
    assert [POLYNOMIALS[f"3.4.3_{e}"](1.0) for e in "ABC"] == pytest.approx(
        [1460.8, 627.2, 566.7], abs=0.06
    )
    thin, thick = (
        POLYNOMIALS[name].series.coef[:0:-1] / POLYNOMIALS[name].series.coef[1]
        for name in ("3.4.1_A", "3.4.3_A")
    )
    assert thick == pytest.approx(thin, abs=6e-4)


# ----------------------------------------------------------------------------- any polynomial


def test_solutions_turning_points_and_multiplicity_of_a_cubic() -> None:
    cubic = PrintedPolynomial("x³ − 3x", Polynomial([0.0, -3.0, 0.0, 1.0]), "N")
    assert cubic.solutions(0.0, -2.0, 2.0) == pytest.approx([-np.sqrt(3), 0, np.sqrt(3)])
    assert cubic.solutions(0.0, 0.5, 2.0) == pytest.approx([np.sqrt(3)])
    assert cubic.solutions(5.0, -2.0, 2.0) == ()
    assert cubic.turning_points(-2.0, 2.0) == pytest.approx([-1.0, 1.0])
    counts = cubic.multiplicity(-1.5, 2.0)
    assert [number for _, _, number in counts] == [2, 3]
    assert [level for level, _, _ in counts] == pytest.approx([-2.0, 1.125])
    assert counts[-1][1] == pytest.approx(2.0)


def test_an_inflection_is_not_a_turning_point() -> None:
    assert (
        PrintedPolynomial("x³", Polynomial([0.0, 0.0, 0.0, 1.0]), "N").turning_points(-1.0, 1.0)
        == ()
    )
