"""Common mistakes with readings, and their corrections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import Channel, list_units_pC


@dataclass(frozen=True, eq=False)
class Misreading:
    """A mistake: readings in wrong columns, in a wrong unit, or with a wrong sign."""

    kind: str  #: ``swapped_channels``, ``wrong_unit``, ``wrong_sign``.
    text: str
    order: tuple[int, ...]  #: The column of each channel.
    factors: Array  #: Of the right readings over those given, (channels,).

    @property
    def exchanged(self) -> int:
        """Number of channels in a wrong column."""
        return sum(i != j for i, j in enumerate(self.order))

    def undone(self, readings: Array) -> Array:
        """The right readings (..., channels)."""
        return np.asarray(readings[..., self.order] * self.factors)


def list_misreadings(channels: Sequence[Channel], unit: str) -> Iterator[Misreading]:
    """Possible mistakes in readings from channels in a unit from `list_units_pC`."""
    names, straight, ones = (
        [c.name for c in channels],
        tuple(range(len(channels))),
        np.ones(len(channels)),
    )
    for order in _orders(len(names)):
        moved = [(names[i], names[j]) for i, j in enumerate(order) if i != j]
        text = f"channels {' and '.join(name for name, _ in moved)} are swapped"
        if len(moved) > 2:
            text += f": they are in columns {', '.join(column for _, column in moved)}"
        yield Misreading("swapped_channels", text, order, ones)
    units = list_units_pC(channels)
    ratios = {other: factor / units[unit] for other, factor in units.items()}
    for other, ratio in ratios.items():
        alike = [name for name, of in ratios.items() if np.allclose(of, ratio, atol=0.0)]
        if other == alike[0] and unit not in alike:  # 1 V on 1000 pF is 1 nC
            text = f"readings are in {' or '.join(alike)}, not in {unit}"
            yield Misreading("wrong_unit", text, straight, ratio)
    yield Misreading("wrong_sign", "readings have the wrong sign", straight, -ones)
    for j, name in enumerate(names):
        text = f"channel {name} has the wrong sign"
        yield Misreading(
            "wrong_sign", text, straight, np.where(np.arange(len(names)) == j, -1.0, 1.0)
        )


def _orders(count: int, most_permuted: int = 4) -> Iterator[tuple[int, ...]]:
    """Permutations for up to `most_permuted` channels, and exchanges of two for more channels."""
    if count <= most_permuted:
        yield from list(permutations(range(count)))[1:]
        return
    for a, b in combinations(range(count), 2):
        order = list(range(count))
        order[a], order[b] = b, a
        yield tuple(order)
