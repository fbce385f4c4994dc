"""The landing page: what the reports found, and where all of them are."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from html import unescape
from pathlib import Path
from urllib.parse import quote

from reports.common.options import OUT
from reports.common.page import Link, Page, Picture, rendered, write_text
from reports.front.catalogue import DEFAULT, REPORTS, command
from reports.front.sensor import SENSOR_CHAPTER
from reports.front.verdicts import VERDICTS, Pages, Verdict, tables_named

LANDING = "index.html"


@dataclass(frozen=True)
class Card:
    """A box of the landing page that leads somewhere.

    `link` is empty, and `command` says how to make it, if what it leads to is not there.
    """

    title: str
    text: str
    link: str = ""
    picture: str = ""
    remark: str = ""
    command: str = ""


def publish(page: Page, directory: Path) -> Path:
    """Write a report's page; return its path.

    In ``reports/out``, or wherever a thesis report lies above, the page leads to the landing page,
    which is written anew.
    """
    above = directory.resolve().parent
    if above != OUT and not (above / REPORTS[DEFAULT].page).is_file():
        return page.write(directory)
    path = replace(page, home=f"../{LANDING}").write(directory)
    write_landing(above)
    return path


def write_landing(directory: Path) -> None:
    """Write the page that leads to all reports in a directory."""
    pages = _made(directory)
    write_text(
        directory / LANDING,
        rendered(
            "landing.html.j2",
            pictures=_pictures_of(pages.get(DEFAULT), SENSOR_CHAPTER.name),
            verdicts=list(_verdicts(pages)),
            reports=[_report_card(name, pages) for name in REPORTS],
            findings=list(_findings(pages)),
            others=_other_pages(directory),
            is_preview=any(page.is_preview for page in pages.values()),
            command=command(DEFAULT),
        ),
    )


def _made(directory: Path) -> Pages:
    """The pages of the reports that are made; one that an older version made is left out."""
    pages = {}
    for name, report in REPORTS.items():
        with suppress(OSError, ValueError):
            pages[name] = Page.read(directory / report.page)
    return pages


def _pictures_of(page: Page | None, section_name: str) -> list[Picture]:
    sections = page.sections if page else []
    return [
        block
        for section in sections
        for block in section.blocks
        if section.name == section_name and isinstance(block, Picture)
    ]


def _thumbnail(report: str, pages: Pages, section_name: str = "") -> str:
    """Link to the first picture of a section, or of the page if none is named; else empty."""
    page = pages[report]
    pictures = _pictures_of(page, section_name) if section_name else page.pictures
    folder = REPORTS[report].page.rpartition("/")[0]
    return quote("/".join(filter(None, [folder, pictures[0].file]))) if pictures else ""


def _verdicts(pages: Pages) -> Iterator[Card]:
    for find in VERDICTS:
        with suppress(KeyError):
            verdict = find(pages)
            yield _verdict_card(verdict, pages)


def _verdict_card(verdict: Verdict, pages: Pages) -> Card:
    report, section = verdict.report, verdict.section
    link = f"{REPORTS[report].page}#{section}"
    remark = "from a preview" if pages[report].is_preview else ""
    picture = _thumbnail(report, pages, verdict.pictured or section)
    return Card(verdict.topic, verdict.sentence, link, picture, remark)


def _report_card(name: str, pages: Pages) -> Card:
    report = REPORTS[name]
    if name not in pages:
        return Card(report.title, report.tells, command=command(name))
    page = pages[name]
    incomplete = [section for section in page.sections if section.state]
    remarks = ["preview"] if page.is_preview else []
    remarks += [f"{len(incomplete)} of its sections are incomplete"] if incomplete else []
    picture = _thumbnail(name, pages)
    return Card(report.title, report.tells, report.page, picture, "; ".join(remarks))


def _findings(pages: Pages) -> Iterator[Card]:
    """Statements of the thesis that do not hold, each with a picture of the section about it."""
    if DEFAULT not in pages:
        return
    for found in tables_named(pages[DEFAULT], "findings"):
        keys = ("place", "states", "gives", "shown")
        for place, states, gives, shown in zip(*map(found.cells, keys), strict=True):
            section = shown.section if isinstance(shown, Link) else found.section.name
            picture = _thumbnail(DEFAULT, pages, section)
            link = f"{REPORTS[DEFAULT].page}#{section}"
            quoted = f"“{str(states).rstrip('.')}”"
            yield Card(quoted, str(gives), link, picture, f"Thesis, {place}")


def _other_pages(directory: Path) -> dict[str, str]:
    """Titles of the pages in folders that the catalogue does not know, by their links."""
    known = {report.page for report in REPORTS.values()}
    links = {}
    for path in sorted(directory.glob(f"*/{LANDING}")):
        link = path.relative_to(directory).as_posix()
        title = re.search(r"<title>(.*?)</title>", path.read_text(encoding="utf-8"), re.DOTALL)
        if link not in known:
            links[quote(link)] = unescape(title[1]).strip() if title else path.parent.name
    return links
