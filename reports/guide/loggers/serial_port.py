"""Touches from a microcontroller that prints ``t_ms,A,B,C,D`` on a serial port (pyserial)."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import serial

from pvdf_fem import Response, Tracker


def read_samples(port: serial.Serial) -> Iterator[tuple[float, list[float]]]:
    """Read times in s and readings in V, without lines that are cut."""
    while line := port.readline():  # empty after the timeout
        cells = line.decode("ascii", "replace").split(",")
        try:
            t_ms, *readings = map(float, cells)
        except ValueError:
            continue  # the first line is often cut
        if len(readings) == 4:
            yield 1e-3 * t_ms, readings


def main(response: str, device: str, baud: int = 115_200) -> None:
    """Print each touch when it has ended."""
    tracker = Tracker(Response.load(response))
    printed = 0
    with serial.Serial(device, baud, timeout=2.0) as port:
        for t, readings in read_samples(port):
            tracker.update(t, readings)
            for touch in tracker.touches[printed:]:
                print(touch, flush=True)
            printed = len(tracker.touches)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])  # sensor.response /dev/ttyACM0
