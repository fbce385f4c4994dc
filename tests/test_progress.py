"""Progress: what is done, how long the rest takes, and where that is told. Time is made up."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest

from pvdf_fem import progress
from pvdf_fem.progress import TaskRunner, format_remaining_time, show_progress


def told(monkeypatch, terminal, asked, after_s=0.0):
    stream = io.StringIO()
    stream.isatty = lambda: terminal
    monkeypatch.setattr("sys.stderr", stream)
    times = iter([10.0, 11.0])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(times)))
    with show_progress("solves", asked, after_s) as show:
        show(1, 4)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("terminal", "asked", "expected"),
    [(True, None, True), (True, False, False), (False, None, False), (False, True, True)],
)
def test_it_is_shown_on_terminals_and_where_it_is_asked_for(monkeypatch, terminal, asked, expected):
    text = told(monkeypatch, terminal, asked)
    assert (f"1 of 4 solves, {format_remaining_time(3.0)} left" in text) == expected
    assert told(monkeypatch, terminal, asked, after_s=2.0) == ""  # a short job is silent


def test_a_callable_is_told_everything(monkeypatch):
    calls = []
    assert told(monkeypatch, True, lambda *at: calls.append(at)) == ""
    assert calls == [(1, 4)]


def test_work_is_told_in_seconds_of_one_core(monkeypatch):
    """Tasks to come take as long as the same function took; `int` waits for its first."""
    times = iter([7.0, 7.5, 7.5, 8.0, 8.0, 8.0, 8.0, 8.5])
    monkeypatch.setattr(progress, "time", SimpleNamespace(process_time=lambda: next(times)))
    calls = []
    work = TaskRunner(1, lambda *at: calls.append(at))
    assert [*work.run([(abs, 2), (abs, 3), (int,), (abs, 4)])] == [2, 3, 0, 4]
    assert calls == [(1.0, 1.5), (1.5, 1.5)]
