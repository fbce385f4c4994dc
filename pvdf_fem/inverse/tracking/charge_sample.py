"""The charges of a contact at one time, with the variances of their errors."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from pvdf_fem.arrays import Array, Mask


@dataclass(frozen=True, eq=False)
class ChargeSample:
    """Charges in pC that a contact has added at one time. Arrays are (electrodes,).

    Their errors have four independent parts: noise of this sample alone; a random walk since the
    onset, by noise in the integrated voltages; a drift of the baseline, which grows steadily; and
    the charge that sampling misses, which is a random walk along the direction of the charges.
    """

    #: Variance in pC² of the noise of a channel whose reading is missing.
    MISSING: ClassVar[float] = 1e12

    time_s: float
    charges_pC: Array
    noise_variance: Array  #: In pC².
    walk_variance: Array  #: In pC².
    drift_pC: Array  #: Standard deviation of the drift.
    sampling_variance: float  #: In pC², along the direction of the charges.

    @property
    def is_measured(self) -> Mask:
        """Which channels have a reading."""
        return self.noise_variance < self.MISSING

    @property
    def variance(self) -> Array:
        """Variances of the charges in pC², without the part that sampling misses."""
        return self.noise_variance + self.walk_variance + np.square(self.drift_pC)

    @property
    def direction(self) -> Array:
        """Unit vector along the charges; zero if there are none."""
        return self.charges_pC / max(float(np.linalg.norm(self.charges_pC)), math.ulp(0.0))

    @property
    def significance(self) -> float:
        """Size of the charges in standard deviations."""
        return float(np.linalg.norm(self.charges_pC / np.sqrt(self.variance)))
