"""How a calibration proceeds, and what it takes for a mistake."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CalibrateOptions:
    """Numbers that decide when a fit has ended, and when touches do not fit."""

    #: Tolerance of the solves over the relative noise, and its finest and coarsest value.
    tolerance_share: float = 0.05
    finest: float = 1e-5
    coarsest: float = 1e-3
    #: Tolerance of the first solves, which lead to better parameters, and of those of rankings.
    first_tolerance: float = 2e-3
    max_rounds: int = 12  #: Rounds of solves.
    expected_rounds: int = 3  #: Rounds that the progress is told by.
    #: Change of readings between solves, over their deviations, that is small enough to end.
    settled: float = 0.02
    #: Largest step of a parameter between solves, over its prior's deviation.
    longest_step: float = 2.0
    longest_move: float = 4.0  #: Longest correction of a place, over its deviation.
    #: Probability with which a good touch is taken for a bad one, over all touches.
    false_outliers: float = 1e-3
    most_outliers: float = 0.2  #: Largest share of the touches that may be bad.
    unlikely: float = 1e-4  #: Probability of a chi-square that is no chance.
    #: Scatter over the noise that is still explained, beyond which parameters are of no use, and
    #: with which mistakes are sought after the first steps.
    scatter: float = 1.5
    most_scatter: float = 4.0
    far_off: float = 10.0
    far: float = 4.0  #: Deviations of a prior that a parameter may be off the scene's value.
    few_touches: int = 8  #: Touches by which changes of places and forces are ranked.
    most_fits: int = 3  #: Changes that are then fitted in full ...
    close_score: float = 5.0  #: ... if their score is no farther than this from the best one.
    #: Mistakes are told if their chi-square is no farther than this from the least one, and that of
    #: the touches as they are is larger by a factor.
    close: float = 20.0
    clearly: float = 2.0
    #: Readings this factor above or below the scene's are not due to a wrong frame.
    other_size: float = 3.0


DEFAULTS = CalibrateOptions()
