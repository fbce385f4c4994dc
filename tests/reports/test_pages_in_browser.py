"""No text of a page is cut or overlapped, by the boxes of a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from reports.common.figures import drawing
from reports.common.page import Column, Page, Picture, Section, Table
from tests.helpers.browsers import browser_or_skip
from tests.helpers.page_boxes import WIDTHS, Fault, look_at

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

KINDS = ("cut", "overlap", "missing")
WORDS = "A sentence that is long enough to be broken into several lines on a phone. " * 3


@pytest.fixture(scope="module")
def opened() -> Iterator[Any]:
    with browser_or_skip() as started:
        yield started


def report(directory: Path, *, crowded: bool = False) -> Page:
    """A report with a long and wide table and a figure, whose labels collide if it is crowded."""
    with drawing(directory / "curve.svg", 120, 60) as figure:
        ax = figure.subplots()
        ax.set(xlabel="force (N)", ylabel="charge (pC)", title="charge against force")
        if crowded:
            ax.text(0.5, 0.5, "first label")
            ax.text(0.52, 0.5, "second label")
            figure.text(0.95, 0.3, "beyond the edge")
    columns = [Column(f"c{n}", f"difference of charge {n} (%)") for n in range(14)]
    rows = [["scene", *(-100.0 / (n + 1) for n in range(13))] for _ in range(40)]
    table = Table("table", WORDS, columns, rows)
    section = Section("s", "A section", [WORDS], [Picture("curve.svg", WORDS), table])
    section.write_tables(directory)
    return Page("Title", [WORDS], [section, Section("t", "Another")], {"Tolerance": "0.1 %"})


def test_a_report_is_sound(tmp_path: Path, opened: Any) -> None:
    report(tmp_path).write(tmp_path)
    look = look_at(tmp_path / "index.html", opened)
    assert not look.faults
    assert look.count > 60


def test_what_a_figure_hides_is_found(tmp_path: Path, opened: Any) -> None:
    report(tmp_path, crowded=True).write(tmp_path)
    assert look_at(tmp_path / "index.html", opened).faults == [
        Fault("cut", "beyond the edge", "curve.svg"),
        Fault("overlap", "first label | second label", "curve.svg"),
    ]


def test_planted_faults_are_found(tmp_path: Path, opened: Any) -> None:
    planted = (
        """
        <p style='width: 5em; overflow: hidden; white-space: nowrap'>hidden words are cut</p>
        <p style='width: 1500px'>"""
        + "beyond " * 200
        + """</p>
        <p>beneath</p><p style='margin-top: -2em'>over it</p><img src='absent.svg'>"""
    )
    (tmp_path / "index.html").write_text(f"<!DOCTYPE html><body>{planted}</body>")
    faults = look_at(tmp_path / "index.html", opened).faults
    places = [f"index.html ({medium})" for medium in WIDTHS]
    found = {kind: [fault for fault in faults if fault.kind == kind] for kind in KINDS}
    assert {fault.where for fault in found["cut"] if "hidden words" in fault.text} == set(places)
    assert {fault.where for fault in found["cut"] if "beyond" in fault.text} == set(places)
    assert [fault.where for fault in found["overlap"]] == places
    assert found["overlap"][0].text == "beneath | over it"
    [missing] = found["missing"]
    assert missing.text.endswith("absent.svg")


def test_a_table_that_scrolls_is_cut_only_in_print(tmp_path: Path, opened: Any) -> None:
    cells = "".join(f"<td>planted {n}</td>" for n in range(60))
    table = f"<div style='overflow: auto'><table><tr>{cells}</tr></table></div>"
    (tmp_path / "index.html").write_text(f"<!DOCTYPE html><body>{table}</body>")
    faults = look_at(tmp_path / "index.html", opened).faults
    assert {fault.where for fault in faults} == {"index.html (print)"}
