"""The table of all faults, and random mixtures of them."""

from __future__ import annotations

import numpy as np

from pvdf_fem.surrogate.touch_domain import Domain, draw_touches
from reports.tracking import clock_faults as clock
from reports.tracking import reading_faults as reading
from reports.tracking import signal_faults as signal
from reports.tracking.fault import Fault, Stage, apply_faults
from reports.tracking.presses import Press, PressedSensor
from reports.tracking.stream import Stream, draw_stream

# Patterns of the messages about a fault, of which a message must match one.
ABOUT_STAMPS = r"stamp|clock|time"
ABOUT_WRAP = r"wrap|overflow|32"
ABOUT_RESTART = r"back|restart|jump|begins? anew"
ABOUT_GAP = r"gap|pause|jump|no (rows|samples)|missing|lost"
ABOUT_MISSING = r"missing|empty"
ABOUT_CHANNEL = r"missing|empty|dead|stuck|frozen|constant"
ABOUT_CLIPPING = r"clip|range|saturat"
ABOUT_OUTLIER = r"spike|outlier|implausible"
ABOUT_HUM = r"\bhum\b|mains"
ABOUT_STEP = r"step|offset|jump|unexplained"
ABOUT_SETTLING = r"settl"
ABOUT_SIGN = r"sign|invert|polarity|negative"

NO_FAULT = Fault("none", signal.keep_signal, Stage.SIGNAL, mixes=False)
FAULTS = (
    NO_FAULT,
    # times
    Fault("one stamp twice", clock.repeat_one_stamp, Stage.STAMP, ABOUT_STAMPS, is_event=True),
    Fault("1 % of the stamps twice", clock.repeat_stamps, Stage.STAMP, ABOUT_STAMPS),
    Fault("rows exchanged", clock.exchange_rows, Stage.ROW, ABOUT_STAMPS, is_event=True),
    Fault("stamps jitter", clock.jitter_stamps, Stage.STAMP),
    Fault("stamps jitter backwards", clock.jitter_stamps_backwards, Stage.STAMP, ABOUT_STAMPS),
    Fault("blocks with one stamp", clock.stamp_bursts, Stage.STAMP, ABOUT_STAMPS),
    Fault("chunks with one stamp", clock.stamp_chunks, Stage.STAMP, ABOUT_STAMPS),
    Fault("whole ms at 2 kHz", clock.truncate_stamps, Stage.STAMP, ABOUT_STAMPS, rate_Hz=2000.0),
    Fault("32-bit µs wrap", clock.wrap_microseconds, Stage.COUNTER, ABOUT_WRAP, sets_origin=True),
    Fault(
        "signed 32-bit µs wrap",
        clock.wrap_signed_microseconds,
        Stage.COUNTER,
        ABOUT_WRAP,
        sets_origin=True,
    ),
    Fault("32-bit ms wrap", clock.wrap_milliseconds, Stage.COUNTER, ABOUT_WRAP, sets_origin=True),
    Fault("times from below zero", clock.start_below_zero, Stage.COUNTER, sets_origin=True),
    Fault("times since 1970", clock.start_at_date, Stage.COUNTER, sets_origin=True),
    Fault("clock jumps back", clock.jump_back, Stage.STAMP, ABOUT_RESTART, is_event=True),
    Fault("clock restarts", clock.restart_clock, Stage.STAMP, ABOUT_RESTART),
    Fault("clock jumps forward", clock.jump_forward, Stage.STAMP, ABOUT_GAP, is_event=True),
    Fault("rows missing for 1 s", clock.drop_rows, Stage.ROW, ABOUT_GAP, is_event=True),
    Fault("0.5 % of the rows missing", clock.drop_single_rows, Stage.ROW),
    Fault("no stamps", clock.lose_stamps, Stage.STAMP, ABOUT_STAMPS, is_event=True),
    Fault("wild stamps", clock.make_stamps_wild, Stage.STAMP, ABOUT_STAMPS, is_event=True),
    Fault("rate drifts by 0.2 %", clock.change_rate, Stage.STAMP),
    # missing readings
    Fault("empty cell", reading.empty_cell, Stage.SAMPLE, ABOUT_MISSING, is_event=True),
    Fault("empty cell at an onset", reading.empty_cell_at_onset, Stage.SAMPLE, ABOUT_MISSING),
    Fault("empty row in a touch", reading.empty_row, Stage.SAMPLE, ABOUT_MISSING, is_event=True),
    Fault("10 to 30 empty rows", reading.empty_rows, Stage.SAMPLE, ABOUT_MISSING, is_event=True),
    Fault(
        "10 to 30 empty rows before a touch",
        reading.empty_rows_before_press,
        Stage.SAMPLE,
        ABOUT_MISSING,
    ),
    Fault("0.5 % of the cells empty", reading.empty_cells, Stage.SAMPLE, ABOUT_MISSING),
    Fault("channel empty", reading.lack_channel, Stage.SAMPLE, ABOUT_CHANNEL),
    Fault(
        "channel reads 0, returns", reading.fail_to_zero, Stage.SAMPLE, ABOUT_CHANNEL, is_event=True
    ),
    Fault(
        "channel empty, returns", reading.fail_to_empty, Stage.SAMPLE, ABOUT_CHANNEL, is_event=True
    ),
    Fault(
        "channel frozen, returns",
        reading.freeze_channel,
        Stage.SAMPLE,
        ABOUT_CHANNEL,
        is_event=True,
    ),
    Fault("channel reads 0 for ever", reading.kill_channel, Stage.SAMPLE, ABOUT_CHANNEL),
    # clipping and resolution
    Fault(
        "clipped, range known", signal.clip_channels_of_known_range, Stage.CONVERTER, ABOUT_CLIPPING
    ),
    Fault("clipped, range unknown", signal.clip_channels, Stage.CONVERTER, ABOUT_CLIPPING),
    Fault("one channel clipped", signal.clip_one_channel, Stage.CONVERTER, ABOUT_CLIPPING),
    Fault("clipped above", signal.clip_above, Stage.CONVERTER, ABOUT_CLIPPING),
    Fault("steps of 1 or 5 mV", signal.quantize, Stage.CONVERTER),
    # outliers
    Fault("spike", reading.add_spike, Stage.SAMPLE, ABOUT_OUTLIER, is_event=True),
    Fault(
        "spike in a touch", reading.add_spike_in_press, Stage.SAMPLE, ABOUT_OUTLIER, is_event=True
    ),
    Fault("0.2 % spikes", reading.add_spikes, Stage.SAMPLE, ABOUT_OUTLIER),
    Fault("spikes while settling", reading.add_spikes_while_settling, Stage.SAMPLE, ABOUT_OUTLIER),
    Fault("bursts of spikes", reading.add_spike_bursts, Stage.SAMPLE, ABOUT_OUTLIER, is_event=True),
    Fault(
        "spikes in all channels",
        reading.add_common_spikes,
        Stage.SAMPLE,
        ABOUT_OUTLIER,
        is_event=True,
    ),
    # hum and other signals
    Fault("hum", signal.add_hum, Stage.SIGNAL, ABOUT_HUM, least_rate_Hz=250.0),
    Fault(
        "hum of known frequency",
        signal.add_hum_of_known_frequency,
        Stage.SIGNAL,
        ABOUT_HUM,
        least_rate_Hz=250.0,
    ),
    Fault("hum from a time on", signal.add_late_hum, Stage.SIGNAL, ABOUT_HUM, least_rate_Hz=250.0),
    # The alias of this hum may look like noise, so that no message is required.
    Fault("hum at 100 Hz", signal.add_hum, Stage.SIGNAL, rate_Hz=100.0),
    Fault("slow drift", signal.add_drift, Stage.SIGNAL),
    Fault("constant offsets", signal.add_offsets, Stage.SIGNAL),
    Fault("offset steps", signal.add_step, Stage.SIGNAL, ABOUT_STEP, is_event=True),
    Fault(
        "touch while settling",
        signal.excuse_early_press,
        Stage.SIGNAL,
        ABOUT_SETTLING,
        is_early=True,
        mixes=False,
    ),
    Fault("inverted", signal.invert_channels, Stage.SIGNAL, ABOUT_SIGN, mixes=False),
)
EARLY_BEGIN_S = (0.05, 0.4)  #: Range of the start of a press while the tracker settles.
EARLY_DURATION_S = (0.15, 0.6)  #: Range of the duration of such a press.


def draw_faulty_stream(
    sensor: PressedSensor,
    domain: Domain,
    faults: tuple[Fault, ...],
    random: np.random.Generator,
    *,
    rate_Hz: float | None = None,
    seconds: float | None = None,
) -> Stream:
    """Draw a stream with faults.

    Parameters
    ----------
    sensor : PressedSensor
        The sensor.
    domain : Domain
        Reach of the presses and range of their forces.
    faults : tuple of Fault
        Faults of the stream.
    random : numpy.random.Generator
        Source of random numbers.
    rate_Hz : float, optional
        Sampling rate, unless a fault requires another one. By default it is random.
    seconds : float, optional
        Duration. By default it depends on the rate, see `draw_stream`.
    """
    early: tuple[Press, ...] = ()
    if any(fault.is_early for fault in faults):
        x_mm, y_mm, _, force_N = draw_touches(domain, 1, int(random.integers(2**31)))[0].tolist()
        begin_s = random.uniform(*EARLY_BEGIN_S)
        early = (Press(begin_s, random.uniform(*EARLY_DURATION_S), x_mm, y_mm, force_N),)
    rates_Hz = [fault.rate_Hz for fault in faults if fault.rate_Hz]
    stream = draw_stream(
        sensor,
        domain,
        random,
        rate_Hz=rates_Hz[0] if rates_Hz else rate_Hz,
        least_rate_Hz=max(fault.least_rate_Hz for fault in faults),
        seconds=seconds,
        early=early,
    )
    return apply_faults(stream, faults, random)


def can_mix(first: Fault, second: Fault) -> bool:
    """Return whether two faults can be combined in one stream."""
    if not (first.mixes and second.mixes):
        return False
    if first.sets_origin and second.sets_origin:
        return False
    rates_Hz = {fault.rate_Hz for fault in (first, second) if fault.rate_Hz}
    min_rate_Hz = max(first.least_rate_Hz, second.least_rate_Hz)
    return len(rates_Hz) < 2 and all(rate_Hz >= min_rate_Hz for rate_Hz in rates_Hz)


def draw_mixture(random: np.random.Generator) -> tuple[Fault, Fault]:
    """Draw two different faults that can be combined in one stream."""
    while True:
        first, second = random.choice(len(FAULTS), 2, replace=False)
        if can_mix(FAULTS[first], FAULTS[second]):
            return FAULTS[first], FAULTS[second]
