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
from pvdf_fem.report.script import Item, Other, ReportPlan

VERDICT = "verdict.txt"  #: File with the verdict of the page in the same folder.
MAX_OPEN_ROWS = 12  #: Rows of the longest table that is not folded.
MAX_ROWS = 60  #: Rows of the longest table on the page; longer ones are in their CSV files only.
MAX_COLUMNS_BESIDE = 6  #: Columns of the widest table that stands beside its figure.
#: Columns of the widest table that stays a table on a phone: beside a figure, and of texts.
MAX_COLUMNS_ON_PHONE = 5
MAX_TEXT_COLUMNS_ON_PHONE = 3
#: Kinds that compare with readings; where they have claims, the verdict consists of these.
JUDGING = ("comparison", "positions")
MAX_CLAIMS = 2  #: Number of claims in a verdict.


@dataclass(frozen=True)
class Entry:
    """A figure or table on the page, or the text in its place.

    Parameters
    ----------
    item : Item
        Its place and keys.
    content : Content, optional
        Its content, None until it is composed.
    svg : str
        Its drawing.
    error : str
        Why there is no content.
    remarks : tuple of str
        Lines below it about failures and warnings.
    """

    item: Item
    content: Content | None = None
    svg: str = ""
    error: str = ""
    remarks: tuple[str, ...] = ()

    @property
    def size(self) -> tuple[str, str]:
        """Width and height of the drawing in its own units."""
        match = re.search(r'viewBox="0 0 (\S+) (\S+)"', self.svg)
        return (match[1], match[2]) if match else ("0", "0")

    @property
    def picture(self) -> Markup:
        """The drawing as an element of the page, with identifiers of its own."""
        name = self.item.name
        body = self.svg[self.svg.find("<svg") :]
        body = re.sub(r"<metadata>.*?</metadata>", "", body, flags=re.DOTALL)
        body = re.sub(r'\b(id="|href="#|url\(#)', rf"\g<1>{name}-", body)
        width, height = self.size
        opening = f'<svg id="svg-{name}" viewBox="0 0 {width} {height}" role="img">'
        return Markup(opening + body[body.find(">") + 1 :].rstrip())

    @property
    def rows(self) -> list[dict[str, str]]:
        """Rows of the table by heading; none for a table that is in its CSV file only."""
        table = None if self.content is None else self.content.table
        if table is None or len(table) > MAX_ROWS:
            return []
        return [dict(row) for row in table.to_dict("records")]


def render_page(plan: ReportPlan, entries: Sequence[Entry], out: Path, **state: Any) -> str:
    """Return the HTML text of a page.

    Parameters
    ----------
    plan : ReportPlan
        The report.
    entries : sequence of Entry
        Its figures and tables.
    out : Path
        Folder of the page.
    **state
        Progress: the numbers of solves and tasks ``done`` and in ``total``, and whether the page
        ``is_preview``.

    Returns
    -------
    str
    """
    entry_by_name = {entry.item.name: entry for entry in entries}
    pictures = []
    for item in plan.summary:
        title = item.kind.title or plan.sections[item.section].title
        pictures.append((entry_by_name[item.name], title))
    return _load_template("page.html.j2").render(
        script=plan.script,
        sections=plan.sections,
        entries=entries,
        verdict=make_verdict(entries),
        pictures=pictures,
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
    """Return the HTML text of a page with the present verdicts of other reports.

    Parameters
    ----------
    page : str
        HTML text of the page.
    plan : ReportPlan
        The report.
    out : Path
        Folder of the page.
    """
    template = _load_template("page.others.html.j2")
    lines = template.render(others=_read_other_verdicts(plan, out))
    return re.sub(r'<ul class="others">.*?</ul>\n', lambda _: lines, page, flags=re.DOTALL)


def make_verdict(entries: Sequence[Entry]) -> str:
    """Return the first claims of the composed items as a sentence, empty without claims."""
    claims = []
    judging_claims = []
    for entry in entries:
        if entry.content is not None and entry.content.claim:
            claims.append(entry.content.claim)
            if getattr(entry.item.kind, "kind", "") in JUDGING:
                judging_claims.append(entry.content.claim)
    chosen = judging_claims if judging_claims else claims
    if not chosen:
        return ""
    text = "; ".join(chosen[:MAX_CLAIMS])
    return f"{text[0].upper()}{text[1:]}."


def _read_other_verdicts(plan: ReportPlan, out: Path) -> list[tuple[Other, str | None]]:
    """Return the other reports with their verdicts, None for a page that does not exist."""
    others = []
    for other in plan.others:
        page = out / other.page
        verdict = "" if page.is_file() else None
        with suppress(OSError, UnicodeDecodeError):
            verdict = page.with_name(VERDICT).read_text("utf-8").strip()
        others.append((other, verdict))
    return others


def _load_template(name: str) -> Template:
    """Return a template of this folder."""
    environment = Environment(
        loader=PackageLoader("pvdf_fem.report", "."),
        autoescape=True,
        keep_trailing_newline=True,
        lstrip_blocks=True,
        trim_blocks=True,
        undefined=StrictUndefined,
    )
    return environment.get_template(name)
