"""Means of consecutive samples: over the borders of blocks, with missing and marked samples."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pvdf_fem.readings.block_means import average_blocks
from pvdf_fem.readings.recording import SampleBlock


def split(times_s, values, sizes):
    """Yield the samples in blocks of given sizes, and then the rest."""
    start = 0
    for size in [*sizes, len(times_s)]:
        yield SampleBlock(times_s[start : start + size], values[start : start + size])
        start += size


@given(
    seed=st.integers(0, 2**32 - 1),
    total=st.integers(0, 60),
    count=st.integers(1, 9),
    sizes=st.lists(st.integers(0, 20), max_size=5),
)
def test_means_do_not_depend_on_blocks_and_leave_missing_samples_out(seed, total, count, sizes):
    random = np.random.default_rng(seed)
    times_s = np.arange(total) / 7.0
    values = random.standard_normal((total, 2))
    values[random.random(values.shape) < 0.3] = np.nan
    blocks = list(average_blocks(split(times_s, values, sizes), count))
    found_s = np.concatenate([[], *(block.times_s for block in blocks)])
    found = np.concatenate([np.empty((0, 2)), *(block.values for block in blocks)])
    starts = range(0, total, count)
    assert len(found) == len(starts)
    for start, time_s, mean in zip(starts, found_s, found, strict=True):
        assert np.isclose(time_s, times_s[start : start + count].mean())
        for column, value in zip(values[start : start + count].T, mean, strict=True):
            given = column[~np.isnan(column)]
            expected = given.mean() if len(given) else np.nan
            assert np.isclose(value, expected, equal_nan=True)


def test_a_mean_is_marked_as_beyond_the_range_if_a_sample_is():
    values = np.array([[1.0, np.inf], [np.inf, -np.inf], [np.nan, 2.0], [2.0, -np.inf]])
    (block,) = average_blocks(iter([SampleBlock(np.arange(4.0), values)]), 2)
    np.testing.assert_array_equal(block.values, [[np.inf, np.nan], [2.0, -np.inf]])
