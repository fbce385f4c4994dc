"""Places and forces of a contact by its charges at one time."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem
from pvdf_fem.inverse.tracking.problem.force_curve import ForceCurve
from pvdf_fem.surrogate.touch_domain import TouchColumn
from tests.helpers.streams import Tap, compute_changes, make_sensor

TAP = Tap(0.0, 1.0, (4.0, -3.0), 0.8)
SENSOR = make_sensor()
PROBLEM = ContactProblem.from_response(SENSOR, {TouchColumn.ROTATION: 0.0}, DEFAULTS)


def make_sample(tap, deviation_pC):
    """Make a sample of exact changes, with noise of a standard deviation."""
    (charges_pC,) = compute_changes(SENSOR, tap, np.array([tap.force_N]))
    zeros = np.zeros(len(charges_pC))
    return ChargeSample(
        0.0,
        charges_pC,
        noise_variance=zeros + deviation_pC**2,
        walk_variance=zeros,
        drift_pC=zeros,
        sampling_variance=0.0,
        is_clipped=np.zeros(len(charges_pC), dtype=bool),
    )


def test_deviations_are_the_cramer_rao_bound():
    """From differences of the charges; and twice the noise doubles the deviations."""
    h = 1e-4
    start = np.array([4.0, -3.0, np.log(0.8)])

    def compute_charges(at):
        moved = replace(TAP, place_mm=tuple(at[:2]))
        return compute_changes(SENSOR, moved, np.exp(at[2:]))[0]

    slopes = []
    for step in h * np.eye(3):
        slopes.append((compute_charges(start + step) - compute_charges(start - step)) / (2.0 * h))
    information = np.array(slopes) @ np.transpose(slopes)
    bound = np.sqrt(np.diag(np.linalg.inv(information)))
    for noise_pC in (2.0, 4.0):
        places = PROBLEM.locate(make_sample(TAP, noise_pC))
        assert len(places) == 1
        assert places.is_explained
        np.testing.assert_allclose(places.likeliest, np.insert(start, 2, 0.0), atol=2e-3)
        np.testing.assert_allclose(places.deviations[[0, 1, 3]], noise_pC * bound, rtol=0.02)


def test_charge_that_sampling_misses_is_uncertain_in_the_force():
    """A charge that is off by 2 % along its direction is a force off by 2 % over its power.

    A fifth of that is off the direction.
    """
    sample = make_sample(TAP, 1.0)
    size = np.linalg.norm(sample.charges_pC)
    forces_N = np.array([0.8 * 0.999, 0.8 * 1.001])
    sizes = np.linalg.norm(compute_changes(SENSOR, TAP, forces_N), axis=1)
    power = np.diff(np.log(sizes))[0] / np.diff(np.log(forces_N))[0]
    exact = PROBLEM.locate(sample).deviations
    missed = PROBLEM.locate(replace(sample, sampling_variance=(0.02 * size) ** 2)).deviations
    force = TouchColumn.FORCE
    assert missed[force] == pytest.approx(np.hypot(exact[force], 0.02 / power), rel=0.05)
    assert (exact[:2] < missed[:2]).all()
    assert (missed[:2] < 2.0 * exact[:2]).all()


def test_other_likely_places_widen_the_deviations():
    """Three electrodes hardly separate two places beyond the ring; less noise leaves one."""
    sample = make_sample(replace(TAP, place_mm=(0.0, -9.0)), 1.0)
    factors = np.array([1.0, 1.0, 1.0, ChargeSample.MISSING])
    size = np.linalg.norm(sample.charges_pC)
    one = PROBLEM.locate(replace(sample, noise_variance=factors * np.square(1e-4 * size)))
    two = PROBLEM.locate(replace(sample, noise_variance=factors * np.square(5e-4 * size)))
    assert (len(one), len(two)) == (1, 2)
    distance = np.abs(two.coordinates[1] - two.coordinates[0])[1]
    assert distance > 3.0
    own = 5.0 * one.deviations[1]
    assert np.hypot(own, 0.1 * distance) < two.deviations[1] < np.hypot(own, 0.5 * distance)


def test_too_few_channels_or_too_light_a_touch_give_no_place():
    sample = make_sample(TAP, 1.0)
    noise_variance = np.array([1.0, 1.0, ChargeSample.MISSING, ChargeSample.MISSING])
    assert PROBLEM.locate(replace(sample, noise_variance=noise_variance)) is None
    light = replace(TAP, force_N=0.05)
    assert PROBLEM.locate(make_sample(light, 0.1)) is None


@pytest.mark.parametrize("force_N", [0.05, 0.8, 8.0])
def test_forces_are_continued_beyond_those_of_the_response(force_N):
    """The response has 0.1 to 5 N; beyond them charges grow with a power of the force."""
    start = np.array([4.0, -3.0, 0.0, np.log(0.8)])
    sample = make_sample(replace(TAP, force_N=force_N), 0.05)
    fitted = ForceCurve(PROBLEM, start).fit(sample, np.log(0.8))
    tolerance = 1e-3 if force_N == 0.8 else 0.1
    assert np.exp(fitted.log_force) == pytest.approx(force_N, rel=tolerance)
    assert (fitted.chi_square < 1e-2) == (force_N == 0.8)


def test_missing_channels_do_not_count_in_the_force():
    start = np.array([4.0, -3.0, 0.0, np.log(0.8)])
    sample = make_sample(TAP, 0.05).without_channel(1)
    fitted = ForceCurve(PROBLEM, start).fit(sample, np.log(0.5))
    assert np.exp(fitted.log_force) == pytest.approx(0.8, rel=1e-3)
    for channel in (0, 2, 3):
        sample = sample.without_channel(channel)
    assert np.isnan(ForceCurve(PROBLEM, start).fit(sample, 0.0).log_force)


@pytest.mark.parametrize("shift_mm", [0.3, 6.0])
def test_a_search_near_a_touch_finds_the_same_as_one_everywhere(shift_mm):
    """A touch that moved a little is found from there; one elsewhere by the search of all."""
    sample = make_sample(TAP, 2.0)
    everywhere = PROBLEM.search(sample)
    start = everywhere.coordinates[:1] + np.array([shift_mm, 0.0, 0.0, 0.1])
    near = PROBLEM.search(sample, start)
    np.testing.assert_allclose(near.coordinates[0], everywhere.coordinates[0], atol=2e-3)
    assert near.touches[0].explained


def test_a_search_near_no_touch_looks_everywhere():
    """Charges that the touch of another place does not explain are located where they come from."""
    other = replace(TAP, place_mm=(-TAP.place_mm[0], -TAP.place_mm[1]))
    found = PROBLEM.search(make_sample(other, 2.0))
    start = PROBLEM.search(make_sample(TAP, 2.0)).coordinates
    near = PROBLEM.search(make_sample(other, 2.0), start)
    np.testing.assert_allclose(near.coordinates[0], found.coordinates[0], atol=2e-3)
