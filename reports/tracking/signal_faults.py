"""Faults of the analogue signal and of the converter: hum, drift, offsets, clipping, polarity."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reports.tracking.fault import draw_channel, draw_row
from reports.tracking.stream import Stream

HUM_V = (5e-3, 40e-3)  #: Smallest and largest amplitude of hum.
HARMONICS = (1, 2, 3)


def keep_signal(stream: Stream, random: np.random.Generator) -> Stream:
    """Change nothing."""
    return stream


def excuse_early_press(stream: Stream, random: np.random.Generator) -> Stream:
    """Excuse the first press, which begins while the tracker settles."""
    early = stream.presses[0]
    return stream.excuse(0.0, early.end_s).describe(f"a press at {early.begin_s:.2f} s")


def _add_hum(
    stream: Stream, random: np.random.Generator, *, begin_s: float = 0.0, is_known: bool = False
) -> Stream:
    """Add hum with two harmonics, whose amplitudes and phases differ between the channels.

    Parameters
    ----------
    stream : Stream
        The stream.
    random : numpy.random.Generator
        Source of amplitudes, frequency and phases.
    begin_s : float, optional
        Time at which the hum begins.
    is_known : bool, optional
        Whether the scene of the tracker has the nominal frequency.
    """
    nominal_Hz = float(random.choice([50.0, 60.0]))
    frequency_Hz = nominal_Hz + random.uniform(-0.2, 0.2)
    lowest_V, highest_V = HUM_V
    amplitude_V = lowest_V * (highest_V / lowest_V) ** random.random()
    hum_V = np.zeros_like(stream.readings_V)
    for harmonic in HARMONICS:
        share = 1.0 if harmonic == 1 else random.uniform(0.0, 0.3)
        sizes_V = amplitude_V * share * random.uniform(0.5, 1.0, len(stream.names))
        phases = random.uniform(0.0, 2.0 * np.pi, len(stream.names))
        angle = 2.0 * np.pi * harmonic * frequency_Hz * stream.true_s
        hum_V += sizes_V * np.sin(angle[:, None] + phases)
    hum_V[stream.true_s < begin_s] = 0.0
    if is_known:
        changes = {**stream.scene_changes, "readout.mains_Hz": nominal_Hz}
        stream = replace(stream, scene_changes=changes)
    story = f"hum of {1e3 * amplitude_V:.1f} mV, {frequency_Hz:.2f} Hz from {begin_s:.2f} s on"
    return stream.describe(story, readings_V=stream.readings_V + hum_V)


def add_hum(stream: Stream, random: np.random.Generator) -> Stream:
    """Add hum of unknown frequency."""
    return _add_hum(stream, random)


def add_hum_of_known_frequency(stream: Stream, random: np.random.Generator) -> Stream:
    """Add hum whose nominal frequency is in the scene."""
    return _add_hum(stream, random, is_known=True)


def add_late_hum(stream: Stream, random: np.random.Generator) -> Stream:
    """Add hum that begins during the stream."""
    return _add_hum(stream, random, begin_s=random.uniform(1.0, 0.6 * stream.seconds))


def add_drift(stream: Stream, random: np.random.Generator) -> Stream:
    """Add a drift of up to 5 mV/s, and slow waves of up to 20 mV."""
    count = len(stream.names)
    slopes_V_s = random.uniform(-5e-3, 5e-3, count)
    angular_Hz = 2.0 * np.pi / random.uniform(20.0, 60.0)
    sizes_V = random.uniform(0.0, 0.02, count)
    phases = random.uniform(0.0, 2.0 * np.pi, count)
    time_s = stream.true_s[:, None]
    drift_V = slopes_V_s * time_s + sizes_V * np.sin(angular_Hz * time_s + phases)
    return stream.describe("slow drift", readings_V=stream.readings_V + drift_V)


def add_offsets(stream: Stream, random: np.random.Generator) -> Stream:
    """Add constant offsets of up to 2 V."""
    offsets_V = random.uniform(-2.0, 2.0, len(stream.names))
    return stream.describe("offsets", readings_V=stream.readings_V + offsets_V)


def add_step(stream: Stream, random: np.random.Generator) -> Stream:
    """Let the offset of a channel step by 10 to 300 mV."""
    row = draw_row(stream, random)
    channel = draw_channel(stream, random)
    step_V = float(random.choice([-1.0, 1.0])) * random.uniform(0.01, 0.3)
    readings_V = stream.readings_V.copy()
    readings_V[row:, channel] += step_V
    story = f"{stream.names[channel]} steps by {step_V:+.3f} V at row {row}"
    return stream.describe(story, readings_V=readings_V)


def invert_channels(stream: Stream, random: np.random.Generator) -> Stream:
    """Invert all channels, so that no press can be located."""
    stream = stream.excuse(-np.inf, np.inf)
    return stream.describe("inverted", readings_V=-stream.readings_V)


def quantize(stream: Stream, random: np.random.Generator) -> Stream:
    """Round readings to steps of 1 or 5 mV."""
    step_V = float(random.choice([1e-3, 5e-3]))
    readings_V = step_V * np.round(stream.readings_V / step_V)
    return stream.describe(f"steps of {step_V:g} V", readings_V=readings_V)


def _draw_range(stream: Stream, random: np.random.Generator, channels: slice) -> float:
    """Draw a range in V that is 50 to 95 % of the largest reading.

    Parameters
    ----------
    stream : Stream
        The stream.
    random : numpy.random.Generator
        Source of the fraction.
    channels : slice
        Channels whose readings are considered.
    """
    largest_V = np.nanmax(np.abs(stream.readings_V[:, channels]))
    return float(random.uniform(0.5, 0.95) * largest_V)


def clip_channels(stream: Stream, random: np.random.Generator) -> Stream:
    """Clip all channels at a range that is not in the scene."""
    range_V = _draw_range(stream, random, slice(None))
    readings_V = np.clip(stream.readings_V, -range_V, range_V)
    return stream.describe(f"clipped at {range_V:.3f} V", readings_V=readings_V)


def clip_channels_of_known_range(stream: Stream, random: np.random.Generator) -> Stream:
    """Clip all channels at a range that is in the scene."""
    range_V = _draw_range(stream, random, slice(None))
    readings_V = np.clip(stream.readings_V, -range_V, range_V)
    changes = {**stream.scene_changes, "readout.range_V": range_V}
    stream = replace(stream, scene_changes=changes)
    return stream.describe(f"clipped at {range_V:.3f} V", readings_V=readings_V)


def clip_one_channel(stream: Stream, random: np.random.Generator) -> Stream:
    """Clip one channel at a range that is not in the scene."""
    channel = draw_channel(stream, random)
    range_V = _draw_range(stream, random, slice(channel, channel + 1))
    readings_V = stream.readings_V.copy()
    readings_V[:, channel] = np.clip(readings_V[:, channel], -range_V, range_V)
    story = f"{stream.names[channel]} clipped at {range_V:.3f} V"
    return stream.describe(story, readings_V=readings_V)


def clip_above(stream: Stream, random: np.random.Generator) -> Stream:
    """Clip all channels above, but not below."""
    limit_V = float(random.uniform(0.5, 0.95) * np.nanmax(stream.readings_V))
    readings_V = np.minimum(stream.readings_V, limit_V)
    return stream.describe(f"clipped above {limit_V:.3f} V", readings_V=readings_V)
