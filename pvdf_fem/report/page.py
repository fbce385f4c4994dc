"""A report's page: a self-contained HTML file with figures."""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined, Template
from markupsafe import Markup

from pvdf_fem import __version__
from pvdf_fem.report.kind import Content
from pvdf_fem.report.script import Item, Other, ReportPlan

VERDICT = "verdict.txt"  #: Has the verdict of the page in the same directory.
LONG_TABLE = 12  #: Rows of a table above which it is folded.
MOST_ROWS = 60  #: Rows of a table above which it is in its CSV file only.
BESIDE_TABLE = 6  #: Columns of a table above which it stands below its figure.
#: Numbers of columns above which a phone shows a row as a list.
WIDE_TABLE, WIDE_TEXTS = 5, 3
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
        """The figure as a page element, with its own identifiers."""
        name, body = self.item.name, self.svg[self.svg.find("<svg") :]
        body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
        body = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
        width, height = self.size
        opening = f'<svg id="svg-{name}" viewBox="0 0 {width} {height}" role="img">'
        return Markup(opening + body[body.find(">") + 1 :].rstrip())

    @property
    def rows(self) -> list[dict[str, str]]:
        """Cells of the table by their heads; nothing for a table in a CSV file only."""
        shown = None if self.content is None else self.content.shown
        if shown is None or len(shown) > MOST_ROWS:
            return []
        return [dict(row) for row in shown.to_dict("records")]


def render_page(plan: ReportPlan, entries: Sequence[Entry], out: Path, **state: Any) -> str:
    """The HTML for a page in a directory, with its `state`: numbers of solves and tasks ``done``
    and in ``total``, and whether the page ``is_preview``."""
    by_name = {entry.item.name: entry for entry in entries}
    pictures = [
        (by_name[i.name], i.kind.title or plan.sections[i.section].title) for i in plan.summary
    ]
    return _template("page.html.j2").render(
        script=plan.script,
        sections=plan.sections,
        entries=entries,
        verdict=make_verdict(entries),
        pictures=pictures,
        others=_others(plan, out),
        limits={
            "long": LONG_TABLE,
            "beside": BESIDE_TABLE,
            "wide": WIDE_TABLE,
            "texts": WIDE_TEXTS,
        },
        version=__version__,
        **state,
    )


def update_other_reports(page: str, plan: ReportPlan, out: Path) -> str:
    """The HTML for a page in a directory, with present verdicts of further reports."""
    written = _template("page.others.html.j2").render(others=_others(plan, out))
    return re.sub(r'<ul class="others">.*?</ul>\n', lambda _: written, page, flags=re.DOTALL)


def _others(plan: ReportPlan, out: Path) -> list[tuple[Other, str | None]]:
    """Further reports with their verdicts, None for missing pages."""
    verdicts = list[str | None]()
    for page in (out / other.page for other in plan.others):
        verdicts.append("" if page.is_file() else None)
        with suppress(OSError, UnicodeDecodeError):
            verdicts[-1] = page.with_name(VERDICT).read_text("utf-8").strip()
    return list(zip(plan.others, verdicts, strict=True))


def _template(name: str) -> Template:
    how: dict[str, Any] = {"trim_blocks": True, "lstrip_blocks": True, "undefined": StrictUndefined}
    how |= {"keep_trailing_newline": True, "autoescape": True}
    loader = PackageLoader("pvdf_fem.report", ".")
    return Environment(loader=loader, **how).get_template(name)


def make_verdict(entries: Sequence[Entry]) -> str:
    """Up to two claims by finished items, as a sentence; empty before the first claim."""
    told = [(e.item.kind, e.content.claim) for e in entries if e.content and e.content.claim]
    judging = [claim for kind, claim in told if getattr(kind, "kind", "") in JUDGING]
    text = "; ".join((judging or [claim for _, claim in told])[:2])
    return f"{text[:1].upper()}{text[1:]}." if text else ""
