"""Files of people: texts read within bounds, and results that appear whole or not at all."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


class FileError(ValueError):
    """A file cannot be read or written; the text names it and says what to change."""


def printable(text: str) -> str:
    """A text in one line: whatever is no printable character as its escape."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def read_text(path: Path, most_bytes: int, what: str) -> str:
    """Text of a regular UTF-8 file, without a byte order mark.

    Parameters
    ----------
    path : Path
        Of the file; a pipe or a device, which may never end, is refused without reading.
    most_bytes : int
        Larger files are refused.
    what : str
        What the file should be, for the complaint: ``a scene file``.

    Raises
    ------
    FileError
        Naming the file.
    """
    advice = f"give the path of {what}"
    try:
        # without O_NONBLOCK, opening a pipe waits for a writer
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with open(descriptor, "rb") as file:
            if not stat.S_ISREG(os.fstat(descriptor).st_mode):
                raise FileError(f"{path}: is no regular file; {advice}")
            raw = file.read(most_bytes + 1)
            size = max(len(raw), os.fstat(descriptor).st_size)
    except OSError as error:
        raise FileError(f"{path}: cannot be read ({error.strerror}); {advice}") from None
    except ValueError as error:
        if isinstance(error, FileError):
            raise
        # a null character in the path
        raise FileError(f"{path}: cannot be read ({error}); {advice}") from None
    if size > most_bytes:
        raise FileError(f"{path}: has {size} bytes, more than {most_bytes}; {advice}")
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        text = f"{path}: line {line} is not UTF-8 text; save the file as UTF-8"
        raise FileError(text) from None


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A path to write to, which becomes `path` at the end, or vanishes after an exception.

    Raises
    ------
    FileError
        When the file cannot be written.
    """
    with _as_file_error(path):
        part = _beside(path)
        try:
            yield part
            part.replace(os.path.realpath(path))  # a symbolic link stays one
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)


def require_writable(path: Path) -> None:
    """Raise `FileError` for a path that `replacing` could not write."""
    with _as_file_error(path):
        part = _beside(path)
        part.touch()
        part.unlink()


def make_directory(path: Path, first: str) -> None:
    """Make a directory and those above it; `FileError` if its `first` file cannot be written."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"{path}: cannot be made a directory ({error.strerror}); name another"
        raise FileError(text) from None
    require_writable(path / first)


def _beside(path: Path) -> Path:
    """A name in the directory of a file that may be replaced."""
    if path.exists():
        if not path.is_file():
            raise FileError(f"{path}: is no regular file; name another")
        if not os.access(path, os.W_OK):
            raise FileError(f"{path}: is write-protected; name another file")
    target = Path(os.path.realpath(path))
    return target.with_name(f".{target.stem[:50]}-{os.getpid()}{path.suffix}")


@contextmanager
def _as_file_error(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise FileError(f"{path}: cannot be written ({reason}); name another file") from error
