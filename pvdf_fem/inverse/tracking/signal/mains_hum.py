"""Mains hum, estimated and subtracted sample by sample."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.tracking.signal.hum.harmonic_windows import Phasors, square_abs
from pvdf_fem.inverse.tracking.signal.hum.hum_follower import (
    HumFollower,
    HumState,
    MainsHumOptions,
)

AUTO = "auto"
#: Frequencies in Hz that ``auto`` looks for.
MAINS_FREQUENCIES_HZ = (50.0, 60.0)

#: Longest step of time, in windows, that is neither a pause nor a step of the clock.
MAX_STEP_WINDOWS = 0.5
#: Relative change of the sampling rate from which everything is learned anew.
MAX_RATE_CHANGE = 0.2


class MainsHum:
    """Mains hum of all channels, which is estimated and subtracted sample by sample.

    Parameters
    ----------
    mains_Hz : float or "auto"
        Nominal frequency of the mains; 0 switches the subtraction off, ``auto`` looks for 50 and
        60 Hz.
    channel_count : int
        Number of channels.
    options : MainsHumOptions, optional
        Options to find and follow the hum.
    names : sequence of str, optional
        Names of the channels for `notes`. Default: their numbers from 1.

    Attributes
    ----------
    notes : list of str
        Findings to be shown to the user; each of them occurs once.

    Raises
    ------
    ValueError
        If `mains_Hz` is negative, not finite, or another word than ``auto``.

    Notes
    -----
    `subtract` has no latency and is not a filter: it subtracts sines whose phasors were estimated
    from earlier blocks. A touch is therefore only distorted by the errors of these phasors.

    Nothing is subtracted before `learn`.

    Examples
    --------
    >>> hum = MainsHum("auto", 4)
    >>> hum.learn(times_s[:250], voltages[:250])
    >>> for time_s, sample in zip(times_s[250:], voltages[250:]):
    ...     cleaned = hum.subtract(time_s, sample)
    """

    def __init__(
        self,
        mains_Hz: float | str,
        channel_count: int,
        options: MainsHumOptions | None = None,
        *,
        names: Sequence[str] | None = None,
    ) -> None:
        self.notes: list[str] = []
        self._options = options or MainsHumOptions()
        self._names = list(names or map(str, range(1, channel_count + 1)))
        self._noted_Hz = set[float]()
        self._candidates_Hz = list_candidates(mains_Hz)
        self._follower = HumFollower(self._candidates_Hz, channel_count, self._options)

        # Samples of the present block.
        self._times_s = np.zeros(0)
        self._voltages = np.zeros((0, channel_count))
        self._block_samples = 0
        self._count = 0
        self._last_time_s = math.nan
        self._max_step_s = math.inf

        # The hum that is subtracted at present; no rotations if there is none.
        self._rotations: Phasors | None = None
        self._phasors: Phasors = np.zeros((0, channel_count), dtype=complex)
        self._phase_rad = 0.0
        self._phase_time_s = 0.0
        self._angular_frequency = 0.0

    @property
    def is_learned(self) -> bool:
        """Whether `subtract` follows the hum, or looks for one that begins."""
        return self._block_samples > 0

    @property
    def is_active(self) -> bool:
        """Whether hum is being subtracted."""
        return self._rotations is not None

    @property
    def frequency_Hz(self) -> float:
        """Estimated frequency of the mains in Hz; NaN without hum."""
        oscillator = self._follower.oscillator
        if oscillator is None or self._follower.state is not HumState.PRESENT:
            return math.nan
        return oscillator.frequency_Hz

    @property
    def harmonics(self) -> Indices:
        """Multiples of the mains frequency that are looked for, shape (harmonics,)."""
        plan = self._follower.plan
        return plan.harmonics if plan else np.zeros(0, dtype=np.int64)

    @property
    def amplitudes_V(self) -> Array:
        """Amplitudes that are subtracted in V, shape (harmonics, electrodes)."""
        follower = self._follower
        if follower.oscillator is None or not self.is_active:
            return np.zeros(follower.is_significant.shape)
        return np.where(follower.is_significant, np.abs(follower.oscillator.phasors), 0.0)

    @property
    def residual_V(self) -> Array:
        """Estimated root mean square of the hum that is left in V, shape (electrodes,).

        It is due to the errors of frequency, phase and phasors at the end of a block, and to
        harmonics that are not subtracted because they are not significant. It is 0 without hum.
        """
        follower = self._follower
        oscillator = follower.oscillator
        if oscillator is None or follower.state is not HumState.PRESENT:
            return np.zeros(len(self._names))
        end_s = oscillator.time_s + self._options.block_s
        lost_fraction = 1.0 - np.square(oscillator.predict_mean_rotation(end_s))
        half_square = 0.5 * square_abs(oscillator.phasors)
        error = oscillator.variance + lost_fraction[:, None] * half_square
        left = np.where(follower.is_significant, error, half_square)
        return np.sqrt(left.sum(axis=0))

    def learn(self, times_s: Array, voltages: Array) -> None:
        """Decide from a block of samples whether there is hum, and start to subtract it.

        Earlier findings are forgotten. The next sample for `subtract` follows this block.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Times of the samples; rows that go back in time are ignored.
        voltages : ndarray, shape (n, electrodes)
            Voltages in V, NaN where they are missing. Half a second is enough for sampling rates
            of 80 Hz or more, a quarter from 200 Hz.
        """
        self._rotations = None
        self._block_samples = 0
        is_finite = np.isfinite(times_s)
        times = times_s[is_finite]
        values = voltages[is_finite]
        is_increasing = np.diff(np.maximum.accumulate(times), prepend=-math.inf) > 0.0
        times = times[is_increasing]
        values = self._mask_extremes(values[is_increasing])
        if len(times) < 2 or not self._candidates_Hz:
            return
        self._follower.learn(times, values)
        if self._follower.state is HumState.UNKNOWN:
            rate_Hz = 1.0 / float(np.median(np.diff(times)))
            self._note_low_rate(rate_Hz)
            return
        self._last_time_s = float(times[-1])
        self._start_block()
        self._prepare_subtraction(self._last_time_s)

    def subtract(self, time_s: float, voltages: Array) -> Array:
        """Subtract the hum from the next sample.

        Parameters
        ----------
        time_s : float
            Time of the sample. If it is not finite, nothing is subtracted.
        voltages : ndarray, shape (electrodes,)
            Voltages in V, NaN where they are missing.

        Returns
        -------
        ndarray, shape (electrodes,)
            Voltages in V; the same array if there is no hum.
        """
        if not self._block_samples or not math.isfinite(time_s):
            return voltages
        self._follow_time(time_s)
        cleaned = voltages
        if self._rotations is not None:
            phase = self._phase_rad + self._angular_frequency * (time_s - self._phase_time_s)
            cleaned = voltages - (np.exp(phase * self._rotations) @ self._phasors).real
        self._store(time_s, voltages)
        return cleaned

    def observe(self, time_s: float, voltages: Sequence[float]) -> None:
        """Look for hum in the next sample while there is none to subtract.

        Parameters
        ----------
        time_s : float
            Time of the sample.
        voltages : sequence of float
            Voltages in V, NaN where they are missing.
        """
        if self._block_samples and math.isfinite(time_s):
            self._follow_time(time_s)
            self._store(time_s, voltages)

    def _follow_time(self, time_s: float) -> None:
        """Drop the present block if its next sample comes after a pause or a step back."""
        step_s = time_s - self._last_time_s
        if not abs(step_s) <= self._max_step_s:
            self._skip_pause(time_s, step_s)
        self._last_time_s = time_s

    def _store(self, time_s: float, voltages: Sequence[float] | Array) -> None:
        """Store a sample in the present block, and finish the block if it is full."""
        count = self._count
        self._times_s[count] = time_s
        self._voltages[count] = voltages
        self._count = count + 1
        if self._count == self._block_samples:
            self._finish_block()

    def predict(self, times_s: Array) -> Array:
        """Predict the hum that is subtracted at some times, such as those of the learned block.

        Parameters
        ----------
        times_s : ndarray, shape (n,)
            Times within a fraction of a second of the last sample.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Hum in V; zero if none is subtracted.
        """
        if self._rotations is None:
            return np.zeros((len(times_s), len(self._names)))
        phase = self._phase_rad + self._angular_frequency * (times_s - self._phase_time_s)
        return (np.exp(phase[:, None] * self._rotations) @ self._phasors).real

    def _start_block(self) -> None:
        """Start a block of samples without any."""
        self._count = 0
        samples = self._follower.block_samples
        if samples == self._block_samples:
            return
        self._block_samples = samples
        self._times_s = np.zeros(samples)
        self._voltages = np.zeros((samples, len(self._names)))
        plan = self._follower.plan
        if plan:
            self._max_step_s = MAX_STEP_WINDOWS * plan.window_s

    def _finish_block(self) -> None:
        """Pass the block on, and subtract the hum that is known then from the next samples."""
        times = self._times_s
        values = self._mask_extremes(self._voltages)
        plan = self._follower.plan
        duration = times[-1] - times[0]
        expected = (len(times) - 1) / plan.rate_Hz if plan else duration
        if abs(duration - expected) > MAX_RATE_CHANGE * expected:
            self.learn(times, values)
            return
        self._follower.add_block(times, values)
        self._start_block()
        self._prepare_subtraction(times[-1])

    def _skip_pause(self, time_s: float, step_s: float) -> None:
        """Drop the present block, because of a pause or a step back before its next sample."""
        self._count = 0
        self._follower.handle_pause(step_s)
        self._prepare_subtraction(time_s)

    def _prepare_subtraction(self, time_s: float) -> None:
        """Prepare to subtract the present hum from the samples of the next block.

        Parameters
        ----------
        time_s : float
            Time of the last sample.

        Notes
        -----
        If the phase φ has the standard deviation σ, the expectation of exp(i h φ) is reduced by
        exp(-h²σ²/2). Hum with this amplitude leaves the least mean square.
        """
        oscillator = self._follower.oscillator
        is_used = self._follower.is_significant.any(axis=1)
        if oscillator is None or self._follower.state is not HumState.PRESENT or not is_used.any():
            self._rotations = None
            return
        mean_rotation = oscillator.predict_mean_rotation(time_s + self._options.block_s)
        factors = np.where(self._follower.is_significant, mean_rotation[:, None], 0.0)
        self._phasors = oscillator.phasors[is_used] * factors[is_used]
        self._rotations = np.multiply(1j, oscillator.harmonics[is_used], dtype=np.complex128)
        self._phase_rad = oscillator.phase_rad
        self._phase_time_s = oscillator.time_s
        self._angular_frequency = 2.0 * math.pi * oscillator.frequency_Hz
        self._note_hum()

    def _mask_extremes(self, voltages: Array) -> Array:
        """Return the voltages with NaN instead of infinite and extreme ones."""
        is_valid = np.abs(voltages) <= self._options.max_voltage_V
        return voltages if is_valid.all() else np.where(is_valid, voltages, math.nan)

    def _note_hum(self) -> None:
        """Note the hum that is subtracted, once for each nominal frequency."""
        plan = self._follower.plan
        if plan is None or plan.nominal_Hz in self._noted_Hz:
            return
        self._noted_Hz.add(plan.nominal_Hz)
        amplitudes = np.sqrt(np.square(self.amplitudes_V).sum(axis=0))
        strongest = int(amplitudes.argmax())
        place = f"{1e3 * amplitudes[strongest]:.2g} mV on {self._names[strongest]}"
        if len(self._names) > 1:
            place += " and less on the other channels"
        text = f"mains hum of {self.frequency_Hz:.2f} Hz, {place}: subtracted"
        self.notes.append(text)

    def _note_low_rate(self, rate_Hz: float) -> None:
        """Note that hum cannot be subtracted, if the user has given its frequency."""
        if len(self._candidates_Hz) > 1 or math.nan in self._noted_Hz:
            return
        self._noted_Hz.add(math.nan)
        text = (
            f"mains_Hz = {self._candidates_Hz[0]:g}: hum is not subtracted at a sampling rate of "
            f"{rate_Hz:.4g} Hz, where it cannot be distinguished from touches; sample at 200 Hz"
        )
        self.notes.append(text)


def list_candidates(mains_Hz: float | str) -> tuple[float, ...]:
    """List the nominal frequencies in Hz that a setting of ``readout.mains_Hz`` stands for."""
    if mains_Hz == AUTO:
        return MAINS_FREQUENCIES_HZ
    try:
        frequency_Hz = float(mains_Hz)
    except ValueError:
        frequency_Hz = math.nan
    if not 0.0 <= frequency_Hz < math.inf:
        message = f"mains_Hz = {mains_Hz}: give a frequency in Hz, 0 for none, or {AUTO}"
        raise ValueError(message)
    return (frequency_Hz,) if frequency_Hz else ()
