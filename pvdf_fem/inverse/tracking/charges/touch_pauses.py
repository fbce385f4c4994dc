"""Pauses between touches that follow each other so fast that they are one contact."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from pvdf_fem.arrays import Array, Mask
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples

#: The film is released where the charges are below this fraction of the largest of the touches
#: before and after, as in `TrackOptions.max_residual_fraction`. The force is about 3 % of theirs.
MAX_PAUSE_FRACTION = 0.1
#: Smallest number of rows in a pause. All channels of a single one may be missing or spikes.
MIN_PAUSE_ROWS = 2
#: Charges of at least so many standard deviations, and of this fraction of the largest, show that
#: the film is pressed.
PRESSED_DEVIATIONS = 4.0
PRESSED_FRACTION = 0.02


def find_pauses(rows: BufferedSamples) -> list[slice]:
    """Find the pauses between the touches of a contact that has ended.

    Parameters
    ----------
    rows : BufferedSamples
        Charges of the contact less their drift, which are zero at its end.

    Returns
    -------
    list of slice
        Rows of each pause. There are none if the contact is a single touch.
    """
    sizes = np.linalg.norm(rows.charges_pC, axis=1)
    touches = _find_runs(sizes > MAX_PAUSE_FRACTION * sizes.max())
    pauses = []
    largest_before = 0.0
    for touch, following in pairwise(touches):
        largest_before = max(largest_before, float(sizes[touch].max()))
        largest_after = float(sizes[following].max())
        limit = MAX_PAUSE_FRACTION * min(largest_before, largest_after)
        between = slice(touch.stop, following.start)
        released = between.start + np.flatnonzero(sizes[between] < limit)
        if len(released) >= MIN_PAUSE_ROWS:
            pauses.append(slice(int(released[0]), int(released[-1]) + 1))
            largest_before = 0.0
    return pauses


def _find_runs(mask: Mask) -> list[slice]:
    """Find the runs of successive true values in a mask, shape (n,)."""
    edges = np.flatnonzero(np.diff(mask, prepend=False, append=False))
    return [slice(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def find_onset(rows: BufferedSamples, direction: Array, largest_row: int) -> float | None:
    """Find the last time before the largest charges at which the film was not pressed.

    Parameters
    ----------
    rows : BufferedSamples
        Charges of a touch less their drift.
    direction : ndarray, shape (electrodes,)
        Unit vector along the largest charges.
    largest_row : int
        Row of the largest charges.

    Returns
    -------
    float or None
        Time in s; None if the film is pressed in the first row already.
    """
    before = rows.select(slice(largest_row))
    sizes = before.charges_pC @ direction
    variance = before.noise_variance @ np.square(direction)
    limits = PRESSED_DEVIATIONS * np.sqrt(variance)
    largest = float(rows.charges_pC[largest_row] @ direction)
    limits = np.maximum(limits, PRESSED_FRACTION * largest)
    # A missing voltage has an infinite variance and shows nothing.
    is_measured = np.isfinite(sizes) & (limits < largest)
    is_released = is_measured & (sizes < limits)
    if not is_released.any():
        return None
    return float(before.time_s[np.flatnonzero(is_released)[-1]])
