"""Texts of a page that are cut or overlap, by the boxes that Chromium gives them."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from playwright.sync_api import Browser

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
  const root = document.documentElement, boxes = [];
  const isFigure = root.tagName === 'svg';
  const page = isFigure ? root.getBoundingClientRect()
    : {left: 0, top: -1e9, right: root.clientWidth, bottom: 1e9};
  const limits = element => {
    for (let e = element; e && e !== root && e !== document.body; e = e.parentElement) {
      const style = getComputedStyle(e);
      if (['auto', 'scroll'].includes(style.overflowX) && !isPrint)
        return {scrolls: e.getBoundingClientRect()};
      if (style.overflowX !== 'visible' || style.overflowY !== 'visible')
        return e.getBoundingClientRect();
    }
    return page;
  };
  const add = (text, rect, inside, parent) => {
    if (!text.trim() || rect.width < 0.5 || rect.height < 0.5) return;
    const port = inside.scrolls;
    if (port && (rect.right > port.right || rect.bottom > port.bottom)) return;
    const room = port ? null : [inside.left, inside.top, inside.right, inside.bottom];
    const box = [rect.left, rect.top, rect.right, rect.bottom];
    boxes.push({text: text.trim().replace(/\\s+/g, ' ').slice(0, 80), box, room, parent});
  };
  const parents = new Map();
  const numberOf = element => {
    if (!parents.has(element)) parents.set(element, parents.size);
    return parents.get(element);
  };
  if (isFigure) {
    for (const group of root.querySelectorAll('g[id^="text_"]')) {
      const comment = [...group.childNodes].find(node => node.nodeType === Node.COMMENT_NODE);
      const turn = /rotate\\((-?[\\d.]+)/.exec(group.innerHTML);
      if (turn && parseFloat(turn[1]) % 90) continue;
      add(comment ? comment.data : group.textContent, group.getBoundingClientRect(), page,
          numberOf(group));
    }
    return boxes;
  }
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    const parent = node.parentElement;
    if (!node.data.trim() || !parent.checkVisibility({visibilityProperty: true})) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    const inside = limits(parent);
    const block = parent.closest('p, li, td, th, figcaption, dt, dd, h1, h2, h3, pre') || parent;
    for (const rect of range.getClientRects()) add(node.data, rect, inside, numberOf(block));
  }
  return boxes;
}
"""
# Whether each picture of a page can be shown, by its address.
_PICTURES = """
async () => {
  const load = image => { image.loading = 'eager'; return image.decode().then(() => 1, () => 0); };
  const pictures = [...document.images];
  await Promise.all(pictures.map(load));
  return Object.fromEntries(pictures.map(image => [image.src, image.naturalWidth > 0]));
}
"""


@dataclass(frozen=True)
class Fault:
    """A text that cannot be read as it should be.

    Attributes
    ----------
    kind : str
        ``cut``, ``overlap`` or ``missing``, the last one of a picture.
    text : str
    where : str
        Name of the page or figure, and how it was looked at.
    """

    kind: str
    text: str
    where: str


@dataclass
class Look:
    """What a look at pages found, and the number of text boxes that it checked."""

    faults: list[Fault]
    count: int = 0


def chromium() -> str | None:
    """Path of the browser's program; None without one."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@contextmanager
def browser() -> Iterator[Browser]:
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        opened = playwright.chromium.launch(executable_path=chromium(), args=arguments)
        try:
            yield opened
        finally:
            opened.close()


def look_at(path: Path, browser: Browser, *, slack_px: float = 0.7) -> Look:
    """Check a page at all widths, without scripts of its own, and the SVG figures that it shows, or
    that are in the folder ``figures`` beside it.

    Texts may stick out of their box, or into each other, by `slack_px`: fonts have rims.
    """
    look = Look([])
    page = browser.new_page()
    for medium, width in WIDTHS.items():
        page.set_viewport_size({"width": width, "height": 900})
        page.emulate_media(media="print" if medium == "print" else "screen")
        page.goto(path.resolve().as_uri())
        where = f"{path.name} ({medium})"
        _check(look, page.evaluate(_BOXES, medium == "print"), where, slack_px)
    pictures: dict[str, bool] = page.evaluate(_PICTURES)
    absent = [picture for picture, is_there in pictures.items() if not is_there]
    look.faults += [Fault("missing", picture, path.name) for picture in absent]
    shown = [name for name, is_there in pictures.items() if is_there and name.endswith(".svg")]
    beside = [file.as_uri() for file in sorted(path.resolve().parent.glob("figures/*.svg"))]
    for picture in (*shown, *beside):
        page.goto(picture)
        _check(look, page.evaluate(_BOXES, False), picture.rpartition("/")[2], slack_px)
    page.close()
    return look


def _check(look: Look, boxes: list[dict[str, Any]], where: str, slack_px: float) -> None:
    look.count += len(boxes)
    look.faults += [Fault("cut", box["text"], where) for box in boxes if _is_cut(box, slack_px)]
    by_top = sorted(boxes, key=lambda box: box["box"][1])
    for number, upper in enumerate(by_top):
        for lower in by_top[number + 1 :]:
            if lower["box"][1] >= upper["box"][3] - slack_px:
                break
            if upper["parent"] != lower["parent"] and _overlap(upper, lower, slack_px):
                look.faults.append(Fault("overlap", f"{upper['text']} | {lower['text']}", where))


def _is_cut(box: dict[str, Any], slack_px: float) -> bool:
    """Whether a text sticks out of the box that shows it."""
    if box["room"] is None:
        return False
    (left, top, right, bottom), (x0, y0, x1, y1) = box["box"], box["room"]
    return bool(min(left - x0, top - y0, x1 - right, y1 - bottom) < -slack_px)


def _overlap(one: dict[str, Any], other: dict[str, Any], slack_px: float) -> bool:
    (left, top, right, bottom), (x0, y0, x1, y1) = one["box"], other["box"]
    return bool(
        min(right, x1) - max(left, x0) > slack_px and min(bottom, y1) - max(top, y0) > slack_px
    )
