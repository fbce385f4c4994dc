"""Accidents to files: bytes are lost, repeated, shuffled or flipped, or nasty ones inserted."""

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
]


def damaged(rng: random.Random, data: bytes) -> bytes:
    """Bytes after one to three accidents."""
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        data = rng.choice(_ACCIDENTS)(rng, data)
    return data[:2_000_000]


def decayed(rng: random.Random, data: bytes) -> bytes:
    """Bytes with some of them flipped, or after accidents."""
    if rng.random() < 0.3:
        return damaged(rng, data)
    for _ in range(rng.choice((1, 10, 100))):
        data = _flip(rng, data)
    return data


def _span(rng: random.Random, data: bytes) -> tuple[int, int]:
    begin = rng.randrange(len(data) + 1)
    return begin, min(len(data), begin + int(2 ** rng.uniform(0, 8)))


def _truncate(rng: random.Random, data: bytes) -> bytes:
    return data[: rng.randrange(len(data) + 1)]


def _delete(rng: random.Random, data: bytes) -> bytes:
    i, j = _span(rng, data)
    return data[:i] + data[j:]


def _repeat(rng: random.Random, data: bytes) -> bytes:
    i, j = _span(rng, data)
    return data[:j] + data[i:j] * rng.choice((1, 2, 50, 1000)) + data[j:]


def _insert(rng: random.Random, data: bytes) -> bytes:
    i = rng.randrange(len(data) + 1)
    return data[:i] + rng.choice(_NASTY) + data[i:]


def _overwrite(rng: random.Random, data: bytes) -> bytes:
    i, j = _span(rng, data)
    return data[:i] + rng.choice(_NASTY) + data[j:]


def _flip(rng: random.Random, data: bytes) -> bytes:
    if not data:
        return data
    i = rng.randrange(len(data))
    return data[:i] + bytes([data[i] ^ 1 << rng.randrange(8)]) + data[i + 1 :]


def _shuffle_lines(rng: random.Random, data: bytes) -> bytes:
    lines = data.split(b"\n")
    i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
    lines[i], lines[j] = lines[j], lines[i]
    return b"\n".join(lines)


def _digits(rng: random.Random, data: bytes) -> bytes:
    places = [i for i, byte in enumerate(data) if byte in b"0123456789"]
    if not places:
        return data
    i = rng.choice(places)
    return data[:i] + rng.choice((b"-", b".", b"e", b"9", b"_", b"e9", b"-1")) + data[i:]


_ACCIDENTS = (_truncate, _delete, _repeat, _insert, _overwrite, _flip, _shuffle_lines, _digits)


def damages(data: bytes, how: Accident = damaged) -> st.SearchStrategy[bytes]:
    """Bytes after accidents, by `damaged` or `decayed`."""
    return st.integers(0, 2**32 - 1).map(lambda seed: how(random.Random(seed), data))
