"""Taps with known courses of the force, and the readings that they make, by exact means."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator
from scipy.signal import lfilter

from pvdf_fem import Scene, solve
from pvdf_fem.readout.channel import channels
from pvdf_fem.response.model import scene_of_touch
from pvdf_fem.solution.solve import rest_charges
from reports.locating.errors import over_disc

Array = NDArray[np.float64]

#: Steps of the circuit in a sample; charges change evenly in each.
STEPS = 64
#: Forces of a tap whose charges are solved.
FORCES = 10
KINDS = ("half-sine", "squared sine", "ramps with hold")


@dataclass(frozen=True)
class Tap:
    """A touch at one place, whose force rises and falls."""

    kind: str
    begin_s: float
    duration_s: float
    x_mm: float
    y_mm: float
    peak_N: float

    @property
    def rise_s(self) -> float:
        """From the beginning to the peak."""
        return (0.3 if self.kind == KINDS[2] else 0.5) * self.duration_s

    def force_N(self, time_s: Array) -> Array:
        """Forces at some times."""
        share = np.clip((time_s - self.begin_s) / self.duration_s, 0.0, 1.0)
        if self.kind == KINDS[2]:
            ramp = np.clip(np.minimum(share, 1.0 - share) / 0.3, 0.0, 1.0)
            course = np.square(ramp) * (3.0 - 2.0 * ramp)
        else:
            course = np.sin(np.pi * share) ** (1 if self.kind == KINDS[0] else 2)
        forces: Array = self.peak_N * course
        return forces


def random_taps(count: int, seed: int, reach_mm: float, forces_N: tuple[float, float]) -> list[Tap]:
    """Taps of 50 to 500 ms: places evenly over a disc, durations and forces evenly in logarithm."""
    draw = np.random.default_rng(seed)
    lowest, highest = forces_N
    taps = []
    for k in range(count):
        kind, begin = KINDS[k % len(KINDS)], 0.6 + 1e-3 * draw.random()
        duration = 0.05 * 10.0 ** draw.random()
        x, y = over_disc(draw, 1, reach_mm)[0].tolist()
        force = lowest * (highest / lowest) ** draw.random()
        taps.append(Tap(kind, begin, duration, x, y, force))
    return taps


class TapCharges:
    """Changes of the charges at a tap's place by force, from full solves.

    They are interpolated by a polynomial of the cube root of the force, in which the charges of a
    stretched film are smooth: F² below some 10 mN, and F to the power 2/3 beyond.
    """

    def __init__(self, scene: Scene, tap: Tap, tolerance: float) -> None:
        """Solve the scene under the tap; raises `NotConvergedError` where a solve fails."""
        self.rest_pC = 1e12 * rest_charges(scene)
        nodes = 0.5 - 0.5 * np.cos(np.pi * np.arange(FORCES + 1) / FORCES)
        charges = [self.rest_pC]
        for force in (tap.peak_N * nodes[1:] ** 3).tolist():
            touch = np.round([tap.x_mm, tap.y_mm, 0.0, force], 12)
            charges.append(
                np.array(list(solve(scene_of_touch(scene, touch, tolerance)).charges_pC.values()))
            )
        self._spline = BarycentricInterpolator(np.cbrt(tap.peak_N) * nodes, np.array(charges))
        self.peak_pC = charges[-1]

    def changes_pC(self, force_N: Array) -> Array:
        """Changes in pC, (n, electrodes)."""
        changes: Array = self._spline(np.cbrt(force_N)) - self.rest_pC
        return changes


def readings(
    scene: Scene, tap: Tap | None, charges: TapCharges | None, seconds: float, rate_Hz: float
) -> tuple[Array, Array]:
    """Times (n,) in s and readings (n, electrodes) in V without noise.

    The circuit is solved exactly for charges that change evenly in each of `STEPS` steps a sample.
    """
    time = np.arange(round(seconds * rate_Hz)) / rate_Hz
    fine = np.linspace(time[0], time[-1], (len(time) - 1) * STEPS + 1)
    changes = np.zeros((len(fine), len(scene.electrode_list)))
    if tap is not None and charges is not None:
        pressed = (fine > tap.begin_s) & (fine < tap.begin_s + tap.duration_s)
        changes[pressed] = charges.changes_pC(tap.force_N(fine[pressed]))
    columns = []
    for channel, change in zip(channels(scene), changes.T, strict=True):
        step = (fine[1] - fine[0]) / channel.time_constant
        spread = -np.expm1(-step) / step if step else 1.0
        jumps = 1e-12 * spread * np.diff(change, prepend=0.0) / channel.capacitance
        voltage = lfilter([1.0], [1.0, -np.exp(-step)], jumps)[::STEPS]
        columns.append(channel.offset + channel.gain * voltage)
    return time, np.column_stack(columns)


def spread(values: Sequence[float] | Array) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(np.square(values))))
