"""Where a touch may be, by its charges at one time."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.contact_problem import ContactProblem
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.surrogate.touch_domain import TouchColumn
from tests.helpers.streams import Tap, compute_changes, make_sensor

TOUCH = Tap(0.0, 1.0, (4.0, -3.0), 0.8)
MADE = make_sensor()
MODEL = ContactProblem.from_response(MADE, {2: 0.0}, DEFAULTS)


def sampled(touch, deviation_pC):
    """A sample of exact changes, with noise of a standard deviation."""
    (charges,) = compute_changes(MADE, touch, np.array([touch.force_N]))
    none = np.zeros(len(charges))
    return ChargeSample(0.0, charges, none + deviation_pC**2, none, none, 0.0)


def test_a_touch_is_found_with_the_deviations_of_its_charges():
    """Cramér-Rao, from differences of the charges; and twice the noise are twice the deviations."""
    start, h = np.array([4.0, -3.0, np.log(0.8)]), 1e-4

    def charges(at):
        moved = replace(TOUCH, place_mm=tuple(at[:2]))
        return compute_changes(MADE, moved, np.exp(at[2:]))[0]

    slopes = [(charges(start + step) - charges(start - step)) / (2.0 * h) for step in h * np.eye(3)]
    bound = np.sqrt(np.diag(np.linalg.inv(np.array(slopes) @ np.transpose(slopes))))
    for noise_pC in (2.0, 4.0):
        places = MODEL.locate(sampled(TOUCH, noise_pC))
        assert (len(places), places.is_explained) == (1, True)
        np.testing.assert_allclose(places.coordinates[0], np.insert(start, 2, 0.0), atol=2e-3)
        np.testing.assert_allclose(places.deviations[[0, 1, 3]], noise_pC * bound, rtol=0.02)


def test_what_sampling_misses_is_uncertain_in_the_force():
    """A charge that is off by 2 % along its direction is a force off by 2 % over its power; a fifth
    of that is off the direction."""
    sample = sampled(TOUCH, 1.0)
    size, force = np.linalg.norm(sample.charges_pC), np.array([0.8 * 0.999, 0.8 * 1.001])
    ends = np.linalg.norm(compute_changes(MADE, TOUCH, force), axis=1)
    power = np.diff(np.log(ends))[0] / np.diff(np.log(force))[0]
    samples = (replace(sample, sampling_variance=(share * size) ** 2) for share in (0.0, 0.02))
    exact, missed = (MODEL.locate(of).deviations for of in samples)
    wider = np.hypot(exact[TouchColumn.FORCE], 0.02 / power)
    assert missed[TouchColumn.FORCE] == pytest.approx(wider, rel=0.05)
    assert (exact[:2] < missed[:2]).all()
    assert (missed[:2] < 2.0 * exact[:2]).all()


def test_other_places_that_may_be_touched_widen_the_deviations():
    """Three electrodes hardly tell two places beyond the ring; less noise leaves one of them."""
    heard = np.array([1.0, 1.0, 1.0, ChargeSample.MISSING])
    sample, found = sampled(replace(TOUCH, place_mm=(0.0, -9.0)), 1.0), []
    for share in (1e-4, 5e-4):
        noise = heard * np.square(share * np.linalg.norm(sample.charges_pC))
        found.append(MODEL.locate(replace(sample, noise_variance=noise)))
    one, two = found
    assert [len(places) for places in found] == [1, 2]
    apart = np.abs(two.coordinates[1] - two.coordinates[0])
    assert apart[1] > 3.0
    own = 5.0 * one.deviations[1]
    assert np.hypot(own, 0.1 * apart[1]) < two.deviations[1] < np.hypot(own, 0.5 * apart[1])


def test_fewer_channels_than_unknowns_or_too_light_a_touch_tell_no_place():
    sample = sampled(TOUCH, 1.0)
    silent = np.array([1.0, 1.0, ChargeSample.MISSING, ChargeSample.MISSING])
    assert MODEL.locate(replace(sample, noise_variance=silent)) is None
    light = replace(TOUCH, force_N=0.05)
    assert MODEL.locate(sampled(light, 0.1)) is None


@pytest.mark.parametrize("force", [0.05, 0.8, 8.0])
def test_forces_are_told_beyond_those_of_the_model(force):
    """The model's forces are 0.1 to 5 N; beyond them charges grow with a power of the force."""
    start = np.array([4.0, -3.0, 0.0, np.log(0.8)])
    sample = sampled(replace(TOUCH, force_N=force), 0.05)
    at, chi_square = MODEL.fit_force(start, sample)
    np.testing.assert_array_equal(at[:3], start[:3])
    assert np.exp(at[TouchColumn.FORCE]) == pytest.approx(force, rel=0.1 if force != 0.8 else 1e-3)
    assert (chi_square < 1e-2) == (force == 0.8)
