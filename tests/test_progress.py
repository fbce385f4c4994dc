"""Progress: what is done, how long the rest takes, and where that is told."""

from __future__ import annotations

import time

import pytest

from pvdf_fem.progress import Work, remaining, shown


class Stream:
    """Standard error that is a terminal, or is not."""

    def __init__(self, terminal: bool) -> None:
        self.terminal, self.text = terminal, ""

    def isatty(self) -> bool:
        return self.terminal

    def write(self, text: str) -> None:
        self.text += text

    def flush(self) -> None:
        pass


def told(monkeypatch, terminal, asked, after_s=0.0, seconds=0.0):
    stream = Stream(terminal)
    monkeypatch.setattr("sys.stderr", stream)
    with shown("solves", asked, after_s) as show:
        time.sleep(seconds)
        show(1, 4)
    return stream.text


@pytest.mark.parametrize(
    ("terminal", "asked", "expected"),
    [(True, None, True), (True, False, False), (False, None, False), (False, True, True)],
)
def test_it_is_shown_on_terminals_and_where_it_is_asked_for(monkeypatch, terminal, asked, expected):
    assert ("1 of 4 solves" in told(monkeypatch, terminal, asked)) == expected


def test_short_jobs_are_silent(monkeypatch):
    assert told(monkeypatch, True, True, after_s=2.0) == ""


def test_the_rest_takes_as_long_as_what_is_done(monkeypatch):
    assert f"1 of 4 solves, {remaining(3.0)} left" in told(monkeypatch, False, True, 0.0, 1.0)
    assert remaining(40.0).split()[1:] == ["40", "s"]
    assert remaining(300.0).split()[1:] == ["5", "min"]


def test_a_callable_is_told_everything(monkeypatch):
    calls = []
    assert told(monkeypatch, True, lambda *at: calls.append(at)) == ""
    assert calls == [(1, 4)]


def busy(seconds):
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
    return seconds


def idle():
    return 0.0


def test_work_is_told_in_seconds_of_one_core():
    """Those to come take as long as what the same function took; `idle` waits for its first."""
    calls = []
    work = Work(1, lambda *at: calls.append(at))
    assert [*work.run([(busy, 0.02), (busy, 0.02), (idle,), (busy, 0.02)])] == [0.02, 0.02, 0, 0.02]
    assert len(calls) == 2
    (done, total), (last, whole) = calls
    assert total == pytest.approx(1.5 * done, rel=0.2)
    assert last == pytest.approx(whole)
    assert last == pytest.approx(0.06, rel=0.2)
