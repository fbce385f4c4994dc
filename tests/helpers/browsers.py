"""A browser for tests, which are skipped where none starts, and texts of a page that are cut or
overlap, by the boxes that the browser gives them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import pytest

#: Names of the browser's program.
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
#: Widths in pixels at which a page is looked at: a screen's, a phone's, and that of printed A4.
WIDTHS = {"screen": 1400, "phone": 390, "print": 703}

# Boxes of all visible texts: of the lines of an HTML page, or of the labels of a figure, which
# matplotlib draws as curves in groups named text_N that begin with a comment. A text has the
# room that it must be in: that of the page, or of the nearest ancestor that hides what is outside.
# What one can scroll to is not cut, except in print.
_BOXES = """
isPrint => {
  const root = document.documentElement, boxes = [], parents = [];
  const sides = rect => [rect.left, rect.top, rect.right, rect.bottom];
  const add = (text, rect, room, parent) => {
    if (!text.trim() || rect.width < 0.5 || rect.height < 0.5) return;
    if (!parents.includes(parent)) parents.push(parent);
    boxes.push({text: text.trim(), box: sides(rect), room, parent: parents.indexOf(parent)});
  };
  if (root.tagName === 'svg') {
    for (const group of root.querySelectorAll('g[id^="text_"]')) {
      const comment = [...group.childNodes].find(node => node.nodeType === Node.COMMENT_NODE);
      const turn = /rotate\\((-?[\\d.]+)/.exec(group.innerHTML);
      if (turn && parseFloat(turn[1]) % 90) continue;
      const text = comment ? comment.data : group.textContent;
      add(text, group.getBoundingClientRect(), sides(root.getBoundingClientRect()), group);
    }
    return boxes;
  }
  const hides = element => {
    const style = getComputedStyle(element);
    return [style.overflowX, style.overflowY];
  };
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    const parent = node.parentElement, range = document.createRange();
    if (!node.data.trim() || !parent.checkVisibility({visibilityProperty: true})) continue;
    let port = parent;
    while (port && hides(port).every(way => way === 'visible')) port = port.parentElement;
    const isScrolled = port && hides(port).includes('auto') && !isPrint;
    const room = port ? sides(port.getBoundingClientRect()) : [0, -1e9, root.clientWidth, 1e9];
    const block = parent.closest('p, li, td, th, figcaption, dt, dd, h1, h2, h3, pre') || parent;
    range.selectNodeContents(node);
    for (const rect of range.getClientRects()) {
      const isSeen = rect.right <= room[2] && rect.bottom <= room[3];
      if (isSeen || !isScrolled) add(node.data, rect, isScrolled ? null : room, block);
    }
  }
  return boxes;
}
"""


class Fault(NamedTuple):
    """A text that cannot be read as it should be."""

    kind: str  #: ``cut`` or ``overlap``.
    text: str
    where: str  #: Name of the page or figure, and how it was looked at.


@contextmanager
def browser_or_skip() -> Iterator[Any]:
    """A browser without a window; skips the test that asks for it where none starts."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not (chromium := next(filter(None, map(shutil.which, PROGRAMS)), None)):
        pytest.skip("there is no Chromium on the path")
    arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
    with playwright.sync_playwright() as driver:
        try:
            opened = driver.chromium.launch(executable_path=chromium, args=arguments)
        except playwright.Error as error:
            pytest.skip(f"no browser starts here: {error}")
        with opened:
            yield opened


def faults_of(path: Path, browser: Any, *, slack_px: float = 0.7) -> list[Fault]:
    """Faults of a page at all widths, without scripts of its own, and of the SVG figures in the
    folder ``figures`` beside it.

    Texts may stick out of their box, or into each other, by `slack_px`: fonts have rims.
    """
    faults, page = list[Fault](), browser.new_page()
    for medium, width in WIDTHS.items():
        page.set_viewport_size({"width": width, "height": 900})
        page.emulate_media(media="print" if medium == "print" else "screen")
        page.goto(path.resolve().as_uri())
        boxes = page.evaluate(_BOXES, medium == "print")
        assert boxes, f"{path} has no texts"
        faults += _checked(boxes, f"{path.name} ({medium})", slack_px)
    for picture in sorted(path.resolve().parent.glob("figures/*.svg")):
        page.goto(picture.as_uri())
        faults += _checked(page.evaluate(_BOXES, False), picture.name, slack_px)
    page.close()
    return faults


def _checked(boxes: list[dict[str, Any]], where: str, slack_px: float) -> Iterator[Fault]:
    """Texts that stick out of what shows them, and pairs that overlap."""
    by_top = sorted(boxes, key=lambda box: box["box"][1])
    for number, upper in enumerate(by_top):
        (left, top, right, bottom), room = upper["box"], upper["room"]
        if (
            room
            and min(left - room[0], top - room[1], room[2] - right, room[3] - bottom) < -slack_px
        ):
            yield Fault("cut", upper["text"], where)
        for lower in by_top[number + 1 :]:
            x0, y0, x1, y1 = lower["box"]
            if y0 >= bottom - slack_px:
                break
            wide, high = min(right, x1) - max(left, x0), min(bottom, y1) - max(top, y0)
            if upper["parent"] != lower["parent"] and min(wide, high) > slack_px:
                yield Fault("overlap", f"{upper['text']} | {lower['text']}", where)
