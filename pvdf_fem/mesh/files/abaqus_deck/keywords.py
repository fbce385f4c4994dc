"""The keyword blocks of an input deck of Abaqus or CalculiX, with the files that it includes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from pvdf_fem.files import FileError, open_regular_file, require_utf8_lines
from pvdf_fem.mesh.files.content import MeshFileError

# More files within files come from files that include each other.
_MOST_NESTED_FILES = 8
# Commas that are not inside of double quotes.
_COMMA = re.compile(r',(?=(?:[^"]*"[^"]*")*[^"]*$)')
# Keywords whose data lines may be in another file, which INPUT names.
_WITH_INPUT = ("NODE", "ELEMENT")


@dataclass(frozen=True)
class DataLine:
    """A data line."""

    place: str  #: File and line number, for messages.
    text: str


@dataclass(frozen=True)
class KeywordBlock:
    """A keyword with its parameters and data lines.

    Parameters
    ----------
    name : str
        The keyword in capital letters without blanks and asterisk, such as ``ENDPART``.
    parameters : dict of str to str
        Values by name in capital letters; the value is empty if a parameter has none.
    place : str
        File and line number of the keyword, for messages.
    lines : list of DataLine
        The data lines, without comments and empty lines.
    """

    name: str
    parameters: dict[str, str]
    place: str
    lines: list[DataLine] = field(default_factory=list)


def read_keyword_blocks(path: Path) -> Iterator[KeywordBlock]:
    """Yield the keyword blocks of an input deck.

    Parameters
    ----------
    path : Path
        The deck. Paths of included files are relative to its folder.

    Yields
    ------
    KeywordBlock

    Raises
    ------
    MeshFileError
        If an included file cannot be read, or if files include each other.
    FileError
        If the deck cannot be read.
    """
    block = None
    for line in _read_lines(path, path.parent, depth=0):
        if not line.text.startswith("*"):
            if block is not None:
                block.lines.append(line)
            continue
        if block is not None:
            yield block
        block = _parse_keyword(line)
        if block.name in _WITH_INPUT and "INPUT" in block.parameters:
            block.lines.extend(_read_included(block, path.parent, depth=1))
    if block is not None:
        yield block


def split_fields(text: str) -> list[str]:
    """Split a line at its commas into fields without surrounding blanks and quotes.

    Parameters
    ----------
    text : str
        The line.

    Returns
    -------
    list of str
        The fields; commas within double quotes do not separate them.
    """
    return [part.strip().strip('"') for part in _COMMA.split(text)]


def _read_lines(path: Path, folder: Path, depth: int) -> Iterator[DataLine]:
    """Yield keyword lines, each with its continuation, and data lines of a deck.

    Parameters
    ----------
    path : Path
        The file.
    folder : Path
        Folder to which the paths of included files are relative.
    depth : int
        Number of files that include this one.

    Yields
    ------
    DataLine
        A keyword line or data line; ``*INCLUDE`` is replaced by the lines of the other file.
    """
    with open_regular_file(path, "a mesh file") as file:
        content = file.read()
    require_utf8_lines(content, path.name)
    keyword: DataLine | None = None  # a keyword line that is continued
    for number, raw in enumerate(content.decode("utf-8-sig", "replace").splitlines(), start=1):
        text = raw.strip()
        if not text or text.startswith("**"):
            continue
        line = DataLine(f"{path.name}, line {number}", text)
        if keyword is not None:
            line = DataLine(keyword.place, keyword.text + text)
            keyword = None
        if line.text.startswith("*") and line.text.endswith(","):
            keyword = line
            continue
        block = _parse_keyword(line) if line.text.startswith("*") else None
        if block is not None and block.name == "INCLUDE":
            yield from _read_included(block, folder, depth=depth + 1)
        else:
            yield line
    if keyword is not None:
        yield keyword


def _read_included(block: KeywordBlock, folder: Path, depth: int) -> Iterator[DataLine]:
    """Yield the lines of the file that the parameter INPUT of a keyword names.

    Parameters
    ----------
    block : KeywordBlock
        The keyword.
    folder : Path
        Folder to which the path of the file is relative.
    depth : int
        Number of files that include it.
    """
    name = block.parameters.get("INPUT", "")
    if not name:
        raise MeshFileError(f"{block.place}: *{block.name}: names no file; give INPUT=file")
    if depth > _MOST_NESTED_FILES:
        reason = "files include each other; remove one of these keywords"
        raise MeshFileError(f"{block.place}: *{block.name}, INPUT={name}: {reason}")
    try:
        yield from _read_lines(folder / name, folder, depth=depth)
    except MeshFileError:
        raise
    except FileError as error:
        raise MeshFileError(
            f"{block.place}: *{block.name}, INPUT={name}: {error}; copy the file beside the deck"
        ) from error


def _parse_keyword(line: DataLine) -> KeywordBlock:
    """Parse a keyword line."""
    first, *others = _COMMA.split(line.text.lstrip("*"))
    parameters = {}
    for part in others:
        name, _, value = part.partition("=")
        parameters["".join(name.split()).upper()] = value.strip().strip('"')
    return KeywordBlock("".join(first.split()).upper(), parameters, place=line.place)
