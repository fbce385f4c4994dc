"""The page of a report: one HTML file with its figures, which needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Self

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

from pvdf_fem import __version__
from pvdf_fem.reporting.kind import Content
from pvdf_fem.reporting.script import Item, ScriptSection

LONG_TABLE = 12  #: Rows of a table above which it is folded.
#: Ranks of kinds whose claims make the verdict, where there are any.
JUDGING = ("comparison", "positions")


@dataclass(frozen=True)
class Head:
    """What stands above all sections."""

    title: str
    text: str
    is_preview: bool
    todo: int  #: Scenes that are not solved yet.
    total: int


@dataclass(frozen=True)
class Entry:
    """A figure or table on the page, or what stands in its place."""

    name: str
    section: int
    kind: str
    title: str
    content: Content | None = None
    svg: str = ""
    error: str = ""
    remarks: tuple[str, ...] = ()

    @classmethod
    def pending(cls, item: Item) -> Self:
        """What stands for an item that is not solved yet."""
        return cls(item.name, item.section, str(getattr(item.kind, "kind", "")), item.kind.title)

    @property
    def picture(self) -> Markup:
        """The figure as a part of the page."""
        return Markup(inlined(self.svg, self.name))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the figure."""
        found = re.search(r'viewBox="0 0 ([\d.]+) ([\d.]+)"', self.svg)
        return (float(found[1]), float(found[2])) if found else (0.0, 0.0)

    @property
    def rows(self) -> list[list[tuple[str, str]]]:
        """Heads and cells of the table, row by row."""
        shown = None if self.content is None else self.content.shown
        if shown is None:
            return []
        heads = list(map(str, shown.columns))
        return [list(zip(heads, map(str, row), strict=True)) for row in shown.to_numpy()]

    @property
    def is_long(self) -> bool:
        """Whether the table is folded."""
        return len(self.rows) > LONG_TABLE


def inlined(svg: str, name: str) -> str:
    """An SVG file as an element of a page; its identifiers begin with a name, which is its own."""
    body = svg[svg.index("<svg") :]
    body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
    body = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
    opening = re.match(r"<svg[^>]*>", body)
    assert opening is not None
    view = re.search(r'viewBox="[^"]*"', opening[0])
    assert view is not None
    attributes = f'id="svg-{name}" {view[0]} role="img" xmlns="http://www.w3.org/2000/svg"'
    return f"<svg {attributes}>" + body[opening.end() :].rstrip()


@dataclass(frozen=True)
class Block:
    """A section on the page."""

    number: int
    section: ScriptSection
    entries: list[Entry]

    @property
    def anchor(self) -> str:
        """Its place on the page."""
        words = re.sub(r"[^a-z0-9]+", "-", self.section.title.lower()).strip("-")
        return words or f"section-{self.number + 1}"


def page_of(
    head: Head, sections: Sequence[ScriptSection], entries: Sequence[Entry], first: Sequence[str]
) -> str:
    """The HTML of a page; `first` names the pictures of the first screen."""
    blocks = [
        Block(i, section, [entry for entry in entries if entry.section == i])
        for i, section in enumerate(sections)
    ]
    by_name = {entry.name: entry for entry in entries}
    return _template().render(
        head=head,
        verdict=verdict(entries),
        pictures=[by_name[name] for name in first],
        parts=list(_parts(blocks)),
        anchors={entry.name: blocks[entry.section].anchor for entry in entries},
        titles={entry.name: entry.title or blocks[entry.section].section.title for entry in entries},
        waiting=sum(entry.content is None and not entry.error for entry in entries),
        version=__version__,
    )


def verdict(entries: Sequence[Entry]) -> str:
    """One sentence of what is found, with its numbers; empty while nothing is."""
    claims = {e.name: e.content.claim for e in entries if e.content and e.content.claim}
    judging = [claims[e.name] for e in entries if e.kind in JUDGING and e.name in claims]
    told = "; ".join((judging or list(claims.values()))[:2])
    return f"{told[:1].upper()}{told[1:]}." if told else ""


def _parts(blocks: Sequence[Block]) -> Iterator[tuple[str, list[Block]]]:
    """Parts of the page with their sections."""
    part, together = "", list[Block]()
    for block in blocks:
        if together and block.section.part != part:
            yield part, together
            together = []
        part = block.section.part
        together.append(block)
    yield part, together


def _template() -> Any:
    loader = PackageLoader("pvdf_fem.reporting", ".")
    how: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True}
    environment = Environment(loader=loader, autoescape=True, undefined=StrictUndefined, **how)
    return environment.get_template("page.html.j2")
