"""Advice on touches of a stream that could not be located."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.electrodes.misreadings import Misreading, list_misreadings
from pvdf_fem.inverse.tracking.charges.charge_sample import ChargeSample
from pvdf_fem.inverse.tracking.problem.contact_problem import ContactProblem

#: Number of touches that are tested for mistakes in their readings.
MAX_TESTED = 4
#: A mistake is named if it explains at least this fraction of them.
MIN_EXPLAINED_FRACTION = 0.75


def find_misreading(
    problem: ContactProblem,
    channels: Sequence[Channel],
    peaks: Sequence[ChargeSample],
    unit: str,
) -> Misreading | None:
    """Find a mistake in the readings that explains why touches could not be located.

    Parameters
    ----------
    problem : ContactProblem
        Template of the contact problems.
    channels : sequence of Channel
        Channels that made the readings.
    peaks : sequence of ChargeSample
        Charges at the peaks of touches that were not located or not explained.
    unit : str
        Unit that the readings were taken to have.

    Returns
    -------
    Misreading or None
        The mistake whose correction lets most of the touches be explained by forces within the
        range of the response, the simplest one of several; None if there is none.
    """
    tested = peaks[:MAX_TESTED]
    needed = max(MIN_EXPLAINED_FRACTION * len(tested), 1.0)
    best = None
    best_count = 0
    for misreading in list_misreadings(channels, unit):
        count = 0
        for peak in tested:
            corrected = correct_sample(peak, misreading, channels)
            count += _is_explained(problem, corrected)
        if count >= needed and count > best_count:
            best = misreading
            best_count = count
    return best


def correct_sample(
    sample: ChargeSample, misreading: Misreading, channels: Sequence[Channel]
) -> ChargeSample:
    """Return a copy of a sample whose charges are corrected for a mistake in the readings.

    Parameters
    ----------
    sample : ChargeSample
        Charges that were computed from the readings with the mistake.
    misreading : Misreading
        The mistake.
    channels : sequence of Channel
        Channels that made the readings.
    """
    charge_per_volt = np.array([channel.capacitance / channel.gain for channel in channels])
    readings = sample.charges_pC / charge_per_volt
    deviations = np.sqrt(sample.variance) / charge_per_volt
    noise_variance = np.square(misreading.correct(deviations) * charge_per_volt)
    is_measured = sample.is_measured[list(misreading.order)]
    zeros = np.zeros_like(readings)
    return replace(
        sample,
        charges_pC=misreading.correct(readings) * charge_per_volt,
        noise_variance=np.where(is_measured, noise_variance, ChargeSample.MISSING),
        walk_variance=zeros,
        drift_pC=zeros,
        sampling_variance=0.0,
    )


def _is_explained(problem: ContactProblem, sample: ChargeSample) -> bool:
    """Return whether a touch with a force within the range of the response explains charges."""
    candidates = problem.locate(sample)
    if candidates is None or not candidates.is_explained:
        return False
    log_force = candidates.likeliest[-1]
    lowest, highest = problem.response.domain.log_force
    return bool(lowest <= log_force <= highest)
