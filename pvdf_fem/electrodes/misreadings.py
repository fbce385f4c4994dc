"""Common mistakes with readings, and their corrections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import Channel, list_units_pC

#: Maximum number of channels of which all permutations are tried.
MAX_PERMUTED = 4


@dataclass(frozen=True, eq=False)
class Misreading:
    """A mistake: readings in wrong columns, in a wrong unit, or with a wrong sign."""

    kind: str  #: ``swapped_channels``, ``wrong_unit`` or ``wrong_sign``.
    text: str  #: The mistake in words.
    order: tuple[int, ...]  #: The column of each channel.
    factors: Array  #: Factors on the readings that correct them, shape (channels,).

    @property
    def swapped_count(self) -> int:
        """Number of channels in a wrong column."""
        return sum(channel != column for channel, column in enumerate(self.order))

    def correct(self, readings: Array) -> Array:
        """Return the readings that would have been recorded without the mistake.

        Parameters
        ----------
        readings : ndarray, shape (..., channels)
            Readings with the mistake.

        Returns
        -------
        ndarray, shape (..., channels)
        """
        return np.asarray(readings[..., self.order] * self.factors)


def list_misreadings(channels: Sequence[Channel], unit: str) -> Iterator[Misreading]:
    """List possible mistakes in readings: swapped columns, then wrong units, then wrong signs.

    Parameters
    ----------
    channels : sequence of Channel
        Channels of the readings.
    unit : str
        The unit of the readings, one of `list_units_pC`.

    Yields
    ------
    Misreading
    """
    names = [channel.name for channel in channels]
    same_order = tuple(range(len(channels)))
    ones = np.ones(len(channels))
    for order in _list_orders(len(channels)):
        text = _describe_order(names, order)
        yield Misreading("swapped_channels", text, order=order, factors=ones)
    for units, ratio in _list_unit_ratios(channels, unit):
        text = f"readings are in {' or '.join(units)}, not in {unit}"
        yield Misreading("wrong_unit", text, order=same_order, factors=ratio)
    yield Misreading("wrong_sign", "readings have the wrong sign", order=same_order, factors=-ones)
    for number, name in enumerate(names):
        text = f"channel {name} has the wrong sign"
        is_inverted = np.arange(len(names)) == number
        signs = np.where(is_inverted, -1.0, 1.0)
        yield Misreading("wrong_sign", text, order=same_order, factors=signs)


def _describe_order(names: Sequence[str], order: Sequence[int]) -> str:
    """Describe in words which channels are swapped, and for more than two the columns."""
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


def _list_unit_ratios(channels: Sequence[Channel], unit: str) -> Iterator[tuple[list[str], Array]]:
    """Yield groups of other units of equal size, with their ratio to the given unit."""
    units = list_units_pC(channels)
    ratios = {other: size / units[unit] for other, size in units.items()}
    for other, ratio in ratios.items():
        # units may have equal size: 1 V on 1000 pF is 1 nC
        equal = [name for name, size in ratios.items() if np.allclose(size, ratio, atol=0.0)]
        if other == equal[0] and unit not in equal:
            yield equal, ratio


def _list_orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield all permutations of few channels, and all swaps of two among many."""
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
