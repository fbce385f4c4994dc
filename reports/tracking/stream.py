"""Streams of readings as a logger writes them, together with the truth about them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.surrogate.touch_domain import Domain
from reports.tracking.presses import Press, PressedSensor, draw_presses

RATES_HZ = (100.0, 250.0, 500.0, 1000.0, 2000.0, 5000.0)  #: Sampling rates that are drawn.
RATE_SHARES = (0.15, 0.2, 0.25, 0.25, 0.1, 0.05)  #: Probabilities of these rates.
NOISE_V = (5e-4, 2e-3)  #: Smallest and largest standard deviation of the noise.
ROWS = 6000  #: Number of rows of a stream, if its duration is within `SECONDS`.
SECONDS = (6.0, 15.0)  #: Shortest and longest stream.
BLOCK_ROWS = 10_000  #: Number of rows that are converted to floats at once.


class Interval(NamedTuple):
    """An interval of true time."""

    begin_s: float
    end_s: float


class LoggedRow(NamedTuple):
    """A row of a logger, and its true time."""

    stamp_s: float
    readings_V: list[float]
    true_s: float


class ClockJump(NamedTuple):
    """A jump of the logger's clock."""

    true_s: float  #: True time of the jump.
    step_s: float


@dataclass(frozen=True, eq=False)
class Stream:
    """Rows of a logger, and the truth about them."""

    stamps_s: Array  #: Times as the logger writes them, shape (n,).
    readings_V: Array  #: Readings as the logger writes them, shape (n, electrodes).
    true_s: Array  #: True times of the rows, shape (n,).
    is_seen: Mask  #: Whether a reading is that of its channel, shape (n, electrodes).
    presses: tuple[Press, ...]
    names: tuple[str, ...]  #: Names of the channels.
    rate_Hz: float
    window: Interval  #: Interval in which faults occur.
    #: Intervals in which a press may be lost or not located, but not located wrongly.
    excused: tuple[Interval, ...] = ()
    forward_jumps: tuple[ClockJump, ...] = ()  #: Jumps that look like gaps in the record.
    scene_changes: Mapping[str, Any] = field(default_factory=dict)  #: Such as a known range.
    story: tuple[str, ...] = ()  #: Faults in words.

    @property
    def seconds(self) -> float:
        """Duration of the stream."""
        return float(self.true_s[-1] - self.true_s[0])

    @cached_property
    def first_stamped_row(self) -> int:
        """Number of the first row that has a stamp."""
        return int(np.argmax(np.isfinite(self.stamps_s)))

    @property
    def presses_in_window(self) -> tuple[Press, ...]:
        """Presses that begin and end in the window."""
        begin_s, end_s = self.window
        presses = [press for press in self.presses if press.begin_s >= begin_s]
        return tuple(press for press in presses if press.end_s <= end_s)

    @property
    def is_in_window(self) -> Mask:
        """Mask of the rows in the window, shape (n,)."""
        begin_s, end_s = self.window
        return (self.true_s >= begin_s) & (self.true_s < end_s)

    def describe(self, fault: str, **changes: Any) -> Stream:
        """Return a copy with changed fields and with a fault added to the story."""
        return replace(self, story=(*self.story, fault), **changes)

    def excuse(self, begin_s: float, end_s: float) -> Stream:
        """Return a copy in which presses are excused if they overlap an interval."""
        return replace(self, excused=(*self.excused, Interval(begin_s, end_s)))

    def is_excused(self, press: Press) -> bool:
        """Return whether a press may be lost or not located."""
        return any(press.overlaps(*interval) for interval in self.excused)

    def select_rows(self, rows: Indices | Mask) -> Stream:
        """Return a copy with some of the rows, in their order."""
        return replace(
            self,
            stamps_s=self.stamps_s[rows],
            readings_V=self.readings_V[rows],
            true_s=self.true_s[rows],
            is_seen=self.is_seen[rows],
        )

    def iterate_rows(self) -> Iterator[LoggedRow]:
        """Yield the rows, converted to floats block by block to save memory."""
        for begin in range(0, len(self.true_s), BLOCK_ROWS):
            block = slice(begin, begin + BLOCK_ROWS)
            yield from map(
                LoggedRow,
                self.stamps_s[block].tolist(),
                self.readings_V[block].tolist(),
                self.true_s[block].tolist(),
            )

    def compute_seen_force(self, press: Press) -> float:
        """Compute the largest force of a press in N, at rows with at least three true readings."""
        is_pressed = (self.true_s >= press.begin_s) & (self.true_s <= press.end_s)
        is_shown = self.is_seen[is_pressed].sum(axis=1) >= 3
        return float(press.compute_force(self.true_s[is_pressed][is_shown]).max(initial=0.0))


def make_stream(
    sensor: PressedSensor,
    presses: tuple[Press, ...],
    random: np.random.Generator,
    *,
    seconds: float,
    rate_Hz: float,
    noise_V: float,
) -> Stream:
    """Make a stream without faults.

    Parameters
    ----------
    sensor : PressedSensor
        The sensor.
    presses : tuple of Press
        Presses that do not overlap.
    random : numpy.random.Generator
        Source of the noise.
    seconds : float
        Duration in s.
    rate_Hz : float
        Sampling rate in Hz.
    noise_V : float
        Standard deviation of the noise in V.
    """
    time_s = np.arange(round(seconds * rate_Hz)) / rate_Hz
    readings_V = sensor.compute_readings(presses, time_s)
    readings_V = readings_V + noise_V * random.standard_normal(readings_V.shape)
    return Stream(
        time_s,
        readings_V,
        true_s=time_s,
        is_seen=np.ones(readings_V.shape, dtype=bool),
        presses=presses,
        names=sensor.names,
        rate_Hz=rate_Hz,
        window=Interval(0.8, seconds - 0.3),
    )


def draw_stream(
    sensor: PressedSensor,
    domain: Domain,
    random: np.random.Generator,
    *,
    rate_Hz: float | None = None,
    least_rate_Hz: float = 0.0,
    seconds: float | None = None,
    early: tuple[Press, ...] = (),
) -> Stream:
    """Draw a stream without faults.

    Parameters
    ----------
    sensor : PressedSensor
        The sensor.
    domain : Domain
        Reach of the presses and range of their forces.
    random : numpy.random.Generator
        Source of random numbers.
    rate_Hz : float, optional
        Sampling rate. By default one of `RATES_HZ` is drawn.
    least_rate_Hz : float, optional
        Lowest sampling rate that is drawn.
    seconds : float, optional
        Duration. By default that of `ROWS` samples, within the limits `SECONDS`.
    early : tuple of Press, optional
        Presses before the random ones.
    """
    drawn_Hz = float(random.choice(RATES_HZ, p=RATE_SHARES))
    rate_Hz = rate_Hz or max(drawn_Hz, least_rate_Hz)
    seconds = seconds or float(np.clip(ROWS / rate_Hz, *SECONDS))
    lowest_V, highest_V = NOISE_V
    noise_V = float(lowest_V * (highest_V / lowest_V) ** random.random())
    ends_s = [press.end_s for press in early]
    first_s = 0.9 + max([0.3, *ends_s])
    presses = draw_presses(domain, random, seconds=seconds, first_s=first_s)
    return make_stream(
        sensor,
        early + presses,
        random,
        seconds=seconds,
        rate_Hz=rate_Hz,
        noise_V=noise_V,
    )
