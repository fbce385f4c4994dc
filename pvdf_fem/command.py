"""What the commands share: exit codes, and complaints about what they were given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

CONVERGED, BAD_INPUT, NOT_CONVERGED, INTERRUPTED, BROKEN_PIPE = 0, 2, 3, 130, 141


class InputError(Exception):
    """The input cannot be used; the arguments are the mistakes, a line each."""


def output_mistakes(path: Path | None, extensions: Sequence[str]) -> list[str]:
    """What would keep a file from being written."""
    if path is None:
        return []
    from pvdf_fem.export import ExportError, require_writable  # slow to import

    if path.suffix.lower() not in extensions:
        return [f"{path}: has no extension of a known format; choose from {' '.join(extensions)}"]
    try:
        require_writable(path)
    except ExportError as error:
        return [str(error)]
    return []
