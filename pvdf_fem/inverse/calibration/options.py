"""Options of a calibration: criteria of convergence, of outliers and of the diagnosis."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrateOptions:
    """Thresholds of a calibration."""

    #: Tolerance of the solves as a fraction of the relative noise `sigma`, between the two bounds
    #: `min_tolerance` and `max_tolerance`.
    tolerance_fraction: float = 0.05
    min_tolerance: float = 1e-5
    max_tolerance: float = 1e-3
    #: Tolerance of the first solves, which only improve the initial guess, and of the solves that
    #: rank corrections.
    first_tolerance: float = 2e-3
    max_rounds: int = 12  #: Maximum number of rounds; each solves the touches that have changed.
    expected_rounds: int = 3  #: Number of rounds from which the progress estimates the solves.
    #: The fit has converged when the error of linearising the stress integrals about the last
    #: solves is below this, as a fraction of the standard deviation of the readings.
    step_error_tolerance: float = 0.02
    #: Longest step of a parameter between solves, in standard deviations of its prior.
    longest_step: float = 2.0
    #: Longest correction of a position, in standard deviations of the positions.
    longest_correction: float = 4.0

    #: Probability that any good touch of a calibration is rejected as an outlier.
    false_outlier_probability: float = 1e-3
    max_outlier_fraction: float = 0.2  #: Maximum fraction of the touches that may be outliers.
    #: The residuals are significantly larger than the noise if the p-value is below this.
    min_p_value: float = 1e-4
    #: Limits of the scatter (`CalibrationFit.scatter`): a correction may explain the touches up to
    #: `plausible_scatter`; the parameters are useless above `max_scatter`; and a fit is abandoned
    #: in favour of corrections if its first solves leave more than `hopeless_scatter`.
    plausible_scatter: float = 1.5
    max_scatter: float = 4.0
    hopeless_scatter: float = 10.0
    #: Maximum distance of a parameter from the scene's value, in standard deviations of its prior.
    max_pull: float = 4.0
    #: Maximum distance of a clipped reading's prediction from its limit, on the wrong side, in
    #: standard deviations.
    max_limit_pull: float = 5.0

    #: Number of touches that are solved to rank corrections of positions and forces.
    ranking_touches: int = 8
    #: Maximum number of corrections that are fitted.
    max_fits: int = 3
    #: Corrections are fitted only if their score is close to the best one within this margin.
    score_margin: float = 5.0
    #: A correction is reported only if its chi-square exceeds the best one by less than this.
    chi_square_margin: float = 20.0
    #: A correction explains the touches only if the chi-square of the uncorrected touches is larger
    #: than its own by this factor. If the p-value of the uncorrected touches is above
    #: `min_p_value`, the factor is ignored.
    min_improvement: float = 2.0
    #: If the readings are larger or smaller than predicted by more than this factor, wrong units of
    #: the force are considered instead of wrong frames.
    max_size_ratio: float = 3.0


DEFAULTS = CalibrateOptions()
