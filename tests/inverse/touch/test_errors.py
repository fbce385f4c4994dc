"""How far touches may be off: deviations, covariances, weights of rivals, and p-values, against
errors that are drawn, the Fisher information, and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.least_squares import SearchOptions
from pvdf_fem.inverse.touch.locate import locate
from pvdf_fem.inverse.touch.locate_many import locate_many
from pvdf_fem.inverse.touch.search import LocateOptions
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES
from tests.helpers.bump_response import draw_uniform_touches, make_bump_response, read_charges

PLACE_MM = np.array([3.0, 4.0, 0.0, 1.0])
ONE_SIGMA = 0.6827


def slopes_of(model, touch):
    """Central differences of the charges by x, y, rotation and force, (electrodes, 4)."""
    steps = np.diag([1e-4, 1e-4, 1e-3, 1e-5])
    ahead, back = (model.evaluate(touch + sign * steps)[0] for sign in (1, -1))
    return ((ahead - back) / (2.0 * np.diag(steps)[:, None])).T


def test_the_covariance_is_the_inverse_information_where_charges_are_linear():
    """Against the Fisher information with slopes by differences; the posterior is normal."""
    model, touch = make_bump_response("rectangle", 6), np.array([3.0, -4.0, 25.0, 0.7])
    charges = read_charges(model, touch)
    # slopes are those before the last step
    options = LocateOptions(search=SearchOptions(chi_square_tolerance=1e-8))
    asked = {"unknown": TOUCH_QUANTITIES, "noise_pC": 0.3, "options": options}
    found = locate(model, charges, 1e-3, **asked)
    variance = (1e-6 + 1e-8 / 3.0) * np.square([*charges.values()]) + 0.09
    slopes = slopes_of(model, touch)
    expected = np.linalg.inv(slopes.T @ (slopes / variance[:, None]))
    assert found.best.covariance == pytest.approx(expected, rel=1e-4)
    sizes = np.sqrt(np.diag(expected))
    assert [*found.deviations.values()] == pytest.approx(sizes, rel=0.1)
    square = np.outer(sizes, sizes)
    assert found.covariance / square == pytest.approx(expected / square, abs=0.2)


def test_errors_deviations_and_p_values_are_those_of_the_noise():
    """68.3 % within one standard deviation, of 4000 ±2.5 % are more than three of its own; places
    as good as the bound of Cramér and Rao; p-values evenly distributed."""
    model, touches = (
        make_bump_response("rectangle"),
        draw_uniform_touches(4000, seed=3, reach_mm=11.0),
    )
    touches[:, 3] = np.clip(touches[:, 3], 0.13, 4.0)
    errors = 0.01 * np.random.default_rng(4).standard_normal((4000, 4))
    charges = model.evaluate(touches)[0] * (1.0 + errors)
    found = locate_many(model, charges, 0.01, rotations_deg=touches[:, 2])
    errors = (found.values - touches)[:, [0, 1, 3]]
    within = np.abs(errors) < found.deviations
    assert within.mean(axis=0) == pytest.approx(ONE_SIGMA, abs=0.025)
    slopes = model.evaluate(touches)[1][:, :, [0, 1, 3]] / (0.01 * charges)[:, :, None]
    bound = np.linalg.inv(slopes.swapaxes(1, 2) @ slopes)
    squares = np.square(errors[:, :2]).sum()
    assert (squares / (bound[:, 0, 0] + bound[:, 1, 1]).sum()) ** 0.5 == pytest.approx(1, abs=0.06)
    shares = np.histogram(found.p_value, 10, (0.0, 1.0))[0] / len(found.p_value)
    assert shares == pytest.approx(0.1, abs=0.02)
    assert (~found.explained).mean() < 0.004


def test_charges_that_undo_each_other_name_the_free_direction():
    """Four electrodes at one place tell a distance and nothing else."""
    model = make_bump_response("circle", 4)
    model = replace(model, electrodes_mm=np.tile(model.electrodes_mm[:1], (4, 1)))
    best = locate(model, read_charges(model, PLACE_MM), unknown=("x_mm", "y_mm")).best
    assert not best.determined
    [free] = best.null_directions
    slopes = slopes_of(model, best.values)[:, :2]
    assert np.sqrt(free @ np.linalg.solve(best.covariance, free)) == pytest.approx(1.0, rel=1e-3)
    assert slopes @ free == pytest.approx(np.zeros(4), abs=1e-4 * np.abs(slopes * free).max())


def test_a_disc_has_no_rotation():
    model = make_bump_response("circle")
    found = locate(model, read_charges(model, PLACE_MM), unknown=TOUCH_QUANTITIES)
    best = found.best
    assert best.values[[0, 1, 3]] == pytest.approx(PLACE_MM[[0, 1, 3]], abs=1e-5)
    assert not best.determined
    assert best.null_directions[0][[0, 1, 3]] == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)
    assert (found.status, len(found.remarks)) == ("located", 1)
    # any rotation is as likely
    assert found.deviations["rotation_deg"] == pytest.approx(ONE_SIGMA * 180.0, rel=0.08)


def test_errors_that_are_told_are_calibrated_along_folds():
    """Of a disc 9 to 12 mm from the centre, where charges' rise turns: by the curvature alone a
    third is within them near the edge; ±12 % are two of 56's own."""
    count, draw = 300, np.random.default_rng(1)
    r, a = np.sqrt(81.0 + 63.0 * draw.random(count)), 2.0 * np.pi * draw.random(count)
    forces = 0.1 * 50.0 ** draw.random(count)
    touches = np.stack([r * np.cos(a), r * np.sin(a), np.zeros(count), forces], axis=1)
    model = make_bump_response("circle", width_mm=4.0)
    charges = model.evaluate(touches)[0] * (1.0 + 0.01 * draw.standard_normal((count, 4)))
    rows = (dict(zip("ABCD", row, strict=True)) for row in charges.tolist())
    locations = [locate(model, row) for row in rows]
    best = np.array([found.best.values for found in locations])
    outer = np.flatnonzero(np.hypot(best[:, 0], best[:, 1]) > 11.5)
    told = [locations[k].to_json()["touches"][0]["standard_deviations"] for k in outer]
    errors = np.abs(best - touches)[outer][:, [0, 1, 3]]
    within = errors < [[*sizes.values()] for sizes in told]
    assert within.mean(axis=0) == pytest.approx(ONE_SIGMA, abs=0.12)


def test_rows_have_what_a_location_has():
    model, touches = make_bump_response("circle", width_mm=4.0), draw_uniform_touches(12, seed=5)
    errors = 0.01 * np.random.default_rng(6).standard_normal((12, 4))
    charges, known = model.evaluate(touches)[0] * (1.0 + errors), {"rotations_deg": np.zeros(12)}
    found = locate_many(model, charges, **known, calibrated=True)
    for k, row in enumerate(charges.tolist()):
        one = locate(model, dict(zip(model.names, row, strict=True)))
        # the best of two may be either, as they have the same chi-square
        same = min(one.touches, key=lambda touch: abs(touch.x_mm - found.values[k, 0]))
        sizes = np.array([*same.deviations.values()])
        square = np.outer(sizes, sizes)
        assert found.values[k] == pytest.approx(same.values, abs=2e-3)
        # slopes are those before the last step
        assert found.covariances[k] / square == pytest.approx(same.covariance / square, abs=0.03)
        assert found.chi_square[k] == pytest.approx(same.chi_square, abs=1e-2)
        assert found.deviations[k] == pytest.approx(
            [*one.compute_deviations(same).values()], rel=0.15
        )
        assert found.alternatives[k] == one.alternatives
    assert (found.alternatives > 0).any()
