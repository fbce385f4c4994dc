"""Command-line options that several reports have."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def number_of(what: str, most: int = 1000) -> Callable[[str], int]:
    """A type for `argparse`: a whole number from 1 to `most`."""

    def parse(text: str) -> int:
        digits = text.isascii() and text.isdigit() and len(text) < 20
        if not digits or not 1 <= int(text) <= most:
            wrong = f"{text[:60]!r} is not a number of {what}; give 1 to {most}"
            raise argparse.ArgumentTypeError(wrong)
        return int(text)

    return parse
