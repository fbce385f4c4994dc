"""Streams of readings of made-up sensors under taps of known force, by a circuit solved exactly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.adaptive import compute_unloaded_charges
from tests.helpers.touch_models import Bumps, bumps

RESISTIVE = {"kind": "voltage", "input_resistance_MOhm": 1.0, "cable_capacitance_pF": 100.0}
#: Steps of the circuit in a sample.
STEPS = 40


@dataclass(frozen=True)
class Tap:
    """A touch with a force like a power of half a sine: the power 0 is held from jump to jump."""

    begin_s: float
    duration_s: float
    place_mm: tuple[float, float]
    force_N: float
    rotation_deg: float = 0.0
    power: int = 1

    def force(self, t):
        phase = (t - self.begin_s) / self.duration_s
        pressed = (phase >= 0.0) & (phase < 1.0)
        course = np.sin(np.pi * np.where(pressed, phase, 0.5)) ** self.power
        return self.force_N * pressed * course


@dataclass(frozen=True, eq=False)
class Rested(Bumps):
    """Made-up charges that grow with the force as those of a stretched membrane.

    The total T and the charge at rest T0 of an electrode have T² (T - T0) in proportion to F².
    """

    @cached_property
    def film_rest_pC(self):
        return 1e12 * compute_unloaded_charges(Problem.from_scene(self.scene))

    def evaluate(self, touches):
        force = touches[:, 3, None]
        at_one = np.column_stack([touches[:, :3], np.ones(len(touches))])
        charges, slopes = super().evaluate(at_one)
        rest, change = self.film_rest_pC, charges - 40.0
        square = (rest + change) ** 2 * change * force**2
        total = rest + np.cbrt(square)
        for _ in range(12):
            slope = 3.0 * total**2 - 2.0 * rest * total
            total = total - (total**2 * (total - rest) - square) / slope
        slopes = slopes * ((total - rest) / change)[..., None]
        slopes[:, :, 3] = 2.0 * square / force / slope
        return total, slopes


def sensor(shape: str = "circle", **readout):
    """A made-up sensor with three voltage channels of 1 MOhm, or another readout."""
    model = bumps(shape)
    scene = model.scene.with_(readout=readout or RESISTIVE)
    return Rested(scene, model.points_mm, model.electrodes_mm, model.names)


def charges_of(model, tap, force):
    """Changes of the charges in pC, (n, electrodes), by forces in N, however small."""
    rows = np.column_stack(
        [np.tile([*tap.place_mm, tap.rotation_deg], (len(force), 1)), np.maximum(force, 1e-12)]
    )
    return model.evaluate(rows)[0] - model.film_rest_pC


def stream(
    model, taps, seconds, *, noise_V=0.0, offset_V=0.0, drift_V_s=0.0, seed=0, rate_Hz=1000.0
):
    """Times and readings in V, (n,) and (n, electrodes)."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    fine, readings = np.linspace(t[0], t[-1], (len(t) - 1) * STEPS + 1), []
    courses = np.zeros((len(fine), len(model.names)))
    for tap in taps:
        courses += charges_of(model, tap, tap.force(fine))
    for channel, course in zip(make_channels(model.scene), courses.T, strict=True):
        step = fine[1] / channel.time_constant
        kept, spread = np.exp(-step), -np.expm1(-step) / step if step else 1.0
        jumps = 1e-12 * spread * np.diff(course, prepend=0.0) / channel.capacitance
        voltages = lfilter([1.0], [1.0, -kept], jumps)[::STEPS]
        readings.append(channel.gain * voltages + channel.offset)
    noise = noise_V * np.random.default_rng(seed).standard_normal((len(t), len(readings)))
    return t, np.transpose(readings) + offset_V + drift_V_s * t[:, None] + noise
