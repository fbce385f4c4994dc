"""Options of the tracker: thresholds to detect, locate and end contacts."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class TrackOptions:
    """Thresholds and durations of the tracker."""

    #: Memory of the baseline filter. A drift that is faster is detected as a contact.
    memory_s: float = 1.0
    min_memory_samples: int = 100  #: Lower bound of this memory in samples, for slow sampling.
    #: Longest window of the contact detector, as a fraction of the number of samples from which the
    #: baseline was learned.
    window_fraction: float = 0.25
    #: Bound on the probability of a false alarm per sample, divided equally among the windows.
    false_alarm_probability: float = 1e-7
    min_noise_V: float = 1e-7  #: Lower bound of the estimated standard deviation of a voltage.

    #: Minimum number of samples of a contact before it is located.
    min_location_samples: int = 6
    #: Minimum norm of the charges, in standard deviations, before a contact is located.
    min_significance: float = 15.0
    #: Relative growth of the number of samples after which a contact is located again.
    relocation_growth: float = 0.5
    #: The same relative growth while all locations have failed.
    retry_growth: float = 0.1
    #: Fraction of the sampling error that is not along the direction of the charges.
    sampling_skew: float = 0.2
    #: Distances, in the logarithm of the force, by which the response is extrapolated to smaller
    #: and to larger forces.
    log_margin_below: float = 7.0
    log_margin_above: float = 2.0

    #: A contact has ended when the mean charges of its last n samples equal those of the n samples
    #: before. The number n is at least `min_still_samples`, and this fraction of all samples.
    min_still_samples: int = 4
    still_fraction: float = 1.0 / 16.0
    #: Residual charge, as a fraction of the largest charges, with which a contact has ended: the
    #: tolerances of resistances and capacitances leave as much.
    negligible_residual_fraction: float = 0.01
    #: Change between two series of samples, as a fraction of the largest charges, with which such a
    #: contact has ended: a drift of the baseline goes on changing the charges.
    negligible_change_fraction: float = 0.0025
    #: Residual charge, as a fraction of the largest charges, with which a contact may also end if
    #: four times as many samples are constant.
    max_residual_fraction: float = 0.1
    #: Number of samples after which a contact may end though its charges never exceeded the noise.
    patience_samples: int = 100
    #: A channel is frozen and not clipped if the charges of the others are a smaller fraction of
    #: the largest ones.
    max_clipped_fraction: float = 0.3
    #: A channel has stepped if only its charge is left at the end: more than this number of
    #: standard deviations and this fraction of the largest charges. Those of the others are
    #: negligible, or within three deviations.
    min_step_deviations: float = 20.0
    min_step_fraction: float = 0.05
    #: A contact is lost if all readings are missing for longer than this time, and than this
    #: fraction of its duration so far.
    max_pause_s: float = 0.25
    max_pause_fraction: float = 0.25
    #: A contact that is longer than `memory_s` is lost when the standard deviation of its charges
    #: exceeds this fraction of the largest charges.
    max_relative_error: float = 0.3


DEFAULTS = TrackOptions()
