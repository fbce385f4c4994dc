"""The text of a scene file: TOML read with bounds, written, and quoted in complaints."""

from __future__ import annotations

import difflib
import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from pvdf_fem.files import FileError, escape_unprintable, read_text

MOST_BYTES = 1_000_000  #: Largest scene file in bytes.

# tomllib's time grows with the square of the number of names in a dotted key; a scene needs
# two of them.
_LONG_KEY = re.compile(
    r"""(?:^|[\[{,])[ \t]*(?:(?:"[^"\n]*"|'[^'\n]*'|[\w-]+)[ \t]*\.[ \t]*){9}""", re.MULTILINE
)

_LISTS = {"axes", "electrodes", "probe", "film.patches"}  #: Keys of which there may be several.


class SceneError(ValueError):
    """A scene that cannot be simulated.

    Attributes
    ----------
    problems : tuple of str
        One line for each mistake: ``key = value: reason; what to change``.
    source : str
        Where the scene came from: a path, or empty.

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
    """The text of a scene file; SceneError unless a UTF-8 file with at most `MOST_BYTES`."""
    if not isinstance(path, str | Path):
        raise SceneError([format_error("path", path, "is no path; give the name of a file")])
    try:
        return read_text(Path(path), MOST_BYTES, "a scene file")
    except FileError as error:
        raise SceneError([str(error)], str(path)) from None


def read_examples() -> dict[str, str]:
    """The texts of the example files, scenes, sweeps and reports, by name."""
    paths = sorted(Path(__file__).parents[1].joinpath("examples").glob("*.toml"))
    return {path.stem: path.read_text("utf-8") for path in paths}


def get_example_text(name: str, files: Mapping[str, str]) -> str:
    """The text of an example file; SceneError with a suggestion for an unknown `name`."""
    if name not in files:
        raise SceneError([f"{quote(name)}: is no example; {suggest(name, list(files))}"])
    return files[name]


class KeyText(NamedTuple):
    """A key of a scene file with its meaning."""

    table: str  #: As its heading has it: ``[film]``.
    name: str
    text: str  #: The key with its default or an example, below lines of comment.


def read_key_texts() -> Iterator[KeyText]:
    """Scene keys from the example with every key."""
    table = ""
    lines: list[str] = []
    for line in read_examples()["four_electrodes"].splitlines():
        if heading := re.match(r"#?(\[+[\w.]+\]+)", line):
            table, lines = heading[1], []
        elif name := re.match(r'#?"?([\w.]+)"? = ', line):
            yield KeyText(table, name[1], "\n".join([*lines, line]))
            lines = []
        else:
            lines = [*lines, line] if line.startswith("# ") else []


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """The table in a TOML text; SceneError naming source and line for what is not TOML."""
    if not isinstance(text, str):
        raise SceneError([format_error("text", text, "is no text; give the TOML of a scene file")])
    if len(text) > MOST_BYTES:
        large = f"has {len(text)} characters, more than {MOST_BYTES}; a scene is small"
        raise SceneError([f"{source}: {large}, give another"], source)
    deep = f"{source}: tables or lists are nested too deeply; a scene needs two levels"
    if long_key := _LONG_KEY.search(text):
        line = text.count("\n", 0, long_key.end()) + 1
        raise SceneError([f"{deep} (line {line})"], source)
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SceneError([deep], source) from None
    except tomllib.TOMLDecodeError as error:
        key = ".".join(re.findall(r"'([\w-]+)'", str(error)))
        change = f"begin each of them with [[{key}]]" if key in _LISTS else "correct the file there"
        text = f"{source}: not TOML: {str(error)[:300]}; {change}"
        raise SceneError([text], source) from None
    except ValueError:  # of int(), whose digits are limited
        text = f"{source}: has an integer of thousands of digits; give a smaller number"
        raise SceneError([text], source) from None


def format_toml(table: Mapping[str, Any]) -> str:
    """TOML for a mapping of tables and lists of tables. Their values are scalars, lists and tables
    of scalars."""
    blocks = []
    for name, content in table.items():
        heading, rows = (
            (f"[[{name}]]", content) if isinstance(content, list) else (f"[{name}]", [content])
        )
        for row in rows:
            lines = [
                heading,
                *(f"{_key(k)} = {format_toml_value(value)}" for k, value in row.items()),
            ]
            blocks.append("\n".join(lines) + "\n")
    return "\n".join(blocks)


def _key(name: str) -> str:
    return name if re.fullmatch(r"[\w-]+", name, re.ASCII) else format_toml_value(name)


def flatten(table: Any, prefix: str = "", *, lists: bool = False) -> Any:
    """Values by dotted key in nested tables (TOML keys without quotes); with `lists` also in lists
    of tables, ``probe[0].x_mm``. In a change a list is a value."""
    if not isinstance(table, Mapping):
        return table
    flat: dict[str, Any] = {}
    for key, value in table.items():
        rows = value if lists and isinstance(value, list) else []
        if rows and isinstance(rows[0], Mapping):
            for i, row in enumerate(rows):
                flat |= flatten(row, f"{prefix}{key}[{i}].", lists=True)
            continue
        nested = isinstance(value, Mapping)
        name = f"{prefix}{key}"
        flat |= flatten(value, f"{name}.", lists=lists) if nested else {name: value}
    return flat


def parse_change(text: str) -> tuple[str, Any]:
    """Key and value of ``KEY=VALUE``, a value in TOML or a bare word; SceneError for no change."""
    shown = text if len(text) <= 80 else f"{text[:77]}..."
    key, equals, value = (part.strip() for part in text.partition("="))
    if not (key and equals and value):
        reason = "is no change; write KEY=VALUE, such as load.force_N=2"
        raise SceneError([f"{shown}: {reason}"])
    try:
        table = parse_toml(f"value = {value}", "")
    except SceneError:
        table = {}
    if list(table) == ["value"]:
        return key, table["value"]
    if re.fullmatch(r"[^\W\d][\w -]*", value):
        return key, value
    reason = "the value is not TOML; write a number, a word, [...] or '\"...\"'"
    raise SceneError([f"{shown}: {reason}"])


def format_toml_value(value: Any) -> str:
    """A scalar, list or table as TOML in a line."""
    if isinstance(value, str):
        # JSON's escapes are TOML's, and further printable characters stand for themselves
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return f"[{', '.join(map(format_toml_value, value))}]"
    if isinstance(value, Mapping):
        items = (
            f"{format_toml_value(str(key))} = {format_toml_value(item)}"
            for key, item in value.items()
        )
        return f"{{ {', '.join(items)} }}"
    return repr(value)


def quote(value: Any, depth: int = 0) -> str:
    """A value in scene file form, in at most 60 characters."""
    if isinstance(value, bool):
        text = str(value).lower()
    elif isinstance(value, int) and value.bit_length() > 128:
        text = f"an integer of {value.bit_length()} bits"
    elif isinstance(value, str):
        text = json.dumps(value[:60], ensure_ascii=False)
    elif isinstance(value, Mapping):
        text = "a table"
    elif isinstance(value, list | tuple):
        inner = [quote(item, depth + 1) for item in value[:10]] if depth < 3 else ["..."]
        text = f"[{', '.join(inner)}]"
    else:
        text = repr(value) if isinstance(value, float | int) else str(value).partition("\n")[0]
    return text if len(text) <= 60 else text[:57] + "..."


def format_error(key: str, value: Any, reason: str) -> str:
    """One complaint; `reason` names the mistake and the change to make."""
    return f"{key} = {quote(value)}: {reason}"


def suggest(word: Any, known: Sequence[str]) -> str:
    """Suggest known words in place of an unknown one.

    Parameters
    ----------
    word : object
        The unknown word; anything but text is similar to no word.
    known : sequence of str

    Returns
    -------
    str
        The most similar word, the words that begin with the unknown one, ``d31_pC_N`` for ``d31``,
        or all words.
    """
    if isinstance(word, str) and word:
        similar = difflib.get_close_matches(word, known, n=1)
        longer = [other for other in known if other.startswith(f"{word}_")]
        if similar or longer:
            return f"did you mean {' or '.join(similar or longer)}?"
    return f"choose from {', '.join(known)}"
