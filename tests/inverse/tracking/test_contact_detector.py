"""Detection of contacts among deviations from the baseline."""

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.contact_detector import ComparedSample, ContactDetector
from pvdf_fem.inverse.tracking.options import TrackOptions
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample

MANY = 10**6  #: So many samples that the noise is known.
CONTACT = np.array([12.0, -5.0])  #: Deviations of a strong contact.


def make_detector(probability, longest_window=64, channel_count=2):
    """Make a detector with a probability of a false alarm in each sample."""
    options = TrackOptions(false_alarm_probability=probability)
    detector = ContactDetector(channel_count, longest_window, options)
    detector.set_errors([0.0] * channel_count, MANY)
    return detector


def add(detector, number, deviations):
    """Add a sample."""
    voltages = [float(deviation) for deviation in deviations]
    sample = FilteredSample(1e-3 * number, voltages, [False] * len(voltages))
    detector.add(ComparedSample(sample, voltages))


def count_alarms(detector, deviations):
    """Count the samples at which a contact is detected; the detector goes on."""
    alarms = 0
    for number, row in enumerate(deviations):
        add(detector, number, row)
        alarms += detector.exceeds_threshold()
        if detector.is_full:
            detector.remove_oldest()
    return alarms


def test_false_alarms_of_known_noise_are_as_rare_as_stated():
    """The probability is a bound for correlated windows, of which a part is tested at a sample."""
    count = 40_000
    noise = np.random.default_rng(0).standard_normal((count, 2))
    alarms = count_alarms(make_detector(2e-3), noise)
    assert 0.1 * 2e-3 * count < alarms < 2e-3 * count


@pytest.mark.parametrize("noise_count", [8, 20, 100])
def test_false_alarms_of_an_estimated_noise_are_as_rare_as_stated(noise_count):
    """The noise of many detectors is estimated from few samples, each with n - 2 freedoms."""
    rng = np.random.default_rng(noise_count)
    probability = 0.02
    repetitions = 4000
    alarms = 0
    for _ in range(repetitions):
        detector = make_detector(probability, longest_window=1, channel_count=1)
        noise = np.sqrt(rng.chisquare(noise_count - 2) / (noise_count - 2))
        detector.set_errors([0.0], noise_count)
        add(detector, 0, rng.standard_normal(1) / noise)
        alarms += detector.exceeds_threshold()
    expected = probability * repetitions
    assert abs(alarms - expected) < 4.0 * expected**0.5


def test_the_threshold_follows_the_number_of_noise_samples_up_and_down():
    """Deviations of 7 are a contact if the noise is known, and may be noise after 8 samples."""
    detector = make_detector(1e-7, longest_window=4, channel_count=1)
    add(detector, 0, [7.0])
    for noise_count, is_contact in ((MANY, True), (8, False), (10 * MANY, True)):
        detector.set_errors([0.0], noise_count)
        assert detector.exceeds_threshold() == is_contact


def test_a_weak_contact_is_detected_by_a_long_window():
    """A mean of 1.5 deviations exceeds the threshold of 1e-7 in 32 samples, not in one."""
    rng = np.random.default_rng(0)
    noise = rng.standard_normal((400, 2))
    noise[200:] += [1.5, 0.0]
    detector = make_detector(1e-7)
    assert count_alarms(detector, noise[:200]) == 0
    first = 200
    while not count_alarms(detector, noise[first : first + 1]):
        first += 1
    assert 208 < first < 240


def test_errors_of_the_baseline_are_no_contact():
    """A mean of one deviation is expected if the error of the baseline is one deviation."""
    deviations = np.full((64, 2), 1.0)
    assert count_alarms(make_detector(1e-7), deviations) > 0
    detector = make_detector(1e-7)
    detector.set_errors([1.0, 1.0], MANY)
    assert count_alarms(detector, deviations) == 0


def test_a_slow_drift_widens_the_detector():
    """Means of the longest window that noise does not explain are learned as their variance."""
    rng = np.random.default_rng(0)
    detector = make_detector(1e-7)
    size = 0.5
    for block in range(80):
        mean = size * rng.standard_normal(2) * [1.0, 0.0]
        noise = rng.standard_normal((64, 2))
        count_alarms(detector, noise + mean * min(block / 10.0, 1.0))
    drift = detector.drift_errors
    assert drift[0] == pytest.approx(size, rel=0.6)
    assert drift[1] < 0.1
    # A step of four such deviations is a contact of a quiet baseline only.
    step = rng.standard_normal((64, 2))
    step[:, 0] += 2.0
    assert count_alarms(make_detector(1e-7), step) > 0
    assert count_alarms(detector, step) == 0
    # Without the drift it becomes sensitive again.
    count_alarms(detector, rng.standard_normal((40 * 64, 2)))
    assert detector.drift_errors[0] < 0.1
    assert count_alarms(detector, step) > 0


@pytest.mark.parametrize("contact_count", [1, 5, 20])
def test_the_samples_of_a_contact_are_counted_with_a_margin(contact_count):
    rng = np.random.default_rng(0)
    detector = make_detector(1e-7)
    for number, noise in enumerate(rng.standard_normal((64, 2))):
        is_contact = number >= 64 - contact_count
        add(detector, number, noise + is_contact * CONTACT)
    counted = detector.count_contact_samples()
    expected = contact_count + contact_count // 4 + 2
    assert abs(counted - expected) <= 1


def test_samples_come_out_as_they_went_in():
    """However many are removed, sums and memory stay those of the samples that are left."""
    rng = np.random.default_rng(0)
    deviations = rng.standard_normal((1000, 2))
    detector = make_detector(1e-7, longest_window=20)
    assert detector.longest_window == 16
    for number, row in enumerate(deviations):
        add(detector, number, row)
        if detector.is_full:
            assert detector.remove_oldest().voltages == deviations[number - 16].tolist()
    assert len(detector) == 16
    last = [sample.voltages for sample in detector.get_samples()]
    np.testing.assert_array_equal(last, deviations[-16:])
    detector.clear()
    assert len(detector) == 0
    assert not detector.exceeds_threshold()
