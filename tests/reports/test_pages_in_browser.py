"""Texts of a page that are cut or overlap are found, by the boxes of a real browser."""

from __future__ import annotations

from pathlib import Path

from tests.helpers.browsers import WIDTHS, browser_or_skip, faults_of

CELLS = "".join(f"<td>cell {n}</td>" for n in range(60))
PLANTED = f"""<!DOCTYPE html><body>
<p style='width: 5em; overflow: hidden; white-space: nowrap'>hidden words are cut</p>
<p style='width: 1500px'>{"beyond " * 200}</p>
<p>beneath</p><p style='margin-top: -2em'>over it</p>
<div style='overflow: auto'><table><tr>{CELLS}</tr></table></div>
"""


def test_planted_faults_are_found(tmp_path: Path) -> None:
    """A table that scrolls is cut only in print."""
    (tmp_path / "index.html").write_text(PLANTED)
    with browser_or_skip() as browser:
        faults = faults_of(tmp_path / "index.html", browser)
    found = {(fault.kind, fault.text.split()[0], fault.where) for fault in faults}
    kinds = [("cut", "hidden"), ("cut", "beyond"), ("overlap", "beneath")]
    expected = {(*kind, f"index.html ({medium})") for kind in kinds for medium in WIDTHS}
    expected |= {("cut", "cell", "index.html (print)")}
    assert found == expected
