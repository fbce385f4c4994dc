"""Touches from a Lab Streaming Layer stream of readings in V, sent on as a stream (pylsl)."""

from __future__ import annotations

import sys

import pylsl

from pvdf_fem import Response, Tracker

COLUMNS = ("touch", "x_mm", "y_mm", "force_N", "x_deviation_mm", "y_deviation_mm")


def main(response: str, name: str) -> None:
    """Follow the stream `name`, and send a sample of `COLUMNS` for each of its samples."""
    tracker = Tracker(Response.load(response))
    (found,) = pylsl.resolve_byprop("name", name, timeout=10.0)
    inlet = pylsl.StreamInlet(found)
    told = pylsl.StreamInfo(
        f"{name}-touches", "Touches", len(COLUMNS), found.nominal_srate(), "float32", name
    )
    outlet = pylsl.StreamOutlet(told)
    while True:
        readings, t = inlet.pull_sample(timeout=2.0)
        if readings is None:
            break
        row = tracker.update(t, readings)
        outlet.push_sample([getattr(row, column) for column in COLUMNS], t)


if __name__ == "__main__":
    main(*sys.argv[1:3])  # model.npz sensor
