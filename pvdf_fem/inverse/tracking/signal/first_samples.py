"""The first samples of a stream: channels without a signal, at a limit, and with spikes."""

from __future__ import annotations

import numpy as np

from pvdf_fem.arrays import Array, Mask

#: Smallest fraction of the readings that a channel with a signal has; loggers that read four
#: channels in turn leave a quarter.
MIN_MEASURED_FRACTION = 0.15
#: Spikes have at most this number of samples, and deviate from the samples before and after them by
#: more noise deviations and a larger multiple of the difference of these samples.
MAX_SPIKE_SAMPLES = 4
SPIKE_DEVIATIONS = 10.0
SPIKE_MULTIPLE = 3.0
#: A channel lies at the end of its range if more than this fraction of its readings equal its
#: extreme one, though it has so many different readings.
MAX_EXTREME_FRACTION = 0.2
MIN_DISTINCT_VOLTAGES = 10


def find_signals(voltages: Array) -> Mask:
    """Mark the channels that have a signal, shape (electrodes,).

    A channel has no signal if all but a few of its voltages are missing, or if they are all equal
    although those of another channel are not.
    """
    is_measured = ~np.isnan(voltages)
    has_values = is_measured.sum(axis=0) > MIN_MEASURED_FRACTION * len(voltages)
    lowest = np.where(is_measured, voltages, np.inf).min(axis=0)
    highest = np.where(is_measured, voltages, -np.inf).max(axis=0)
    varies = lowest < highest
    return np.asarray(has_values & (varies | ~varies.any()))


def find_channels_at_limit(voltages: Array) -> Mask:
    """Mark the channels whose unloaded reading lies at the end of a converter's range.

    Many of their voltages then equal the lowest or the highest one, though others are spread.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V; NaN where they are missing.

    Returns
    -------
    ndarray of bool, shape (electrodes,)
    """
    is_at_limit = []
    for values in voltages.T:
        measured = values[~np.isnan(values)]
        if len(np.unique(measured)) < MIN_DISTINCT_VOLTAGES:
            is_at_limit.append(False)
            continue
        share = max(np.mean(measured == measured.min()), np.mean(measured == measured.max()))
        is_at_limit.append(bool(share > MAX_EXTREME_FRACTION))
    return np.array(is_at_limit)


def remove_spikes(voltages: Array, noise_V: Array) -> Array:
    """Replace spikes by NaN: single voltages and short bursts that leave the signal and come back.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V.
    noise_V : ndarray, shape (electrodes,)
        Standard deviations of a voltage.

    Returns
    -------
    ndarray, shape (n, electrodes)
        Copy of the voltages.
    """
    is_spike = np.zeros(voltages.shape, dtype=bool)
    for length in range(1, MAX_SPIKE_SAMPLES + 1):
        before = voltages[: -length - 1]
        after = voltages[length + 1 :]
        middle = (before + after) / 2.0
        limit = SPIKE_DEVIATIONS * noise_V + SPIKE_MULTIPLE * np.abs(after - before)
        for offset in range(1, length + 1):
            inside = slice(offset, offset + len(middle))
            is_spike[inside] |= np.abs(voltages[inside] - middle) > limit
    cleaned = np.where(is_spike, np.nan, voltages)
    first = slice(MAX_SPIKE_SAMPLES)
    cleaned[first][_find_spikes_at_start(cleaned, noise_V)] = np.nan
    return cleaned


def _find_spikes_at_start(voltages: Array, noise_V: Array) -> Mask:
    """Mark those of the first voltages that are far outside the range of the later ones.

    Spikes in the first samples do not come back to a voltage before them.

    Parameters
    ----------
    voltages : ndarray, shape (n, electrodes)
        Voltages in V; NaN where they are missing.
    noise_V : ndarray, shape (electrodes,)
        Standard deviations of a voltage.

    Returns
    -------
    ndarray of bool, shape (`MAX_SPIKE_SAMPLES`, electrodes)
    """
    first = voltages[:MAX_SPIKE_SAMPLES]
    later = voltages[MAX_SPIKE_SAMPLES:]
    is_measured = ~np.isnan(later)
    lowest = np.where(is_measured, later, np.inf).min(axis=0)
    highest = np.where(is_measured, later, -np.inf).max(axis=0)
    margin = SPIKE_DEVIATIONS * noise_V + np.maximum(highest - lowest, 0.0)
    is_outside = (first > highest + margin) | (first < lowest - margin)
    return np.asarray(is_outside & is_measured.any(axis=0))


def compute_medians(values: Array) -> Array:
    """Compute medians along the first axis without missing values; 0 where all are missing."""
    is_measured = ~np.isnan(values)
    ordered = np.sort(values, axis=0)  # NaN comes last
    count = is_measured.sum(axis=0)
    middle = np.maximum(count - 1, 0) // 2
    median = np.take_along_axis(ordered, middle[None], axis=0)[0]
    return np.where(count > 0, median, 0.0)
