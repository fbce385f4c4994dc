"""The mistake in readings that explains why touches were not located."""

from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.electrodes.misreadings import list_misreadings
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem
from pvdf_fem.inverse.tracking.stream_diagnosis import correct_sample, find_misreading
from pvdf_fem.surrogate.touch_domain import TouchColumn
from tests.helpers.streams import Tap, compute_changes, make_sensor

SENSOR = make_sensor()
CHANNELS = make_channels(SENSOR.scene)
PROBLEM = ContactProblem.from_response(SENSOR, {TouchColumn.ROTATION: 0.0}, DEFAULTS)
PLACES_MM = ((4.0, -3.0), (-2.0, 5.0), (1.0, 6.0), (-5.0, -2.0))


def make_peak(place_mm, factors=1.0, order=(0, 1, 2, 3)):
    """Make the peak of a touch of 0.8 N, with the charges of wrong readings."""
    tap = Tap(0.0, 1.0, place_mm, 0.8)
    (charges_pC,) = compute_changes(SENSOR, tap, np.array([0.8]))
    zeros = np.zeros(len(charges_pC))
    return ChargeSample(
        0.0,
        (charges_pC * factors)[list(order)],
        noise_variance=zeros + (2.0 * np.mean(np.abs(factors))) ** 2,
        walk_variance=zeros,
        drift_pC=zeros,
        sampling_variance=0.0,
        is_clipped=np.zeros(len(charges_pC), dtype=bool),
    )


def find(peaks):
    """Find the mistake in readings in V."""
    return find_misreading(PROBLEM, CHANNELS, peaks, "V")


@pytest.mark.parametrize(
    ("factors", "kind", "word"),
    [
        (-1.0, "wrong_sign", "readings"),
        (np.array([1.0, -1.0, 1.0, 1.0]), "wrong_sign", "channel B"),
        (1e3, "wrong_unit", "mV"),
    ],
)
def test_a_wrong_sign_and_a_wrong_unit_are_found(factors, kind, word):
    found = find([make_peak(place, factors) for place in PLACES_MM])
    assert found.kind == kind
    assert word in found.text


def test_swapped_channels_are_found():
    found = find([make_peak(place, order=(0, 2, 1, 3)) for place in PLACES_MM])
    assert found.kind == "swapped_channels"
    assert found.order == (0, 2, 1, 3)


def test_a_mistake_must_explain_most_of_the_touches():
    """Three of four are enough, two of four are not."""
    inverted = [make_peak(place, -1.0) for place in PLACES_MM]
    noise = replace(inverted[0], charges_pC=np.array([300.0, -200.0, 300.0, -200.0]))
    assert find([*inverted[:3], noise]).kind == "wrong_sign"
    assert find([*inverted[:2], noise, noise]) is None
    assert find([]) is None


@pytest.mark.parametrize("missing", [0, 3])
def test_a_missing_channel_stays_missing_in_any_correction(missing):
    """Its charge is unknown, however small the unit and wherever its column belongs."""
    peak = make_peak(PLACES_MM[0]).without_channel(missing)
    for misreading in list_misreadings(CHANNELS, "V"):
        corrected = correct_sample(peak, misreading, CHANNELS)
        assert not corrected.is_measured[misreading.order.index(missing)]
        if np.abs(misreading.factors).max() <= 1.0:
            assert corrected.is_measured.sum() == 3


def test_a_correction_is_that_of_the_readings():
    """With different gains and capacitances, charges are permuted as readings."""
    channels = [
        replace(channel, gain=gain, capacitance=channel.capacitance * size)
        for channel, gain, size in zip(CHANNELS, (1.0, -2.0, 5.0, 1.0), (1, 2, 3, 4), strict=True)
    ]
    true = make_peak(PLACES_MM[1])
    charge_per_volt = np.array([channel.capacitance / channel.gain for channel in channels])
    for misreading in list_misreadings(channels, "V"):
        readings = np.empty(4)
        readings[list(misreading.order)] = true.charges_pC / charge_per_volt / misreading.factors
        wrong = replace(true, charges_pC=readings * charge_per_volt)
        corrected = correct_sample(wrong, misreading, channels)
        np.testing.assert_allclose(corrected.charges_pC, true.charges_pC, rtol=1e-12)
