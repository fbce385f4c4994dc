"""The page of a report: one HTML file with its figures, which needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from pvdf_fem import __version__
from pvdf_fem.reporting.kind import Content
from pvdf_fem.reporting.script import Item, Other, Plan

VERDICT = "verdict.txt"  #: Has the verdict of the page in the same directory.
LONG_TABLE = 12  #: Rows of a table above which it is folded.
MOST_ROWS = 60  #: Rows of a table above which it is in its CSV file only.
BESIDE_TABLE = 6  #: Columns of a table above which it stands below its figure.
WIDE_TABLE = 5  #: Columns of a table above which a phone shows a row as a list.
JUDGING = ("comparison", "positions")  #: Kinds whose findings are the verdict, if there are any.


@dataclass(frozen=True)
class Entry:
    """A figure or table on the page, or what stands in its place."""

    item: Item
    content: Content | None = None
    svg: str = ""
    error: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[str, str]:
        """Width and height of the figure."""
        found = re.search(r'viewBox="0 0 (\S+) (\S+)"', self.svg)
        return (found[1], found[2]) if found else ("0", "0")

    @property
    def picture(self) -> Markup:
        """The figure as an element of the page, with identifiers of its own."""
        name, body = self.item.name, self.svg[self.svg.find("<svg") :]
        body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
        body = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
        width, height = self.size
        opening = f'<svg id="svg-{name}" viewBox="0 0 {width} {height}" role="img">'
        return Markup(opening + body[body.find(">") + 1 :].rstrip())

    @property
    def rows(self) -> list[dict[str, str]]:
        """Cells of the table by their heads."""
        shown = None if self.content is None else self.content.shown
        if shown is None or len(shown) > MOST_ROWS:
            return []
        return [dict(row) for row in shown.to_dict("records")]

    @property
    def is_long(self) -> bool:
        """Whether the table is folded."""
        return len(self.rows) > LONG_TABLE

    @property
    def is_below(self) -> bool:
        """Whether the table has the page's whole width."""
        return bool(self.rows) and (not self.svg or len(self.rows[0]) > BESIDE_TABLE)

    @property
    def is_wide(self) -> bool:
        """Whether a phone shows rows as lists."""
        return bool(self.rows) and len(self.rows[0]) > WIDE_TABLE


@dataclass(frozen=True)
class OtherLine:
    """The line about another report: its verdict, or None where its page is not made."""

    other: Other
    verdict: str | None


def others_of(plan: Plan, out: Path) -> list[OtherLine]:
    """The lines about other reports, for a page in a directory."""
    lines = []
    for other in plan.script.other:
        page, told = out / other.page, None
        if page.is_file():
            told = ""
            with suppress(OSError, UnicodeDecodeError):
                told = (page.parent / VERDICT).read_text("utf-8").strip()
        lines.append(OtherLine(other, told))
    return lines


def with_others(page: str, others: Sequence[OtherLine]) -> str:
    """The HTML of a page with other lines about other reports."""
    written = _template("page.others.html.j2").render(others=others)
    return re.sub(r'<ul class="others">.*?</ul>\n', lambda _: written, page, flags=re.DOTALL)


def _template(name: str) -> Template:
    loader = PackageLoader("pvdf_fem.reporting", ".")
    how: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "undefined": StrictUndefined}
    how["keep_trailing_newline"] = True
    return Environment(loader=loader, autoescape=True, **how).get_template(name)


def page_of(
    plan: Plan,
    entries: Sequence[Entry],
    others: Sequence[OtherLine],
    is_preview: bool,
    *,
    done: int,
    total: int,
) -> str:
    """The HTML of a page, when some of all scenes and tasks are done."""
    by_name = {entry.item.name: entry for entry in entries}
    anchors = [_anchor(section.title, i) for i, section in enumerate(plan.script.section)]
    blocks = [
        (section, anchors[i], [entry for entry in entries if entry.item.section == i])
        for i, section in enumerate(plan.script.section)
    ]
    return _template("page.html.j2").render(
        script=plan.script,
        verdict=verdict(entries),
        pictures=[
            (by_name[i.name], i.kind.title or plan.script.section[i.section].title)
            for i in plan.summary
        ],
        parts=[(part, list(of)) for part, of in groupby(blocks, key=lambda block: block[0].part)],
        waiting=sum(entry.content is None and not entry.error for entry in entries),
        done=done,
        total=total,
        others=others,
        is_preview=is_preview,
        version=__version__,
    )


def verdict(entries: Sequence[Entry]) -> str:
    """One sentence of what is found, with its numbers; empty while nothing is."""
    told = [(e.item.kind, e.content.claim) for e in entries if e.content and e.content.claim]
    judging = [claim for kind, claim in told if getattr(kind, "kind", "") in JUDGING]
    text = "; ".join((judging or [claim for _, claim in told])[:2])
    return f"{text[:1].upper()}{text[1:]}." if text else ""


def _anchor(title: str, number: int) -> str:
    words = re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
    return f"{words}-{number + 1}".strip("-")
