"""Progress: finished work, the remaining time, and where both are shown. Time is made up."""

from __future__ import annotations

import io
import subprocess
import sys
from types import SimpleNamespace

import pytest

from pvdf_fem import progress
from pvdf_fem.progress import TaskRunner, format_remaining_time, show_progress


def run_job(monkeypatch, on_terminal, requested, after_s=0.0):
    """Return the standard error of a job of which a quarter is done after a second."""
    stream = io.StringIO()
    stream.isatty = lambda: on_terminal
    monkeypatch.setattr("sys.stderr", stream)
    times = iter([10.0, 11.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(times)))
    with show_progress("solves", requested, after_s) as show:
        show(1, 4)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("on_terminal", "requested", "expected"),
    [
        (True, None, "25%"),
        (True, True, "25%"),
        (True, False, ""),
        (False, None, ""),
        (False, False, ""),
        (False, True, f"1 of 4 solves, {format_remaining_time(3.0)} left\n"),
    ],
)
def test_progress_is_shown_on_terminals_and_on_request(
    monkeypatch, on_terminal, requested, expected
):
    text = run_job(monkeypatch, on_terminal, requested)
    assert expected in text
    assert bool(text) is bool(expected)
    assert run_job(monkeypatch, on_terminal, requested, after_s=2.0) == ""  # a short job is silent


def test_a_terminal_has_a_bar_with_the_remaining_time_that_disappears(monkeypatch):
    *_, bar, end = run_job(monkeypatch, True, None).split("\r")
    assert bar.strip() == ""  # the bar is overwritten by blanks
    assert end == ""
    shown = run_job(monkeypatch, True, None).split("\r")[1]
    assert shown.startswith(" 25% ")
    assert "1 of 4 solves, 00:03 left" in shown


def test_lines_of_progress_are_some_seconds_apart(monkeypatch):
    stream = io.StringIO()
    monkeypatch.setattr("sys.stderr", stream)
    times = iter([0.0, 2.5, 3.0, 4.6])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(times)))
    with show_progress("solves", True) as show:
        for done in (1, 2, 3):
            show(done, 4)
    assert [line[:1] for line in stream.getvalue().splitlines()] == ["1", "3"]


def test_a_callable_receives_every_report(monkeypatch):
    calls = []
    assert run_job(monkeypatch, True, lambda *report: calls.append(report)) == ""
    assert calls == [(1, 4)]


def test_tqdm_is_imported_with_the_first_bar_only():
    code = "import sys, pvdf_fem.progress; print('tqdm' in sys.modules)"
    command = [sys.executable, "-c", code]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


def test_tasks_are_reported_in_seconds_of_one_core(monkeypatch):
    """Tasks to come take as long as the same function took; `int` waits for its first."""
    times = iter([7.0, 7.5, 7.5, 8.0, 8.0, 8.0, 8.0, 8.5])
    monkeypatch.setattr(progress, "time", SimpleNamespace(process_time=lambda: next(times)))
    calls = []
    runner = TaskRunner(1, lambda *report: calls.append(report))
    assert [*runner.run([(abs, 2), (abs, 3), (int,), (abs, 4)])] == [2, 3, 0, 4]
    assert calls == [(1.0, 1.5), (1.5, 1.5)]
