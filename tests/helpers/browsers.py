"""A browser for tests; where none starts they are skipped with the reason."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from tests.helpers.page_boxes import browser, chromium

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 120.0  #: Time in which a browser starts on any machine.
TRIAL = "from tests.helpers.page_boxes import browser\nwith browser(): pass"


@contextmanager
def browser_or_skip() -> Iterator[Any]:
    """A browser without a window; skips the test that asks for it where there is none."""
    if reason := refusal():
        pytest.skip(reason)
    with browser() as started:
        yield started


@cache
def refusal() -> str:
    """Why no browser starts here; empty where one does.

    The first start is in another process: a driver that misses a library of the system would take
    the tests with it, or leave them waiting.
    """
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
