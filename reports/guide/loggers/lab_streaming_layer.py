"""Touches from a Lab Streaming Layer stream of readings in V, sent on as a stream (pylsl)."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence

import pylsl

from pvdf_fem import Response, Tracker

COLUMNS = ("touch", "x_mm", "y_mm", "force_N", "x_deviation_mm", "y_deviation_mm")
#: Stamps are converted to the clock of this computer, and never go back. `proc_ALL` would smooth
#: them as well, which takes a pause of the source for jitter: after a pause of 2 s all samples
#: come 2 s too early. The tracker removes jitter by itself, and keeps pauses.
POST_PROCESSING = pylsl.proc_clocksync | pylsl.proc_monotonize
END_S = 5.0  #: A source without samples for this time has ended.


def find_channels(info: pylsl.StreamInfo, names: Sequence[str]) -> list[int]:
    """Return the channels labelled with the names, or the first ones of a stream without labels."""
    labels = info.get_channel_labels() or []
    if set(names) <= set(labels):
        return [labels.index(name) for name in names]
    if any(labels):
        raise SystemExit(f"{info.name()}: has the channels {labels}; label them {list(names)}")
    return list(range(len(names)))


def receive_samples(inlet: pylsl.StreamInlet) -> Iterator[tuple[float, list[float]]]:
    """Yield stamps and samples as they arrive, until the source has ended.

    Samples are pulled one by one, also those that are sent in chunks: `pull_chunk` waits until it
    has 1024 of them, and does not return at all if the source ends meanwhile.
    """
    while True:
        sample, stamp = inlet.pull_sample(timeout=END_S)
        if sample is None:
            return
        yield stamp, sample


def main(response: str, name: str) -> None:
    """Track the stream `name`, and send a sample of `COLUMNS` for each of its samples."""
    tracker = Tracker(Response.load(response))
    sources = pylsl.resolve_byprop("name", name, timeout=10.0)
    if len(sources) != 1:
        raise SystemExit(f"{len(sources)} streams are called {name}; start one")
    inlet = pylsl.StreamInlet(sources[0], processing_flags=POST_PROCESSING)
    channels = find_channels(inlet.info(timeout=10.0), tracker.response.names)
    outlet = pylsl.StreamOutlet(
        pylsl.StreamInfo(
            f"{name}-touches",
            "Touches",
            len(COLUMNS),
            sources[0].nominal_srate(),
            "float32",
            f"{name}-touches",
        )
    )
    for stamp, sample in receive_samples(inlet):
        row = tracker.update(stamp, [sample[channel] for channel in channels])
        outlet.push_sample([getattr(row, column) for column in COLUMNS], row.t_s)
    for touch in tracker.touches:
        print(touch)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2])  # sensor.response sensor
