"""The charges of a contact at one instant, with the variances of their errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Mask


@dataclass(frozen=True, eq=False)
class ChargeSample:
    """Charges that a contact has generated until one instant, in arrays of shape (electrodes,).

    The errors of the charges have four independent contributions: the noise of this sample; a
    random walk since the onset, due to the noise of the integrated voltages; a drift, due to the
    error of the baseline, which grows linearly; and the sampling error, that is the charge missed
    between samples, a random walk along the direction of the charges.
    """

    #: Noise variance in pC² that stands for a missing reading.
    MISSING: ClassVar[float] = 1e18
    #: Readings with a larger variance are missing. Means of missing readings have a smaller
    #: variance than each of them.
    MAX_VARIANCE: ClassVar[float] = 1e12

    time_s: float
    charges_pC: Array
    noise_variance: Array  #: Variance in pC² of the noise of this sample.
    walk_variance: Array  #: Variance in pC² of the random walk.
    drift_pC: Array  #: Standard deviation of the drift.
    sampling_variance: float  #: Variance in pC² along the direction of the charges.
    #: Whether the channel was clipped, so that its charge is only a limit of the true one.
    is_clipped: Mask

    @property
    def is_measured(self) -> Mask:
        """Mask of the channels that have a reading."""
        return self.noise_variance < self.MAX_VARIANCE

    @property
    def variance(self) -> Array:
        """Variances of the charges in pC², without the sampling error."""
        return self.noise_variance + self.walk_variance + np.square(self.drift_pC)

    @property
    def size_pC(self) -> float:
        """Norm of the charges."""
        return math.hypot(*self.charges_pC.tolist())

    @property
    def direction(self) -> Array:
        """Unit vector along the charges; the zero vector if all charges are zero."""
        return self.charges_pC / max(self.size_pC, math.ulp(0.0))

    @property
    def significance(self) -> float:
        """Norm of the charges, each divided by its standard deviation without sampling error."""
        return float(np.linalg.norm(self.charges_pC / np.sqrt(self.variance)))

    def has_same_charges(self, other: ChargeSample) -> bool:
        """Whether another sample has the same charges with the same noise at the same time."""
        return (
            self.time_s == other.time_s
            and np.array_equal(self.charges_pC, other.charges_pC)
            and np.array_equal(self.noise_variance, other.noise_variance)
        )

    def without_channel(self, number: int) -> ChargeSample:
        """Return a copy in which the charge of an electrode is missing."""
        is_excluded = np.arange(len(self.charges_pC)) == number
        return replace(
            self,
            charges_pC=np.where(is_excluded, 0.0, self.charges_pC),
            noise_variance=np.where(is_excluded, self.MISSING, self.noise_variance),
        )


class ChargeValues(NamedTuple):
    """Quantities of a `ChargeSample` as plain numbers, by electrode.

    A stream has one for each row, of few electrodes: arithmetic with floats takes a fraction of the
    time of that with arrays.
    """

    time_s: float
    charges_pC: list[float]
    noise_variance: list[float]
    walk_variance: list[float]
    drift_pC: Sequence[float]
    sampling_variance: float
    is_clipped: Sequence[bool]

    @property
    def size_pC(self) -> float:
        """Norm of the charges."""
        return math.hypot(*self.charges_pC)

    def to_sample(self) -> ChargeSample:
        """Return the same quantities in arrays."""
        arrays = np.array([self.charges_pC, self.noise_variance, self.walk_variance, self.drift_pC])
        return ChargeSample(
            self.time_s,
            arrays[0],
            noise_variance=arrays[1],
            walk_variance=arrays[2],
            drift_pC=arrays[3],
            sampling_variance=self.sampling_variance,
            is_clipped=np.array(self.is_clipped),
        )
