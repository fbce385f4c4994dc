"""Spikes in single samples and short bursts, beside steps and flanks of touches."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample
from pvdf_fem.inverse.tracking.signal.spike_filter import SpikeFilter
from tests.helpers.tracking.baselines import make_circuit, make_learned_baseline

NOISE_V = 1e-3
INTERVAL_S = 1e-3
CHANNELS = 2


def make_filter():
    """Make a filter of two channels with noise of 1 mV."""
    return SpikeFilter(make_learned_baseline(make_circuit(CHANNELS), noise_V=NOISE_V))


def make_noise(count, seed=0):
    """Make noise, shape (samples, channels)."""
    return NOISE_V * np.random.default_rng(seed).standard_normal((count, CHANNELS))


def run_filter(spike_filter, voltages, interval_s=INTERVAL_S, pauses=()):
    """Return the voltages that a filter passes on; all samples must come out once, in order."""
    received = []
    for number, row in enumerate(voltages):
        sample = FilteredSample(
            number * interval_s,
            row.tolist(),
            [False] * CHANNELS,
            follows_pause=number in pauses,
        )
        received.extend(spike_filter.receive(sample, interval_s))
    received.extend(spike_filter.flush())
    times = [sample.time_s for sample in received]
    assert times == [number * interval_s for number in range(len(voltages))]
    return np.array([sample.voltages for sample in received])


@given(
    length=st.integers(1, 4),
    channel=st.integers(0, CHANNELS - 1),
    size_V=st.one_of(st.floats(0.05, 1e160), st.floats(-1e160, -0.05)),
    start=st.integers(5, 30),
)
def test_spikes_of_one_to_four_samples_are_removed_and_nothing_else(length, channel, size_V, start):
    clean = make_noise(60)
    voltages = clean.copy()
    voltages[start : start + length, channel] += size_V
    spike_filter = make_filter()
    filtered = run_filter(spike_filter, voltages)
    expected = clean.copy()
    expected[start : start + length, channel] = math.nan
    np.testing.assert_array_equal(filtered, expected)
    counts = [0] * CHANNELS
    counts[channel] = length
    assert spike_filter.spike_counts == counts


@given(
    height_V=st.one_of(st.floats(0.02, 5.0), st.floats(-5.0, -0.02)),
    rise_samples=st.integers(1, 20),
    start=st.integers(5, 30),
)
def test_steps_and_fast_flanks_are_kept(height_V, rise_samples, start):
    """The flank is linear, and stays at its end for longer than any spike."""
    ramp = np.clip((np.arange(100) - start) / rise_samples, 0.0, 1.0)
    voltages = make_noise(100) + height_V * ramp[:, None] * np.array([1.0, 0.3])
    spike_filter = make_filter()
    np.testing.assert_array_equal(run_filter(spike_filter, voltages), voltages)
    assert spike_filter.spike_counts == [0] * CHANNELS


@pytest.mark.parametrize("duration_s", [8e-3, 20e-3])
def test_an_impact_of_some_milliseconds_is_kept(duration_s):
    times = np.arange(100) * INTERVAL_S
    phase = np.clip((times - 0.0405) / duration_s, 0.0, 1.0)
    voltages = make_noise(100) + 0.8 * np.square(np.sin(np.pi * phase))[:, None]
    spike_filter = make_filter()
    np.testing.assert_array_equal(run_filter(spike_filter, voltages), voltages)


@pytest.mark.parametrize("length", [1, 2, 4])
def test_a_short_touch_is_kept_and_a_spike_of_all_channels_is_removed(length):
    """Two samples or more in which all channels deviate to one side are a touch."""
    voltages = make_noise(60)
    voltages[30 : 30 + length] += [0.5, 0.2]
    filtered = run_filter(make_filter(), voltages)
    assert np.isnan(filtered).sum() == (CHANNELS if length == 1 else 0)
    voltages[30 : 30 + length, 1] -= 0.7
    filtered = run_filter(make_filter(), voltages)
    assert np.isnan(filtered).sum() == CHANNELS * length


@pytest.mark.parametrize("offset", [1, 2])
def test_a_spike_within_a_flank_is_removed(offset):
    """One sample of the held ones is far from both neighbours."""
    voltages = make_noise(60)
    voltages[30:] += 1.0
    voltages[30 + offset, 0] = 200.0
    spike_filter = make_filter()
    filtered = run_filter(spike_filter, voltages)
    expected = voltages.copy()
    expected[30 + offset, 0] = math.nan
    np.testing.assert_array_equal(filtered, expected)
    assert spike_filter.spike_counts == [1, 0]


@pytest.mark.parametrize(("rate_Hz", "longest"), [(100.0, 4), (1000.0, 5), (4000.0, 20)])
def test_the_longest_spike_is_five_milliseconds_or_four_samples(rate_Hz, longest):
    for length, is_spike in ((longest, True), (longest + 1, False)):
        voltages = make_noise(100)
        voltages[40 : 40 + length, 0] += 1.0
        filtered = run_filter(make_filter(), voltages, 1.0 / rate_Hz)
        is_removed = np.isnan(filtered[40 : 40 + length, 0])
        assert is_removed.all() if is_spike else not is_removed.any()


def test_a_spike_before_a_pause_is_passed_on_with_it():
    """After a pause the voltage may be another one: nothing is compared across it."""
    voltages = make_noise(40)
    voltages[20:] += 1.0
    spike_filter = make_filter()
    filtered = run_filter(spike_filter, voltages, pauses=(20,))
    np.testing.assert_array_equal(filtered, voltages)
    # The level after the pause is the new one, so that a return to the old one is a spike.
    voltages[30] -= 1.0
    filtered = run_filter(make_filter(), voltages, pauses=(20,))
    assert np.isnan(filtered[30]).all()
    assert np.isnan(filtered).sum() == CHANNELS


def test_a_missing_voltage_is_not_suspicious():
    voltages = make_noise(40)
    voltages[10:20, 0] = math.nan
    voltages[15, 1] += 1.0
    filtered = run_filter(make_filter(), voltages)
    expected = voltages.copy()
    expected[15, 1] = math.nan
    np.testing.assert_array_equal(filtered, expected)


def test_overlapping_spikes_of_two_channels_are_removed():
    """Together they last longer than the longest spike."""
    voltages = make_noise(60)
    voltages[30:33, 0] = -5.0
    voltages[32:35, 1] = -5.0
    interval_s = 1e-2  # the longest spike has four samples
    passed = run_filter(make_filter(), voltages, interval_s)
    expected = np.where(voltages < -1.0, np.nan, voltages)
    np.testing.assert_array_equal(passed, expected)


def test_an_offset_that_steps_beside_a_spike_is_kept():
    voltages = make_noise(60)
    voltages[30:33, 0] = -5.0
    voltages[31:, 1] += 0.5
    passed = run_filter(make_filter(), voltages, 1e-2)
    assert np.isfinite(passed[:, 1]).all()
