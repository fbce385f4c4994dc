"""Fits of made-up states of the sensor to the thesis's measured errors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import minimize

from pvdf_fem.arrays import Array
from reports.chapters.film_placement.explained import Trial, misfits_mm
from reports.chapters.film_placement.sensor import (
    FILM_MM,
    FILM_TURN_DEG,
    GAIN_SHARE,
    NAMES,
    SensorStates,
    ThesisContours,
    Touch,
    position_errors_mm,
)
from reports.chapters.positions.location import PositionCase
from reports.common.results import Results
from reports.common.thesis_data import Position, Thesis

PLACED = "shift and turn"
GAINS = "gains"
ALL = "shift, turn and gains"
#: Numbers of parameters of the causes.
PARAMETERS = {PLACED: 3, GAINS: len(NAMES) - 1, ALL: 2 + len(NAMES)}


@dataclass(frozen=True, eq=False)
class Measured:
    """The rows of the tables with what predicts their errors."""

    rows: Sequence[Position]
    touches: Sequence[Touch]
    #: By the name of the probe.
    contours: dict[str, ThesisContours]

    @classmethod
    def of(cls, thesis: Thesis, results: Results, rows: Sequence[Position]) -> Measured:
        """The rows with their maps, from the records of `placement_scenes`."""
        cases = [PositionCase.of(row) for row in rows]
        contours = {case.probe: ThesisContours.of(thesis, results, case) for case in cases}
        return cls(rows, [Touch.of(thesis, results, case) for case in cases], contours)

    @property
    def printed_mm(self) -> Array:
        """The printed errors, (rows,); NaN where contours did not cross."""
        return np.array([row.error_mm for row in self.rows])

    def errors_mm(self, states: SensorStates, rows: slice = slice(None)) -> Array:
        """Errors by the thesis's method, (n, rows)."""
        return np.stack([self._errors(touch, states) for touch in self.touches[rows]], axis=1)

    def separate_mm(self, count: int, reach_mm: float) -> Array:
        """Errors of touches that are each misplaced by itself, (count, rows)."""
        states = [
            SensorStates.touch_misplaced(count, reach_mm, seed=10 + i)
            for i in range(len(self.touches))
        ]
        return np.stack(list(map(self._errors, self.touches, states)), axis=1)

    def _errors(self, touch: Touch, states: SensorStates) -> Array:
        return position_errors_mm(touch, self.contours[touch.case.probe], states)


@dataclass(frozen=True, eq=False)
class Fit:
    """A cause that is fitted to one table, or to several at once."""

    tables: tuple[str, ...]
    cause: str
    #: The rows of the tables among all rows.
    rows: slice
    states: SensorStates
    trial: Trial
    measured: Measured
    #: Fits of a part of the cause to the same rows.
    parts: tuple[Fit, ...] = ()

    @property
    def title(self) -> str:
        """The name of the table, or ``Both tables``."""
        return self.tables[0] if len(self.tables) == 1 else "Both tables"

    @cached_property
    def state(self) -> SensorStates | None:
        """The state that a descent ends in; None if no state drawn agrees.

        The descent begins at the best state drawn or found for a part of the cause.
        """
        best = self.trial.best
        if best is None:
            return None
        starts = [self.states.one(best), *(part.state for part in self.parts if part.state)]
        start = min(starts, key=self._misfit_mm)

        def misfit(steps: Array) -> float:
            state = _moved(start, steps, self.cause)
            return self._misfit_mm(state) if _plausible(state) else np.inf

        return _moved(start, _descended(misfit, PARAMETERS[self.cause]), self.cause)

    def _misfit_mm(self, state: SensorStates) -> float:
        errors = self.measured.errors_mm(state, self.rows)
        return float(misfits_mm(errors, self.trial.printed_mm)[0])

    @cached_property
    def errors_mm(self) -> Array:
        """Errors of that state, (rows,); NaN without one."""
        if self.state is None:
            return np.full(len(self.trial.printed_mm), np.nan)
        return self.measured.errors_mm(self.state, self.rows)[0]


def _descended(misfit: Callable[[Array], float], count: int, most: int = 30) -> Array:
    """The steps (count,) at which `misfit` is smallest, from zero, in `most` trials of each."""
    corners = np.concatenate([np.zeros((1, count)), 0.2 * np.eye(count)])
    options = {"initial_simplex": corners, "maxfev": most * count, "xatol": 1e-3, "fatol": 1e-3}
    with np.errstate(invalid="ignore"):  # infinite misfits are subtracted
        return minimize(misfit, np.zeros(count), method="Nelder-Mead", options=options).x


def _moved(start: SensorStates, steps: Array, cause: str) -> SensorStates:
    """A state after steps, in units of the largest shift, turn and change of gain."""
    count = 0 if cause == GAINS else 3
    placed, gains = np.zeros(3), np.zeros(len(NAMES))
    placed[:count] = steps[:count]
    gains[: len(steps) - count] = GAIN_SHARE * steps[count:]
    return SensorStates(
        start.shifts_mm + FILM_MM * placed[:2],
        start.turns_deg + FILM_TURN_DEG * placed[2],
        start.gains * np.exp(gains - gains.mean()),
    )


def _plausible(state: SensorStates) -> bool:
    """Whether a state could have been drawn."""
    logs = np.log(state.gains)
    widest = np.log((1.0 + GAIN_SHARE) / (1.0 - GAIN_SHARE))
    return bool(
        np.linalg.norm(state.shifts_mm) <= FILM_MM
        and np.abs(state.turns_deg).max() <= FILM_TURN_DEG
        and np.ptp(logs) <= widest
    )


def fitted(measured: Measured, count: int, touch_mm: float) -> list[Fit]:
    """All causes fitted to each table and to both.

    Parameters
    ----------
    measured : Measured
        Its rows are in the order of the tables.
    count : int
        Number of states drawn of each cause, and of tables made up.
    touch_mm : float
        Distance within which a touch by itself is misplaced.
    """
    placed = SensorStates.drawn(count, placed=True, gains=False)
    gains = SensorStates.drawn(count, placed=False, gains=True)
    both = SensorStates.drawn(count, placed=True, gains=True)
    errors = {drawn: measured.errors_mm(drawn) for drawn in (placed, gains, both)}
    causes = {PLACED: (placed,), GAINS: (gains,), ALL: (placed, gains, both)}
    nominal_mm = measured.errors_mm(SensorStates.none())[0]
    separate_mm = measured.separate_mm(count, touch_mm)
    fits: list[Fit] = []
    for tables, rows in _parts([row.source for row in measured.rows]):
        for cause, drawn in causes.items():
            trial = Trial(
                [[row.source for row in measured.rows].count(table) for table in tables],
                measured.printed_mm[rows],
                nominal_mm[rows],
                np.concatenate([errors[each] for each in drawn])[:, rows],
                separate_mm[:, rows],
                PARAMETERS[cause],
            )
            states = drawn[0].and_(*drawn[1:])
            parts = tuple(fit for fit in fits if fit.tables == tables) if cause == ALL else ()
            fits.append(Fit(tables, cause, rows, states, trial, measured, parts))
    return fits


def _parts(sources: Sequence[str]) -> list[tuple[tuple[str, ...], slice]]:
    """Each table with its rows, and all tables together if there are several."""
    tables = tuple(dict.fromkeys(sources))
    starts = [sources.index(table) for table in tables]
    parts = [
        ((table,), slice(start, start + sources.count(table)))
        for table, start in zip(tables, starts, strict=True)
    ]
    whole = [(tables, slice(0, len(sources)))] if len(tables) > 1 else []
    return [*parts, *whole]
