"""Touches from a microcontroller that prints ``t_us,A,B,C,D`` on a serial port (pyserial).

Above 1 kHz print ``micros()``, since whole milliseconds repeat. The counters of 32 bits start again
from 0 after 71 minutes or 49 days, and after a reset: the tracker notices both.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Sequence

import serial

from pvdf_fem import Response, Tracker

UNITS_S = {"t_us": 1e-6, "t_ms": 1e-3, "t_s": 1.0}  #: Units of the time by the name of its column.
COLUMNS = ("t_us", "A", "B", "C", "D")  #: Columns of a program that prints no header.


def parse_reading(cell: str) -> float:
    """Return the reading in a cell; NaN, a missing reading, for anything but a number."""
    try:
        return float(cell)
    except ValueError:
        return math.nan


def read_samples(
    port: serial.Serial, names: Sequence[str]
) -> Iterator[tuple[float, dict[str, float]]]:
    """Yield times in s and readings in V by electrode.

    Lines that are cut, as the first one often is, have other numbers of cells and are left out.
    A header, which may come again after a reset, names the columns.
    """
    columns: Sequence[str] = COLUMNS
    port.readline()  # the rest of a line that began before the port was opened
    while line := port.readline():  # empty after the timeout
        if not line.endswith(b"\n"):
            continue
        cells = [cell.strip() for cell in line.decode("ascii", "replace").split(",")]
        if UNITS_S.keys() & set(cells):
            columns = cells
            continue
        readings = dict(zip(columns, map(parse_reading, cells), strict=False))
        if len(cells) != len(columns):
            continue
        (unit,) = UNITS_S.keys() & set(columns)
        time_s = UNITS_S[unit] * readings[unit]
        if math.isfinite(time_s):
            yield time_s, {name: readings[name] for name in names if name in readings}


def main(response: str, device: str, baud: int = 921_600) -> None:
    """Print each touch when it has ended."""
    tracker = Tracker(Response.load(response))
    printed = 0
    with serial.Serial(device, baud, timeout=2.0) as port:
        for time_s, readings in read_samples(port, tracker.response.names):
            tracker.update(time_s, readings)
            for touch in tracker.touches[printed:]:
                print(touch, flush=True)
            printed = len(tracker.touches)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])  # sensor.response /dev/ttyACM0
