"""The keys of a report script: its head, its sections, and lines about other reports."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import AfterValidator, Field

from pvdf_fem.scene.keys import Section, make_validation_error

MAX_WORDS = 120  #: Maximum number of words in a text.
Table = dict[str, Any]


def _check_word_count(text: str) -> str:
    """Return the text unchanged; raise a validation error if it has too many words."""
    count = len(text.split())
    if count > MAX_WORDS:
        raise make_validation_error(f"has {count} words, more than {MAX_WORDS}; shorten it")
    return text


Title = Annotated[str, Field(min_length=1, max_length=100)]
Text = Annotated[str, AfterValidator(_check_word_count)]


class ScriptSection(Section):
    """A section of the page: a `title`, a sentence or two in `text`, figures and tables.

    Consecutive sections with the same `part` have a common heading with this text.
    """

    title: Title
    text: Text = ""
    part: str = ""
    figure: tuple[Table, ...] = ()
    table: tuple[Table, ...] = ()


class Other(Section):
    """A line about another report, with its `title` and the path of its `page`.

    The path is relative to the folder of this page. The line quotes the verdict of the other page.
    If that page does not exist, the line says `how` to make it.
    """

    title: Title
    page: Annotated[str, Field(min_length=1)]
    how: Text


class Script(Section):
    """The keys of a report script.

    `title` is the title of the page and `text` an introduction below it. `scene` is the path of a
    scene file, relative to the script, or a table of scene keys. Alternatively, `example` names an
    example scene of the package. `data`, `section` and `other` are tables with the readings, the
    sections of the page, and other reports.
    """

    title: Title
    text: Text = ""
    scene: str | Table | None = Field(None, union_mode="left_to_right")
    example: str | None = None
    data: dict[str, Table] = Field(default_factory=dict)
    section: Annotated[tuple[Table, ...], Field(min_length=1)]
    other: tuple[Table, ...] = ()
