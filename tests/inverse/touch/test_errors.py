"""Uncertainty of touches: deviations, covariances, weights of other touches, and p-values.

They are compared with errors that are drawn, with the Fisher information, and with closed forms.
"""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.least_squares import SearchOptions
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.inverse.touch.locate_many import locate_many
from pvdf_fem.inverse.touch.search import LocateOptions
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response, read_charges

TOUCH = np.array([3.0, 4.0, 0.0, 1.0])
ONE_SIGMA = 0.6827
#: Columns of x, y and force.
POSITION_AND_FORCE = [0, 1, 3]


def compute_slopes(response, touch):
    """Central differences of the charges by x, y, rotation and force, (electrodes, 4)."""
    steps = np.diag([1e-4, 1e-4, 1e-3, 1e-5])
    ahead = response.evaluate(touch + steps)[0]
    back = response.evaluate(touch - steps)[0]
    return ((ahead - back) / (2.0 * np.diag(steps)[:, None])).T


def test_the_covariance_is_the_inverse_information_where_charges_are_linear():
    """The Fisher information has slopes by differences; the posterior is normal."""
    response = make_bump_response("rectangle", 6)
    touch = np.array([3.0, -4.0, 25.0, 0.7])
    charges = read_charges(response, touch)
    # The Jacobian is that before the last step.
    options = LocateOptions(search=SearchOptions(chi_square_tolerance=1e-8))
    location = locate(
        response, charges, 1e-3, unknown=TOUCH_QUANTITIES, noise_pC=0.3, options=options
    )
    variance = (1e-6 + 1e-8 / 3.0) * np.square([*charges.values()]) + 0.09
    slopes = compute_slopes(response, touch)
    expected = np.linalg.inv(slopes.T @ (slopes / variance[:, None]))
    assert location.best.covariance == pytest.approx(expected, rel=1e-4)
    sizes = np.sqrt(np.diag(expected))
    assert [*location.deviations.values()] == pytest.approx(sizes, rel=0.1)
    square = np.outer(sizes, sizes)
    assert location.covariance / square == pytest.approx(expected / square, abs=0.2)


def test_deviations_and_p_values_are_those_of_drawn_errors():
    """68.3 % of errors are within a deviation, positions reach the Cramér-Rao bound, p are uniform.

    Of 4000 touches ±2.5 % are more than three standard deviations of the fraction.
    """
    response = make_bump_response("rectangle")
    touches = draw_uniform_touches(4000, seed=3, reach_mm=11.0)
    touches[:, 3] = np.clip(touches[:, 3], 0.13, 4.0)
    noise = 0.01 * np.random.default_rng(4).standard_normal((4000, 4))
    charges = response.evaluate(touches)[0] * (1.0 + noise)
    found = locate_many(response, charges, 0.01, rotations_deg=touches[:, 2])
    errors = (found.values - touches)[:, POSITION_AND_FORCE]
    is_within = np.abs(errors) < found.deviations
    assert is_within.mean(axis=0) == pytest.approx(ONE_SIGMA, abs=0.025)
    slopes = response.evaluate(touches)[1][:, :, POSITION_AND_FORCE] / (0.01 * charges)[:, :, None]
    bound = np.linalg.inv(slopes.swapaxes(1, 2) @ slopes)
    squares = np.square(errors[:, :2]).sum()
    bounds = (bound[:, 0, 0] + bound[:, 1, 1]).sum()
    assert (squares / bounds) ** 0.5 == pytest.approx(1, abs=0.06)
    fractions = np.histogram(found.p_value, 10, (0.0, 1.0))[0] / len(found.p_value)
    assert fractions == pytest.approx(0.1, abs=0.02)
    assert (~found.explained).mean() < 0.004


def test_charges_that_cancel_name_the_undetermined_direction():
    """Four electrodes at one position determine a distance and nothing else."""
    response = make_bump_response("circle", 4)
    one_position = np.tile(response.electrodes_mm[:1], (4, 1))
    response = replace(response, electrodes_mm=one_position)
    best = locate(response, read_charges(response, TOUCH), unknown=("x_mm", "y_mm")).best
    assert not best.determined
    [direction] = best.null_directions
    slopes = compute_slopes(response, best.values)[:, :2]
    length = np.sqrt(direction @ np.linalg.solve(best.covariance, direction))
    assert length == pytest.approx(1.0, rel=1e-3)
    tolerance = 1e-4 * np.abs(slopes * direction).max()
    assert slopes @ direction == pytest.approx(np.zeros(4), abs=tolerance)


def test_a_disc_has_no_rotation():
    response = make_bump_response("circle")
    location = locate(response, read_charges(response, TOUCH), unknown=TOUCH_QUANTITIES)
    best = location.best
    assert best.values[POSITION_AND_FORCE] == pytest.approx(TOUCH[POSITION_AND_FORCE], abs=1e-5)
    assert not best.determined
    position_and_force = best.null_directions[0][POSITION_AND_FORCE]
    assert position_and_force == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert (location.status, len(location.notes)) == ("located", 1)
    # Every rotation is as likely.
    assert location.deviations["rotation_deg"] == pytest.approx(ONE_SIGMA * 180.0, rel=0.08)


def test_calibrated_deviations_hold_along_folds():
    """By the curvature alone a third of the errors near the edge are within their deviations.

    Discs touch 9 to 12 mm from the centre, where the derivative of the charges changes its sign.
    Of 56 touches ±12 % are two standard deviations of the fraction.
    """
    count = 300
    random = np.random.default_rng(1)
    radii = np.sqrt(81.0 + 63.0 * random.random(count))
    angles = 2.0 * np.pi * random.random(count)
    forces = 0.1 * 50.0 ** random.random(count)
    columns = [radii * np.cos(angles), radii * np.sin(angles), np.zeros(count), forces]
    touches = np.stack(columns, axis=1)
    response = make_bump_response("circle", width_mm=4.0)
    noise = 0.01 * random.standard_normal((count, 4))
    charges = response.evaluate(touches)[0] * (1.0 + noise)
    locations = []
    for row in charges.tolist():
        locations.append(locate(response, dict(zip("ABCD", row, strict=True))))
    best = np.array([location.best.values for location in locations])
    outer = np.flatnonzero(np.hypot(best[:, 0], best[:, 1]) > 11.5)
    deviations = []
    for row in outer:
        sizes = locations[row].to_json()["touches"][0]["standard_deviations"]
        deviations.append([*sizes.values()])
    errors = np.abs(best - touches)[outer][:, POSITION_AND_FORCE]
    is_within = errors < deviations
    assert is_within.mean(axis=0) == pytest.approx(ONE_SIGMA, abs=0.12)


def test_rows_agree_with_single_locations():
    response = make_bump_response("circle", width_mm=4.0)
    touches = draw_uniform_touches(12, seed=5)
    noise = 0.01 * np.random.default_rng(6).standard_normal((12, 4))
    charges = response.evaluate(touches)[0] * (1.0 + noise)
    rows = locate_many(response, charges, rotations_deg=np.zeros(12), calibrated=True)
    for k, row in enumerate(charges.tolist()):
        location = locate(response, dict(zip(response.names, row, strict=True)))
        # Two touches with the same chi-square may be in either order.
        touch = min(location.touches, key=lambda one: abs(one.x_mm - rows.values[k, 0]))
        sizes = np.array([*touch.deviations.values()])
        square = np.outer(sizes, sizes)
        assert rows.values[k] == pytest.approx(touch.values, abs=2e-3)
        # The Jacobian is that before the last step.
        covariance = touch.covariance / square
        assert rows.covariances[k] / square == pytest.approx(covariance, abs=0.03)
        assert rows.chi_square[k] == pytest.approx(touch.chi_square, abs=1e-2)
        calibrated = [*location.compute_deviations(touch).values()]
        assert rows.deviations[k] == pytest.approx(calibrated, rel=0.15)
        assert rows.alternatives[k] == location.alternatives
    assert (rows.alternatives > 0).any()
