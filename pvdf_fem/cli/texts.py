"""The commands ``pvdf-fem example`` and ``pvdf-fem keys``, which print texts."""

from __future__ import annotations

import argparse
import re
from itertools import groupby
from typing import Any

from pvdf_fem.cli.options import MAX_QUOTED, add_command
from pvdf_fem.cli.program import ExitCode, InputError
from pvdf_fem.scene.scene_file import get_example_text, read_examples, read_key_texts, suggest

_EXAMPLE = """\
Print a scene file, sweep file or report script that comes with the package. Without
a name, list them."""

_EXAMPLE_EPILOG = """\
example:
  pvdf-fem example triangle > triangle.toml

exit codes: 0 printed, 2 no example of this name"""

_KEYS = """\
Print a scene file with every key: its meaning, its range, and its default or an
example. With words, print only the keys in whose names or meanings a word begins
with at least one of them."""

_KEYS_EPILOG = """\
examples:
  pvdf-fem keys > scene.toml
  pvdf-fem keys force tension

exit codes: 0 printed, 2 no key has such a word"""


def add_parser(commands: Any) -> None:
    """Add the parsers of ``pvdf-fem example`` and ``keys`` to `commands`."""
    example = add_command(
        commands,
        "example",
        _print_example,
        summary="files to begin with",
        description=_EXAMPLE,
        epilog=_EXAMPLE_EPILOG,
    )
    example.add_argument(
        "name", metavar="NAME", nargs="?", help="name of an example; without it, all are listed"
    )
    keys = add_command(
        commands,
        "keys",
        _print_keys,
        summary="meanings of the keys of a scene file",
        description=_KEYS,
        epilog=_KEYS_EPILOG,
    )
    keys.add_argument(
        "words", metavar="WORD", nargs="*", help="the beginning of a word to search for"
    )


def _print_example(options: argparse.Namespace) -> int:
    """Print the text of an example, or without a name all names with the first lines.

    Raises
    ------
    SceneError
        If there is no example of this name.
    """
    examples = read_examples()
    if options.name is not None:
        print(get_example_text(options.name, examples), end="")
        return ExitCode.CONVERGED
    width = max(len(name) for name in examples)
    for name, text in examples.items():
        first_line = text.splitlines()[0].lstrip("# ")
        print(f"{name:<{width}}  {first_line}")
    return ExitCode.CONVERGED


def _print_keys(options: argparse.Namespace) -> int:
    """Print a scene file with all keys, or the texts of the keys that match one of the words.

    A key matches if a word of its table, its name or its text begins with the word searched for.

    Raises
    ------
    InputError
        If no key matches.
    """
    if not options.words:
        print(read_examples()["four_electrodes"], end="")
        return ExitCode.CONVERGED
    # match the beginning of a word, or of a part of a name between underscores
    beginnings = [rf"(?<![^\W_]){re.escape(word.casefold())}" for word in options.words]
    pattern = re.compile("|".join(beginnings))
    keys = list(read_key_texts())
    matches = [key for key in keys if pattern.search(f"{key.table} {key.text}".casefold())]
    if not matches:
        word = options.words[0]
        names = list(dict.fromkeys(key.name for key in keys))
        near = suggest(word.casefold(), names)
        raise InputError(f"{word[:MAX_QUOTED]}: is in no name or description of a key; {near}")
    for table, group in groupby(matches, lambda key: key.table):
        print(table)
        for key in group:
            print(key.text)
        print()
    return ExitCode.CONVERGED
