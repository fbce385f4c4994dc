"""The option ``--processes`` of subcommands that solve many scenes."""

from __future__ import annotations

import argparse
from typing import Any


def add_processes_option(parser: Any) -> None:
    """Add the option ``--processes``, an integer or None, to a parser or argument group."""
    parser.add_argument(
        "--processes",
        metavar="N",
        type=int,
        default=None,
        help="number of processes (default: one per core)",
    )


def find_process_errors(options: argparse.Namespace) -> list[str]:
    """Return a list with an error message if ``--processes`` is below 1, else an empty list."""
    count = options.processes
    if count is None or count >= 1:
        return []
    return [f"--processes {count}: must be at least 1; remove the option to use all cores"]
