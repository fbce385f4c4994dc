"""Where a touch may be, by its charges at one time."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.response.model import FORCE
from pvdf_fem.tracking.options import DEFAULTS
from pvdf_fem.tracking.place import ChangeModel, Sample
from tests.helpers.streams import Tap, charges_of, sensor

TOUCH = Tap(0.0, 1.0, (4.0, -3.0), 0.8)


def model_of(made, rotation=0.0):
    return ChangeModel.of(made, {2: rotation}, DEFAULTS)


def sampled(made, touch, deviation_pC, missed=0.0):
    """A sample of exact changes, with noise of a standard deviation."""
    (charges,) = charges_of(made, touch, np.array([touch.force_N]))
    none = np.zeros(len(charges))
    return Sample(0.0, charges, none + deviation_pC**2, none, none, missed)


def test_a_touch_is_found_with_the_deviations_of_its_charges():
    """Cramér-Rao, from differences of the charges; and twice the noise are twice the deviations."""
    made = sensor()
    places = model_of(made).located(sampled(made, TOUCH, 2.0))
    np.testing.assert_allclose(places.at[0], [4.0, -3.0, 0.0, np.log(0.8)], atol=2e-3)
    assert (len(places.at), places.explained) == (1, True)
    columns = []
    for step in 1e-4 * np.eye(3):
        ends = []
        for sign in (1.0, -1.0):
            x, y, log_force = np.array([4.0, -3.0, np.log(0.8)]) + sign * step
            moved = replace(TOUCH, place_mm=(x, y))
            ends.append(charges_of(made, moved, np.exp([log_force]))[0])
        columns.append((ends[0] - ends[1]) / 2e-4)
    slopes = np.array(columns) / 2.0
    expected = np.sqrt(np.diag(np.linalg.inv(slopes @ slopes.T)))
    np.testing.assert_allclose(places.deviations[[0, 1, 3]], expected, rtol=0.02)
    more = model_of(made).located(sampled(made, TOUCH, 4.0))
    np.testing.assert_allclose(more.deviations[[0, 1, 3]], 2.0 * expected, rtol=0.05)


def test_what_sampling_misses_is_uncertain_in_the_force_alone():
    """A charge that is off by 2 % along its direction is a force off by 2 % over its power."""
    made = sensor()
    sample = sampled(made, TOUCH, 1.0)
    size, force = np.linalg.norm(sample.charges), np.array([0.8 * 0.999, 0.8 * 1.001])
    ends = np.linalg.norm(charges_of(made, TOUCH, force), axis=1)
    power = np.diff(np.log(ends))[0] / np.diff(np.log(force))[0]
    exact, missed = (
        model_of(made).located(replace(sample, missed=(share * size) ** 2)).deviations
        for share in (0.0, 0.02)
    )
    wider = np.hypot(exact[FORCE], 0.02 / power)
    assert missed[FORCE] == pytest.approx(wider, rel=0.05)
    np.testing.assert_allclose(missed[:2], exact[:2], rtol=0.2)


def test_other_places_that_may_be_touched_widen_the_deviations():
    """Three electrodes hardly tell two places beyond the ring; less noise leaves one of them."""
    made, heard = sensor(), np.array([1.0, 1.0, 1.0, Sample.UNHEARD])
    sample, found = sampled(made, replace(TOUCH, place_mm=(0.0, -9.0)), 1.0), []
    for share in (1e-4, 5e-4):
        noise = heard * np.square(share * np.linalg.norm(sample.charges))
        found.append(model_of(made).located(replace(sample, noise=noise)))
    one, two = found
    assert [len(places.at) for places in found] == [1, 2]
    apart = np.abs(two.at[1] - two.at[0])
    assert apart[1] > 3.0
    own = 5.0 * one.deviations[1]
    assert np.hypot(own, 0.1 * apart[1]) < two.deviations[1] < np.hypot(own, 0.5 * apart[1])


def test_fewer_channels_than_unknowns_or_too_light_a_touch_tell_no_place():
    made = sensor()
    sample = sampled(made, TOUCH, 1.0)
    silent = np.array([1.0, 1.0, Sample.UNHEARD, Sample.UNHEARD])
    assert model_of(made).located(replace(sample, noise=silent)) is None
    light = replace(TOUCH, force_N=0.05)
    assert model_of(made).located(sampled(made, light, 0.1)) is None


@pytest.mark.parametrize("force", [0.05, 0.8, 8.0])
def test_forces_are_told_beyond_those_of_the_model(force):
    """The model's forces are 0.1 to 5 N; beyond them charges grow with a power of the force."""
    made = sensor()
    touch = replace(TOUCH, force_N=force)
    at, chi_square = model_of(made).pressed(
        np.array([4.0, -3.0, 0.0, np.log(0.8)]), sampled(made, touch, 0.05)
    )
    np.testing.assert_array_equal(at[:3], [4.0, -3.0, 0.0])
    assert np.exp(at[FORCE]) == pytest.approx(force, rel=0.1 if force != 0.8 else 1e-3)
    assert (chi_square < 1e-2) == (force == 0.8)


@pytest.mark.parametrize("force", [0.02, 0.8, 9.0])
def test_slopes_by_the_force_are_those_of_the_charges(force):
    made = sensor()
    problem = model_of(made).of_sample(sampled(made, TOUCH, 2.0), np.array([FORCE]))
    at, step = np.array([[2.0, 1.0, 0.0, np.log(force)]]), 1e-6 * np.eye(4)[FORCE]
    system = problem.linearised(at)
    ends = [problem.linearised(at + sign * step)[0, :, 0] for sign in (1.0, -1.0)]
    np.testing.assert_allclose(system[0, :, 1 + FORCE], (ends[0] - ends[1]) / 2e-6, rtol=1e-5)
    assert (system[:, :, 1 : 1 + FORCE] == 0.0).all()
