"""Command-line options that several reports share."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable
from pathlib import Path

from pvdf_fem.files import same_file

OUT = Path(__file__).resolve().parents[1] / "out"


def number_of(what: str, most: int = 1000) -> Callable[[str], int]:
    """A type for `argparse`: a whole number of `what`, from 1 to `most`."""

    def parse(text: str) -> int:
        digits = text.isascii() and text.isdigit() and len(text) < 20
        if not digits or not 1 <= int(text) <= most:
            problem = f"{text[:60]!r} is not a number of {what}; give 1 to {most}"
            raise argparse.ArgumentTypeError(problem)
        return int(text)

    return parse


def add_out(parser: argparse.ArgumentParser, folder: str = "") -> None:
    """Add ``--out``; its default is `folder` within ``reports/out``."""
    parser.add_argument(
        "--out", type=_out, default=OUT / folder, metavar="DIR", help="output directory"
    )


def _out(text: str) -> Path:
    path = Path(text)
    if same_file(path, OUT.with_name("thesis")):
        raise argparse.ArgumentTypeError(f"{text} holds the thesis's data; name another directory")
    return path


def add_processes(parser: argparse.ArgumentParser) -> None:
    """Add ``--processes``; its default is the number of cores."""
    parser.add_argument(
        "--processes",
        type=number_of("processes"),
        default=os.cpu_count() or 1,
        metavar="N",
        help="default: cores",
    )
