"""The page of a report: one self-contained HTML file with figures and tables."""

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
from pvdf_fem.report.script import Item, ReportPlan
from pvdf_fem.report.script_keys import Other

VERDICT = "verdict.txt"  #: File with the verdict of the page in the same folder.
MAX_OPEN_ROWS = 12  #: Maximum number of rows of a table that is not folded.
MAX_ROWS = 60  #: Maximum number of rows on the page; longer tables are only in their CSV files.
MAX_COLUMNS_BESIDE = 6  #: Maximum number of columns of a table beside its figure.
#: Maximum number of columns of a table that is not stacked on a phone: with and without a figure.
MAX_COLUMNS_ON_PHONE = 5
MAX_TEXT_COLUMNS_ON_PHONE = 3
#: Kinds that compare with readings; if they have claims, the verdict contains only these.
COMPARISON_KINDS = ("comparison", "positions")
MAX_CLAIMS = 2  #: Maximum number of claims in a verdict.


@dataclass(frozen=True)
class Entry:
    """A figure or table on the page, or the reason why it is missing.

    Parameters
    ----------
    item : Item
        Position in the script, and keys.
    content : Content, optional
        None until the content is composed, or if it could not be made.
    svg : str
        The figure as SVG, empty without a figure.
    error : str
        Reason why the content could not be made, or empty.
    remarks : tuple of str
        Lines about failures and warnings, shown below the content.
    """

    item: Item
    content: Content | None = None
    svg: str = ""
    error: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[str, str]:
        """Width and height of the figure as written in its SVG `viewBox`; "0" without a figure."""
        match = re.search(r'viewBox="0 0 (\S+) (\S+)"', self.svg)
        return (match[1], match[2]) if match else ("0", "0")

    @property
    def svg_element(self) -> Markup:
        """The figure as an SVG element for the page, with identifiers unique on the page."""
        name = self.item.name
        body = self.svg[self.svg.find("<svg") :]
        body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
        body = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
        width, height = self.size
        opening = f'<svg id="svg-{name}" viewBox="0 0 {width} {height}" role="img">'
        return Markup(opening + body[body.find(">") + 1 :].rstrip())

    @property
    def rows(self) -> list[dict[str, str]]:
        """Rows of the table as dicts by heading; empty without a table or beyond `MAX_ROWS`."""
        table = None if self.content is None else self.content.table
        if table is None or len(table) > MAX_ROWS:
            return []
        return [dict(row) for row in table.to_dict("records")]


def render_page(plan: ReportPlan, entries: Sequence[Entry], out: Path, **state: Any) -> str:
    """Render the page of a report as HTML.

    Parameters
    ----------
    plan : ReportPlan
        The validated report script.
    entries : sequence of Entry
        Figures and tables in the order of the script.
    out : Path
        Folder of the page, to which the pages of other reports are relative.
    **state
        Progress, for the template: numbers of solves and tasks ``done`` and in ``total``, and
        whether the page ``is_preview``.

    Returns
    -------
    str
    """
    entry_by_name = {entry.item.name: entry for entry in entries}
    previews = []
    for item in plan.summary:
        title = item.kind.title or plan.sections[item.section].title
        previews.append((entry_by_name[item.name], title))
    return _load_template("page.html.j2").render(
        script=plan.script,
        sections=plan.sections,
        entries=entries,
        verdict=make_verdict(entries),
        previews=previews,
        others=_read_other_verdicts(plan, out),
        limits={
            "long": MAX_OPEN_ROWS,
            "beside": MAX_COLUMNS_BESIDE,
            "wide": MAX_COLUMNS_ON_PHONE,
            "texts": MAX_TEXT_COLUMNS_ON_PHONE,
        },
        version=__version__,
        **state,
    )


def update_other_reports(page: str, plan: ReportPlan, out: Path) -> str:
    """Return the HTML of a page with updated verdicts of the other reports.

    Parameters
    ----------
    page : str
        HTML of the page.
    plan : ReportPlan
        The validated report script, which lists the other reports.
    out : Path
        Folder of the page, to which the pages of other reports are relative.
    """
    template = _load_template("page.others.html.j2")
    lines = template.render(others=_read_other_verdicts(plan, out))
    return re.sub(r'<ul class="others">.*?</ul>\n', lambda _: lines, page, flags=re.DOTALL)


def make_verdict(entries: Sequence[Entry]) -> str:
    """Join the first claims of the composed items to a sentence; empty without claims.

    If kinds that compare with readings (`COMPARISON_KINDS`) have claims, only these are used.
    """
    claims = []
    comparing_claims = []
    for entry in entries:
        if entry.content is not None and entry.content.claim:
            claims.append(entry.content.claim)
            if getattr(entry.item.kind, "kind", "") in COMPARISON_KINDS:
                comparing_claims.append(entry.content.claim)
    chosen = comparing_claims if comparing_claims else claims
    if not chosen:
        return ""
    text = "; ".join(chosen[:MAX_CLAIMS])
    return f"{text[0].upper()}{text[1:]}."


def _read_other_verdicts(plan: ReportPlan, out: Path) -> list[tuple[Other, str | None]]:
    """Return the other reports with their verdicts.

    The verdict is None if the page does not exist, and empty if only its verdict is missing.
    """
    others = []
    for other in plan.others:
        page = out / other.page
        verdict = "" if page.is_file() else None
        with suppress(OSError, UnicodeDecodeError):
            verdict = page.with_name(VERDICT).read_text("utf-8").strip()
        others.append((other, verdict))
    return others


def _load_template(name: str) -> Template:
    """Load a template from the folder of this module."""
    environment = Environment(
        loader=PackageLoader("pvdf_fem.report", "."),
        autoescape=True,
        keep_trailing_newline=True,
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    return environment.get_template(name)
