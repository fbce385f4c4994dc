"""The error of files that cannot be written."""

from __future__ import annotations

from pvdf_fem.files import FileError


class ExportError(FileError):
    """A solution or mesh cannot be written in a file format; the message says what to change."""
