"""Presses of a probe on a sensor, and the readings that they make in the channels.

A press is what truly happens; a touch is what a tracker reports.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.channel import Channel, make_channels
from pvdf_fem.inverse.touch.measurement import compute_unloaded_charges
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import Domain, draw_touches

#: Number of forces at which the charges of a press are evaluated. With 28 the spline between them
#: is off by 1e-6 of the largest charge.
FORCE_NODES = 28
#: Limits of the power of the force with which charges grow from zero: 2 for a stretched film.
SMALL_FORCE_EXPONENTS = (0.5, 3.0)
#: Longest step in s in which a charge is taken to change linearly. Within 1 ms of a press of 0.1 s
#: it is off by 1e-4 of the largest charge.
LONGEST_STEP_S = 1e-3
DURATIONS_S = (0.1, 2.0)  #: Shortest and longest press.
PAUSES_S = (0.3, 1.5)  #: Shortest and longest time between two presses.
FIRST_S = 1.2  #: Earliest start of the first press; a tracker settles before it.
LAST_S = 0.5  #: Time without a press at the end of a stream.
TAP_S = 0.4  #: A shorter press has no hold.


@dataclass(frozen=True)
class Press:
    """A press, whose force rises along half a cosine wave, is held, and falls likewise."""

    begin_s: float
    duration_s: float
    x_mm: float
    y_mm: float
    force_N: float
    #: Fraction of the duration that rise and fall take together; 1 is a tap without a hold.
    ramp_fraction: float = 1.0

    @property
    def end_s(self) -> float:
        """Time at which the force is zero again."""
        return self.begin_s + self.duration_s

    def compute_force(self, time_s: Array) -> Array:
        """Compute the force in N at times in s, shape (n,); it is zero outside the press."""
        elapsed_s = np.asarray(time_s) - self.begin_s
        margin_s = np.minimum(elapsed_s, self.duration_s - elapsed_s)
        phase = np.clip(margin_s / (0.5 * self.ramp_fraction * self.duration_s), 0.0, 1.0)
        return self.force_N * np.sin(0.5 * np.pi * phase) ** 2

    def overlaps(self, begin_s: float, end_s: float) -> bool:
        """Return whether the press and an interval of time overlap."""
        return self.begin_s < end_s and begin_s < self.end_s


def draw_presses(
    domain: Domain, random: np.random.Generator, *, seconds: float, first_s: float = FIRST_S
) -> tuple[Press, ...]:
    """Draw presses one after the other: taps and holds with pauses between them.

    Parameters
    ----------
    domain : Domain
        Reach of the places, and the range of the forces.
    random : numpy.random.Generator
        Source of random numbers.
    seconds : float
        Duration of the stream.
    first_s : float, optional
        Earliest start of the first press.

    Returns
    -------
    tuple of Press
        Presses in the order of time. Logarithms of durations and forces are uniform.
    """
    shortest_s, longest_s = DURATIONS_S
    most = int(seconds / (shortest_s + PAUSES_S[0])) + 1
    touches = draw_touches(domain, most, int(random.integers(2**31)))
    presses: list[Press] = []
    begin_s = first_s + random.uniform(*PAUSES_S) - PAUSES_S[0]
    for x_mm, y_mm, _, force_N in touches.tolist():
        duration_s = float(shortest_s * (longest_s / shortest_s) ** random.random())
        if begin_s + duration_s > seconds - LAST_S:
            break
        ramp_fraction = random.uniform(0.3, 1.0) if duration_s > TAP_S else 1.0
        presses.append(Press(begin_s, duration_s, x_mm, y_mm, force_N, ramp_fraction))
        begin_s += duration_s + random.uniform(*PAUSES_S)
    return tuple(presses)


@dataclass(frozen=True, eq=False)
class PressedSensor:
    """A sensor whose charges are known for any press.

    Parameters
    ----------
    response : ChargeFunction
        Charges as a function of the touch, more accurate than the tracked response. Its scene has
        the readout.
    forces_N : tuple of float
        Smallest and largest force at which it is evaluated.
    """

    response: ChargeFunction
    forces_N: tuple[float, float]

    @cached_property
    def channels(self) -> list[Channel]:
        """Readout channels in the order of the electrodes."""
        return list(make_channels(self.response.scene))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the channels."""
        return tuple(channel.name for channel in self.channels)

    @cached_property
    def unloaded_pC(self) -> Array:
        """Charges without a press in pC, shape (electrodes,)."""
        return compute_unloaded_charges(self.response, "change")[0]

    def compute_changes(self, press: Press, force_N: Array) -> Array:
        """Compute the changes of the charges under a press.

        Parameters
        ----------
        press : Press
            The press, for its position.
        force_N : ndarray, shape (n,)
            Forces in N.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Changes in pC.

        Notes
        -----
        The charges are splines of the cube root of the force, because the charges of a stretched
        film are smooth functions of it: they grow with F² for small forces, and with F to the power
        2/3 for large ones. Below the smallest force, a power of the force with the same slope
        continues the spline.
        """
        smallest_N = self.forces_N[0]
        smallest_root, largest_root = np.cbrt(self.forces_N)
        roots = np.linspace(smallest_root, largest_root, FORCE_NODES)
        touches = np.zeros((FORCE_NODES, 4))
        touches[:, 0] = press.x_mm
        touches[:, 1] = press.y_mm
        touches[:, 3] = np.clip(roots**3, *self.forces_N)
        charges_pC, _ = self.response.evaluate(touches)
        spline = CubicSpline(roots, charges_pC - self.unloaded_pC)
        exponents = roots[0] / 3.0 * spline(roots[0], 1) / spline(roots[0])
        exponents = np.clip(exponents, *SMALL_FORCE_EXPONENTS)
        shares = np.minimum(force_N / smallest_N, 1.0)[:, None] ** exponents
        return shares * spline(np.cbrt(np.maximum(force_N, smallest_N)))

    def compute_readings(self, presses: tuple[Press, ...], time_s: Array) -> Array:
        """Compute the readings of the channels without noise.

        Parameters
        ----------
        presses : tuple of Press
            Presses that do not overlap.
        time_s : ndarray, shape (n,)
            Evenly spaced times.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Readings in V.

        Notes
        -----
        The voltages solve C dV/dt + V/R = dQ/dt exactly for charges that change linearly in steps
        of at most `LONGEST_STEP_S`.
        """
        interval_s = time_s[1] - time_s[0]
        substeps = int(np.ceil(interval_s / LONGEST_STEP_S))
        step_s = interval_s / substeps
        fine_s = time_s[0] + step_s * np.arange((len(time_s) - 1) * substeps + 1)
        charges_pC = np.zeros((len(fine_s), len(self.names)))
        for press in presses:
            begin, end = np.searchsorted(fine_s, [press.begin_s, press.end_s])
            force_N = press.compute_force(fine_s[begin:end])
            charges_pC[begin:end] += self.compute_changes(press, force_N)
        readings_V = []
        for channel, charge_pC in zip(self.channels, charges_pC.T, strict=True):
            step = step_s / channel.time_constant
            # Charge that arrives evenly during a step decays for half of the step on average.
            mean_decay = -np.expm1(-step) / step if step else 1.0
            jumps_V = 1e-12 * mean_decay * np.diff(charge_pC, prepend=0.0) / channel.capacitance
            voltage_V = lfilter([1.0], [1.0, -np.exp(-step)], jumps_V)[::substeps]
            readings_V.append(channel.offset + channel.gain * voltage_V)
        return np.column_stack(readings_V)
