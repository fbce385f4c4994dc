"""A browser for tests, which are skipped where none starts, and texts of a page that are cut or
overlap, by the boxes that the browser gives them."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Names of the browser's program.
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PATIENCE_S = 120.0  #: Time in which a browser starts on any machine.
TRIAL = "from tests.helpers.browsers import browser\nwith browser(): pass"
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


class Fault(NamedTuple):
    """A text that cannot be read as it should be."""

    kind: str  #: ``cut``, ``overlap``, or ``missing`` of a picture.
    text: str
    where: str  #: Name of the page or figure, and how it was looked at.


@contextmanager
def browser() -> Iterator[Any]:
    """A browser without a window."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        opened = playwright.chromium.launch(executable_path=chromium(), args=arguments)
        try:
            yield opened
        finally:
            opened.close()


@contextmanager
def browser_or_skip() -> Iterator[Any]:
    """A browser without a window; skips the test that asks for it where there is none."""
    if reason := refusal():
        pytest.skip(reason)
    with browser() as started:
        yield started


def chromium() -> str | None:
    """Path of the browser's program; None without one."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


@cache
def refusal() -> str:
    """Why no browser starts here; empty where one does.

    The first start is in another process: a driver that misses a library of the system would take
    the tests with it, or leave them waiting.
    """
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if not chromium():
        return "there is no Chromium on the path"
    with tempfile.TemporaryFile() as told:
        quiet: dict[str, Any] = {"stdin": subprocess.DEVNULL, "stdout": told, "stderr": told}
        try:
            command = [sys.executable, "-c", TRIAL]
            code = subprocess.run(command, cwd=ROOT, timeout=PATIENCE_S, **quiet).returncode
        except subprocess.TimeoutExpired:
            return f"no browser started within {PATIENCE_S:g} s"
        told.seek(0)
        lines = told.read().decode(errors="replace").split("\n")
    causes = [line for line in lines if "error while loading shared libraries" in line]
    last = (causes or [line for line in lines if line.strip()] or [f"exit code {code}"])[-1]
    return f"no browser starts here: {last.strip()}" if code else ""


def faults_of(path: Path, browser: Any, *, slack_px: float = 0.7) -> list[Fault]:
    """Faults of a page at all widths, without scripts of its own, and of the SVG figures that it
    shows, or that are in the folder ``figures`` beside it.

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
    pictures: dict[str, bool] = page.evaluate(_PICTURES)
    absent = [picture for picture, is_there in pictures.items() if not is_there]
    faults += [Fault("missing", picture, path.name) for picture in absent]
    shown = [name for name, is_there in pictures.items() if is_there and name.endswith(".svg")]
    beside = [file.as_uri() for file in sorted(path.resolve().parent.glob("figures/*.svg"))]
    for picture in (*shown, *beside):
        page.goto(picture)
        faults += _checked(page.evaluate(_BOXES, False), picture.rpartition("/")[2], slack_px)
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
