"""Touches from a microcontroller that prints ``t_ms,A,B,C,D`` on a serial port (pyserial)."""

from __future__ import annotations

import sys
from collections.abc import Iterator

import serial

from pvdf_fem import Response, Tracker


def samples(port: serial.Serial) -> Iterator[tuple[float, list[float]]]:
    """Times in s and readings in V of the lines that are whole."""
    while line := port.readline():  # empty after the timeout
        cells = line.decode("ascii", "replace").split(",")
        try:
            t_ms, *readings = map(float, cells)
        except ValueError:
            continue  # the first line is often cut
        if len(readings) == 4:
            yield 1e-3 * t_ms, readings


def main(response: str, device: str, baud: int = 115_200) -> None:
    """Print each touch as it ends."""
    tracker, told = Tracker(Response.load(response)), 0
    with serial.Serial(device, baud, timeout=2.0) as port:
        for t, readings in samples(port):
            tracker.update(t, readings)
            for touch in tracker.touches[told:]:
                print(touch, flush=True)
            told = len(tracker.touches)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])  # model.npz /dev/ttyACM0
