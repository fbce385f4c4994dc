"""The text of a scene file: TOML with limits on its size, and the format of error messages."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pvdf_fem.files import FileError, escape_unprintable, read_text

MAX_BYTES = 1_000_000  #: Maximum size of a scene file in bytes.

# Keys of ten and more names are refused, since tomllib's time grows with the square of their
# number; a scene needs two.
_LONG_KEY = re.compile(
    r"""(?:^|[\[{,])[ \t]*(?:(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)[ \t]*\.[ \t]*){9}""", re.MULTILINE
)
# Words, names of files and paths, which need no quotes as values on the command line.
_BARE_TEXT = re.compile(r"[./~]*[^\W\d][\w ./:\\~-]*")
# Lists of tables, whose headings are in double brackets.
_REPEATED_TABLES = {"axes", "electrodes", "probe", "film.patches"}


class SceneError(ValueError):
    """Errors of a scene.

    Attributes
    ----------
    problems : tuple of str
        A line for each error, of the form ``key = value: reason; advice``.
    source : str
        Path of the file or name of the text that has the errors; may be empty.

    Examples
    --------
    >>> try:
    ...     Scene(film={"thickness_um": -25.0})
    ... except SceneError as error:
    ...     print(error.problems)
    """

    def __init__(self, problems: Iterable[str], source: str = "") -> None:
        self.problems = tuple(map(escape_unprintable, problems))
        self.source = source
        super().__init__(self.problems, source)

    def __str__(self) -> str:
        head = f"{self.source} is not a valid scene" if self.source else "not a valid scene"
        return "\n  ".join([f"{head}:", *self.problems])


def read_scene_text(path: Path | str) -> str:
    """Read the text of a scene file.

    Parameters
    ----------
    path : Path or str
        Path of a UTF-8 file of at most `MAX_BYTES` bytes.

    Returns
    -------
    str

    Raises
    ------
    SceneError
        If `path` is not a path, or the file cannot be read or is too large.
    """
    if not isinstance(path, str | Path):
        raise SceneError([format_error("path", path, "is not a path; give the name of a file")])
    try:
        return read_text(Path(path), MAX_BYTES, "a scene file")
    except FileError as error:
        raise SceneError([str(error)], str(path)) from None


def read_examples() -> dict[str, str]:
    """Return the texts of the package's examples (scenes, sweeps and reports) by file name."""
    paths = sorted(Path(__file__).parents[1].joinpath("examples").glob("*.toml"))
    return {path.stem: path.read_text("utf-8") for path in paths}


def get_example_text(name: str, files: Mapping[str, str]) -> str:
    """Return the text with a name in `files`; raise `SceneError` with advice for other names."""
    if name not in files:
        raise SceneError([f"{quote(name)}: is not an example; {suggest(name, list(files))}"])
    return files[name]


class KeyText(NamedTuple):
    """A key of a scene file with its meaning."""

    table: str  #: Heading of the table, such as ``[film]``.
    name: str
    text: str  #: Comment lines with the meaning, and a line with the default or an example.


def read_key_texts() -> Iterator[KeyText]:
    """Yield all keys of a scene file with their meanings, from the example ``four_electrodes``."""
    table = ""
    lines: list[str] = []
    for line in read_examples()["four_electrodes"].splitlines():
        # headings and keys that are not in use are commented out with # and no blank
        heading = re.match(r"#?(\[+[\w.]+\]+)", line)
        key = re.match(r'#?"?([\w.]+)"? = ', line)
        if heading:
            table = heading[1]
            lines = []
        elif key:
            yield KeyText(table, key[1], text="\n".join([*lines, line]))
            lines = []
        elif line.startswith("# "):
            lines.append(line)
        else:
            lines = []


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse a TOML text, unless it is too long or has keys of ten or more names.

    Parameters
    ----------
    text : str
        TOML with at most as many characters as the number `MAX_BYTES`.
    source : str
        Name of the text in error messages.

    Returns
    -------
    dict

    Raises
    ------
    SceneError
        If the text is not a text, is too long, is not TOML, is nested too deeply or has an integer
        of thousands of digits. Only the first error is described, with its line if it is known.
    """
    if not isinstance(text, str):
        reason = "is not text; give the TOML of a scene file"
        raise SceneError([format_error("text", text, reason)])
    # a file of MAX_BYTES bytes has at most as many characters, so none of these is refused
    if len(text) > MAX_BYTES:
        reason = f"has {len(text)} characters, more than {MAX_BYTES}; give a shorter text"
        raise SceneError([f"{source}: {reason}"], source)
    too_deep = f"{source}: tables or lists are nested too deeply; a scene needs two levels"
    long_key = _LONG_KEY.search(text)
    if long_key:
        line = text.count("\n", 0, long_key.end()) + 1
        raise SceneError([f"{too_deep} (line {line})"], source)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SceneError([too_deep], source) from None
    except tomllib.TOMLDecodeError as error:
        # for a repeated heading the message is "Cannot declare ('film', 'patches') twice (at ...)"
        key = ".".join(re.findall(r"'([\w-]+)'", str(error)))
        advice = "correct this line"
        if "Invalid value" in str(error):
            advice = "write a number, a text in quotes, true, false or a list in brackets there"
        if key in _REPEATED_TABLES:
            advice = f"begin each of these tables with [[{key}]]"
        problem = f"{source}: is not valid TOML: {str(error)[:300]}; {advice}"
        raise SceneError([problem], source) from None
    except ValueError:  # Python refuses to convert integers with thousands of digits
        problem = f"{source}: has an integer of thousands of digits; give a smaller number"
        raise SceneError([problem], source) from None


def format_toml(table: Mapping[str, Any]) -> str:
    """Format tables as a TOML text.

    Parameters
    ----------
    table : mapping of str to mapping or list of mappings
        Tables and lists of tables by name. Their values are scalars, lists and inner tables, which
        are written in one line each.

    Returns
    -------
    str
    """
    blocks = []
    for name, content in table.items():
        is_list = isinstance(content, list)
        heading = f"[[{name}]]" if is_list else f"[{name}]"
        for row in content if is_list else [content]:
            lines = [heading]
            for key, value in row.items():
                lines.append(f"{_format_key(key)} = {format_toml_value(value)}")
            blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _format_key(name: str) -> str:
    """Return a key as TOML, in quotes if it has characters that a bare key must not have."""
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else format_toml_value(name)


def flatten(table: Any, prefix: str = "", *, lists: bool = False) -> Any:
    """Flatten nested tables to values by dotted key.

    Parameters
    ----------
    table : mapping or object
        Nested tables. Any other value is returned unchanged.
    prefix : str
        Text that is put before each key; for recursive calls.
    lists : bool
        Whether to flatten lists of tables, too, with keys such as ``probe[0].x_mm``; otherwise a
        list is a value.

    Returns
    -------
    dict or object
        Values by keys such as ``film.thickness_um``; empty tables have no values.
    """
    if not isinstance(table, Mapping):
        return table
    flat: dict[str, Any] = {}
    for key, value in table.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping):
            flat |= flatten(value, f"{name}.", lists=lists)
        elif lists and isinstance(value, list) and value and isinstance(value[0], Mapping):
            for number, row in enumerate(value):
                flat |= flatten(row, f"{name}[{number}].", lists=True)
        else:
            flat[name] = value
    return flat


def parse_change(text: str) -> tuple[str, Any]:
    """Parse a change of a scene, ``KEY=VALUE``, as it is given on the command line.

    Parameters
    ----------
    text : str
        The key, an equals sign, and the value as TOML, or as words or a path without quotes.

    Returns
    -------
    key : str
        The key; whether a scene has it is not checked.
    value : object
        The value that the TOML has, or the words as a text.

    Raises
    ------
    SceneError
        If the text does not have this form.
    """
    shown = text if len(text) <= 80 else f"{text[:77]}..."
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        reason = "is not a change; write KEY=VALUE, such as load.force_N=2"
        raise SceneError([f"{shown}: {reason}"])
    try:
        table = parse_toml(f"value = {value}", "")
    except SceneError:
        table = {}
    if list(table) == ["value"]:
        return key, table["value"]
    if _BARE_TEXT.fullmatch(value):
        return key, value
    reason = "the value is not TOML; write a number, a word, [...] or '\"...\"'"
    raise SceneError([f"{shown}: {reason}"])


def format_toml_value(value: Any) -> str:
    """Format a text, boolean, number, list or table as TOML in one line."""
    if isinstance(value, str):
        # the escapes of JSON are valid in TOML, and other printable characters need none
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(format_toml_value, value))}]"
    if isinstance(value, Mapping):
        items = [
            f"{format_toml_value(str(key))} = {format_toml_value(item)}"
            for key, item in value.items()
        ]
        return f"{{ {', '.join(items)} }}"
    return repr(value)


def quote(value: Any, depth: int = 0) -> str:
    """Write a value as in a scene file, in at most 60 characters, for an error message.

    Parameters
    ----------
    value : object
        Any value. Long texts and long or deeply nested lists are shortened, and tables and huge
        integers are described in words.
    depth : int
        Number of lists around the value; for recursive calls.

    Returns
    -------
    str
    """
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, int) and value.bit_length() > 128:
        text = f"an integer of {value.bit_length()} bits"
    elif isinstance(value, str):
        text = json.dumps(value[:60], ensure_ascii=False)
    elif isinstance(value, Mapping):
        text = "a table"
    elif isinstance(value, list | tuple):
        items = [quote(item, depth + 1) for item in value[:10]] if depth < 3 else ["..."]
        text = f"[{', '.join(items)}]"
    elif isinstance(value, float | int):
        text = repr(value)
    else:
        text = str(value).partition("\n")[0]
    return text if len(text) <= 60 else text[:57] + "..."


def format_error(key: str, value: Any, reason: str) -> str:
    """Format an error as ``key = value: reason``.

    Parameters
    ----------
    key : str
        Key of a scene, or name of an argument.
    value : object
        The value, which is quoted in at most 60 characters.
    reason : str
        ``reason; advice``: what is wrong, and what to do.

    Returns
    -------
    str
    """
    return f"{key} = {quote(value)}: {reason}"


def suggest(word: Any, known: Sequence[str]) -> str:
    """Suggest valid words instead of an invalid one.

    Parameters
    ----------
    word : object
        The invalid word, or a value of another type.
    known : sequence of str
        The valid words.

    Returns
    -------
    str
        A question with the most similar valid word. If there is none, a question with the valid
        words that begin with the invalid one and an underscore, such as ``d31_pC_N`` for ``d31``.
        If there are none either, a list of all valid words.
    """
    if isinstance(word, str) and word:
        similar = difflib.get_close_matches(word, known, n=1)
        longer = [other for other in known if other.startswith(f"{word}_")]
        if similar or longer:
            return f"did you mean {' or '.join(similar or longer)}?"
    return f"choose from {', '.join(known)}"
