"""Reading input files up to a maximum size, and writing output files atomically."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO


class FileError(ValueError):
    """A file that cannot be read or written; the message says which file and what to change."""


def escape_unprintable(text: str) -> str:
    """Escape unprintable characters of a text, including line ends."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


# --------------------------------------------------------------------------------------- reading


def read_text(path: Path, max_bytes: int, description: str) -> str:
    """Read a regular UTF-8 file as text, without its byte order mark.

    Parameters
    ----------
    path, max_bytes, description
        See `read_bytes`.

    Returns
    -------
    str
        The text.

    Raises
    ------
    FileError
        If the file cannot be read, has more than `max_bytes`, or is not UTF-8.
    """
    return decode_text(path, read_bytes(path, max_bytes, description))


def read_bytes(path: Path, max_bytes: int, description: str) -> bytes:
    """Read the content of a regular file.

    Parameters
    ----------
    path : Path
        The file.
    max_bytes : int
        Maximum size of the file.
    description : str
        Words for the expected file in error messages, such as ``a scene file``.

    Returns
    -------
    bytes
        The content.

    Raises
    ------
    FileError
        If the file cannot be read or has more than `max_bytes`, or if it is a pipe or a device,
        which may never end.
    """
    with open_regular_file(path, description) as file, _convert_read_errors(path, description):
        content = file.read(max_bytes + 1)
        size = max(len(content), os.fstat(file.fileno()).st_size)
    if size > max_bytes:
        raise FileError(
            f"{path}: has {size} bytes, more than {max_bytes}; give the path of {description}"
        )
    return content


def decode_text(path: Path, content: bytes) -> str:
    """Decode the content of a file as UTF-8, without its byte order mark.

    Raises `FileError` with the line number if the content is not UTF-8.
    """
    require_utf8_lines(content, str(path))
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content.count(b"\n", 0, error.start) + 1
        raise FileError(f"{path}: line {line} is not UTF-8 text; save the file as UTF-8") from None


def require_utf8_lines(content: bytes, name: str) -> None:
    """Raise `FileError` if a text is UTF-16, or if its lines end in CR alone.

    Parameters
    ----------
    content : bytes
        The content of a file, or only its first line.
    name : str
        Name of the file for error messages.
    """
    has_byte_order_mark = content.startswith((b"\xff\xfe", b"\xfe\xff"))
    has_null_byte = content[:2].count(0) == 1  # one of two bytes of an ASCII letter
    if has_byte_order_mark or has_null_byte:
        raise FileError(f"{name}: is UTF-16 text; save the file as UTF-8")
    if b"\r" in content.removesuffix(b"\r") and b"\n" not in content:
        raise FileError(f"{name}: has lines that end in CR alone; save the file with LF or CR LF")


@contextmanager
def open_regular_file(path: Path, description: str) -> Iterator[BinaryIO]:
    """Open a regular file for reading within this context.

    Parameters
    ----------
    path, description
        See `read_bytes`.

    Yields
    ------
    file object
        The file, in binary mode.

    Raises
    ------
    FileError
        If the file cannot be read, or is a pipe or a device.
    """
    with _convert_read_errors(path, description):
        # without O_NONBLOCK, opening a pipe waits for a writer
        descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        file = open(descriptor, "rb")  # noqa: SIM115
    with file:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            raise FileError(f"{path}: is not a regular file; give the path of {description}")
        yield file


@contextmanager
def _convert_read_errors(path: Path, description: str) -> Iterator[None]:
    """Convert errors of the system in this context to `FileError`."""
    try:
        yield
    except FileError:
        raise
    except (OSError, ValueError) as error:  # ValueError for a null character in the path
        reason = getattr(error, "strerror", error)
        raise FileError(
            f"{path}: cannot be read ({reason}); give the path of {description}"
        ) from None


# --------------------------------------------------------------------------------------- writing


@contextmanager
def replace_file(path: Path) -> Iterator[Path]:
    """Create or replace a file at the end of this context.

    The new file gets the permissions and, if possible, the owner of the old one. If the context
    raises an exception, the old file remains unchanged.

    Parameters
    ----------
    path : Path
        File to create or replace.

    Yields
    ------
    Path
        Path of a temporary file in the same folder, to which the content is written.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    with _convert_write_errors(path):
        temporary = _make_temporary_path(path)
        try:
            yield temporary
            with suppress(FileNotFoundError):
                copy_permissions(path, temporary)
            temporary.replace(os.path.realpath(path))  # a symbolic link is kept
        finally:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)


def copy_permissions(source: Path, target: Path) -> None:
    """Copy the permissions of a file and, if the system allows it, its owner to another file.

    Parameters
    ----------
    source : Path
        File whose permissions are copied.
    target : Path
        File to change. Nothing happens if it does not exist.
    """
    status = source.stat()
    if hasattr(os, "chown"):
        with suppress(OSError):
            os.chown(target, status.st_uid, status.st_gid)
    with suppress(PermissionError, FileNotFoundError):
        target.chmod(stat.S_IMODE(status.st_mode))


def require_writable(path: Path, *inputs: Path | str | None) -> None:
    """Raise `FileError` if a file cannot be written by `replace_file` or is one of `inputs`."""
    require_distinct(path, *inputs)
    with _convert_write_errors(path):
        temporary = _make_temporary_path(path)
        temporary.touch()
        temporary.unlink()


def require_distinct(path: Path, *inputs: Path | str | None) -> None:
    """Raise `FileError` if a file is the same as one of `inputs`, also through links."""
    for other in inputs:
        if other is not None and is_same_file(path, other):
            raise FileError(
                f"{path}: would overwrite {other}, which is the same file; give another name"
            )


def is_same_file(path: Path | str, other: Path | str) -> bool:
    """Return whether two paths refer to the same file or directory, also through links."""
    try:
        return os.path.samefile(path, other)
    except OSError:  # one does not exist
        return os.path.realpath(path) == os.path.realpath(other)


def make_directory(path: Path, first: str, *inputs: Path) -> None:
    """Create an output directory with its parents, unless it exists.

    Parameters
    ----------
    path : Path
        The directory.
    first : str
        Name of a file in it, for which writing is tested.
    *inputs : Path
        Input files, which must not be in this directory.

    Raises
    ------
    FileError
        If the directory cannot be created, if it contains one of `inputs`, or if the file `first`
        cannot be written.
    """
    for other in inputs:
        if is_same_file(path, other.parent):
            raise FileError(f"{path}: contains the input file {other.name}; give another directory")
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(
            f"{path}: cannot be created as a directory ({error.strerror}); give another name"
        ) from None
    require_writable(path / first)


def _make_temporary_path(path: Path) -> Path:
    """Return a temporary path beside a file; raise `FileError` if the file cannot be replaced."""
    if path.exists():
        if not path.is_file():
            raise FileError(f"{path}: is not a regular file; give another name")
        if not os.access(path, os.W_OK):
            raise FileError(f"{path}: is write-protected; give another name")
    target = Path(os.path.realpath(path))
    return target.with_name(f".{target.stem[:50]}-{os.getpid()}{path.suffix}")


@contextmanager
def _convert_write_errors(path: Path) -> Iterator[None]:
    """Convert errors of the system in this context to `FileError`."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or error
        raise FileError(f"{path}: cannot be written ({reason}); give another name") from error
