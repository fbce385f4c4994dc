"""Accidents to files: pieces are lost, moved, repeated or flipped, or nasty ones put there."""

from __future__ import annotations

import os
import random
from collections.abc import Callable

from hypothesis import Phase, settings
from hypothesis import strategies as st

Accident = Callable[[random.Random, bytes], bytes]
EXAMPLES = int(os.environ.get("PVDF_FEM_EXAMPLES", "100"))


def drawn(share: float) -> settings:
    """Settings for a share of all examples, whose number is in the variable ``PVDF_FEM_EXAMPLES``;
    they are not shrunk."""
    most = max(1, round(share * EXAMPLES))
    return settings(max_examples=most, phases=[Phase.explicit, Phase.generate])


_NASTY = [
    *(b"\0", b"\xff", b"\xef\xbb\xbf", b"\r", b"\x1b[31m", b"\xc3", b"\xed\xa0\x80"),
    *(b"nan", b"-inf", b"1e308", b"5e-324", b"-0.0", b"1e-300", b"true", b"1979-05-27", b"0x" * 9),
    *(b"\xe2\x80\xae", b'"', b"'''", b'"""', b"[", b"]]", b"{", b"=", b".", b",", b"#", b"\n"),
    *(b"9" * 5000, b"[" * 2000, b"a." * 200, b"[[electrodes]]\n", b"[probe]\n", b"\nfilm.x = 1\n"),
    *(b"\\u0000", b"\n[film.radius_mm]\n", b"\nshape = 'circle'\n", b'\n"a\\nb" = 1\n'),
    *(b"9", b"-", b"e9", b"_"),
]


def damaged(rng: random.Random, data: bytes) -> bytes:
    """Bytes after one to three accidents."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        begin = rng.randrange(len(data) + 1)
        end = rng.choice((begin, begin + int(2 ** rng.uniform(0, 8)), len(data)))
        before, piece, after = data[:begin], data[begin:end], data[end:]
        there = rng.randrange(len(after) + 1)
        results = (
            before + after,
            before + after[:there] + piece + after[there:],
            before + piece * rng.choice((2, 50, 1000)) + after,
            before + rng.choice(_NASTY) + after,
            before + _flipped(rng, piece) + after,
        )
        data = rng.choice(results)[:2_000_000]
    return data


def decayed(rng: random.Random, data: bytes) -> bytes:
    """Bytes with some of them flipped, or after accidents."""
    if rng.random() < 0.3:
        return damaged(rng, data)
    for _ in range(rng.choice((1, 10, 100))):
        data = _flipped(rng, data)
    return data


def _flipped(rng: random.Random, data: bytes) -> bytes:
    """Bytes with a bit flipped, if there are any."""
    place = rng.randrange(max(len(data), 1))
    flipped = bytes(byte ^ 1 << rng.randrange(8) for byte in data[place : place + 1])
    return data[:place] + flipped + data[place + 1 :]


def damages(data: bytes, how: Accident = damaged) -> st.SearchStrategy[bytes]:
    """Bytes after accidents, by `damaged` or `decayed`."""
    return st.integers(0, 2**32 - 1).map(lambda seed: how(random.Random(seed), data))
