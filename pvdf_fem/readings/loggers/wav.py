"""Sound files, such as WAV and FLAC: piezoelectric films are often recorded by sound cards."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.readings.loggers.logger_reader import (
    BLOCK_SAMPLES,
    LoggerChannel,
    LoggerReader,
    RegularClock,
)

#: Largest sample of formats with integers, by the names of soundfile, as a fraction of full scale.
LARGEST_SAMPLES = {
    "PCM_S8": 1.0 - 2.0**-7,
    "PCM_U8": 1.0 - 2.0**-7,
    "PCM_16": 1.0 - 2.0**-15,
    "PCM_24": 1.0 - 2.0**-23,
    "PCM_32": 1.0 - 2.0**-31,
}
#: A file of this size has a header of 44 bytes, or a longer one, and no more than a few samples.
MAX_HEADER_BYTES = 4096


class WavReader(LoggerReader):
    """A reader of sound files by soundfile.

    Samples are fractions of the full scale. Integers of b bits are divided by 2**(b - 1), but the
    largest one becomes 1 and the two smallest ones -1, since the converter clips there. Numbers of
    floating-point files are returned as they are, even above 1.
    """

    title = "WAV"
    extensions = (".wav", ".wave", ".flac", ".w64", ".rf64", ".aif", ".aiff")
    package = "soundfile"
    has_fractions = True

    def __init__(self, path: Path, stack: ExitStack) -> None:
        super().__init__(path, stack)
        soundfile = self.import_package("soundfile")
        try:
            self.file = stack.enter_context(soundfile.SoundFile(path))
        except soundfile.SoundFileError as error:
            raise self.make_format_error(error) from None
        if self.file.frames == 0 and path.stat().st_size > MAX_HEADER_BYTES:
            advice = "repair its header, for example by: sox --ignore-length FILE NEW.wav"
            raise self.make_error(f"its header says that it has no samples; {advice}")

    @classmethod
    def is_recognised(cls, head: bytes) -> bool:
        """Return whether a file is RIFF WAVE, RF64, W64, AIFF or FLAC."""
        is_riff = head[:4] in (b"RIFF", b"RF64", b"RIFX") and head[8:12] == b"WAVE"
        is_aiff = head[:4] == b"FORM" and head[8:12] in (b"AIFF", b"AIFC")
        is_w64 = head[:4] == b"riff" and head[24:28] == b"wave"
        return is_riff or is_aiff or is_w64 or head[:4] == b"fLaC"

    def list_channels(self) -> list[LoggerChannel]:
        """Return the channels, which are named by their numbers from 1."""
        clock = RegularClock(1.0 / self.file.samplerate)
        return [LoggerChannel(str(i + 1), clock=clock) for i in range(self.file.channels)]

    def read_columns(self, addresses: Sequence[str]) -> Iterator[list[Array]]:
        """Yield blocks of samples of several channels, see `LoggerReader.read_columns`."""
        indices = [int(address) - 1 for address in addresses]
        largest = LARGEST_SAMPLES.get(self.file.subtype)
        self.file.seek(0)
        for block in self.file.blocks(BLOCK_SAMPLES, dtype="float64", always_2d=True):
            samples = block[:, indices]
            if largest is None:
                yield list(samples.T)
                continue
            # A converter that clips gives the largest integer, and the smallest one or the one
            # above. Both become ±1, so that they are at the end of a range_V of the full scale.
            samples = np.where(samples >= largest, 1.0, samples)
            samples = np.where(samples <= -largest, -1.0, samples)
            yield list(samples.T)
