"""Means of consecutive samples of a recording, for rates far above those of touches."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.recording import SampleBlock


def average_blocks(blocks: Iterator[SampleBlock], count: int) -> Iterator[SampleBlock]:
    """Yield blocks with the means of groups of `count` consecutive samples.

    Missing samples are left out of the mean. It is infinite if a sample is marked as beyond the
    range. The last group of a recording may have fewer samples.

    Parameters
    ----------
    blocks : iterator of SampleBlock
        Blocks of any sizes.
    count : int
        Number of samples, at least 1.
    """
    rest: SampleBlock | None = None
    for block in blocks:
        if rest is not None:
            times_s = np.concatenate([rest.times_s, block.times_s])
            block = SampleBlock(times_s, np.concatenate([rest.values, block.values]))
        whole = len(block.times_s) // count * count
        rest = SampleBlock(block.times_s[whole:], block.values[whole:])
        if whole:
            yield _average(SampleBlock(block.times_s[:whole], block.values[:whole]), count)
    if rest is not None and len(rest.times_s):
        yield _average(rest, len(rest.times_s))


def _average(block: SampleBlock, count: int) -> SampleBlock:
    """Average groups of `count` samples of a block, whose length is a multiple of `count`."""
    times_s = _compute_means(block.times_s[:, None], count)[:, 0]
    return SampleBlock(times_s, _compute_means(block.values, count))


def _compute_means(values: Array, count: int) -> Array:
    """Compute the means of groups of rows without missing values; NaN if all are missing.

    Parameters
    ----------
    values : ndarray, shape (groups * count, columns)
        Values, NaN where missing.
    count : int
        Number of rows of a group.
    """
    groups = values.reshape(-1, count, values.shape[1])
    is_given = ~np.isnan(groups)
    with np.errstate(invalid="ignore"):  # NaN for ∞ - ∞ and for 0 / 0
        sums = np.where(is_given, groups, 0.0).sum(axis=1)
        return np.asarray(sums / is_given.sum(axis=1))
