"""Recordings of made-up loggers, and how tests read them."""

from __future__ import annotations

import struct
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import numpy as np

from pvdf_fem.readings.loggers.open_recording import RecordingOptions, open_recording
from pvdf_fem.readings.recording import Recording

NAMES = ("A", "B", "C", "D")


class ReadRecording(NamedTuple):
    """All samples of a recording."""

    times_s: np.ndarray
    values: np.ndarray
    recording: Recording

    @property
    def names(self):
        return [column.name for column in self.recording.columns]

    @property
    def units(self):
        return [column.unit and column.unit.symbol for column in self.recording.columns]

    @property
    def notes(self):
        return "\n".join(self.recording.notes)


def read_recording(path: Path, electrodes=NAMES, **options) -> ReadRecording:
    """Read all blocks of a recording."""
    with ExitStack() as stack:
        recording = open_recording(path, stack, electrodes, RecordingOptions(**options))
        assert recording is not None
        blocks = list(recording.blocks)
    times_s = np.concatenate([block.times_s for block in blocks])
    values = np.concatenate([block.values for block in blocks])
    return ReadRecording(times_s, values, recording)


def make_samples(count: int = 50, seed: int = 0) -> np.ndarray:
    """Make samples of the four electrodes, (count, 4), different in every cell."""
    return np.random.default_rng(seed).uniform(-0.9, 0.9, (count, len(NAMES)))


# ------------------------------------------------------------------------------------------- XDF


def write_xdf(path: Path, streams, clock_offsets=()) -> None:
    """Write an XDF file by its specification, version 1.0.

    Parameters
    ----------
    path : Path
        The file.
    streams : list of tuple
        Name, labels with units, nominal rate, stamps and samples (n, channels) of each stream. A
        stamp of NaN is left out, so that a reader deduces it from the nominal rate.
    clock_offsets : list of tuple
        Number of the stream from 1, time of collection and value of each offset.
    """
    chunks = [_make_chunk(1, b"<info><version>1.0</version></info>")]
    for number, (name, labels, rate_Hz, stamps, samples) in enumerate(streams, 1):
        channels = "".join(
            f"<channel><label>{label}</label><unit>{unit}</unit></channel>"
            for label, unit in labels
        )
        header = (
            f"<info><name>{name}</name><type>Film</type>"
            f"<channel_count>{len(labels)}</channel_count><nominal_srate>{rate_Hz}</nominal_srate>"
            f"<channel_format>double64</channel_format>"
            f"<desc><channels>{channels}</channels></desc></info>"
        )
        chunks.append(_make_chunk(2, struct.pack("<I", number) + header.encode()))
        content = struct.pack("<I", number) + b"\x04" + struct.pack("<I", len(stamps))
        for stamp, row in zip(stamps, samples, strict=True):
            content += b"\0" if np.isnan(stamp) else b"\x08" + struct.pack("<d", stamp)
            content += struct.pack(f"<{len(row)}d", *row)
        chunks.append(_make_chunk(3, content))
    for number, time_s, value_s in clock_offsets:
        chunks.append(_make_chunk(4, struct.pack("<Idd", number, time_s, value_s)))
    path.write_bytes(b"XDF:" + b"".join(chunks))


def _make_chunk(tag: int, content: bytes) -> bytes:
    return b"\x04" + struct.pack("<IH", len(content) + 2, tag) + content
