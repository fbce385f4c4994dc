"""Location of many touches, each from one row of readings, at tens of thousands per second."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.electrodes.channel import get_reading_unit
from pvdf_fem.inverse.clipping import ReadingLimits, TableLimits
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
from pvdf_fem.inverse.touch.validation import MAX_READING_PC, MIN_CHARGE_PC, find_reading_errors
from pvdf_fem.scene.arguments import as_response, coerce
from pvdf_fem.surrogate.charge_function import ChargeFunction
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: Maximum number of rows that are located together. Each takes about 3 kB during the searches.
CHUNK_ROWS = 32768
#: Options of searches for mistakes in readings. Most mistakes are not the cause and fit no touch,
#: so that these searches are abandoned early.
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
    unit: str | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
    include_calibration: bool = True,
    calibrated: bool = False,
) -> Touches:
    """Find the most likely touch for each of many rows of readings.

    The position is always unknown; rotation and force are unknown unless they are given. Rows are
    independent of each other: a row that cannot be used has no touch, but a status that says why.

    Parameters
    ----------
    response, sigma, noise_pC, reading, unit
        As for `locate`, except that `response` must not be a scene.
    readings : array_like, shape (n, electrodes), or mapping
        Rows of readings of all electrodes, in the order of the response; or columns of n readings
        by the electrode's name, for some or all electrodes. None and NaN are missing readings, and
        infinite ones are beyond the range of the channel.
    rotations_deg : array_like, shape (n,), optional
        Known rotation of each row in the frame of the scene's stage.
    forces_N : array_like, shape (n,), optional
        Known force of each row.
    limits : mapping of str to tuple of float, optional
        Lowest and highest reading by electrode in `unit`, at which readings are clipped, besides
        the range of the readout. By default those that `readings` show, see
        `pvdf_fem.inverse.clipping.TableLimits`.
    include_calibration : bool
        Whether standard deviations include the errors that the calibration of the sensor has left,
        of the scene's ``[calibration]``. They are the same for all touches, so that averaging does
        not reduce them.
    calibrated : bool
        Whether to find all likely touches of each row, and to compute `Touches.deviations` from the
        posterior distribution instead of the curvature of the likelihood, as `locate` does. This is
        a hundred times slower.

    Returns
    -------
    Touches
        A touch and a status for each row.

    Raises
    ------
    ValueError
        If shapes do not match, or if arguments are invalid as for `locate`.

    Notes
    -----
    The first search for a row begins at the best candidate of a coarse grid. If its end point does
    not explain the readings, searches from several candidates follow, and finally searches
    throughout the domain as in `locate`.

    Examples
    --------
    >>> response = build_response("sensor.toml", tolerance=3e-2)
    >>> readings = [[350.0, 240.0, 200.0, 230.0], [330.0, 300.0, 210.0, 240.0]]
    >>> locate_many(response, readings, sigma=0.01, reading="change").status
    """
    response = as_response(response)
    columns = _read_columns(response, readings)
    calibrated = coerce("calibrated", calibrated, bool)
    limits = coerce("limits", limits, dict[str, tuple[float, float]] | None)
    if unit is None:
        unit = get_reading_unit(response.scene)
    errors = list(
        find_reading_errors(
            response.scene,
            dict.fromkeys(columns.names, math.pi),  # valid numbers: rows have a status instead
            sigma=sigma,
            noise_pC=noise_pC,
            reading=reading,
            unloaded_charges=response.unloaded_charges_pC,
            unit=unit,
        )
    )
    known: dict[int, Array] = {}
    if rotations_deg is not None:
        known[TouchColumn.ROTATION] = _convert_values_to_floats(rotations_deg, "rotations_deg")
    if forces_N is not None:
        known[TouchColumn.FORCE] = _convert_values_to_floats(forces_N, "forces_N")
    for column, values in known.items():
        if values.shape != (len(columns.readings),):
            name = "forces_N" if column == TouchColumn.FORCE else "rotations_deg"
            errors.append(f"{name} of shape {values.shape}: give one number per row")
    if errors:
        raise ValueError("\n".join(errors))
    measurement = Measurement.from_response(
        response,
        columns.names,
        sigma=sigma,
        noise_pC=noise_pC,
        reading=reading,
        unit=unit,
        include_calibration=coerce("include_calibration", include_calibration, bool),
    )
    units_pC = get_units_pC(response.scene, unit)
    electrode_units_pC = np.array([units_pC[name] for name in columns.names])
    readings_pC = columns.readings * electrode_units_pC
    if limits is None:
        recognised = TableLimits(measurement.channels).learn(readings_pC, "pC")
    else:
        recognised = _order_limits(limits, columns.names).scale(electrode_units_pC)
    measurement = replace(measurement, limits_pC=measurement.limits_pC.tighten(recognised))
    unknown = np.array([i for i in range(len(TOUCH_QUANTITIES)) if i not in known])
    status = _decide_initial_status(measurement, readings_pC, known, unknown)
    names = tuple(TOUCH_QUANTITIES[column] for column in unknown)
    touches = Touches.make_empty(status, names, measurement.reading)
    is_clipped = measurement.find_sides(readings_pC) != 0
    touches.clipped[:] = _join_names(columns.names, is_clipped)
    touches.missing[:] = _join_names(columns.names, ~np.isfinite(readings_pC) & ~is_clipped)
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
    """Locate some rows together, and store their touches and explanations in `touches`.

    A row that is not explained by the search from the best candidate is searched again from several
    candidates, and then throughout the domain. If no touch explains it, mistakes in its readings
    are tried.

    Parameters
    ----------
    touches : Touches
        Results of all rows, whose entries for `rows` are overwritten.
    rows : ndarray of int, shape (m,)
        Indices of the rows to locate.
    measurement : Measurement
        Meaning, channels and noise of the readings.
    readings_pC : ndarray, shape (m, electrodes)
        Readings of these m rows in nominal pC: volts times the channel's nominal capacitance.
    known : mapping
        Known quantities of all n rows by column, arrays of shape (n,).
    calibrated : bool
        Whether to search throughout the domain for every row, which gives deviations from the
        posterior distribution and the number of alternatives.
    """
    unknown = np.array([i for i in range(len(TOUCH_QUANTITIES)) if i not in known])
    fixed = _compute_fixed_coordinates(known, rows)
    problem = measurement.make_problem(readings_pC, unknown)
    ends = search_rows(problem, fixed, count=1)
    failed = np.flatnonzero(~mark_explained(problem, ends))
    if failed.size:
        failed_fixed = _compute_fixed_coordinates(known, rows[failed])
        failed_problem = problem.select_rows(failed)
        retried = search_rows(failed_problem, failed_fixed, DEFAULT_OPTIONS.retry_candidates)
        ends.replace_worse(failed, retried)
    remaining = np.arange(len(rows))
    if not calibrated:
        remaining = np.flatnonzero(~mark_explained(problem, ends))
    for index in remaining.tolist():
        location = _search_row_everywhere(problem, ends, fixed, index)
        if calibrated:
            touches.alternatives[rows[index]] = location.alternatives
            if location.touches:
                touches.deviations[rows[index]] = list(location.deviations.values())
    touches.store(rows, problem, ends)
    is_unexplained = ~touches.explained[rows]
    unexplained = rows[is_unexplained]
    unexplained_pC = readings_pC[is_unexplained]
    unexplained_fixed = _compute_fixed_coordinates(known, unexplained)
    for found in find_explanations(measurement, unexplained_pC, unknown, unexplained_fixed):
        touches.explanations[unexplained[found.rows]] += f"; explained if {found.text}"


def _compute_fixed_coordinates(known: Mapping[int, Array], rows: Indices) -> dict[int, Array]:
    """Compute the coordinates of the known quantities of some rows, by column.

    Parameters
    ----------
    known : mapping
        Known quantities of all rows by column; forces in N.
    rows : ndarray of int, shape (m,)
        Indices of the rows.

    Returns
    -------
    dict of int to ndarray, shape (m,)
        Known quantities of these rows, with the logarithm of the force in place of the force.
    """
    fixed = {}
    for column, values in known.items():
        fixed[column] = np.log(values[rows]) if column == TouchColumn.FORCE else values[rows]
    return fixed


class ReadingExplanation(NamedTuple):
    """A mistake in readings whose correction lets touches explain some rows."""

    text: str  #: The mistake in words.
    problem: LocationProblem  #: The problem with the corrected readings of all rows.
    ends: SearchResult  #: End points of the searches for the explained rows.
    rows: Indices  #: Indices of the explained rows.


def find_explanations(
    measurement: Measurement,
    readings_pC: Array,
    unknown: Indices,
    fixed: Mapping[int, Array],
) -> Iterator[ReadingExplanation]:
    """Yield the common mistakes whose correction lets touches explain some rows of readings.

    Parameters
    ----------
    measurement : Measurement
        Meaning, channels and noise of the readings as stated by the user.
    readings_pC : ndarray, shape (n, electrodes)
        Readings that no touch explains, in nominal pC: volts times the channel's nominal
        capacitance.
    unknown : ndarray of int
        Columns of the free quantities.
    fixed : mapping
        Coordinates of the fixed quantities by column, arrays of shape (n,).

    Yields
    ------
    ReadingExplanation
        One for each mistake whose correction explains at least one row.
    """
    if not len(readings_pC):
        return
    sides = measurement.find_sides(readings_pC)
    limited_pC = measurement.limits_pC.replace_clipped(readings_pC, sides)
    for alternative in measurement.list_alternatives():
        corrected = alternative.correct(limited_pC)
        corrected_sides = np.sign(alternative.correct(sides.astype(float))).astype(int)
        problem = alternative.measurement.make_problem(corrected, unknown, corrected_sides)
        ends = search_rows(problem, fixed, count=1, options=EXPLANATION_SEARCH)
        rows = np.flatnonzero(mark_explained(problem, ends))
        if rows.size:
            yield ReadingExplanation(alternative.text, problem, ends.select(rows), rows)


def _search_row_everywhere(
    problem: LocationProblem, ends: SearchResult, fixed: Mapping[int, Array], index: int
) -> Location:
    """Locate one row by searches throughout the domain, as `locate` does.

    Parameters
    ----------
    problem : LocationProblem
        The problem of all n rows.
    ends : SearchResult
        The best end point of each row so far. That of row `index` is overwritten in place if a
        better one is found.
    fixed : mapping
        Coordinates of the fixed quantities by column, arrays of shape (n,).
    index : int
        Index of the row.

    Returns
    -------
    Location
        All likely touches of the row, from the new searches and the previous end point.
    """
    row = np.array([index])
    row_problem = problem.select_rows(row)
    row_fixed = {column: float(values[index]) for column, values in fixed.items()}
    searched = search_everywhere(row_problem, row_fixed, DEFAULT_OPTIONS)
    every_end = concatenate_results([ends.select(row), searched])
    ends.replace_worse(row, every_end.select(every_end.ranking.argsort()[:1]))
    return make_location(row_problem, every_end)


class _ReadingColumns(NamedTuple):
    """Readings of some electrodes, in the unit of the user."""

    names: tuple[str, ...]  #: Names of the electrodes.
    readings: Array  #: Rows of readings; shape (n, electrodes).


def _read_columns(
    response: ChargeFunction, readings: ArrayLike | Mapping[str, ArrayLike]
) -> _ReadingColumns:
    """Convert readings to an array, from rows of numbers or from columns by electrode.

    A `ValueError` is raised if the shapes do not match or if readings are not numbers.
    """
    if not hasattr(readings, "keys"):
        names = tuple(response.names)
        rows = _convert_values_to_floats(readings, "readings")
        if rows.ndim != 2 or rows.shape[1] != len(names):
            reason = f"must be (rows, {len(names)})"
            advice = f"give a column for each of {', '.join(names)}"
            raise ValueError(f"readings of shape {rows.shape}: {reason}; {advice}")
        return _ReadingColumns(names, rows)
    by_name: Any = readings  # a mapping or a DataFrame, which has keys, too
    columns = {
        name: _convert_values_to_floats(by_name[name], f"readings.{name}") for name in by_name
    }
    if len({column.shape for column in columns.values()}) > 1:
        raise ValueError("readings: columns differ in length; give one reading per row")
    if not columns:
        return _ReadingColumns((), np.empty((0, 0)))
    return _ReadingColumns(tuple(columns), np.stack(list(columns.values()), axis=1))


def _order_limits(limits: Mapping[str, tuple[float, float]], names: Sequence[str]) -> ReadingLimits:
    """Return limits in the order of electrodes; those without an entry have infinite limits."""
    pairs = [limits.get(name, (-math.inf, math.inf)) for name in names]
    low, high = np.array(pairs, dtype=float).reshape(-1, 2).T
    return ReadingLimits(low, high)


def _join_names(names: Sequence[str], is_named: Mask) -> list[str]:
    """Join the names that are marked in each row of a mask, with spaces between them.

    Parameters
    ----------
    names : sequence of str
        The names.
    is_named : ndarray of bool, shape (n, names)
        The mask.

    Returns
    -------
    list of str
        A text for each row.
    """
    texts = [""] * len(is_named)
    for row in np.flatnonzero(is_named.any(axis=1)).tolist():
        texts[row] = " ".join(np.array(names)[is_named[row]].tolist())
    return texts


def _convert_values_to_floats(values: Any, key: str) -> Array:
    """Convert values to an array of floats, in which None becomes NaN.

    Raises
    ------
    ValueError
        If a value is not a number; the message begins with `key`, the name of the argument.
    """
    try:
        return np.asarray(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        reason = "must be a table of numbers; give NaN for missing ones"
        raise ValueError(f"{key} = {values!r:.60}: {reason}") from None


def _decide_initial_status(
    measurement: Measurement, readings_pC: Array, known: Mapping[int, Array], unknown: Indices
) -> NDArray[np.object_]:
    """Decide for each row of readings whether to search for its touch, or why this is impossible.

    Parameters
    ----------
    measurement : Measurement
        Meaning, channels and noise of the readings.
    readings_pC : ndarray, shape (n, electrodes)
        Readings in nominal pC (volts times the channel's nominal capacitance); may be infinite or
        NaN.
    known : mapping
        Known quantities by column, arrays of shape (n,).
    unknown : ndarray of int
        Columns of the free quantities.

    Returns
    -------
    ndarray of TouchStatus, shape (n,)
        `TouchStatus.LOCATED` for rows that can be used, otherwise the reason.
    """
    any_row = np.zeros_like(readings_pC[:1])
    values = np.zeros(any_row.shape, dtype=int)
    needed = len(measurement.make_problem(any_row, unknown, values).free_columns)
    is_clipped = measurement.find_sides(readings_pC) != 0
    is_number = np.isfinite(readings_pC)
    is_missing = ~(is_number | is_clipped)
    is_value = is_number & ~is_clipped
    value_counts = is_value.sum(axis=1)
    # Huge readings must not overflow.
    clipped = np.clip(readings_pC, -MAX_READING_PC, MAX_READING_PC)
    is_small = np.abs(measurement.to_signals(clipped)) < MIN_CHARGE_PC
    has_no_deviation = (is_small & (measurement.noise_pC == 0.0)).any(axis=1)
    lowest, highest = measurement.response.domain.force_N
    forces = known.get(TouchColumn.FORCE, np.full(len(readings_pC), lowest))
    is_finite = np.isfinite([forces, *known.values()]).all(axis=0)
    status = np.full(len(readings_pC), TouchStatus.LOCATED, dtype=object)
    # If several reasons apply, the last one overwrites the others.
    is_too_few = value_counts < needed
    status[is_too_few] = TouchStatus.CLIPPED
    if readings_pC.shape[1] < needed:
        status[:] = TouchStatus.UNDETERMINED
    status[~((lowest <= forces) & (forces <= highest))] = TouchStatus.OUTSIDE
    status[is_small.all(axis=1) | has_no_deviation] = TouchStatus.ZERO
    is_too_large = (np.abs(readings_pC) > MAX_READING_PC) & is_number
    status[is_too_large.any(axis=1)] = TouchStatus.TOO_LARGE
    status[(is_too_few & is_missing.any(axis=1)) | ~is_finite] = TouchStatus.NOT_FINITE
    return status
