"""Charge against angle and force of a centred probe, and the way back, with its ambiguities."""

from __future__ import annotations

import csv
import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pvdf_fem import Scene
from pvdf_fem.sweeps.sweep import solve_all
from reports.common.thesis_data import DATA
from reports.thesis_methods.cosine_series import CosineSeries, Reading
from reports.thesis_methods.force_law import MembraneLaw
from reports.thesis_methods.orientation import orientations

# Numbers that the tables copied from each other, repeat, or that leave their own trend.
DEFECTS = ("identical", "equal_to", "outlier", "below_trend")
LAW = MembraneLaw(48.0, 770.0)


def table(*sources: str) -> list[Reading]:
    with (DATA / "charges.csv").open(encoding="utf-8", newline="") as stream:
        return [
            Reading(
                float(row["rotation_deg"]),
                float(row["force_N"]),
                row["electrode"],
                float(row["charge_pC"]),
            )
            for row in csv.DictReader(stream)
            if row["source"] in sources and not any(defect in row["flag"] for defect in DEFECTS)
        ]


TABLE_4_1 = table("Table 4.1")
TABLES_4_5_AND_4_6 = table("Table 4.5", "Table 4.6")


def made_up(coefficients: list[list[float]], law: MembraneLaw = LAW) -> CosineSeries:
    """A series fitted to charges that it gives exactly."""
    exact = CosineSeries(law, np.array(coefficients), (0.25, 7.5), 0.0, 0.0, 0.0)
    return CosineSeries.fit(
        [
            Reading(angle, force, electrode, float(exact.charge_pC(angle, force, electrode)))
            for angle in range(0, 91, 15)
            for force in (0.25, 0.7, 2.0, 7.5)
            for electrode in "ABCD"
        ],
        cosine_terms=len(coefficients[0]),
        force_terms=len(coefficients),
        law=law,
    )


# About the finite-element model's: a contrast of 4 % that rises with the force.
SERIES = made_up([[1.0, 0.018, 0.006, 0.002], [0.005, 0.002, 0.0, 0.0]])


def charges(series: CosineSeries, angle: float, force: float, names: str) -> dict[str, float]:
    return {name: float(series.charge_pC(angle, force, name)) for name in names}


# ------------------------------------------------------------------------------- the series


def test_fit_recovers_a_series() -> None:
    assert SERIES.coefficients == pytest.approx(
        np.array([[1.0, 0.018, 0.006, 0.002], [0.005, 0.002, 0.0, 0.0]]), abs=1e-12
    )
    assert SERIES.worst < 1e-12
    assert SERIES.forces_N == (0.25, 7.5)


@given(st.floats(-360.0, 360.0), st.floats(0.25, 7.5))
def test_symmetries_of_the_series(angle: float, force: float) -> None:
    A = SERIES.charge_pC(angle, force, "A")
    assert SERIES.charge_pC(-angle, force, "A") == pytest.approx(A)
    assert SERIES.charge_pC(180.0 + angle, force, "C") == pytest.approx(A)
    assert SERIES.charge_pC(90.0 - angle, force, "B") == pytest.approx(A)
    assert SERIES.charge_pC(angle + 90.0, force, "D") == pytest.approx(A)


@given(st.floats(-0.99, 0.99), st.floats(0.26, 7.4))
def test_slopes_are_derivatives(c: float, force: float) -> None:
    along_c = SERIES.charge_at([c - 1e-6, c + 1e-6], force)
    along_F = SERIES.charge_at(c, [force - 1e-6, force + 1e-6])
    slopes = np.array([np.diff(along_c)[0], np.diff(along_F)[0]]) / 2e-6
    assert SERIES.slopes(c, force) == pytest.approx(slopes, rel=1e-6, abs=1e-6)


def test_left_out_error_is_that_of_leaving_out() -> None:
    def fit(readings: list[Reading]) -> CosineSeries:
        return CosineSeries.fit(readings, cosine_terms=4, force_terms=1, law=LAW)

    errors = [
        fit(TABLE_4_1[:i] + TABLE_4_1[i + 1 :]).deviations([reading])[0]
        for i, reading in enumerate(TABLE_4_1)
    ]
    fitted = fit(TABLE_4_1)
    assert fitted.left_out == pytest.approx(np.sqrt(np.mean(np.square(errors))), rel=1e-9)
    assert fitted.rms == pytest.approx(np.sqrt(np.mean(fitted.deviations(TABLE_4_1) ** 2)))


def test_four_numbers_hold_table_4_1_to_its_noise() -> None:
    """84 charges, whose mirror images differ by up to 0.2 %; two terms are not enough."""
    four, two = (
        CosineSeries.fit(TABLE_4_1, cosine_terms=n, force_terms=1, law=LAW) for n in (4, 2)
    )
    assert four.rms < 7e-4
    assert four.worst < 1.8e-3
    assert two.worst > 1e-2


def test_twelve_numbers_hold_tables_4_5_and_4_6() -> None:
    series = CosineSeries.fit(TABLES_4_5_AND_4_6, cosine_terms=4, force_terms=3)
    assert series.left_out < 1.05e-3
    assert series.worst < 3e-3


def test_the_series_refuses_forces_without_data() -> None:
    with pytest.raises(ValueError, match=r"force 8\.0 N is outside of \[0\.25, 7\.5\]"):
        SERIES.charge_pC(0.0, 8.0)
    with pytest.raises(ValueError, match="electrode 'E'"):
        SERIES.charge_pC(0.0, 1.0, "E")


def test_readings_that_do_not_determine_a_series_are_refused() -> None:
    with pytest.raises(ValueError, match="more, or less terms"):
        CosineSeries.fit(TABLE_4_1[:4], cosine_terms=4, force_terms=1, law=LAW)
    with pytest.raises(ValueError, match="do not determine"):
        CosineSeries.fit(TABLE_4_1, cosine_terms=4, force_terms=2, law=LAW)
    at_two_angles = [r for r in TABLES_4_5_AND_4_6 if r.angle_deg in (30, 60)]
    with pytest.raises(ValueError, match="do not determine"):
        CosineSeries.fit(at_two_angles, cosine_terms=3, force_terms=1, law=LAW)


# ----------------------------------------------------------------------------- the way back


@settings(deadline=None, max_examples=40)
@given(st.floats(0.0, 90.0), st.floats(0.26, 7.4))
@example(0.0, 2.25)
def test_angle_and_force_come_back(angle: float, force: float) -> None:
    known = orientations(SERIES, charges(SERIES, angle, force, "A"), force, charge_error_pC=0.1)
    both = orientations(SERIES, charges(SERIES, angle, force, "AB"), charge_error_pC=0.1)
    for found in (known, both):
        assert len(found) == 1
        # at 0° and 90°, an angle is the root of the rounding error
        assert found[0].angle_deg == pytest.approx(angle, abs=1e-4)
        assert found[0].force_N == pytest.approx(force, rel=1e-9)
        assert found[0].misfit_pC < 1e-8


def test_candidates_are_the_mirror_images() -> None:
    (found,) = orientations(SERIES, charges(SERIES, 150.0, 1.0, "ABCD"), 1.0, charge_error_pC=1.0)
    assert found.candidates_deg == pytest.approx((30.0, 150.0))
    for angle in (0.0, 90.0):
        (found,) = orientations(
            SERIES, charges(SERIES, angle, 1.0, "ABCD"), 1.0, charge_error_pC=1.0
        )
        assert all(abs((c - angle + 90) % 180 - 90) < 1e-4 for c in found.candidates_deg)


def test_charges_beyond_the_range() -> None:
    """A little above the largest charge is 0° within the errors; far above is no angle."""
    largest = float(SERIES.charge_pC(0.0, 1.0))
    (found,) = orientations(SERIES, {"A": largest + 2.0}, 1.0, charge_error_pC=1.0)
    assert found.angle_deg == 0.0
    assert found.angle_range_deg[1] > 1.0
    assert found.misfit_pC == pytest.approx(2.0)
    assert orientations(SERIES, {"A": largest + 4.0}, 1.0, charge_error_pC=1.0) == ()
    contrast = {"A": largest + 5.0, "B": float(SERIES.charge_pC(0.0, 1.0, "B")) - 5.0}
    assert orientations(SERIES, contrast, charge_error_pC=1.0) == ()
    (found,) = orientations(SERIES, contrast, charge_error_pC=2.0)
    assert found.angle_deg == 0.0


def test_charges_of_no_force_in_the_range() -> None:
    assert orientations(SERIES, {"A": 100.0, "B": 98.0}, charge_error_pC=1.0) == ()
    assert orientations(SERIES, {"A": 9000.0, "B": 8800.0}, charge_error_pC=1.0) == ()


def test_a_charge_that_is_not_monotone_has_several_angles() -> None:
    """As of a rigid probe, whose corner raises the charge of A near 27°."""
    series = made_up([[1.0, 0.1, -0.06]])
    force, true = 1.0, 20.0
    one = orientations(series, charges(series, true, force, "A"), force, charge_error_pC=0.1)
    assert len(one) == 2
    assert min(abs(o.angle_deg - true) for o in one) < 1e-4
    for other in one:
        assert series.charge_pC(other.angle_deg, force) == pytest.approx(
            series.charge_pC(true, force)
        )
    (both,) = orientations(series, charges(series, true, force, "AB"), force, charge_error_pC=0.1)
    assert both.angle_deg == pytest.approx(true, abs=1e-4)


def test_errors_of_an_angle() -> None:
    """Four charges halve the variance of two, and 68 % of the ranges hold the true angle."""
    force, true, error = 1.0, 25.0, 1.0

    def width(names: str) -> float:
        (found,) = orientations(
            SERIES, charges(SERIES, true, force, names), force, charge_error_pC=error
        )
        return found.angle_range_deg[1] - found.angle_range_deg[0]

    assert width("AB") / width("ABCD") == pytest.approx(math.sqrt(2), rel=1e-2)
    assert width("AC") == pytest.approx(width("A") / math.sqrt(2), rel=1e-2)
    assert width("B") > width("A")  # B is flat at small angles
    noise = np.random.default_rng(1).normal(0.0, error, (400, 4))
    exact = charges(SERIES, true, force, "ABCD")
    hits = 0
    for row in noise:
        noisy = {name: q + e for (name, q), e in zip(exact.items(), row, strict=True)}
        found = orientations(SERIES, noisy, force, charge_error_pC=error)[0]
        hits += found.angle_range_deg[0] < true < found.angle_range_deg[1]
    assert hits / 400 == pytest.approx(0.683, abs=0.07)  # 3 standard deviations


def test_errors_of_a_force_found_with_the_angle() -> None:
    """Sum and difference of A and B have √2 errors; 2/3 of a percent of charge is 1 % of force."""
    (found,) = orientations(SERIES, charges(SERIES, 45.0, 1.0, "AB"), charge_error_pC=1.0)
    total = sum(charges(SERIES, 45.0, 1.0, "AB").values())
    exponent = float(LAW.exponent(1.0))
    assert found.force_error_N == pytest.approx(math.sqrt(2) / total / exponent, rel=0.02)
    along_c, _ = SERIES.slopes(0.0, 1.0)
    assert math.cos(2 * math.radians(found.angle_range_deg[0])) == pytest.approx(
        math.sqrt(2) / (2 * along_c), rel=1e-6
    )


def test_a_and_c_do_not_tell_angle_from_force() -> None:
    with pytest.raises(ValueError, match="A, C only"):
        orientations(SERIES, {"A": 800.0, "C": 800.0})
    with pytest.raises(ValueError, match="no charges"):
        orientations(SERIES, {}, 1.0)
    with pytest.raises(ValueError, match="charge_error_pC"):
        orientations(SERIES, {"A": 800.0}, 1.0, charge_error_pC=0.0)


def test_angles_of_table_4_1_come_back() -> None:
    """From A alone up to 5° off near 90°, where it is flat; from all four within 1.7°."""
    series = CosineSeries.fit(TABLE_4_1, cosine_terms=4, force_terms=1, law=LAW)
    by_angle: dict[float, dict[str, float]] = defaultdict(dict)
    for reading in TABLE_4_1:
        by_angle[reading.angle_deg][reading.electrode] = reading.charge_pC
    for angle, measured in by_angle.items():
        found = orientations(series, measured, 1.0)[0]
        assert min(abs(candidate - angle) for candidate in found.candidates_deg) < 1.7


def test_angle_and_force_of_tables_4_5_and_4_6_come_back() -> None:
    series = CosineSeries.fit(TABLES_4_5_AND_4_6 + TABLE_4_1, cosine_terms=4, force_terms=3)
    pairs: dict[tuple[float, float], dict[str, float]] = defaultdict(dict)
    for reading in TABLES_4_5_AND_4_6:
        pairs[reading.angle_deg, reading.force_N][reading.electrode] = reading.charge_pC
    for (angle, force), measured in pairs.items():
        if len(measured) == 2:
            found = orientations(series, measured)[0]
            assert found.angle_deg == pytest.approx(angle, abs=1.4)
            assert found.force_N == pytest.approx(force, rel=2.7e-3)


# --------------------------------------------------------------------------------- the model


def test_angle_and_force_from_simulated_charges() -> None:
    """Calibrated at four angles and three forces, asked at others."""
    scene = Scene().with_(
        probe={"shape": "rectangle", "width_mm": 14.0, "height_mm": 7.0},
        **{"numerics.tolerance": 1e-4},
    )

    def simulate(
        angles: list[float], forces: list[float]
    ) -> list[tuple[float, float, dict[str, float]]]:
        at = [(angle, force) for angle in angles for force in forces]
        records = solve_all(
            [scene.with_(**{"probe.rotation_deg": a, "load.force_N": f}) for a, f in at],
            processes=1,
        )
        return [(a, f, r.charges_pC(8.0, 8.0)) for (a, f), r in zip(at, records, strict=True)]

    series = CosineSeries.fit(
        [
            Reading(angle, force, electrode, charge)
            for angle, force, found in simulate([0.0, 15.0, 30.0, 45.0], [0.5, 1.0, 2.0])
            for electrode, charge in found.items()
        ],
        cosine_terms=5,
        force_terms=2,
    )
    for angle, force, found in simulate([22.0], [1.4]):
        (best,) = orientations(series, found)
        assert best.angle_deg == pytest.approx(angle, abs=0.5)
        assert best.force_N == pytest.approx(force, rel=2e-3)
