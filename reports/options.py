"""Command-line options that several reports have."""

from __future__ import annotations

import argparse
from collections.abc import Callable


def number_of(what: str) -> Callable[[str], int]:
    """A type for `argparse`: a whole number from 1 on."""

    def parse(text: str) -> int:
        if not text.isdigit() or int(text) < 1:
            raise argparse.ArgumentTypeError(f"{text!r} is not a number of {what}; give 1 or more")
        return int(text)

    return parse
