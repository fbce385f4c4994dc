"""Plateaus of saturated amplifiers, beside forces that are held and peaks of touches."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pvdf_fem.inverse.tracking.charges.sample_buffer import BufferedSamples
from pvdf_fem.inverse.tracking.charges.saturation import find_saturated_channels

NOISE_V = 1e-3
RATE_HZ = 500.0
CAPACITANCE_PF = 1000.0
TIME_S = np.arange(500) / RATE_HZ


def read_out(charges_V, time_constant_s):
    """Return the voltages behind a resistance for charges over capacitance in V."""
    decay = np.exp(-1.0 / (RATE_HZ * time_constant_s))
    return lfilter([1.0], [1.0, -decay], np.diff(charges_V, prepend=0.0))


def make_rows(voltages):
    """Make the rows of a channel."""
    zeros = np.zeros((len(voltages), 1))
    return BufferedSamples(
        TIME_S[: len(voltages)],
        zeros,
        noise_variance=np.full_like(zeros, (CAPACITANCE_PF * NOISE_V) ** 2),
        walk_variance=zeros,
        drift_pC=zeros,
        sampling_variance=zeros[:, 0],
        is_clipped=zeros > 0.0,
        voltages=voltages[:, None],
    )


def find_plateau(voltages, time_constant_s=1.0):
    """Return the number of rows on the plateau of a channel; 0 if there is none."""
    found = find_saturated_channels(make_rows(voltages), [CAPACITANCE_PF], [1.0 / time_constant_s])
    return found.get(0, 0)


def make_noise(size_V, seed):
    return size_V * np.random.default_rng(seed).standard_normal(len(TIME_S))


def make_tap(force_shape):
    """Make the charges of a touch from 0.1 to 0.9 s over capacitance in V."""
    phase = np.clip((TIME_S - 0.1) / 0.8, 0.0, 1.0)
    if force_shape == "tap":
        return 0.8 * np.sin(np.pi * phase) ** 2
    return 0.8 * np.clip(np.minimum(phase, 1.0 - phase) / 0.1, 0.0, 1.0)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("plateau_noise_V", [0.0, 3e-4, 1e-3])
@pytest.mark.parametrize("force_shape", ["tap", "hold"])
@pytest.mark.parametrize("fraction", [0.3, 0.6])
def test_a_limit_with_noise_on_it_is_found(force_shape, fraction, plateau_noise_V, sign):
    voltages = read_out(make_tap(force_shape), 1.0)
    limit_V = fraction * voltages.max()
    is_limited = voltages > limit_V
    readings = np.where(
        is_limited,
        limit_V + make_noise(plateau_noise_V, 1),
        voltages + make_noise(NOISE_V, 2),
    )
    found = find_plateau(sign * readings)
    # Voltages just below the limit are not told from it.
    assert is_limited.sum() <= found <= (voltages > limit_V - 10.0 * NOISE_V).sum()


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("time_constant_s", [0.05, 0.3, 1.0])
@pytest.mark.parametrize("force_shape", ["tap", "hold"])
def test_peaks_and_decays_of_touches_are_not_limits(force_shape, time_constant_s, seed):
    voltages = read_out(make_tap(force_shape), time_constant_s)
    assert find_plateau(voltages + make_noise(NOISE_V, seed), time_constant_s) == 0


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("step_V", [2e-3, 5e-3, 2e-2])
@pytest.mark.parametrize("force_shape", ["tap", "hold"])
def test_readings_in_coarse_steps_are_not_limits(force_shape, step_V, seed):
    """Many readings at the peak are equal."""
    voltages = read_out(make_tap(force_shape), 1.0) + make_noise(NOISE_V, seed)
    assert find_plateau(step_V * np.round(voltages / step_V)) == 0


def test_charge_that_comes_evenly_is_no_limit():
    """It gives a constant voltage, which is approached as slowly as the circuit decays."""
    charges_V = np.clip(TIME_S - 0.1, 0.0, 0.8) * 10.0
    voltages = read_out(charges_V, 0.05)
    for seed in range(20):
        assert find_plateau(voltages + make_noise(NOISE_V, seed), 0.05) == 0
