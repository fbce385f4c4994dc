"""The option ``--without-calibration`` of commands that locate touches."""

from __future__ import annotations

import argparse


def add_calibration_option(parser: argparse.ArgumentParser) -> None:
    """Add the option ``--without-calibration``."""
    parser.add_argument(
        "--without-calibration",
        action="store_true",
        help="leave the errors of the calibration, [calibration] of the scene, out of the standard "
        "deviations. They are the same for all touches, so that averaging does not reduce them",
    )
