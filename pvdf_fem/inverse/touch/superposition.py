"""Searches by full solves, with initial candidates from superposed charges of single touches.

The charges of two simultaneous touches are nearly the sum of those of single touches, except that
each touch stiffens the film for the other one. Single touches are therefore solved at a few
positions and interpolated, and pairs of them are fitted to the measured charges.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.inverse.coordinates import get_base_quantity
from pvdf_fem.inverse.least_squares import (
    SearchResult,
    concatenate_results,
    run_levenberg_marquardt,
)
from pvdf_fem.inverse.single_touches import SingleTouches, tabulate_single_touches
from pvdf_fem.inverse.touch.location_problem import POSITION, LocationProblem
from pvdf_fem.inverse.touch.search import LocateOptions, find_distinct_ends
from pvdf_fem.inverse.touch.solved_charges import (
    UNSOLVED_PC,
    SolvedResponse,
    make_single_probe_scene,
)
from pvdf_fem.inverse.touch.touch import mark_plausible
from pvdf_fem.scene.stage import Stage
from pvdf_fem.surrogate.charge_function import compute_unloaded_charges_pC, count_probes
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: Exponent of the stiffening of the film by touches. Charges that are a times those under 1 N
#: belong to the force a (Σ a)^`STIFFENING` in N, with the sum of the amplitudes a of all touches.
STIFFENING = 0.35
#: Minimum amplitude of each touch as a fraction of the sum of the amplitudes.
MIN_FORCE_FRACTION = 0.03


def search_touches_by_solves(
    problem: LocationProblem, response: SolvedResponse, options: LocateOptions
) -> SearchResult:
    """Search for the touch of one probe, or of two simultaneous ones, by full solves.

    Searches with coarse solves begin at the candidates with the lowest chi-square, and further ones
    beside the best end point. Searches with fine solves continue from the distinct end points. If
    no end point explains the charges, the same is done for the remaining candidates.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    response : SolvedResponse
        The response of the problem, with fine solves.
    options : LocateOptions
        Numbers and tolerances of the searches.

    Returns
    -------
    SearchResult
        The distinct end points, with the lowest chi-square first; may be empty.
    """
    coarse = _make_coarse_problem(problem, response, options)
    swapped_columns = response.swapped_columns
    candidates = []
    for unheated in _fix_temperatures(coarse):
        candidates.append(
            _improve_superposition_candidates(unheated, response.scene_touch, options)
        )
    refined = options.refined_candidates
    found: list[SearchResult] = []
    for ranks in (slice(refined), slice(refined, None)):
        initial = np.concatenate([starts[ranks] for starts in candidates])
        ends = run_levenberg_marquardt(coarse, initial, options=options.solved_search)
        ends = search_along_weak_direction(coarse, ends, options)
        ends = _select_distinct_ends(coarse, ends, swapped_columns, options)
        if not ends.coordinates.size:
            continue
        finished = run_levenberg_marquardt(problem, ends.coordinates, options=options.solved_search)
        found.append(finished)
        min_chi_square = np.array([finished.ranking.min()])
        if mark_plausible(min_chi_square, problem.degrees_of_freedom, options.significance).any():
            break
    if not found:
        return ends
    return _select_distinct_ends(problem, concatenate_results(found), swapped_columns, options)


def _make_coarse_problem(
    problem: LocationProblem, response: SolvedResponse, options: LocateOptions
) -> LocationProblem:
    """Return a copy of a problem with coarse solves and correspondingly larger deviations.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    response : SolvedResponse
        The response with fine solves.
    options : LocateOptions
        Options with the tolerance of the coarse solves.

    Returns
    -------
    LocationProblem
        A problem whose variances include the errors of the coarse solves. These are assumed to be
        uniformly distributed within the tolerance, hence the factor 1/√3.
    """
    coarse_response = replace(response, error_bound=options.coarse_tolerance)
    solve_error = options.coarse_tolerance / 3**0.5 * problem.charges_pC
    deviations = np.hypot(problem.deviations_pC, solve_error)
    return replace(problem, response=coarse_response, deviations_pC=deviations)


def search_along_weak_direction(
    problem: LocationProblem, ends: SearchResult, options: LocateOptions
) -> SearchResult:
    """Search beside the best end point along the direction that the charges determine least.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    ends : SearchResult
        End points of earlier searches.
    options : LocateOptions
        Offsets from the best end point, and maximum number of repetitions from a better one.

    Returns
    -------
    SearchResult
        The end points of the earlier searches, followed by the new ones.

    Notes
    -----
    At a fold of the charges two neighbouring touches have almost the same charges, and a search on
    one side of the fold does not reach the touch on the other side. Along a flat valley a search
    may end before the minimum. The direction is the right singular vector of the smallest singular
    value of the Jacobian with respect to coordinates divided by their maximum steps.
    """
    free = problem.free_columns
    longest_steps = problem.longest_steps[free]
    for _ in range(options.side_rounds):
        best = ends.select(ends.ranking.argsort()[:1])
        if not best.converged.any():
            break
        scaled_jacobian = best.jacobian[0][:, free] * longest_steps
        directions = np.linalg.svd(scaled_jacobian).Vh
        weakest = directions[-1]
        step = longest_steps * weakest / np.abs(weakest).max()
        beside = np.repeat(best.coordinates, len(options.side_steps), axis=0)
        beside[:, free] += np.outer(options.side_steps, step)
        more = run_levenberg_marquardt(problem, beside, options=options.solved_search)
        ends = concatenate_results([ends, more])
        improvement = best.chi_square[0] - more.ranking.min()
        if improvement < options.solved_search.chi_square_tolerance:
            break
    return ends


def _fix_temperatures(problem: LocationProblem) -> Iterator[LocationProblem]:
    """Yield copies of a problem with fixed temperatures, to find candidates by superposition.

    The first problem has the charges of all electrodes. If a temperature is unknown, problems that
    omit one electrode each follow, since a warm probe above an electrode changes its charge most.
    """
    quantities = problem.response.quantity_names
    unheated_columns = []
    for column in problem.unknown.tolist():
        if get_base_quantity(quantities[column]) != "temperature_K":
            unheated_columns.append(column)
    all_electrodes = replace(problem, unknown=np.array(unheated_columns))
    yield all_electrodes
    if len(unheated_columns) == len(problem.unknown):
        return
    for omitted in range(len(problem.electrodes)):
        sides = problem.limit_sides
        yield replace(
            all_electrodes,
            electrodes=np.delete(problem.electrodes, omitted),
            charges_pC=np.delete(problem.charges_pC, omitted, axis=1),
            deviations_pC=np.delete(problem.deviations_pC, omitted, axis=1),
            limit_sides=None if sides is None else np.delete(sides, omitted, axis=1),
        )


def _improve_superposition_candidates(
    problem: LocationProblem, scene_touch: Array, options: LocateOptions
) -> Array:
    """Find candidates by superposition, improve them by a few search steps, and sort them.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    scene_touch : ndarray, shape (k,)
        Touch of the scene, with the values of the fixed quantities.
    options : LocateOptions
        Number of candidates, and number of steps.

    Returns
    -------
    ndarray, shape (n, k)
        Coordinates after the steps, those with the lowest chi-square first.
    """
    preliminary = replace(options.solved_search, max_steps=options.preliminary_steps)
    candidates = find_superposed_candidates(problem, scene_touch, options)
    ends = run_levenberg_marquardt(problem, candidates, options=preliminary)
    return ends.coordinates[np.argsort(ends.chi_square)]


def _select_distinct_ends(
    problem: LocationProblem, ends: SearchResult, swapped_columns: Indices, options: LocateOptions
) -> SearchResult:
    """Select the end points that are distinct, likely, and at which the scene could be solved.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    ends : SearchResult
        All end points. They are changed in place: equal probes are exchanged so that the first one
        has the smaller x.
    swapped_columns : ndarray of int
        Order of the columns that exchanges the two equal probes; empty without equal probes.
    options : LocateOptions
        Limits that decide which end points are likely, and which are duplicates.

    Returns
    -------
    SearchResult
        The selected end points, the lowest chi-square first; may be empty.
    """
    if swapped_columns.size:
        first_x = ends.coordinates[:, TouchColumn.X]
        second_x = ends.coordinates[:, len(TOUCH_QUANTITIES) + TouchColumn.X]
        is_swapped = first_x > second_x
        ends.coordinates[is_swapped] = ends.coordinates[is_swapped][:, swapped_columns]
        ends.jacobian[is_swapped] = ends.jacobian[is_swapped][..., swapped_columns]
    # Unsolved scenes get UNSOLVED_PC as charges, so that chi-square is about this or larger (the
    # measured charges are negligible beside it); 1e-6 leaves a wide margin.
    chi_square_unsolved = np.square(UNSOLVED_PC / problem.deviations_pC).min()
    ends = ends.select(np.flatnonzero(ends.chi_square < 1e-6 * chi_square_unsolved))
    if not ends.coordinates.size:
        return ends
    return ends.select(find_distinct_ends(problem, ends, options))


class _Superpositions(NamedTuple):
    """Combinations of single touches that are fitted to measured charges."""

    positions_mm: Array  #: Positions x, y of the probes on the film; shape (n, probes, 2).
    #: Factors on the changes of the charges due to the single touches; shape (n, probes).
    amplitudes: Array


def find_superposed_candidates(
    problem: LocationProblem, scene_touch: Array, options: LocateOptions
) -> Array:
    """Find initial candidates by fitting sums of the charges of single touches.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    scene_touch : ndarray, shape (k,)
        Touch of the scene, with the values of quantities that are fixed. Only unknown positions and
        forces are replaced.
    options : LocateOptions
        Spacing of the single touches, and number and minimum distance of the candidates.

    Returns
    -------
    ndarray, shape (n, k)
        Coordinates of the candidates, the best fit first; may be empty.

    Notes
    -----
    A force is F_i = a_i (Σ a)^`STIFFENING` in N, with the amplitudes a_i of the single touches.
    """
    response = problem.response
    scenes = []
    for index in range(count_probes(response)):
        scenes.append(make_single_probe_scene(response.scene, index))
    tables = []
    for scene in pin_profile_files(scenes):
        table = tabulate_single_touches(
            scene,
            response.domain.reach_mm,
            solved_pitch_mm=options.solved_pitch_mm,
            fine_pitch_mm=options.superposed_pitch_mm,
        )
        tables.append(table)
    superpositions = _fit_superpositions(problem, tables)
    chosen = _choose_distant_candidates(superpositions.positions_mm, options)
    amplitudes = superpositions.amplitudes[chosen]
    coordinates = np.tile(problem.to_coordinates(scene_touch[None]), (len(chosen), 1))
    candidates = coordinates.copy()
    probes = problem.view_by_probe(candidates)  # a view: `candidates` is changed through it
    stage = response.scene.stage or Stage()
    probes[..., POSITION] = superpositions.positions_mm[chosen] @ stage.rotation.T
    log_stiffening = STIFFENING * np.log(amplitudes.sum(axis=1))
    probes[..., TouchColumn.FORCE] = np.log(amplitudes) + log_stiffening[:, None]
    is_unknown = np.isin(np.arange(coordinates.shape[1]), problem.unknown)
    return np.where(is_unknown, candidates, coordinates)


def _fit_superpositions(
    problem: LocationProblem, tables: Sequence[SingleTouches]
) -> _Superpositions:
    """Fit sums of the charges of single touches to the measured charges, for all combinations.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    tables : sequence of SingleTouches
        Single touches of each probe; the same object for equal probes.

    Returns
    -------
    _Superpositions
        Combinations in which the amplitude of every probe is positive and above
        `MIN_FORCE_FRACTION` of the sum, the best fit first.

    Notes
    -----
    Let the rows of D be the changes of the charges due to the single touches of a combination, and
    q the measured change, both divided by the standard deviations of the charges. The
    amplitudes a that minimise |Dᵀa - q|² solve the normal equations DDᵀ a = D q, and the fit lowers
    |q|² by (D q)ᵀa. A slight regularisation is added, since two single touches may have nearly the
    same charges.
    """
    electrodes = problem.electrodes
    deviations = problem.deviations_pC[0]
    unloaded_charges, _ = compute_unloaded_charges_pC(problem.response.scene)
    unloaded = np.nan_to_num(unloaded_charges[electrodes])
    changes = []
    for table in tables:
        changes.append(table.charges_pC[:, electrodes] - unloaded)
    whitened = np.concatenate(changes) / deviations
    measured = (problem.charges_pC[0] - unloaded) / deviations
    is_limit = problem.is_limit[0]  # limits have no weight
    whitened[:, is_limit] = 0.0
    measured[is_limit] = 0.0
    combinations_of_rows = _list_combinations(tables)
    products = whitened @ whitened.T
    right_sides = (whitened @ measured)[combinations_of_rows]
    matrices = products[combinations_of_rows[:, :, None], combinations_of_rows[:, None, :]]
    regularisation = 1e-9 * products.diagonal().mean() * np.eye(combinations_of_rows.shape[1])
    solved = np.linalg.solve(matrices + regularisation, right_sides[:, :, None])
    amplitudes = solved[:, :, 0]
    reduction = (right_sides * amplitudes).sum(axis=1)
    total = np.abs(amplitudes).sum(axis=1, keepdims=True)
    is_pressing = (amplitudes > MIN_FORCE_FRACTION * total).all(axis=1)
    descending = np.argsort(-np.where(is_pressing, reduction, -np.inf))
    order = descending[: is_pressing.sum()]
    positions = np.concatenate([table.positions_mm for table in tables])
    return _Superpositions(positions[combinations_of_rows[order]], amplitudes[order])


def _list_combinations(tables: Sequence[SingleTouches]) -> Indices:
    """List all ways to combine one single touch of each probe.

    Parameters
    ----------
    tables : sequence of SingleTouches
        Single touches of each of one or two probes. If both are the same object, the probes are
        equal: a pair is listed once, without its exchange, and no touch is paired with itself.

    Returns
    -------
    ndarray of int, shape (n, probes)
        Row indices of the touches in all tables, concatenated.
    """
    first_rows = range(len(tables[0].positions_mm))
    if len(tables) == 1:
        return np.array(first_rows)[:, None]
    if tables[0] is tables[1]:
        return np.array(list(combinations(first_rows, 2)))
    count = len(tables[0].positions_mm) + len(tables[1].positions_mm)
    return np.array(list(product(first_rows, range(len(first_rows), count))))


def _choose_distant_candidates(positions_mm: Array, options: LocateOptions) -> list[int]:
    """Choose the best candidates whose positions differ enough from each other.

    Parameters
    ----------
    positions_mm : ndarray, shape (n, probes, 2)
        Positions of the probes of each candidate, the best candidate first.
    options : LocateOptions
        Maximum number of candidates, and minimum difference of one coordinate of a position.

    Returns
    -------
    list of int
        Row indices of the chosen candidates, the best first.
    """
    chosen: list[int] = []
    for row in range(len(positions_mm)):
        differences = np.abs(positions_mm[chosen] - positions_mm[row])
        distances = differences.max(axis=(1, 2), initial=0.0)
        if (distances >= options.candidate_distance_mm).all():
            chosen.append(row)
        if len(chosen) == options.superposed_candidates:
            break
    return chosen
