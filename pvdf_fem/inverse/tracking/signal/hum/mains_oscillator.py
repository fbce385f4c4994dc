"""Phase, frequency and phasors of the mains hum, followed by Kalman filters."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.tracking.signal.hum.harmonic_windows import (
    CombinedPhasors,
    Phasors,
    WindowFits,
    square_abs,
)

#: Lower bound of the variance of a phasor in V².
MIN_VARIANCE_V2 = 1e-24
#: Largest change by one update, in standard deviations of the innovation; larger ones are clipped.
MAX_INNOVATION = 3.0
#: Innovations of two successive updates that exceed this number of standard deviations, and differ
#: by less than this fraction, are a jump, which is accepted at once.
JUMP_INNOVATION = 4.0
JUMP_DISAGREEMENT = 0.5
#: Minimum number of windows that count in an update, and that must agree in a jump.
MIN_WINDOWS = 0.1
MIN_JUMP_WINDOWS = 2.0
#: Standard deviation of the phase, in rad, from which the phase counts as lost.
LOST_PHASE_RAD = 0.5


@dataclass(frozen=True)
class OscillatorDrift:
    """Rates at which the hum is expected to change."""

    #: Random walk of the frequency in Hz per square root of a second. Grids of 50 Hz wander by
    #: 20 mHz in some ten seconds.
    frequency_walk_Hz: float = 5e-3
    #: Random walk of a phasor per square root of a second, relative to its absolute value.
    relative_phasor_walk: float = 5e-3
    #: Largest deviation of the frequency from its nominal value in Hz.
    max_deviation_Hz: float = 1.0


class MainsOscillator:
    """Harmonics with one common phase and frequency, and a phasor for each electrode.

    The hum of an electrode is the sum over the harmonics h of Re(c exp(i h φ)), with the phase
    φ(t) = φ₀ + 2π f (t - t₀). A Kalman filter follows φ and f, whose random walk is that of the
    mains; the phasors c then are almost constant, and each has a scalar Kalman filter.

    Parameters
    ----------
    harmonics : ndarray, shape (harmonics,)
        Multiples of the mains frequency.
    nominal_Hz : float
        Nominal frequency.
    time_s : float
        Time t₀.
    channel_count : int
        Number of channels.
    drift : OscillatorDrift
        Rates at which the hum is expected to change.
    """

    def __init__(
        self,
        harmonics: Indices,
        nominal_Hz: float,
        time_s: float,
        *,
        channel_count: int,
        drift: OscillatorDrift,
    ) -> None:
        self.harmonics = harmonics
        self.nominal_Hz = nominal_Hz
        self.drift = drift
        self.time_s = time_s
        self.phase_rad = 0.0
        self.frequency_Hz = nominal_Hz
        #: In V, shape (harmonics, electrodes).
        self.phasors: Phasors = np.zeros((len(harmonics), channel_count), dtype=complex)
        #: Variance of the real and the imaginary part in V², shape (harmonics, electrodes).
        self.variance: Array = np.zeros((len(harmonics), channel_count))
        # Covariance of the phase and of the angular frequency.
        self._phase_variance = 0.0
        self._covariance = 0.0
        self._angular_variance = 0.0
        self._last_innovation: Phasors | None = None

    @property
    def _prior_angular_variance(self) -> float:
        """Variance of the angular frequency about its nominal value, before any data."""
        return (0.5 * math.pi * self.drift.max_deviation_Hz) ** 2

    @property
    def has_lost_phase(self) -> bool:
        """Whether the phase is so uncertain that the next update has to restart it."""
        return self._phase_variance > LOST_PHASE_RAD**2

    def predict_phase(self, times_s: Array) -> Array:
        """Predict the phase of the mains in rad at some times."""
        return self.phase_rad + 2.0 * math.pi * self.frequency_Hz * (times_s - self.time_s)

    def predict_hum(self, times_s: Array) -> Array:
        """Predict the hum in V at some times, shape (times, electrodes)."""
        phase = self.predict_phase(times_s)[:, None]
        return (np.exp(1j * phase * self.harmonics) @ self.phasors).real

    def predict_phase_variance(self, time_s: float) -> float:
        """Predict the variance of the phase in rad² at a time."""
        step = time_s - self.time_s
        walk = (2.0 * math.pi * self.drift.frequency_walk_Hz) ** 2
        linear = self._phase_variance + 2.0 * step * self._covariance
        return linear + step**2 * self._angular_variance + walk * abs(step) ** 3 / 3.0

    def predict_mean_rotation(self, time_s: float) -> Array:
        """Predict the factor by which the uncertain phase reduces the expected hum at a time.

        Parameters
        ----------
        time_s : float
            Time of the prediction.

        Returns
        -------
        ndarray, shape (harmonics,)
            The expectation exp(-h²σ²/2) of exp(i h δ), if the error δ of the phase is normally
            distributed with the standard deviation σ.
        """
        return np.exp(-0.5 * np.square(self.harmonics) * self.predict_phase_variance(time_s))

    def start(self, fits: WindowFits, combined: CombinedPhasors) -> None:
        """Start from the first windows, which were fitted with the phase predicted so far.

        Parameters
        ----------
        fits : WindowFits
            Fits of the windows.
        combined : CombinedPhasors
            Their robust mean.

        Notes
        -----
        The frequency follows from the rotation of the phasors from window to window, by linear
        regression; the prior standard deviation of the deviation from the nominal frequency is a
        quarter of its limit.
        """
        self.move_to(combined.time_s)
        self.phasors = combined.phasors
        self.variance = combined.variance
        total = combined.weights.sum(axis=0)
        weights = combined.weights / (combined.variance * total)
        correlation = (weights * fits.phasors * combined.phasors.conj()).sum(axis=2)
        rotation = np.angle(correlation) / self.harmonics
        power = (weights * square_abs(combined.phasors)).sum(axis=2)
        information = np.square(self.harmonics) * power
        elapsed = fits.times_s - combined.time_s
        normal = float(np.square(elapsed) @ information.sum(axis=1))
        prior = self._prior_angular_variance
        deviation = 2.0 * math.pi * (self.frequency_Hz - self.nominal_Hz)
        gradient = float(elapsed @ (rotation * information).sum(axis=1)) - deviation / prior
        self._angular_variance = 1.0 / (normal + 1.0 / prior)
        self._covariance = 0.0
        # A common rotation of all phasors is a part of their variance.
        self._phase_variance = 0.0
        self._change_frequency(gradient * self._angular_variance)

    def move_to(self, time_s: float) -> None:
        """Move the reference time t₀, and let the covariances grow until then."""
        step = time_s - self.time_s
        walk = (2.0 * math.pi * self.drift.frequency_walk_Hz) ** 2
        self._phase_variance = self.predict_phase_variance(time_s)
        self._covariance += step * self._angular_variance + walk * step * abs(step) / 2.0
        self._angular_variance = min(
            self._angular_variance + walk * abs(step), self._prior_angular_variance
        )
        relative_walk = self.drift.relative_phasor_walk**2 * abs(step)
        self.variance = self.variance + relative_walk * square_abs(self.phasors)
        phase = self.phase_rad + 2.0 * math.pi * self.frequency_Hz * step
        self.phase_rad = math.remainder(phase, 2.0 * math.pi)
        self.time_s = time_s

    def update(self, combined: CombinedPhasors) -> float:
        """Update phase, frequency and phasors by the phasors of new windows.

        Parameters
        ----------
        combined : CombinedPhasors
            Phasors of windows that were fitted with the predicted phase.

        Returns
        -------
        float
            Change of the phasors relative to their magnitudes, at most 1; 0 if no window counts.
        """
        if combined.weights.sum(axis=0).max() < MIN_WINDOWS:
            return 0.0
        self.move_to(combined.time_s)
        if self.has_lost_phase:
            self.phasors = combined.phasors
            self.variance = combined.variance
            self._phase_variance = 0.0
            self._covariance = 0.0
            return 0.0
        innovation = combined.phasors - self.phasors
        is_jump = self._detect_jump(innovation, combined)
        rotated = combined.phasors * self._update_phase(innovation, combined)
        self._update_phasors(rotated, combined.variance, is_jump)
        change = float((square_abs(innovation) / combined.variance).sum())
        total = float((square_abs(combined.phasors) / combined.variance).sum())
        return math.sqrt(change / total) if change < total else 1.0

    def lose_phase(self) -> None:
        """Make the phase unknown, as after a step of the clock."""
        self._phase_variance = math.inf

    def accept_next_jump(self) -> None:
        """Accept a jump at the next update without waiting for another one, as after a pause."""
        self._last_innovation = None

    def _detect_jump(self, innovation: Phasors, combined: CombinedPhasors) -> Mask:
        """Detect phasors that have jumped, shape (harmonics, electrodes).

        Parameters
        ----------
        innovation : ndarray, shape (harmonics, electrodes)
            Measured minus predicted phasors in V.
        combined : CombinedPhasors
            The measured phasors.
        """
        square = square_abs(innovation)
        last = self._last_innovation
        self._last_innovation = innovation
        is_jump = square > JUMP_INNOVATION**2 * (combined.variance + self._sum_variances())
        is_jump &= combined.weights.sum(axis=0) >= MIN_JUMP_WINDOWS
        if last is not None:
            is_jump &= square_abs(innovation - last) < JUMP_DISAGREEMENT**2 * square
        return is_jump

    def _sum_variances(self) -> Array:
        """Compute the variances of the predicted phasors, with the part due to the phase."""
        return self.variance + self._phase_variance * self._square_slope()

    def _square_slope(self) -> Array:
        """Compute the squared derivatives of the phasors with respect to the phase."""
        return np.square(self.harmonics)[:, None] * square_abs(self.phasors)

    def _update_phase(self, innovation: Phasors, combined: CombinedPhasors) -> Phasors:
        """Update phase and frequency.

        Parameters
        ----------
        innovation : ndarray, shape (harmonics, electrodes)
            Measured minus predicted phasors in V.
        combined : CombinedPhasors
            The measured phasors.

        Returns
        -------
        ndarray, shape (harmonics, 1)
            Factors by which the new phase rotates the measured phasors.
        """
        weight = 1.0 / (combined.variance + self.variance)
        information = float((weight * self._square_slope()).sum())
        clipped = _clip(innovation, combined.variance + self._sum_variances())
        slope = self.harmonics[:, None] * self.phasors.conj()
        gradient = float((weight * (slope * clipped).imag).sum())
        # Gains of the Kalman filter, multiplied by the information so that it may be zero.
        gain = 1.0 / (1.0 + self._phase_variance * information)
        correction = gain * self._phase_variance * gradient
        self.phase_rad += correction
        self._change_frequency(gain * self._covariance * gradient)
        self._angular_variance -= gain * information * self._covariance**2
        self._covariance *= gain
        self._phase_variance *= gain
        return np.exp(-1j * correction * self.harmonics)[:, None]

    def _update_phasors(self, measured: Phasors, variance: Array, is_jump: Mask) -> None:
        """Update the phasors.

        Parameters
        ----------
        measured : ndarray, shape (harmonics, electrodes)
            Measured phasors in V with the updated phase.
        variance : ndarray, shape (harmonics, electrodes)
            Variance of their real and imaginary parts in V².
        is_jump : ndarray, shape (harmonics, electrodes)
            Whether the phasor is replaced by the measured one.
        """
        innovation = measured - self.phasors
        clipped = _clip(innovation, variance + self.variance)
        gain = self.variance / (self.variance + variance)
        self.phasors = np.where(is_jump, measured, self.phasors + gain * clipped)
        updated = np.where(is_jump, variance, self.variance * (1.0 - gain))
        self.variance = np.maximum(updated, MIN_VARIANCE_V2)

    def _change_frequency(self, step_rad_s: float) -> None:
        """Change the frequency within its limits, by an angular frequency in rad/s."""
        limit = self.drift.max_deviation_Hz
        deviation = self.frequency_Hz + step_rad_s / (2.0 * math.pi) - self.nominal_Hz
        self.frequency_Hz = self.nominal_Hz + min(max(deviation, -limit), limit)


def _clip(innovation: Phasors, variance: Array) -> Phasors:
    """Shorten the innovations that are longer than expected from their variance."""
    limit = MAX_INNOVATION * np.sqrt(variance)
    return innovation * np.minimum(limit / np.maximum(np.abs(innovation), 1e-30), 1.0)
