"""No text of a page is cut or overlapped, by the boxes of a real browser."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.browsers import browser_or_skip
from tests.helpers.page_boxes import WIDTHS, look_at

pytest.importorskip("playwright.sync_api", reason="playwright is not installed")

KINDS = ("cut", "overlap", "missing")


@pytest.fixture(scope="module")
def opened() -> Iterator[Any]:
    with browser_or_skip() as started:
        yield started


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
