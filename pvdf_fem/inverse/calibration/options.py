"""Options of a calibration: when the fit has converged, and when touches do not fit."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrateOptions:
    """Thresholds of a calibration."""

    #: Tolerance of the solves over the relative noise, and its least and largest value.
    tolerance_share: float = 0.05
    min_tolerance: float = 1e-5
    max_tolerance: float = 1e-3
    #: Tolerance of the first solves, which only lead to better parameters, and of solves by which
    #: corrections are ranked.
    first_tolerance: float = 2e-3
    max_rounds: int = 12  #: Largest number of rounds, in each of which touches are solved anew.
    expected_rounds: int = 3  #: Number of rounds that the progress expects.
    #: The fit has converged when the error of the linear step between solves is below this, over
    #: the standard deviation of the readings.
    step_error_tolerance: float = 0.02
    #: Longest step of a parameter between solves, over the standard deviation of its prior.
    longest_step: float = 2.0
    #: Longest correction of a place, over its standard deviation.
    longest_correction: float = 4.0

    #: Probability that one of the good touches is rejected as an outlier.
    false_outlier_probability: float = 1e-3
    max_outlier_share: float = 0.2  #: Largest share of the touches that may be outliers.
    min_p_value: float = 1e-4  #: A p-value below this is no chance: the model does not fit.
    #: Scatter over the noise: up to this it is plausible, above the second value parameters are of
    #: no use, and above the third one corrections are tried after the first solves.
    plausible_scatter: float = 1.5
    max_scatter: float = 4.0
    hopeless_scatter: float = 10.0
    #: Largest distance of a parameter from the scene's value, in standard deviations of its prior.
    max_pull: float = 4.0

    ranking_touches: int = 8  #: Touches that are solved to rank corrections of places and forces.
    max_fits: int = 3  #: Number of corrections that are fitted in full ...
    score_margin: float = 5.0  #: ... if their score is no farther than this from the best one.
    #: A correction is reported if its chi-square is no farther than this from the best one, and
    #: that of the uncorrected touches is larger by a factor.
    chi_square_margin: float = 20.0
    min_improvement: float = 2.0
    #: Readings that are larger or smaller than the scene's by this factor are not due to a wrong
    #: frame.
    max_size_ratio: float = 3.0


DEFAULTS = CalibrateOptions()
