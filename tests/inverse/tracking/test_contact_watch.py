"""Watching the baseline between contacts."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pvdf_fem.inverse.tracking.contact_watch import ContactWatch
from pvdf_fem.inverse.tracking.options import DEFAULTS
from pvdf_fem.inverse.tracking.signal.filtered_sample import FilteredSample
from tests.helpers.tracking.baselines import make_circuit, make_learned_baseline

INTERVAL_S = 1e-3
NOISE_V = 1e-3
CHANNELS = 3
COUNT = 400
OPTIONS = replace(DEFAULTS, window_fraction=0.25)


def make_watch(*, touch_sign=1.0, **circuit_options):
    """Make a watch whose baseline was learned from 400 samples until the time 0."""
    circuit = make_circuit(CHANNELS, **circuit_options)
    baseline = make_learned_baseline(circuit, noise_V=NOISE_V, count=COUNT)
    return ContactWatch(baseline, COUNT, OPTIONS, verification_s=0.2, touch_sign=touch_sign)


def run(watch, voltages, *, first=1, pause_at=None):
    """Return the samples of the first contact in voltages, or none."""
    for number, row in enumerate(voltages, start=first):
        sample = FilteredSample(
            INTERVAL_S * number,
            row.tolist(),
            [False] * CHANNELS,
            follows_pause=number == pause_at,
        )
        contact = watch.add(sample, INTERVAL_S)
        if contact:
            return contact
    return []


def make_noise(count, seed=0):
    """Make noise of all channels."""
    return NOISE_V * np.random.default_rng(seed).standard_normal((count, CHANNELS))


def test_noise_is_no_contact_and_enters_the_baseline_late():
    """The last samples, as many as the longest window, are not in the baseline yet."""
    watch = make_watch()
    assert run(watch, make_noise(3000)) == []
    assert watch.detector.longest_window == 64
    assert len(watch.detector) == 64
    baseline = watch.baseline
    for channel in baseline.channels:
        assert channel.time_s == pytest.approx(INTERVAL_S * (3000 - 64))
        assert channel.noise_V == pytest.approx(NOISE_V, rel=0.1)


@pytest.mark.parametrize("is_slow", [False, True])
def test_a_contact_hardly_changes_the_baseline(is_slow):
    """Its samples are returned, and those before it are in the baseline."""
    watch = make_watch()
    voltages = make_noise(600)
    ramp = np.clip((np.arange(600) - 299) / (60.0 if is_slow else 1.0), 0.0, 1.0)
    contact = run(watch, voltages + 0.02 * ramp[:, None] * np.array([1.0, -0.5, 0.2]))
    onset_s = INTERVAL_S * 301
    assert contact[0].time_s <= onset_s + 3.0 * INTERVAL_S * (1.0 + 3.0 * is_slow)
    assert contact[0].time_s > onset_s - 20.0 * INTERVAL_S
    assert contact[-1].time_s < onset_s + 0.04
    times = np.diff([sample.time_s for sample in contact])
    np.testing.assert_allclose(times, INTERVAL_S)
    for channel in watch.baseline.channels:
        assert channel.time_s == pytest.approx(contact[0].time_s - INTERVAL_S)
        error = channel.compute_relative_error(contact[0].time_s, INTERVAL_S)
        assert abs(channel.predict(contact[0].time_s)) < 4.0 * error * NOISE_V


def test_a_missing_channel_and_one_without_a_line_have_no_part_in_the_detection():
    watch = make_watch()
    watch.baseline.channels[2].forget_line()
    voltages = make_noise(100)
    voltages[:, 1] = math.nan
    voltages[:5, 2] += 1.0  # Before it holds a line.
    assert run(watch, voltages[:5]) == []


@pytest.mark.parametrize("left_V", [0.0, 0.1])
def test_what_a_pause_leaves_is_a_residual(left_V):
    """The first sample after it gives the residual, which decays; later ones are no contact."""
    watch = make_watch(time_constant_s=0.5, touch_sign=-1.0)
    run(watch, make_noise(200))
    first = 1200
    times = INTERVAL_S * np.arange(2000)
    voltages = make_noise(2000, seed=1)
    voltages[:, 0] += left_V * np.exp(-times / 0.5)
    assert run(watch, voltages, first=first, pause_at=first) == []
    is_unverified = watch.unverified_until_s > 0.0
    assert is_unverified == (left_V > 0.0)
    if is_unverified:
        assert watch.unverified_until_s == pytest.approx(INTERVAL_S * first + 0.2)
    channel = watch.baseline.channels[0]
    end_s = INTERVAL_S * (first + 1999)
    left_at_end_V = left_V * math.exp(-1.999 / 0.5)
    error = channel.compute_relative_error(end_s, INTERVAL_S)
    assert abs(channel.predict(end_s) - left_at_end_V) < 4.0 * error * NOISE_V


def test_charges_of_a_touch_after_a_pause_are_a_contact():
    """Something presses already if the sum of the charges has the sign of a touch."""
    watch = make_watch()
    run(watch, make_noise(200))
    voltages = make_noise(400, seed=1) + np.array([0.1, -0.05, 0.0])
    contact = run(watch, voltages, first=1200, pause_at=1200)
    assert contact[0].time_s == pytest.approx(INTERVAL_S * 1200)
    assert contact[0].time_s < watch.unverified_until_s


def test_a_contact_after_a_pause_is_found_beside_a_residual():
    watch = make_watch(touch_sign=-1.0)
    run(watch, make_noise(200))
    voltages = make_noise(400, seed=1) + 0.1
    voltages[200:] += 0.05
    contact = run(watch, voltages, first=1200, pause_at=1200)
    assert contact[-1].time_s == pytest.approx(INTERVAL_S * 1400, abs=0.005)


def test_after_a_contact_only_new_samples_are_watched():
    watch = make_watch()
    voltages = make_noise(100)
    voltages[50:] += 0.1
    contact = run(watch, voltages)
    assert contact
    watch.restart(INTERVAL_S * 100, INTERVAL_S)
    assert len(watch.detector) == 0
    assert run(watch, make_noise(300, seed=1), first=101) == []
