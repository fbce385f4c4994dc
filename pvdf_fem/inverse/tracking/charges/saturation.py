"""Saturated amplifiers: voltages that stay at a limit with noise on top of it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples

#: Channels with a larger noise have no readings.
MAX_NOISE_V = 1e3
#: Smaller changes, as a fraction of the noise, are those of the baseline under equal readings.
EQUAL_FRACTION = 0.01
#: Fraction of the changes that are smaller than the resolution. Noise makes one change of twenty
#: that is below a tenth of its standard deviation.
RESOLUTION_QUANTILE = 0.05
#: Voltages within this number of noise deviations of the extreme one belong to its plateau.
PLATEAU_DEVIATIONS = 6.0
#: Smallest number of rows of a plateau.
MIN_PLATEAU_ROWS = 6
#: A plateau scatters by at most this number of noise deviations. The top of a parabola, down to
#: `PLATEAU_DEVIATIONS`, scatters by two.
MAX_SCATTER = 1.3
#: A voltage that is not limited decays in the time of the plateau by this number of noise
#: deviations at least, so that it scatters by more than two; else nothing is known.
MIN_DECAY = 8.0
#: Number of rows before the plateau in which the voltage rises steeply to a limit.
RISE_ROWS = 3
#: Their rise is at least this number of times that of a parabola or of an exponential, which
#: approach their extreme slowly. A plateau that scatters less than the noise needs only exceed it.
MIN_RISE = 2.0
MIN_RISE_TO_QUIET_PLATEAU = 1.0
#: Standard errors of the scatter, relative to the noise, by which such a plateau scatters less.
QUIET_DEVIATIONS = 1.5


def find_saturated_channels(
    rows: BufferedSamples, capacitances: Sequence[float], decay_rates: Sequence[float]
) -> dict[int, int]:
    """Find the channels whose voltage stayed at a limit of their amplifier.

    Parameters
    ----------
    rows : BufferedSamples
        Voltages and charges of a contact.
    capacitances : sequence of float
        Capacitances in pF.
    decay_rates : sequence of float
        Rates 1/(R C) in 1/s.

    Returns
    -------
    dict of int to int
        Number of rows on the plateau, by channel.

    Notes
    -----
    A voltage behind a resistance is not constant while a force is held: it decays. A plateau is
    therefore a limit if it is flat within the noise, if a voltage that decays would not be, and if
    it begins abruptly: charge that comes evenly, faster than it is lost, also gives a constant
    voltage, but that is approached slowly.
    """
    interval_s = float(rows.time_s[-1] - rows.time_s[0]) / max(len(rows.time_s) - 1, 1)
    found = {}
    for number, (capacitance, rate) in enumerate(zip(capacitances, decay_rates, strict=True)):
        noise_V = math.sqrt(float(np.median(rows.noise_variance[:, number]))) / capacitance
        is_known = not rows.is_clipped[:, number].any()
        # The noise variance of a channel without readings is that of missing ones.
        is_known &= noise_V < MAX_NOISE_V
        if rate and is_known:
            voltages = rows.voltages[:, number]
            measured = voltages[~np.isnan(voltages)]
            decay = rate * interval_s
            # The voltage swings to the other side when a touch is released.
            count = max(
                _measure_plateau(measured, noise_V, decay),
                _measure_plateau(-measured, noise_V, decay),
            )
            if count:
                found[number] = count
    return found


def _measure_plateau(voltages: Array, noise_V: float, decay: float) -> int:
    """Return the number of rows of the plateau at the highest voltage; 0 if there is none.

    Parameters
    ----------
    voltages : ndarray, shape (n,)
        Voltages in V.
    noise_V : float
        Standard deviation of a voltage.
    decay : float
        Fraction of a voltage that is lost from one row to the next.
    """
    if len(voltages) < MIN_PLATEAU_ROWS + RISE_ROWS:
        return 0
    noise_V = max(noise_V, _estimate_resolution(voltages, noise_V))
    highest = int(voltages.argmax())
    limit_V = float(voltages[highest])
    falls = np.flatnonzero(voltages < limit_V - PLATEAU_DEVIATIONS * noise_V)
    first = int(max(falls[falls < highest], default=-1)) + 1
    end = int(min(falls[falls > highest], default=len(voltages)))
    count = end - first
    if count < MIN_PLATEAU_ROWS or first < RISE_ROWS:
        return 0
    # The first and the last row may be partly on the flanks.
    plateau = voltages[first + 1 : end - 1]
    if decay * count * limit_V < MIN_DECAY * noise_V:
        return 0
    scatter = float(plateau.std()) / noise_V
    if scatter > MAX_SCATTER:
        return 0
    # The standard deviation of n normal variables has the relative error 1/√(2 n).
    is_quiet = scatter < 1.0 - QUIET_DEVIATIONS / math.sqrt(2.0 * count)
    min_rise = MIN_RISE_TO_QUIET_PLATEAU if is_quiet else MIN_RISE
    rise_V = float(plateau.mean() - voltages[first - RISE_ROWS])
    growth = max((1.0 + 2.0 * RISE_ROWS / count) ** 2, math.exp(min(RISE_ROWS * decay, 10.0)))
    is_abrupt = rise_V > min_rise * growth * PLATEAU_DEVIATIONS * noise_V
    return count if is_abrupt else 0


def _estimate_resolution(voltages: Array, noise_V: float) -> float:
    """Estimate the step of a converter that is coarser than the noise, in V.

    Parameters
    ----------
    voltages : ndarray, shape (n,)
        Voltages in V.
    noise_V : float
        Standard deviation of a voltage.

    Returns
    -------
    float
        Small compared with the noise if the converter is fine.
    """
    changes = np.abs(np.diff(voltages))
    changes = changes[changes > EQUAL_FRACTION * noise_V]
    return float(np.quantile(changes, RESOLUTION_QUANTILE)) if len(changes) else 0.0
