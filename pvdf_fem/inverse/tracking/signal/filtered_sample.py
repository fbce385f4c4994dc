"""Samples of the voltages of all channels, in which missing and clipped ones are marked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from pvdf_fem.inverse.tracking.signal.baseline import SettledBaseline


class FilteredSample(NamedTuple):
    """Voltages of all channels at one instant; a list has an entry for each channel."""

    time_s: float
    voltages: list[float]  #: In V; NaN where they are missing.
    is_clipped: list[bool]  #: Whether the voltage is only a limit of the true one.
    follows_pause: bool = False  #: Whether readings or times were missing before this sample.
    #: Number of samples just before this one that were clipped though not marked so, by channel;
    #: empty if there are none.
    clipped_before: Sequence[int] = ()

    def remove_voltage(self, number: int) -> None:
        """Mark the voltage of a channel as missing."""
        self.voltages[number] = math.nan
        self.is_clipped[number] = False

    @property
    def has_no_reading(self) -> bool:
        """Whether all voltages are missing."""
        first = self.voltages[0]
        if first == first:  # not NaN
            return False
        return all(map(math.isnan, self.voltages))


@dataclass(frozen=True, eq=False)
class SettledSamples:
    """Baseline of the first samples, and the samples after them."""

    baseline: SettledBaseline
    sample_count: int  #: Number of samples that the baseline was learned from.
    spike_counts: list[int]  #: Number of readings that were spikes, by channel.
    is_at_limit: list[bool]  #: Whether a channel lies at the end of its range.
    #: The last samples, without hum, which may already belong to a contact.
    pending: list[FilteredSample]
