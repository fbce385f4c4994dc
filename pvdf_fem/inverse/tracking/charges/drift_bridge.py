"""Correction of the charges of a contact by the charge that is left at its end."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples


class CorrectedCharges(NamedTuple):
    """Charges after the correction by their residual at the end; the drift is then zero."""

    charges_pC: Array  #: Shape (electrodes,), or (samples, electrodes) for several samples.
    walk_variance: Array  #: Variance in pC² of all errors but noise and sampling, as the charges.
    sampling_variance: Array  #: Variance in pC², shape () or (samples,).


@dataclass(frozen=True, eq=False)
class Bridge:
    """Correction of the charges of a contact by their residual at its end (Brownian bridge).

    Arrays have the shape (electrodes,).

    Notes
    -----
    The errors e(t) are normally distributed. Their covariance with the error at the end T,
    c(t) = cov(e(t), e(T)), is the sum of the random-walk variance at t, the product of the drifts
    at t and T, and the sampling variance at t. Conditional on e(T) = r, the error e(t) has the mean
    r c/v and the variance var(e(t)) - c²/v (Rasmussen and Williams, Gaussian Processes for Machine
    Learning, 2006, eq. A.6). The variance of the sampling error is kept as a scalar along the
    direction of the charges; for its correction, the projections of the other errors onto this
    direction count as noise.
    """

    #: Mean charges r in pC after the end. The true charges are zero there, so that r is the
    #: accumulated error.
    residual: Array
    total: Array  #: Variance v of the residual in pC².
    along: Array  #: Squared components of the direction of the charges.
    drift_pC: Array  #: Drift at the end.
    sampling_total: float  #: Variance in pC² of the sampling error and the others along it.

    def condition(self, samples: ChargeSample | BufferedSamples) -> CorrectedCharges:
        """Condition the errors of one or several samples on the residual.

        Parameters
        ----------
        samples : ChargeSample or BufferedSamples
            Samples of the contact.

        Returns
        -------
        CorrectedCharges
            Charges less the mean of their errors, and the remaining variances; in arrays with the
            shapes of those of the samples.
        """
        # The estimate may fall, so that an earlier one may be larger than that at the end.
        sampling_variance = np.minimum(samples.sampling_variance, self.sampling_total)
        sampling = np.multiply.outer(sampling_variance, self.along)
        covariance = samples.walk_variance + samples.drift_pC * self.drift_pC
        walk_variance = samples.walk_variance + np.square(samples.drift_pC)
        walk_variance = walk_variance - np.square(covariance) / self.total
        return CorrectedCharges(
            samples.charges_pC - self.residual * (covariance + sampling) / self.total,
            np.maximum(walk_variance, 0.0),
            sampling_variance * (1.0 - sampling_variance / self.sampling_total),
        )

    def correct_sample(self, sample: ChargeSample) -> ChargeSample:
        """Return a copy of a sample with the corrected charges and variances."""
        corrected = self.condition(sample)
        return replace(
            sample,
            charges_pC=corrected.charges_pC,
            walk_variance=corrected.walk_variance,
            drift_pC=np.zeros_like(sample.drift_pC),
            sampling_variance=float(corrected.sampling_variance),
        )


def compute_accumulated_variance(last: ChargeSample, direction: Array) -> Array:
    """Compute the variance of the errors that have accumulated until the last sample.

    Parameters
    ----------
    last : ChargeSample
        Last sample of a contact.
    direction : ndarray, shape (electrodes,)
        Unit vector along the charges, which is the direction of the sampling error.

    Returns
    -------
    ndarray, shape (electrodes,)
        Variances in pC².
    """
    sampling_variance = last.sampling_variance * np.square(direction)
    return last.walk_variance + np.square(last.drift_pC) + sampling_variance


def make_bridge(
    residual: Array, noise_variance: Array, *, last: ChargeSample, direction: Array
) -> Bridge:
    """Make the correction of charges by their residual at the end.

    Parameters
    ----------
    residual : ndarray, shape (electrodes,)
        Mean charges in pC after the end.
    noise_variance : ndarray, shape (electrodes,)
        Variance of the residual in pC² due to the noise of the samples.
    last : ChargeSample
        Last sample.
    direction : ndarray, shape (electrodes,)
        Unit vector along the largest charges.
    """
    total = compute_accumulated_variance(last, direction) + noise_variance
    along = np.square(direction)
    others = float(along @ (total - last.sampling_variance * along))
    return Bridge(
        residual,
        total,
        along=along,
        drift_pC=last.drift_pC,
        sampling_total=last.sampling_variance + others,
    )
