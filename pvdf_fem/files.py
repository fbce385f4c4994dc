"""Input files, read within bounds, and output files, written whole or not at all."""

from __future__ import annotations

import csv
import os
import re
import stat
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

_DECIMAL_COMMA = re.compile(r"^(\s*[+-]?[0-9]*),([0-9]+([eE][+-]?[0-9]+)?\s*)$")


class FileError(ValueError):
    """A file cannot be read or written; the text names the file and says what to change."""


def escape_unprintable(text: str) -> str:
    """A text in a line, with unprintable characters escaped."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


def read_text(path: Path, most_bytes: int, what: str) -> str:
    """Text of a regular UTF-8 file, without a byte order mark; see `read_bytes`, `decode_text`."""
    return decode_text(path, read_bytes(path, most_bytes, what))


def read_bytes(path: Path, most_bytes: int, what: str) -> bytes:
    """Content of a regular file.

    A pipe or a device, which may never end, is refused without reading. `what` names the expected
    file in error texts: ``a scene file``. Raises `FileError` when the file cannot be read, or has
    more than `most_bytes`.
    """
    with open_regular_file(path, what) as file, _as_unreadable(path, what):
        raw = file.read(most_bytes + 1)
        size = max(len(raw), os.fstat(file.fileno()).st_size)
    if size > most_bytes:
        raise FileError(
            f"{path}: has {size} bytes, more than {most_bytes}; give the path of {what}"
        )
    return raw


def decode_text(path: Path, raw: bytes) -> str:
    """The text of a file's content, without a byte order mark; `FileError` if it is not UTF-8."""
    require_utf8_lines(raw, str(path))
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        text = f"{path}: line {line} is not UTF-8 text; save the file as UTF-8"
        raise FileError(text) from None


def require_utf8_lines(raw: bytes, name: str) -> None:
    """Raise `FileError` for a text, or a first line, in UTF-16, or whose lines end in CR alone."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")) or raw[:2].count(0) == 1:
        raise FileError(f"{name}: is UTF-16 text; save the file as UTF-8")
    if b"\r" in raw.removesuffix(b"\r") and b"\n" not in raw:
        raise FileError(f"{name}: has lines that end in CR alone; save the file with LF or CR LF")


def read_csv_rows(lines: Iterable[str], header: str) -> Iterator[list[str]]:
    """Rows in a CSV file with this first line. Where the line has semicolons and no comma
    (spreadsheets with decimal commas), commas become points."""
    semicolons = ";" in header and "," not in header
    for row in csv.reader(lines, delimiter=";" if semicolons else ",", strict=True):
        yield [_DECIMAL_COMMA.sub(r"\1.\2", cell) for cell in row] if semicolons else row


@contextmanager
def open_regular_file(path: Path, what: str) -> Iterator[BinaryIO]:
    """A context with a regular file that is open for reading; `read_text` has the details."""
    with _as_unreadable(path, what):
        # without O_NONBLOCK, opening a pipe waits for a writer
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        file = open(descriptor, "rb")  # noqa: SIM115
    with file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise FileError(f"{path}: is no regular file; give the path of {what}")
        yield file


@contextmanager
def _as_unreadable(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except FileError:
        raise
    except (OSError, ValueError) as error:  # the latter for a null character in the path
        reason = getattr(error, "strerror", error)
        text = f"{path}: cannot be read ({reason}); give the path of {what}"
        raise FileError(text) from None


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """A context with the path of a temporary file, which replaces `path` at the end.

    A file that is replaced leaves its permissions and, where possible, its owner to the new one.
    After an exception the temporary file is removed, and `path` stays as it was. Raises `FileError`
    when the file cannot be written.
    """
    with _as_file_error(path):
        temporary = _beside(path)
        try:
            yield temporary
            with suppress(FileNotFoundError):
                copy_permissions(path, temporary)
            temporary.replace(os.path.realpath(path))  # a symbolic link stays one
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def copy_permissions(path: Path, other: Path) -> None:
    """Give a file the permissions of a second file and, if the system permits, its owner."""
    status = path.stat()
    if hasattr(os, "chown"):
        with suppress(OSError):
            os.chown(other, status.st_uid, status.st_gid)
    with suppress(PermissionError, FileNotFoundError):
        other.chmod(stat.S_IMODE(status.st_mode))


def require_writable(path: Path, *others: Path | None) -> None:
    """Raise `FileError` for a path that `replace_file` could not write, or a path in `others`."""
    require_distinct(path, *others)
    with _as_file_error(path):
        temporary = _beside(path)
        temporary.touch()
        temporary.unlink()


def require_distinct(path: Path, *others: Path | None) -> None:
    """Raise `FileError` for a path that would overwrite a file in `others`, under every name."""
    for other in others:
        if other is not None and is_same_file(path, other):
            raise FileError(
                f"{path}: would overwrite {other}, which is the same file; name another"
            )


def is_same_file(path: Path, other: Path) -> bool:
    """Whether two paths lead to the same file or directory, also through links."""
    try:
        return os.path.samefile(path, other)
    except OSError:  # one does not exist
        return os.path.realpath(path) == os.path.realpath(other)


def make_directory(path: Path, first: str, *others: Path) -> None:
    """Make a directory and its parents for files that may not overwrite `others`.

    Raises `FileError` when the directory cannot be made or holds a file in `others`, or when the
    file named `first` could not be written.
    """
    for other in others:
        if is_same_file(path, other.parent):
            raise FileError(f"{path}: holds {other.name}, which is read; name another directory")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        text = f"{path}: cannot be made a directory ({error.strerror}); name another"
        raise FileError(text) from None
    require_writable(path / first)


def _beside(path: Path) -> Path:
    """A temporary name beside a file; raises `FileError` if the file may not be replaced."""
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
