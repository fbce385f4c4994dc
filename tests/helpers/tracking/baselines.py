"""Baselines of channels as if they had been learned from samples."""

import math

import numpy as np

from pvdf_fem.electrodes.channel import Channel
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.inverse.tracking.signal.baseline import Baseline, SettledBaseline
from pvdf_fem.inverse.tracking.signal.circuit import ReadoutCircuit


def make_circuit(channel_count=1, *, time_constant_s=math.inf, low_V=-math.inf, high_V=math.inf):
    """Make a circuit of equal channels of 1 nF."""
    channel = Channel("A", 1e-9, time_constant_s / 1e-9, low_V=low_V, high_V=high_V)
    return ReadoutCircuit.from_channels([channel] * channel_count)


def make_learned_baseline(
    circuit, *, noise_V=1e-3, level_V=0.0, slope_V_s=0.0, count=400, interval_s=1e-3
):
    """Make a baseline that was learned until the time 0."""
    baseline = Baseline(circuit, DEFAULTS)
    ones = np.ones(len(baseline.channels))
    settled = SettledBaseline(
        0.0,
        level_V * ones,
        slope_V_s * ones,
        residual=0.0 * ones,
        noise_V=noise_V * ones,
        count=(count * ones).astype(int),
    )
    baseline.set_lines(settled, interval_s)
    return baseline
