"""Clipped readings: limits of channels, stated by the scene or recognised in tables of readings.

A converter outputs the end of its range instead of any reading beyond it. Such a reading is a limit
of the true one, not a value. Limits come from ``readout.range_V``, or from plateaus: values at the
extreme of a channel that occur more often than chance allows. An instrument may also mark a reading
as beyond its range, without a number.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.electrodes.channel import Channel, list_units_pC

#: Advice about readings at the end of the range of their channel.
CLIPPED_ADVICE = "press lighter, or widen the range of the channels (readout.range_V)"
#: Readings count as clipped from this fraction of the way between offset and end of the range. The
#: highest code of a bipolar 10-bit converter is 0.2 % of this way below the end.
CODE_FRACTION = 0.998
#: A repeated extreme is a plateau if its probability by chance is below this.
MAX_CHANCE = 1e-3
#: Minimum number of other readings that a plateau is compared with.
MIN_OTHERS = 3
#: Number of other readings, those next to the extreme, from which spacing and steps are estimated.
MAX_OTHERS = 200
#: The step of readings is sought down to this fraction of the smallest difference between them.
FINEST_STEP = 0.01
#: Extremes of several channels are equal within this fraction, which allows for rounded digits.
EQUAL_EXTREMES = 1e-5


class ReadingLimits(NamedTuple):
    """Lowest and highest readings that each channel can have, infinite where there is no limit."""

    low: Array  #: Readings at or below these are clipped; shape (channels,).
    high: Array  #: Readings at or above these are clipped; shape (channels,).

    def find_sides(self, readings: Array) -> Indices:
        """Find the readings that are clipped, and the side on which the true readings are.

        Parameters
        ----------
        readings : ndarray, shape (..., channels)
            Readings in the unit of the limits; NaN where missing, and infinite where an instrument
            has marked them as beyond its range.

        Returns
        -------
        ndarray of int, shape (..., channels)
            1 where the true reading is above the upper limit, -1 where it is below the lower one, 0
            for values. Readings that exceed the range by more than its width are values, since no
            converter outputs them: they are in another unit.
        """
        with np.errstate(over="ignore"):  # readings may be as large as 1e308
            width = self.high - self.low
            is_high = (readings >= self.high) & (readings <= self.high + width)
            is_low = (readings <= self.low) & (readings >= self.low - width)
        is_high = (is_high | np.isposinf(readings)) & np.isfinite(self.high)
        is_low = (is_low | np.isneginf(readings)) & np.isfinite(self.low)
        return is_high.astype(int) - is_low.astype(int)

    def replace_clipped(self, readings: Array, sides: Indices) -> Array:
        """Return readings with the limits in place of clipped ones; see `find_sides`."""
        limited = np.where(sides > 0, self.high, readings)
        return np.where(sides < 0, self.low, limited)

    def tighten(self, other: ReadingLimits) -> ReadingLimits:
        """Return the narrower of two pairs of limits for each channel."""
        return ReadingLimits(np.maximum(self.low, other.low), np.minimum(self.high, other.high))

    def scale(self, factors: Array) -> ReadingLimits:
        """Return limits in another unit; `factors`, of shape (channels,), are positive."""
        return ReadingLimits(self.low * factors, self.high * factors)


def compute_volts_per_unit(channels: Sequence[Channel], unit: str) -> Array:
    """Compute the size of a unit of readings in V for each channel; shape (channels,)."""
    units_pC = list_units_pC(channels)
    return units_pC[unit] / units_pC["V"]


def compute_range_limits(channels: Sequence[Channel], unit: str) -> ReadingLimits:
    """Compute the limits of readings from the ranges of the channels.

    Parameters
    ----------
    channels : sequence of Channel
        Channels with their ranges and offsets.
    unit : str
        Unit of the readings, a key of `list_units_pC`.

    Returns
    -------
    ReadingLimits
        Limits in this unit, slightly within the ranges (`CODE_FRACTION`).
    """
    low = []
    high = []
    for channel in channels:
        low.append(channel.offset + CODE_FRACTION * (channel.low_V - channel.offset))
        high.append(channel.offset + CODE_FRACTION * (channel.high_V - channel.offset))
    limits_V = ReadingLimits(np.array(low), np.array(high))
    return limits_V.scale(1.0 / compute_volts_per_unit(channels, unit))


def find_plateaus(readings: Array, channels: Sequence[Channel], unit: str) -> ReadingLimits:
    """Find limits at which readings of a table are clipped, though no range is stated.

    Parameters
    ----------
    readings : ndarray, shape (n, channels)
        Rows of readings; NaN where missing, infinite where marked as beyond the range. Repeated
        rows count once.
    channels : sequence of Channel
        Channels of the readings, with their offsets.
    unit : str
        Unit of the readings, a key of `list_units_pC`.

    Returns
    -------
    ReadingLimits
        The extreme readings of channels that are clipped; infinite for other channels.

    Notes
    -----
    Let s be the mean spacing of readings next to the extreme, and δ the step in which the channel
    outputs readings. By chance another reading equals the extreme with a probability of about δ/s,
    and k of them are equal with (δ/s)^(k - 1). It is at least the fraction of readings that are
    equal elsewhere, as in tables of symmetric touches without noise. If extremes of several
    channels are equal in volts, their probabilities are multiplied.
    """
    low = np.full(len(channels), -math.inf)
    high = np.full(len(channels), math.inf)
    if len(readings):
        offsets = np.array([channel.offset for channel in channels])
        volts = np.unique(readings, axis=0) * compute_volts_per_unit(channels, unit) - offsets
        is_clipped_above = _mark_plateaus(volts)
        is_clipped_below = _mark_plateaus(-volts)
        extremes = measure_extremes(readings)
        high = np.where(is_clipped_above, extremes.high, high)
        low = np.where(is_clipped_below, extremes.low, low)
    return ReadingLimits(low, high)


def measure_extremes(readings: Array) -> ReadingLimits:
    """Return the lowest and the highest finite reading of each channel.

    Parameters
    ----------
    readings : ndarray, shape (n, channels)
        Rows of readings; NaN where missing, infinite where marked as beyond the range.

    Returns
    -------
    ReadingLimits
        For a channel without finite readings, ∞ is the lowest and -∞ the highest one.
    """
    is_finite = np.isfinite(readings)
    low = np.where(is_finite, readings, math.inf).min(axis=0, initial=math.inf)
    high = np.where(is_finite, readings, -math.inf).max(axis=0, initial=-math.inf)
    return ReadingLimits(low, high)


class TableLimits:
    """Limits at which the channels of a table clip, which are learned while its rows arrive.

    They are plateaus, and the extremes of channels with readings that the instrument has marked as
    beyond its range. Where this range is not stated, it contains all readings of the channel: a
    marked reading is beyond their extreme.

    Parameters
    ----------
    channels : sequence of Channel
        Channels of the readings, with their ranges.
    """

    def __init__(self, channels: Sequence[Channel]) -> None:
        self.channels = tuple(channels)
        none = np.full(len(channels), math.inf)
        self._plateaus = ReadingLimits(-none, none)
        self._extremes = ReadingLimits(none, -none)
        self._is_marked_low = np.zeros(len(channels), dtype=bool)
        self._is_marked_high = np.zeros(len(channels), dtype=bool)

    def learn(self, readings: Array, unit: str) -> ReadingLimits:
        """Learn from rows of readings, and return the limits for them.

        Parameters
        ----------
        readings : ndarray, shape (n, channels)
            Rows of readings; NaN where missing, infinite where marked as beyond the range.
        unit : str
            Unit of the readings, a key of `list_units_pC`.

        Returns
        -------
        ReadingLimits
            Infinite for channels that do not clip.
        """
        self._plateaus = self._plateaus.tighten(find_plateaus(readings, self.channels, unit))
        extremes = measure_extremes(readings)
        self._extremes = ReadingLimits(
            np.minimum(self._extremes.low, extremes.low),
            np.maximum(self._extremes.high, extremes.high),
        )
        self._is_marked_low |= np.isneginf(readings).any(axis=0)
        self._is_marked_high |= np.isposinf(readings).any(axis=0)
        return self._plateaus.tighten(self._make_marked_limits())

    def _make_marked_limits(self) -> ReadingLimits:
        """Return numbers just beyond the extremes of marked channels without a stated range."""
        has_low = [math.isfinite(channel.low_V) for channel in self.channels]
        has_high = [math.isfinite(channel.high_V) for channel in self.channels]
        is_low = self._is_marked_low & ~np.array(has_low) & np.isfinite(self._extremes.low)
        is_high = self._is_marked_high & ~np.array(has_high) & np.isfinite(self._extremes.high)
        below = np.nextafter(self._extremes.low, -math.inf)
        above = np.nextafter(self._extremes.high, math.inf)
        return ReadingLimits(np.where(is_low, below, -math.inf), np.where(is_high, above, math.inf))


class _Extreme(NamedTuple):
    """Largest reading of one channel, and how probable it is by chance."""

    value: float  #: The largest reading above the offset in V.
    repeats: int  #: Number of readings that have this value.
    chance: float  #: Probability of this number by chance.
    spacing: float  #: Mean spacing of the other readings next to the extreme in V.


def _mark_plateaus(heights: Array) -> Mask:
    """Mark the channels whose largest readings are clipped.

    Parameters
    ----------
    heights : ndarray, shape (n, channels)
        Readings above the offset in V, without repeated rows; NaN where missing.

    Returns
    -------
    ndarray of bool, shape (channels,)
    """
    extremes = [_measure_extreme(column[np.isfinite(column)]) for column in heights.T]
    is_clipped = np.zeros(len(extremes), dtype=bool)
    for extreme in extremes:
        tolerance = EQUAL_EXTREMES * extreme.value
        group = []
        for index, other in enumerate(extremes):
            if other.repeats and abs(other.value - extreme.value) <= tolerance:
                group.append(index)
        if extreme.repeats < 2:
            continue
        chance = extreme.chance
        for index in group:
            if extremes[index] is not extreme:
                shared = 2.0 * tolerance / extremes[index].spacing
                chance *= extremes[index].chance * min(shared, 1.0)
        if chance < MAX_CHANCE:
            is_clipped[group] = True
    return is_clipped


def _measure_extreme(heights: Array) -> _Extreme:
    """Measure how often the largest reading of a channel occurs, and how probable that is.

    Parameters
    ----------
    heights : ndarray, shape (n,)
        Readings above the offset in V.

    Returns
    -------
    _Extreme
        Its `repeats` is 0 if there are too few other readings, or none above the offset.
    """
    value = heights.max(initial=0.0)
    others = np.sort(heights[heights < value])[-MAX_OTHERS:]
    round_off = 1e-9 * np.abs(heights).max(initial=0.0)
    if value <= round_off or len(others) < MIN_OTHERS:
        return _Extreme(0.0, repeats=0, chance=1.0, spacing=1.0)
    distinct = np.unique(others)
    repeats = int((heights == value).sum())
    spacing = 2.0 * float(value - np.median(others)) / len(others)
    step = _estimate_step(np.append(distinct, value))
    tied = 1.0 - len(distinct) / len(others)
    chance = min(max(step / spacing, tied), 1.0) ** (repeats - 1)
    return _Extreme(float(value), repeats, chance, spacing)


def _estimate_step(values: Array) -> float:
    """Estimate the step of a channel's readings, by rounded digits or the codes of a converter.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Distinct readings in ascending order.

    Returns
    -------
    float
        The largest step of which all differences are multiples, but at least `FINEST_STEP` of the
        smallest difference.
    """
    smallest = float(np.diff(values).min())
    steps = smallest / np.arange(1, round(1.0 / FINEST_STEP) + 1)
    with np.errstate(over="ignore", invalid="ignore"):  # readings may be as large as 1e300
        multiples = (values - values[0]) / steps[:, None]
        is_multiple = (np.abs(multiples - np.rint(multiples)) < 0.1).all(axis=1)
    return float(steps[is_multiple.argmax()]) if is_multiple.any() else float(steps[-1])
