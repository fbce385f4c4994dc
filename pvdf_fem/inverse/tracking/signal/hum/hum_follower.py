"""Finding mains hum in blocks of samples, and following it from block to block."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import Enum, auto

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.signal.hum.harmonic_windows import (
    CombinedPhasors,
    WindowFits,
    WindowPlan,
    combine_windows,
    square_abs,
)
from pvdf_fem.inverse.tracking.signal.hum.hum_search import (
    MIN_AGREEING_FRACTION,
    HumSearch,
    bound_variance,
    compute_significance,
    estimate_noise_variance,
    fit_block,
    search_hum,
)
from pvdf_fem.inverse.tracking.signal.hum.mains_oscillator import MainsOscillator, OscillatorDrift

#: Factors by which the variance of the noise falls and grows at most from block to block.
VARIANCE_FALL = 0.8
VARIANCE_GROWTH = 1.1

#: Logarithm of the largest ratio of the variances of the residuals at the frequency of the hum and
#: at another nominal frequency.
MAX_LOG_RATIO = 0.7


@dataclass(frozen=True)
class MainsHumOptions:
    """Options to find and follow hum."""

    harmonic_count: int = 10  #: Largest multiple of the mains frequency that is subtracted.
    block_s: float = 0.24  #: Duration of the data from which the hum is updated at a time.
    #: Significance (see `compute_significance`) from which a block contains hum.
    min_significance: float = 10.0
    #: Squared amplitude of an electrode's harmonic, relative to its expectation from the variance,
    #: from which it is subtracted; half of it is enough to go on.
    min_phasor_significance: float = 9.0
    #: Fraction of the windows of a learned block that must agree, to subtract hum at once.
    min_quiet_fraction: float = 0.7
    #: Number of further blocks that must agree with hum before it is subtracted, otherwise.
    confirming_blocks: int = 3
    #: Largest change of the phasors, relative to their absolute values, in such a block.
    max_change: float = 0.3
    #: Number of blocks after which unconfirmed or insignificant hum is given up.
    patience_blocks: int = 20
    #: While there is no hum, one of so many blocks is searched for it.
    blocks_per_search: int = 3
    #: Voltages beyond this limit in V count as missing.
    max_voltage_V: float = 1e4
    drift: OscillatorDrift = field(default_factory=OscillatorDrift)


class HumState(Enum):
    """State of the search for hum."""

    UNKNOWN = auto()  #: The sampling rate is not known, or too low.
    ABSENT = auto()  #: No hum was found yet.
    UNCONFIRMED = auto()  #: A block contained hum, but it may have been a touch.
    PRESENT = auto()  #: There is hum.


class HumFollower:
    """Hum at one of several nominal frequencies, estimated from successive blocks of samples.

    Parameters
    ----------
    candidates_Hz : sequence of float
        Nominal frequencies.
    channel_count : int
        Number of channels.
    options : MainsHumOptions
        Options to find and follow the hum.

    Attributes
    ----------
    state : HumState
        State of the search for hum.
    oscillator : MainsOscillator or None
        The hum, unless it is unknown or absent.
    is_significant : ndarray, shape (harmonics, electrodes)
        The harmonics that are significant.
    """

    def __init__(
        self, candidates_Hz: Sequence[float], channel_count: int, options: MainsHumOptions
    ) -> None:
        self._candidates_Hz = candidates_Hz
        self._channel_count = channel_count
        self._options = options
        self._plans: list[WindowPlan] = []
        self._plan_index = 0
        self._noise_variance = np.zeros(channel_count)
        self._block_count = 0
        self._confirmed_blocks = 0
        self._idle_blocks = 0
        self._is_search_due = False
        self.state = HumState.UNKNOWN
        self.oscillator: MainsOscillator | None = None
        self.is_significant = np.zeros((0, channel_count), dtype=bool)

    @property
    def plan(self) -> WindowPlan | None:
        """Harmonics and windows at the present sampling rate; None if there are none."""
        return self._plans[self._plan_index] if self._plans else None

    @property
    def block_samples(self) -> int:
        """Number of samples of the next block."""
        if self.oscillator is None:
            return max((plan.block_samples for plan in self._plans), default=0)
        return self._plans[self._plan_index].block_samples

    def learn(self, times_s: Array, voltages: Array) -> None:
        """Decide from a block of samples whether there is hum; earlier findings are forgotten.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Increasing times of the samples.
        voltages : ndarray, shape (n, electrodes)
            Voltages in V, NaN where they are missing.
        """
        options = self._options
        rate_Hz = 1.0 / float(np.median(np.diff(times_s)))
        self._plan_index = 0
        self._plans = []
        for nominal_Hz in self._candidates_Hz:
            plan = WindowPlan.from_rate(
                nominal_Hz,
                rate_Hz,
                harmonic_count=options.harmonic_count,
                block_s=options.block_s,
            )
            if len(plan.harmonics):
                self._plans.append(plan)
        self._give_up()
        if not self._plans:
            self.state = HumState.UNKNOWN
            return
        search = self._start_best(times_s, voltages)
        if self.oscillator and search.agreeing_fraction >= options.min_quiet_fraction:
            self.state = HumState.PRESENT

    def add_block(self, times_s: Array, voltages: Array) -> None:
        """Update the hum with a block, or search the block for hum.

        Parameters
        ----------
        times_s : ndarray, shape (block_samples,)
            Times of the samples, without a pause.
        voltages : ndarray, shape (block_samples, electrodes)
            Voltages in V, NaN where they are missing.
        """
        if self.oscillator is not None:
            self._follow(self.oscillator, times_s, voltages)
            return
        if self._is_search_due:
            self._is_search_due = False
            self._start_best(times_s, voltages)
            return
        self._block_count += 1
        search_count, is_skipped = divmod(self._block_count, self._options.blocks_per_search)
        if not is_skipped:
            plan = self._plans[search_count % len(self._plans)]
            search = self._search(plan, times_s, voltages)
            if search.significance >= self._options.min_significance:
                self._start_best(times_s, voltages)

    def handle_pause(self, step_s: float) -> None:
        """Prepare for samples after a pause, or after a step of the clock that is not positive."""
        if self.oscillator is None:
            return
        if step_s > 0.0:
            self.oscillator.accept_next_jump()
        else:
            self.oscillator.lose_phase()

    def _search(self, plan: WindowPlan, times_s: Array, voltages: Array) -> HumSearch:
        """Search a block for hum of the nominal frequency of a plan."""
        return search_hum(
            plan,
            times_s,
            voltages,
            drift=self._options.drift,
            min_significance=self._options.min_significance,
        )

    def _start_best(self, times_s: Array, voltages: Array) -> HumSearch:
        """Start to follow the most significant hum of all nominal frequencies in a block, if any.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Times of the samples.
        voltages : ndarray, shape (n, electrodes)
            Voltages in V, NaN where they are missing.
        """
        searches = [self._search(plan, times_s, voltages) for plan in self._plans]
        significances = [search.significance for search in searches]
        log_variances = [float(np.log(search.noise_variance).mean()) for search in searches]
        best = int(np.argmax(significances))
        search = searches[best]
        # Hum of 60 Hz that touches interrupt five times a second may seem to be of 50 Hz, but its
        # fits are worse than those of 60 Hz.
        is_poor = log_variances[best] > min(log_variances) + MAX_LOG_RATIO
        if search.significance >= self._options.min_significance and not is_poor:
            self._plan_index = best
            self._noise_variance = search.noise_variance
            self._confirmed_blocks = 0
            self._idle_blocks = 0
            self.state = HumState.UNCONFIRMED
            self.oscillator = search.oscillator
            self.is_significant = np.zeros(search.oscillator.phasors.shape, dtype=bool)
            self._select_phasors(search.oscillator)
        return search

    def _give_up(self) -> None:
        """Return to the state without hum."""
        self.state = HumState.ABSENT
        self.oscillator = None
        harmonic_count = len(self.plan.harmonics) if self.plan else 0
        self.is_significant = np.zeros((harmonic_count, self._channel_count), dtype=bool)

    def _follow(self, oscillator: MainsOscillator, times_s: Array, voltages: Array) -> None:
        """Update the hum with a block.

        Parameters
        ----------
        oscillator : MainsOscillator
            The hum.
        times_s : ndarray, shape (block_samples,)
            Times of the samples.
        voltages : ndarray, shape (block_samples, electrodes)
            Voltages in V, NaN where they are missing.
        """
        plan = self._plans[self._plan_index]
        fits = fit_block(oscillator, times_s, voltages, plan=plan)
        combined = combine_windows(fits, oscillator.phasors, self._noise_variance)
        change = oscillator.update(combined)
        self._update_noise(fits)
        self._select_phasors(oscillator)
        self._idle_blocks += 1
        if self.state is HumState.UNCONFIRMED:
            self._confirm(combined, change)
        elif self.is_significant.any():
            self._idle_blocks = 0
        if self._idle_blocks >= self._options.patience_blocks:
            self._give_up()

    def _confirm(self, combined: CombinedPhasors, change: float) -> None:
        """Count a block for or against hum that is not confirmed yet.

        Parameters
        ----------
        combined : CombinedPhasors
            Phasors of the block.
        change : float
            Their change from the prediction relative to their absolute values.
        """
        if combined.weights.mean(axis=0).max() < MIN_AGREEING_FRACTION:
            return  # A touch disturbs the block.
        is_hum = compute_significance(combined) >= self._options.min_significance
        if not is_hum or change > self._options.max_change:
            # If a touch in this block changed the phasors, the next block shows the hum again.
            self._give_up()
            self._is_search_due = True
            return
        self._confirmed_blocks += 1
        if self._confirmed_blocks >= self._options.confirming_blocks:
            self.state = HumState.PRESENT

    def _update_noise(self, fits: WindowFits) -> None:
        """Update the variance of the noise in bounded steps."""
        estimate = estimate_noise_variance(fits)
        is_known = np.isfinite(estimate)
        last = self._noise_variance
        bounded = np.clip(estimate, VARIANCE_FALL * last, VARIANCE_GROWTH * last)
        self._noise_variance = bound_variance(np.where(is_known, bounded, last))

    def _select_phasors(self, oscillator: MainsOscillator) -> None:
        """Select the significant phasors, with a hysteresis of a factor of two."""
        ratio = square_abs(oscillator.phasors) / (2.0 * oscillator.variance)
        threshold = self._options.min_phasor_significance
        self.is_significant = ratio > np.where(self.is_significant, 0.5 * threshold, threshold)
