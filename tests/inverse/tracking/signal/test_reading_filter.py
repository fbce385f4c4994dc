"""Readings that are missing, clipped or frozen."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.signal.reading_filter import ChannelFilter, ReadingFilter, Validity
from tests.helpers.tracking.baselines import make_circuit, make_learned_baseline

NOISE_V = 1e-3
INTERVAL_S = 1e-3


def make_channel_filter(*, noise_V=NOISE_V, low_V=-math.inf, high_V=math.inf):
    """Make the filter of a channel whose baseline is at 0 V."""
    baseline = make_learned_baseline(make_circuit(), noise_V=noise_V)
    return ChannelFilter(low_V, high_V, baseline.channels[0])


def classify(channel_filter, voltages):
    """Return the validity of each of the next readings."""
    validities = []
    for number, voltage in enumerate(voltages):
        validities.append(channel_filter.classify(INTERVAL_S * number, float(voltage)))
    return validities


def make_noise(count, *, noise_V=NOISE_V, step_V=0.0, seed=0):
    """Make noise of a channel, rounded to steps of a converter."""
    noise = noise_V * np.random.default_rng(seed).standard_normal(count)
    return step_V * np.round(noise / step_V) if step_V else noise


@given(st.sampled_from([math.nan, 1e6, -1e6, 1e160, -1e300]))
def test_what_no_converter_can_read_is_missing(voltage):
    channel_filter = make_channel_filter()
    noise = make_noise(20)
    assert classify(channel_filter, [*noise, voltage])[-1] is Validity.MISSING
    assert classify(channel_filter, [0.5])[-1] is Validity.VALUE


@given(
    low_V=st.floats(-10.0, -0.1),
    high_V=st.floats(0.1, 10.0),
    fraction=st.floats(-0.5, 1.5),
)
def test_readings_at_a_given_limit_or_beyond_are_clipped(low_V, high_V, fraction):
    voltage = low_V + fraction * (high_V - low_V)
    channel_filter = make_channel_filter(low_V=low_V, high_V=high_V)
    *_, validity = classify(channel_filter, [*make_noise(10), voltage])
    is_clipped = min(fraction, 1.0 - fraction) < 1e-8
    if abs(min(fraction, 1.0 - fraction)) > 1e-8:
        assert validity is (Validity.CLIPPED if is_clipped else Validity.VALUE)
    at_limits = [classify(channel_filter, [limit])[-1] for limit in (low_V, high_V)]
    assert at_limits == [Validity.CLIPPED] * 2


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("limit_V", [2.0, math.inf])
def test_an_infinite_reading_is_clipped_at_the_limit_or_the_extreme(sign, limit_V):
    """Instruments mark readings beyond their range; without any reading before, it is missing."""
    reading_filter, _ = make_reading_filter(low_V=-limit_V, high_V=limit_V)
    sample = reading_filter.mark(0.0, [sign * math.inf, 0.0], follows_pause=False)
    assert math.isnan(sample.voltages[0]) == math.isinf(limit_V)
    for number, voltage in enumerate([0.5, -0.25, 0.1], start=1):
        reading_filter.mark(INTERVAL_S * number, [voltage, voltage], follows_pause=False)
    sample = reading_filter.mark(1.0, [sign * math.inf, 0.0], follows_pause=False)
    assert sample.is_clipped == [True, False]
    extreme_V = 0.5 if sign > 0.0 else -0.25
    expected_V = extreme_V if math.isinf(limit_V) else sign * limit_V
    assert sample.voltages[0] == pytest.approx(expected_V)


def test_a_frozen_channel_is_found_after_a_few_readings_and_returns():
    channel_filter = make_channel_filter()
    noise = make_noise(500)
    validities = classify(channel_filter, [*noise, *[noise[-1]] * 50])
    assert set(validities[:500]) == {Validity.VALUE}
    # The probability of equal readings is at most 1/500, so that 1e-9 takes at most five of them.
    assert set(validities[505:]) == {Validity.FROZEN}
    assert set(classify(channel_filter, make_noise(20, seed=1))) == {Validity.VALUE}


@pytest.mark.parametrize("noise_steps", [0.1, 0.3, 1.0, 3.0])
def test_a_coarse_converter_is_not_frozen(noise_steps):
    """However often it repeats readings by chance, none of 20,000 counts as frozen or clipped."""
    noise_V = 1e-3
    channel_filter = make_channel_filter(noise_V=noise_V)
    readings = 0.3 * noise_V + make_noise(20_000, noise_V=noise_V, step_V=noise_V / noise_steps)
    assert set(classify(channel_filter, readings)) == {Validity.VALUE}


def make_touch(height_V, limit_V, count=200, seed=0):
    """Make half a sine of a touch with noise, that is clipped at a limit."""
    touch = height_V * np.sin(np.pi * np.arange(count) / count)
    return np.minimum(touch + make_noise(count, seed=seed), limit_V)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_plateau_at_the_extreme_is_learned_as_a_limit(sign):
    """All readings of the plateau are clipped; the first ones are when the third is.

    They are counted once, so that they can be marked afterwards.
    """
    limit_V = 0.6
    channel_filter = make_channel_filter()
    touch = sign * make_touch(1.0, limit_V)
    classify(channel_filter, make_noise(500))
    plateau_count = 0
    for voltage in touch:
        (validity,) = classify(channel_filter, [voltage])
        unmarked_count = channel_filter.take_unmarked_count()
        if abs(voltage) < limit_V:
            assert validity is Validity.VALUE
            assert unmarked_count == 0
            continue
        plateau_count += 1
        assert validity is (Validity.VALUE if plateau_count < 3 else Validity.CLIPPED)
        assert unmarked_count == (2 if plateau_count == 3 else 0)
    # In the next touch the limit is known from its first reading on.
    touch = sign * make_touch(1.0, limit_V, seed=1)
    validities = np.array(classify(channel_filter, touch))
    assert set(validities[np.abs(touch) == limit_V]) == {Validity.CLIPPED}


def test_a_sample_says_which_samples_before_it_were_clipped():
    reading_filter, _ = make_reading_filter()
    touch = make_touch(1.0, 0.6)
    noise = make_noise(700, seed=1)
    counts = []
    for number, voltage in enumerate([*make_noise(500), *touch]):
        voltages = [float(noise[number]), float(voltage)]
        sample = reading_filter.mark(INTERVAL_S * number, voltages, follows_pause=False)
        counts.append(tuple(sample.clipped_before))
    first = 500 + int(np.argmax(touch == 0.6))
    assert counts[first + 2] == (0, 2)
    assert set(counts[: first + 2] + counts[first + 3 :]) == {()}
    assert reading_filter.clipped_counts == [0, int((touch == 0.6).sum())]


def test_a_limit_is_forgotten_when_a_reading_exceeds_it():
    """A channel that froze at its extreme has no limit there."""
    channel_filter = make_channel_filter()
    touch = make_touch(1.0, math.inf)
    frozen = [*make_noise(500), *touch[:60], *[touch[:60].max() + 1e-3] * 20]
    assert classify(channel_filter, frozen)[-1] is Validity.CLIPPED
    validities = classify(channel_filter, make_touch(2.0, math.inf, seed=1))
    assert set(validities[100:]) == {Validity.VALUE}
    assert channel_filter.high_V == pytest.approx(1e6)


def test_a_plateau_within_the_noise_or_below_the_extreme_is_frozen():
    """There is no limit at the baseline, nor below readings that were seen before."""
    for level_V in (0.0, 0.5):
        channel_filter = make_channel_filter()
        readings = [*make_noise(500), *make_touch(1.0, math.inf), *[level_V] * 30]
        assert classify(channel_filter, readings)[-1] is Validity.FROZEN
        assert channel_filter.high_V == pytest.approx(1e6)


def test_the_first_reading_counts_as_an_extreme():
    """A plateau above the first reading is not at the lower limit."""
    channel_filter = make_channel_filter()
    readings = [-0.9, *make_noise(500), *[-0.5] * 30]
    assert classify(channel_filter, readings)[-1] is Validity.FROZEN


def make_reading_filter(**options):
    """Make the filter of two channels, and their baseline."""
    circuit = make_circuit(2, **options)
    baseline = make_learned_baseline(circuit, noise_V=NOISE_V)
    return ReadingFilter(circuit, baseline), baseline


@pytest.mark.parametrize(("outage_s", "offset_V"), [(0.2, 0.3), (0.2, 0.0), (0.05, 0.3)])
def test_a_channel_that_returns_with_another_offset_is_learned_again(outage_s, offset_V):
    """Not after a short outage, in which a touch may have begun."""
    reading_filter, baseline = make_reading_filter()
    noise = NOISE_V * np.random.default_rng(0).standard_normal((600, 2))
    times = INTERVAL_S * np.arange(600)
    is_out = (times >= 0.3) & (times < 0.3 + outage_s)
    noise[is_out, 0] = math.nan
    noise[times >= 0.3 + outage_s, 0] += offset_V
    for time, voltages in zip(times, noise, strict=True):
        sample = reading_filter.mark(time, voltages.tolist(), follows_pause=False)
        assert math.isnan(sample.voltages[0]) == math.isnan(voltages[0])
    is_learned_again = outage_s > 0.1 and offset_V > 0.0
    assert [channel.is_settled for channel in baseline.channels] == [not is_learned_again, True]


def test_marks_of_a_sample():
    """Clipped voltages stay as limits, huge ones are counted as spikes, missing rows as nothing."""
    reading_filter, _ = make_reading_filter(low_V=-1.0, high_V=1.0)
    sample = reading_filter.mark(0.0, [1.0, 1e9], follows_pause=True)
    assert sample.voltages[0] == 1.0
    assert math.isnan(sample.voltages[1])
    assert sample.is_clipped == [True, False]
    assert sample.follows_pause
    sample = reading_filter.mark(1e-3, [math.nan, math.nan], follows_pause=False)
    assert sample.has_no_reading
    assert sample.is_clipped == [False, False]
    assert reading_filter.clipped_counts == [1, 0]
    assert reading_filter.spikes.spike_counts == [0, 1]


def test_held_samples_of_a_frozen_channel_become_missing():
    """A step that freezes is held as a possible spike, with all its equal readings."""
    reading_filter, _ = make_reading_filter()
    noise = NOISE_V * np.random.default_rng(0).standard_normal((300, 2))
    noise[50, 0] = 0.1  # Larger than the plateau, which is not a limit therefore.
    noise[294:, 0] = 0.06
    passed = []
    for number, voltages in enumerate(noise):
        sample = reading_filter.mark(INTERVAL_S * number, voltages.tolist(), follows_pause=False)
        passed.extend(reading_filter.spikes.receive(sample, INTERVAL_S))
    passed.extend(reading_filter.spikes.flush())
    assert len(passed) == 300
    assert all(math.isnan(sample.voltages[0]) for sample in passed[294:])
    assert [math.isnan(sample.voltages[0]) for sample in passed[:294]].count(True) == 1
