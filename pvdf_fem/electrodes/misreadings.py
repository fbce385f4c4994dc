"""Common mistakes with readings, and their corrections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import Channel, list_units_pC

#: For up to this number of channels, all permutations are listed; for more, only pairwise swaps.
MAX_PERMUTED = 4
#: What to do about each kind of mistake.
ADVICE = {
    "swapped_channels": "correct the names of the columns",
    "wrong_sign": "give a negative readout.gain",
}


#: Units of most readings.
USUAL_UNITS = ("pC", "V")


def choose_usual_unit(units: Sequence[str]) -> str:
    """Return one of some units of the same size, of `USUAL_UNITS` if any is among them."""
    usual = [unit for unit in USUAL_UNITS if unit in units]
    return [*usual, *units][0]


@dataclass(frozen=True, eq=False)
class Misreading:
    """A mistake in readings: in wrong columns, in a wrong unit, or with a wrong sign."""

    kind: str  #: ``swapped_channels``, ``wrong_unit`` or ``wrong_sign``.
    text: str  #: The mistake in words.
    order: tuple[int, ...]  #: For each channel, the column that contains its readings.
    #: For each channel, the factor that corrects its readings, shape (channels,).
    factors: Array
    units: tuple[str, ...] = ()  #: Units of the same size that the readings may have, if wrong.

    @property
    def advice(self) -> str:
        """What to do about the mistake."""
        if self.units:
            return f"give --unit {choose_usual_unit(self.units)}"
        return ADVICE[self.kind]

    @property
    def swapped_count(self) -> int:
        """Number of channels whose readings are in the column of another channel."""
        return sum(channel != column for channel, column in enumerate(self.order))

    def correct(self, readings: Array) -> Array:
        """Return a copy of readings that is corrected for the mistake.

        Parameters
        ----------
        readings : ndarray, shape (..., channels)
            Readings with the mistake.

        Returns
        -------
        ndarray, shape (..., channels)
            In the order of the channels.
        """
        return np.asarray(readings[..., self.order] * self.factors)


def list_misreadings(channels: Sequence[Channel], unit: str) -> Iterator[Misreading]:
    """Yield possible mistakes in readings: swapped columns, then wrong units, then wrong signs.

    Parameters
    ----------
    channels : sequence of Channel
        The channels that made the readings.
    unit : str
        The unit that the readings are said to have, a key of `list_units_pC`.

    Yields
    ------
    Misreading
        A single mistake; mistakes are not combined. The wrong sign is that of all channels, then
        that of each channel alone.
    """
    names = [channel.name for channel in channels]
    same_order = tuple(range(len(channels)))
    ones = np.ones(len(channels))
    for order in _list_wrong_channel_orders(len(channels)):
        text = _describe_order(names, order)
        yield Misreading("swapped_channels", text, order=order, factors=ones)
    for units, ratio in list_unit_ratios(channels, unit):
        text = f"readings are in {' or '.join(units)}, not in {unit}"
        yield Misreading("wrong_unit", text, order=same_order, factors=ratio, units=tuple(units))
    yield Misreading("wrong_sign", "readings have the wrong sign", order=same_order, factors=-ones)
    for number, name in enumerate(names):
        text = f"channel {name} has the wrong sign"
        is_inverted = np.arange(len(names)) == number
        signs = np.where(is_inverted, -1.0, 1.0)
        yield Misreading("wrong_sign", text, order=same_order, factors=signs)


def _describe_order(names: Sequence[str], order: Sequence[int]) -> str:
    """Describe in words which channels are swapped, and for more than two also their columns."""
    swapped = []
    columns = []
    for channel, column in enumerate(order):
        if channel != column:
            swapped.append(names[channel])
            columns.append(names[column])
    text = f"channels {' and '.join(swapped)} are swapped"
    if len(swapped) > 2:
        text += f": they are in columns {', '.join(columns)}"
    return text


def list_unit_ratios(channels: Sequence[Channel], unit: str) -> Iterator[tuple[list[str], Array]]:
    """Yield the units whose size differs from that of a given unit, grouped by size.

    Yields
    ------
    names : list of str
        The units of this size. There may be several: on channels of 1000 pF, 1 V is 1 nC.
    ratio : ndarray, shape (channels,)
        This size divided by that of the given unit, on each channel.
    """
    units_pC = list_units_pC(channels)
    ratios = {name: size_pC / units_pC[unit] for name, size_pC in units_pC.items()}
    for name, ratio in ratios.items():
        equal_units = []
        for other, other_ratio in ratios.items():
            if np.allclose(other_ratio, ratio, atol=0.0):
                equal_units.append(other)
        is_first_of_size = name == equal_units[0]  # to yield every size once
        if is_first_of_size and unit not in equal_units:
            yield equal_units, ratio


def _list_wrong_channel_orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield wrong orders of channels: all of them, or swaps of two if there are many channels.

    The limit is `MAX_PERMUTED` channels.
    """
    if count <= MAX_PERMUTED:
        orders = permutations(range(count))
        next(orders)  # skip the correct order
        yield from orders
        return
    for first, second in combinations(range(count), 2):
        order = list(range(count))
        order[first] = second
        order[second] = first
        yield tuple(order)
