"""Streams of readings of made-up sensors under taps of known force, by a circuit solved exactly."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lfilter

from pvdf_fem.electrodes.channel import make_channels
from pvdf_fem.problem.problem import Problem
from pvdf_fem.solver.adaptive import compute_unloaded_charges
from tests.helpers.bump_response import BumpResponse, make_bump_response

RESISTIVE = {"kind": "voltage", "input_resistance_MOhm": 1.0, "cable_capacitance_pF": 100.0}
#: Steps of the circuit in one sampling interval.
SUBSTEPS = 40
#: Newton steps for the total charge.
NEWTON_STEPS = 12


@dataclass(frozen=True)
class Tap:
    """A press whose force follows a power of half a sine; the power 0 is a force that is held."""

    begin_s: float
    duration_s: float
    place_mm: tuple[float, float]
    force_N: float
    rotation_deg: float = 0.0
    power: int = 1

    def force(self, t):
        """Return the force in N at times in s."""
        phase = (t - self.begin_s) / self.duration_s
        is_pressed = (phase >= 0.0) & (phase < 1.0)
        shape = np.sin(np.pi * np.where(is_pressed, phase, 0.5)) ** self.power
        return self.force_N * is_pressed * shape


@dataclass(frozen=True, eq=False)
class MembraneCharges(BumpResponse):
    """Made-up charges that grow with the force as those of a stretched membrane.

    With the charge T0 of an electrode on the unloaded film, T² (T - T0) is proportional to F² for
    its total charge T.
    """

    @cached_property
    def film_unloaded_pC(self):
        return 1e12 * compute_unloaded_charges(Problem.from_scene(self.scene))

    def evaluate(self, touches):
        force = touches[:, 3, None]
        touches_of_1_N = np.column_stack([touches[:, :3], np.ones(len(touches))])
        charges, slopes = super().evaluate(touches_of_1_N)
        unloaded = self.film_unloaded_pC
        change = charges - 40.0
        product = (unloaded + change) ** 2 * change * force**2
        total = unloaded + np.cbrt(product)
        for _ in range(NEWTON_STEPS):
            slope = 3.0 * total**2 - 2.0 * unloaded * total
            total = total - (total**2 * (total - unloaded) - product) / slope
        slopes = slopes * ((total - unloaded) / change)[..., None]
        slopes[:, :, 3] = 2.0 * product / force / slope
        return total, slopes


def make_sensor(shape: str = "circle", **readout):
    """Make a sensor with voltage channels of 1 MOhm, or with another readout."""
    model = make_bump_response(shape)
    scene = model.scene.with_(readout=readout or RESISTIVE)
    return MembraneCharges(scene, model.points_mm, model.electrodes_mm, model.names)


def compute_changes(model, tap, force):
    """Compute the changes of the charges in pC, (n, electrodes), by forces in N, (n,)."""
    pose = np.tile([*tap.place_mm, tap.rotation_deg], (len(force), 1))
    # The charges of no force at all are a limit.
    touches = np.column_stack([pose, np.maximum(force, 1e-12)])
    return model.evaluate(touches)[0] - model.film_unloaded_pC


def make_stream(
    model, taps, seconds, *, noise_V=0.0, offset_V=0.0, drift_V_s=0.0, seed=0, rate_Hz=1000.0
):
    """Make times in s, (n,), and readings in V, (n, electrodes), of taps one after the other."""
    t = np.arange(round(seconds * rate_Hz)) / rate_Hz
    fine_t = np.linspace(t[0], t[-1], (len(t) - 1) * SUBSTEPS + 1)
    changes_pC = np.zeros((len(fine_t), len(model.names)))
    for tap in taps:
        changes_pC += compute_changes(model, tap, tap.force(fine_t))
    readings = []
    for channel, change_pC in zip(make_channels(model.scene), changes_pC.T, strict=True):
        step = fine_t[1] / channel.time_constant
        decay = np.exp(-step)
        # Charge that comes evenly during a step decays for half of it in the mean.
        mean_decay = -np.expm1(-step) / step if step else 1.0
        jumps = 1e-12 * mean_decay * np.diff(change_pC, prepend=0.0) / channel.capacitance
        voltages = lfilter([1.0], [1.0, -decay], jumps)[::SUBSTEPS]
        readings.append(channel.gain * voltages + channel.offset)
    noise = noise_V * np.random.default_rng(seed).standard_normal((len(t), len(readings)))
    return t, np.transpose(readings) + offset_V + drift_V_s * t[:, None] + noise
