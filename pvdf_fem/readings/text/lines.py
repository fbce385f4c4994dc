"""Lines of text in files and live streams, in any of the usual encodings."""

from __future__ import annotations

import codecs
import re
from collections.abc import Iterator
from typing import BinaryIO

from pvdf_fem.files import FileError

MAX_ROW_BYTES = 1 << 20  #: Maximum size of a line.
CHUNK_BYTES = 1 << 18  #: Maximum number of bytes that are read at once; a pipe may return fewer.
UTF16_BYTES = 4  #: Number of bytes by which UTF-16 is recognised.
_UTF16_BYTE_ORDER_MARKS = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}
_LINE_ENDS = re.compile(rb"[\r\n]+")


def read_lines(stream: BinaryIO, name: str) -> Iterator[list[str]]:
    """Yield lists of the lines that have arrived since the previous list, without blank lines.

    Lines end with LF, CR LF, or CR. A text that begins like UTF-16 is read as UTF-16. Otherwise
    each line is decoded by `decode_line`, since spreadsheets and older loggers do not write UTF-8.

    Parameters
    ----------
    stream : binary file
        A file or a pipe.
    name : str
        Its name, for messages.

    Yields
    ------
    list of str
        Lines without their ends.

    Raises
    ------
    FileError
        If a line is longer than `MAX_ROW_BYTES`.
    """
    rest = b""
    for chunk in _read_utf8_chunks(stream):
        *lines, rest = _LINE_ENDS.split(rest + chunk)
        if len(rest) > MAX_ROW_BYTES:
            raise FileError(f"{name}: has a line of more than {MAX_ROW_BYTES} bytes; give a table")
        texts = [decode_line(line) for line in lines if line.strip()]
        if texts:
            yield texts
    if rest.strip():
        yield [decode_line(rest)]


def _read_utf8_chunks(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the bytes of a text as they arrive; those of UTF-16 are converted to UTF-8."""
    first = b""
    for chunk in _read_chunks(stream):
        first += chunk
        if len(first) >= UTF16_BYTES:
            break
    encoding = find_utf16_encoding(first)
    if encoding is None:
        yield first.removeprefix(codecs.BOM_UTF8)
        yield from _read_chunks(stream)
        return
    decoder = codecs.getincrementaldecoder(encoding)("replace")
    yield decoder.decode(first).removeprefix("\ufeff").encode()
    for chunk in _read_chunks(stream):
        yield decoder.decode(chunk).encode()


def _read_chunks(stream: BinaryIO) -> Iterator[bytes]:
    """Yield the bytes of a stream as they arrive."""
    while True:
        chunk: bytes = stream.read1(CHUNK_BYTES)  # type: ignore[attr-defined]
        if not chunk:
            return
        yield chunk


def find_utf16_encoding(first: bytes) -> str | None:
    """Return the encoding of a text that begins like UTF-16, and None for any other text.

    Parameters
    ----------
    first : bytes
        The first bytes of the text, `UTF16_BYTES` if it has so many. Either they begin with a byte
        order mark, or every second one is null, as in UTF-16 of ASCII characters.
    """
    if first[:2] in _UTF16_BYTE_ORDER_MARKS:
        return _UTF16_BYTE_ORDER_MARKS[first[:2]]
    nulls = [byte == 0 for byte in first[:UTF16_BYTES]]
    if nulls == [False, True, False, True]:
        return "utf-16-le"
    if nulls == [True, False, True, False]:
        return "utf-16-be"
    return None


def decode_line(line: bytes) -> str:
    """Decode a line as UTF-8, or else as Windows-1252 or Latin-1."""
    for encoding in ("utf-8", "cp1252"):
        try:
            return line.decode(encoding)
        except UnicodeDecodeError:
            continue
    return line.decode("latin-1")
