"""Locate the most likely touch for each of many rows of readings, tens of thousands a second."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.inverse.least_squares import SearchOptions, SearchResult, concatenate_results
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.measurement import Deviations, Measurement, get_units_pC
from pvdf_fem.inverse.touch.search import (
    DEFAULT_OPTIONS,
    make_location,
    mark_explained,
    search_everywhere,
    search_rows,
)
from pvdf_fem.inverse.touch.touch import TouchStatus
from pvdf_fem.inverse.touch.touches import Touches
from pvdf_fem.inverse.touch.validation import LARGEST_PC, LEAST_PC, find_reading_errors
from pvdf_fem.scene.arguments import as_response, coerce
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: Rows that are located together: they take some 3 kB each while searches are under way.
CHUNK_ROWS = 32768
#: Of searches for mistakes in readings, few of which converge.
EXPLANATION_SEARCH = SearchOptions(max_steps=12)


def locate_many(
    response: ChargeFunction,
    readings: ArrayLike | Mapping[str, ArrayLike],
    sigma: Deviations = 0.01,
    *,
    rotations_deg: ArrayLike | None = None,
    forces_N: ArrayLike | None = None,
    noise_pC: Deviations | None = None,
    reading: str | None = None,
    unit: str = "pC",
    calibrated: bool = False,
) -> Touches:
    """Find the most likely touch for each of many rows of readings.

    The place is always unknown, rotation and force are unless they are given. A row that cannot be
    used changes no other row.

    Parameters
    ----------
    response, sigma, noise_pC, reading, unit
        As for `locate`; a scene cannot stand for the response.
    readings : array_like, shape (n, electrodes), or mapping
        Rows of readings of all electrodes, or the n readings of some electrodes by name.
    rotations_deg : array_like, shape (n,), optional
        Known rotations in the frame of the scene's stage.
    forces_N : array_like, shape (n,), optional
        Known forces.
    calibrated : bool
        Whether all likely touches of each row are found and deviations are calibrated, as `locate`
        does; that is a hundred times slower.

    Returns
    -------
    Touches
        A touch and a status for each row.

    Raises
    ------
    ValueError
        For shapes that do not match, and for mistakes as in `locate`.

    Notes
    -----
    The first search for a row begins with the best candidate of a coarse grid. If its end does not
    explain the readings, searches from several candidates follow, and at last searches all over the
    domain as in `locate`.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> readings = [[350.0, 240.0, 200.0, 230.0], [330.0, 300.0, 210.0, 240.0]]
    >>> locate_many(response, readings, sigma=0.01, reading="change").status
    """
    response = as_response(response)
    columns = _read_columns(response, readings)
    calibrated = coerce("calibrated", calibrated, bool)
    errors = list(
        find_reading_errors(
            response.scene,
            dict.fromkeys(columns.names, math.pi),  # any valid readings
            sigma=sigma,
            noise_pC=noise_pC,
            reading=reading,
            unloaded_charges=response.unloaded_charges_pC,
            unit=unit,
        )
    )
    known: dict[int, Array] = {}
    if rotations_deg is not None:
        known[TouchColumn.ROTATION] = _read_numbers(rotations_deg, "rotations_deg")
    if forces_N is not None:
        known[TouchColumn.FORCE] = _read_numbers(forces_N, "forces_N")
    for column, values in known.items():
        if values.shape != (len(columns.readings),):
            name = "forces_N" if column == TouchColumn.FORCE else "rotations_deg"
            errors.append(f"{name} of shape {values.shape}: give one number per row")
    if errors:
        raise ValueError("\n".join(errors))
    measurement = Measurement.from_response(
        response, columns.names, sigma=sigma, noise_pC=noise_pC, reading=reading, unit=unit
    )
    units_pC = get_units_pC(response.scene, unit)
    readings_pC = columns.readings * [units_pC[name] for name in columns.names]
    unknown = np.array([i for i in range(len(TOUCH_QUANTITIES)) if i not in known])
    status = _decide_initial_status(measurement, readings_pC, known, unknown)
    names = tuple(TOUCH_QUANTITIES[column] for column in unknown)
    touches = Touches.empty(status, names, measurement.reading)
    usable = np.flatnonzero(status == TouchStatus.LOCATED)
    for first in range(0, len(usable), CHUNK_ROWS):
        rows = usable[first : first + CHUNK_ROWS]
        _locate_rows(touches, rows, measurement, readings_pC[rows], known, calibrated)
    return touches


def _locate_rows(
    touches: Touches,
    rows: Indices,
    measurement: Measurement,
    readings_pC: Array,
    known: Mapping[int, Array],
    calibrated: bool,
) -> None:
    """Locate some rows together and store their touches.

    Parameters
    ----------
    touches : Touches
        Results of all rows, of which these are filled in.
    rows : ndarray of int, shape (m,)
        The rows to locate.
    measurement : Measurement
        Meaning and noise of the readings.
    readings_pC : ndarray, shape (m, electrodes)
        Readings of these rows.
    known : mapping
        Known quantities of all rows by column.
    calibrated : bool
        Whether all likely touches are found for deviations and numbers of alternatives.
    """
    unknown = np.array([i for i in range(len(TOUCH_QUANTITIES)) if i not in known])
    fixed = _fix_coordinates(known, rows)
    problem = measurement.make_problem(readings_pC, unknown)
    ends = search_rows(problem, fixed, count=1)
    failed = np.flatnonzero(~mark_explained(problem, ends))
    if failed.size:
        failed_fixed = _fix_coordinates(known, rows[failed])
        failed_problem = problem.select_rows(failed)
        retried = search_rows(failed_problem, failed_fixed, DEFAULT_OPTIONS.retry_candidates)
        ends.replace_worse(failed, retried)
    thorough = np.arange(len(rows))
    if not calibrated:
        thorough = np.flatnonzero(~mark_explained(problem, ends))
    for index in thorough.tolist():
        location = _search_thoroughly(problem, ends, fixed, index)
        if calibrated:
            touches.alternatives[rows[index]] = location.alternatives
            if location.touches:
                touches.deviations[rows[index]] = list(location.deviations.values())
    touches.store(rows, problem, ends)
    is_strange = ~touches.explained[rows]
    strange = rows[is_strange]
    strange_fixed = _fix_coordinates(known, strange)
    for found in find_explanations(measurement, readings_pC[is_strange], unknown, strange_fixed):
        touches.explanations[strange[found.rows]] += f"; explained if {found.text}"


def _fix_coordinates(known: Mapping[int, Array], rows: Indices) -> dict[int, Array]:
    """Return the fixed coordinates of some rows from the known quantities of all rows."""
    fixed = {}
    for column, values in known.items():
        fixed[column] = np.log(values[rows]) if column == TouchColumn.FORCE else values[rows]
    return fixed


class ReadingExplanation(NamedTuple):
    """A mistake in readings without which touches explain some rows."""

    text: str  #: The mistake in words.
    problem: LocationProblem  #: The problem without the mistake, of all rows.
    ends: SearchResult  #: Ends of searches at the touches that explain rows.
    rows: Indices  #: The rows that are explained.


def find_explanations(
    measurement: Measurement,
    readings_pC: Array,
    unknown: Indices,
    fixed: Mapping[int, Array],
) -> Iterator[ReadingExplanation]:
    """Find mistakes in readings without which touches explain them.

    Parameters
    ----------
    measurement : Measurement
        Meaning and noise of the readings as they were given.
    readings_pC : ndarray, shape (n, electrodes)
        Readings that no touch explains.
    unknown : ndarray of int
        Columns of the free quantities.
    fixed : mapping
        Coordinates (n,) of the fixed quantities by column.

    Yields
    ------
    ReadingExplanation
        One for each mistake that explains some rows.
    """
    if not len(readings_pC):
        return
    for alternative in measurement.list_alternatives():
        corrected = alternative.correct(readings_pC)
        problem = alternative.measurement.make_problem(corrected, unknown)
        ends = search_rows(problem, fixed, count=1, options=EXPLANATION_SEARCH)
        rows = np.flatnonzero(mark_explained(problem, ends))
        if rows.size:
            yield ReadingExplanation(alternative.text, problem, ends.select(rows), rows)


def _search_thoroughly(
    problem: LocationProblem, ends: SearchResult, fixed: Mapping[int, Array], index: int
) -> Location:
    """Locate one row by searches all over the domain, as `locate` does.

    Parameters
    ----------
    problem : LocationProblem
        The problem of all rows.
    ends : SearchResult
        The best end for each row so far; the row's end is replaced by a better one.
    fixed : mapping
        Coordinates (rows,) of the fixed quantities by column.
    index : int
        The row.
    """
    row = np.array([index])
    row_problem = problem.select_rows(row)
    row_fixed = {column: float(values[index]) for column, values in fixed.items()}
    searched = search_everywhere(row_problem, row_fixed, DEFAULT_OPTIONS)
    every_end = concatenate_results([ends.select(row), searched])
    ends.replace_worse(row, every_end.select(every_end.ranking.argsort()[:1]))
    return make_location(row_problem, every_end)


class _ReadingColumns(NamedTuple):
    """Readings of some electrodes."""

    names: tuple[str, ...]  #: Names of the electrodes.
    readings: Array  #: (n, electrodes)


def _read_columns(
    response: ChargeFunction, readings: ArrayLike | Mapping[str, ArrayLike]
) -> _ReadingColumns:
    """Return names of electrodes with their readings, from rows or from columns by name."""
    if not hasattr(readings, "keys"):
        names = tuple(response.names)
        rows = _read_numbers(readings, "readings")
        if rows.ndim != 2 or rows.shape[1] != len(names):
            raise ValueError(f"readings of shape {rows.shape}: must be (n, {len(names)})")
        return _ReadingColumns(names, rows)
    given: Any = readings
    columns = {name: _read_numbers(given[name], f"readings.{name}") for name in given}
    if len({column.shape for column in columns.values()}) > 1:
        raise ValueError("readings: columns differ in length; give one reading per row")
    if not columns:
        return _ReadingColumns((), np.empty((0, 0)))
    return _ReadingColumns(tuple(columns), np.stack(list(columns.values()), axis=1))


def _read_numbers(values: Any, key: str) -> Array:
    """Return values as floats, NaN for None; `ValueError` if they are not numbers."""
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        reason = "must be a table of numbers; give NaN for missing ones"
        raise ValueError(f"{key} = {values!r:.60}: {reason}") from None


def _decide_initial_status(
    measurement: Measurement, readings_pC: Array, known: Mapping[int, Array], unknown: Indices
) -> NDArray[np.object_]:
    """Find the rows that cannot be located.

    Parameters
    ----------
    measurement : Measurement
        Meaning and noise of the readings.
    readings_pC : ndarray, shape (n, electrodes)
        Readings, some of which may be infinite or NaN.
    known : mapping
        Known quantities (n,) by column.
    unknown : ndarray of int
        Columns of the free quantities.

    Returns
    -------
    ndarray of TouchStatus, shape (n,)
        `TouchStatus.LOCATED` for rows that can be located, otherwise the reason why not.
    """
    any_row = np.zeros_like(readings_pC[:1])
    is_determinable = measurement.make_problem(any_row, unknown).is_determinable
    clipped = np.clip(readings_pC, -LARGEST_PC, LARGEST_PC)  # huge readings must not overflow
    is_small = np.abs(measurement.to_signals(clipped)) < LEAST_PC
    has_no_deviation = (is_small & (measurement.noise_pC == 0.0)).any(axis=1)
    lowest, highest = measurement.response.domain.force_N
    forces = known.get(TouchColumn.FORCE, np.full(len(readings_pC), lowest))
    is_finite = np.isfinite([*readings_pC.T, *known.values()]).all(axis=0)
    status = np.full(len(readings_pC), TouchStatus.LOCATED, dtype=object)
    # Where several reasons apply, the last one is given.
    if not is_determinable:
        status[:] = TouchStatus.UNDETERMINED
    status[~((lowest <= forces) & (forces <= highest))] = TouchStatus.OUTSIDE
    status[is_small.all(axis=1) | has_no_deviation] = TouchStatus.ZERO
    status[(np.abs(readings_pC) > LARGEST_PC).any(axis=1)] = TouchStatus.TOO_LARGE
    status[~is_finite] = TouchStatus.NOT_FINITE
    return status
