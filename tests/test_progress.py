"""Progress: what is done, how long the rest takes, and where that is told. Time is made up."""

from __future__ import annotations

import io
from types import SimpleNamespace

import pytest

from pvdf_fem import progress
from pvdf_fem.progress import Work, remaining, shown


class Stream(io.StringIO):
    """Standard error that is a terminal, or is not."""

    def __init__(self, terminal: bool) -> None:
        super().__init__()
        self.terminal = terminal

    def isatty(self) -> bool:
        return self.terminal


def told(monkeypatch, terminal, asked, after_s=0.0, seconds=1.0):
    stream = Stream(terminal)
    monkeypatch.setattr("sys.stderr", stream)
    times = iter([10.0, 10.0 + seconds])
    monkeypatch.setattr(progress, "time", SimpleNamespace(monotonic=lambda: next(times)))
    with shown("solves", asked, after_s) as show:
        show(1, 4)
    return stream.getvalue()


@pytest.mark.parametrize(
    ("terminal", "asked", "expected"),
    [(True, None, True), (True, False, False), (False, None, False), (False, True, True)],
)
def test_it_is_shown_on_terminals_and_where_it_is_asked_for(monkeypatch, terminal, asked, expected):
    text = told(monkeypatch, terminal, asked)
    assert (f"1 of 4 solves, {remaining(3.0)} left" in text) == expected
    assert told(monkeypatch, terminal, asked, after_s=2.0) == ""  # a short job is silent


def test_times_are_told_in_seconds_and_from_two_minutes_on_in_minutes():
    assert remaining(40.0).split()[1:] == ["40", "s"]
    assert remaining(300.0).split()[1:] == ["5", "min"]


def test_a_callable_is_told_everything(monkeypatch):
    calls = []
    assert told(monkeypatch, True, lambda *at: calls.append(at)) == ""
    assert calls == [(1, 4)]


def long_one(value):
    return value


def short_one():
    return 0.0


def test_work_is_told_in_seconds_of_one_core(monkeypatch):
    """Tasks to come take as long as the same function took; `short_one` waits for its first."""
    monkeypatch.setattr(progress, "_timed", lambda of, *given: (of(*given), 0.5 * bool(given)))
    calls = []
    work = Work(1, lambda *at: calls.append(at))
    assert [*work.run([(long_one, 2), (long_one, 3), (short_one,), (long_one, 4)])] == [2, 3, 0, 4]
    assert calls == [(1.0, 1.5), (1.5, 1.5)]
