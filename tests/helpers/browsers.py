"""A browser for tests, which are skipped where none starts."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

#: Names of the browser's program.
PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "chrome")


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
