"""Samples of a contact in bounded memory."""

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.sample_buffer import CAPACITY, SampleBuffer

CHANNELS = 3


def make_samples(count, *, missing_fraction=0.0):
    """Make samples of random charges, each with its voltages."""
    rng = np.random.default_rng(count)
    samples = []
    for number in range(count):
        is_missing = rng.random(CHANNELS) < missing_fraction
        noise_variance = rng.uniform(1.0, 4.0, CHANNELS)
        voltages = rng.standard_normal(CHANNELS)
        sample = ChargeSample(
            1e-3 * number,
            rng.standard_normal(CHANNELS),
            noise_variance=np.where(is_missing, ChargeSample.MISSING, noise_variance),
            walk_variance=np.full(CHANNELS, 0.1 * number),
            drift_pC=np.full(CHANNELS, 0.2 * number),
            sampling_variance=0.3 * number,
            is_clipped=rng.random(CHANNELS) < 1e-3,
        )
        samples.append((sample, np.where(is_missing, np.nan, voltages)))
    return samples


def fill_buffer(samples):
    """Return a buffer with samples."""
    buffer = SampleBuffer(CHANNELS)
    for sample, voltages in samples:
        buffer.add(sample, voltages)
    return buffer


@pytest.mark.parametrize("missing_fraction", [0.0, 0.3])
@pytest.mark.parametrize("count", [1, CAPACITY - 1, CAPACITY, 4 * CAPACITY, 5 * CAPACITY + 37])
def test_rows_are_means_of_their_samples(count, missing_fraction):
    """Whether samples were merged one by one or by halving, rows are the same weighted means."""
    samples = make_samples(count, missing_fraction=missing_fraction)
    buffer = fill_buffer(samples)
    size = buffer.samples_per_row
    assert buffer.sample_count == count
    assert len(buffer) == count // size < CAPACITY
    rows = buffer.rows
    for index in range(len(buffer)):
        group = [sample for sample, _ in samples[index * size : (index + 1) * size]]
        row = rows.get_sample(index)
        for name in ("time_s", "walk_variance", "drift_pC", "sampling_variance"):
            expected = np.mean([getattr(sample, name) for sample in group], axis=0)
            np.testing.assert_allclose(getattr(row, name), expected, rtol=1e-12, atol=1e-12)
        weights = np.array([1.0 / sample.noise_variance for sample in group])
        charges_pC = np.array([sample.charges_pC for sample in group])
        expected = (weights * charges_pC).sum(axis=0) / weights.sum(axis=0)
        np.testing.assert_allclose(row.charges_pC, expected, rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(row.noise_variance, 1.0 / weights.sum(axis=0), rtol=1e-9)
        is_clipped = np.any([sample.is_clipped for sample in group], axis=0)
        np.testing.assert_array_equal(row.is_clipped, is_clipped)


@pytest.mark.parametrize("count", [CAPACITY - 1, 3 * CAPACITY])
def test_a_channel_counts_as_missing_only_if_all_samples_of_a_row_miss_it(count):
    samples = make_samples(count, missing_fraction=0.5)
    buffer = fill_buffer(samples)
    size = buffer.samples_per_row
    voltages = np.array([voltages for _, voltages in samples[: len(buffer) * size]])
    is_measured = ~np.isnan(voltages).reshape(len(buffer), size, CHANNELS).all(axis=1)
    np.testing.assert_array_equal(~np.isnan(buffer.rows.voltages), is_measured)
    is_below = buffer.rows.noise_variance < ChargeSample.MAX_VARIANCE
    np.testing.assert_array_equal(is_below, is_measured)


def test_the_next_halving_is_announced():
    """The record then keeps its peak: the rows become half as many just after that sample."""
    buffer = SampleBuffer(CHANNELS)
    for sample, voltages in make_samples(4 * CAPACITY):
        is_announced = buffer.is_halved_by_next
        size = buffer.samples_per_row
        buffer.add(sample, voltages)
        assert (buffer.samples_per_row > size) == is_announced
    assert buffer.samples_per_row == 8


@pytest.mark.parametrize("count", [1, 2, 5, 700])
@pytest.mark.parametrize("added", [20, 2 * CAPACITY + 1, 2 * CAPACITY + 7])
def test_the_last_samples_are_marked_as_clipped_also_in_an_incomplete_row(added, count):
    buffer = fill_buffer(make_samples(added))
    size = buffer.samples_per_row
    before = buffer.rows.is_clipped.copy()
    buffer.mark_clipped(1, count)
    to_complete = -added % size
    for sample, voltages in make_samples(to_complete):
        buffer.add(sample, voltages)
    first = max(added - count, 0) // size
    rows = buffer.rows
    assert rows.is_clipped[first:, 1].all()
    np.testing.assert_array_equal(rows.is_clipped[:first, 1], before[:first, 1])
    np.testing.assert_array_equal(rows.is_clipped[:first, ::2], before[:first, ::2])
    complete = added // size
    assert (rows.noise_variance[first:complete, 1] > ChargeSample.MAX_VARIANCE).all()


def test_an_excluded_channel_is_missing_in_all_rows():
    samples = make_samples(CAPACITY + 3)
    buffer = fill_buffer(samples)
    assert buffer.samples_per_row == 2
    buffer.exclude_channel(0)
    sample, voltages = samples[-1]
    buffer.add(sample.without_channel(0), voltages)  # The row was begun before the exclusion.
    rows = buffer.rows
    assert (rows.noise_variance[:, 0] > ChargeSample.MAX_VARIANCE).all()
    assert not rows.charges_pC[:, 0].any()
    assert (rows.noise_variance[:, 1:] < ChargeSample.MAX_VARIANCE).all()
