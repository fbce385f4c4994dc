"""The option ``--processes`` of commands that solve many scenes."""

from __future__ import annotations

import argparse
from typing import Any

ALL_CORES = -1  #: Stands for one process per core.


def add_processes(parser: Any) -> None:
    """Add the option to a parser, or to a group of one."""
    parser.add_argument(
        "--processes",
        metavar="N",
        type=int,
        default=ALL_CORES,
        help="number of processes (default: one per core)",
    )


def find_process_errors(options: argparse.Namespace) -> list[str]:
    """Return a message if the number of processes is not positive, else nothing."""
    count = options.processes
    if count == ALL_CORES or count >= 1:
        return []
    return [f"--processes {count}: must be at least 1; remove the option to use all cores"]
