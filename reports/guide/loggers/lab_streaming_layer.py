"""Touches from a Lab Streaming Layer stream of readings in V, sent on as a stream (pylsl)."""

from __future__ import annotations

import sys

import pylsl

from pvdf_fem import Response, Tracker

COLUMNS = ("touch", "x_mm", "y_mm", "force_N", "x_deviation_mm", "y_deviation_mm")


def main(response: str, name: str) -> None:
    """Track the stream `name`, and send a sample of `COLUMNS` for each of its samples."""
    tracker = Tracker(Response.load(response))
    (source,) = pylsl.resolve_byprop("name", name, timeout=10.0)
    inlet = pylsl.StreamInlet(source)
    info = pylsl.StreamInfo(
        f"{name}-touches", "Touches", len(COLUMNS), source.nominal_srate(), "float32", name
    )
    outlet = pylsl.StreamOutlet(info)
    while True:
        readings, t = inlet.pull_sample(timeout=2.0)
        if readings is None:
            break
        row = tracker.update(t, readings)
        outlet.push_sample([getattr(row, column) for column in COLUMNS], t)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])  # sensor.response sensor
