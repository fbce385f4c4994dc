"""The search by full solves, which begins where superposed charges of single touches are similar.

Touches of two probes at once have nearly the sum of the charges of single touches, except that each
stiffens the film for the other. So single touches are solved on a coarse raster and interpolated,
and pairs of them are fitted to the measured charges.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product
from typing import NamedTuple

import numpy as np
from scipy.interpolate import RBFInterpolator

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.batch.batch import solve_scenes
from pvdf_fem.film.loads.profiles import pin_profile_files
from pvdf_fem.inverse.least_squares import (
    SearchResult,
    concatenate_results,
    run_levenberg_marquardt,
)
from pvdf_fem.inverse.touch.location_problem import POSITION, LocationProblem, get_base_quantity
from pvdf_fem.inverse.touch.search import LocateOptions, find_distinct_ends
from pvdf_fem.inverse.touch.solved_charges import (
    UNSOLVED_PC,
    SolvedResponse,
    make_single_probe_scene,
)
from pvdf_fem.inverse.touch.touch import is_plausible
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.stage import Stage
from pvdf_fem.solver.nonlinear.status import NotConvergedError
from pvdf_fem.surrogate.charge_function import compute_unloaded_charges_pC, count_probes
from pvdf_fem.surrogate.touch_domain import TOUCH_QUANTITIES, TouchColumn

#: Power of the sum of the superposed forces by which each force is larger than without the other
#: touch, since the common tension stiffens the film.
STIFFENING = 0.35
#: Least share of a touch in the sum of the forces.
MIN_FORCE_FRACTION = 0.03


def search_by_solves(
    problem: LocationProblem, response: SolvedResponse, options: LocateOptions
) -> SearchResult:
    """Search for the touch of one probe or of two by full solves.

    Coarse solves follow the most likely candidates, then a search beside the best end, and fine
    solves finish the distinct ends. The remaining candidates follow if no end explains the charges.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    response : SolvedResponse
        The problem's response.
    options : LocateOptions
        Numbers and tolerances.

    Returns
    -------
    SearchResult
        The distinct ends, the best first.
    """
    coarse = _make_coarse_problem(problem, response, options)
    swapped_columns = response.swapped_columns
    candidates = []
    for cold in _make_cold_problems(coarse):
        candidates.append(_take_preliminary_steps(cold, response.scene_touch, options))
    refined = options.refined_candidates
    found: list[SearchResult] = []
    for part in (slice(refined), slice(refined, None)):
        initial = np.concatenate([likely[part] for likely in candidates])
        ends = run_levenberg_marquardt(coarse, initial, options=options.solved_search)
        ends = search_along_weak_direction(coarse, ends, options)
        ends = _select_distinct(coarse, ends, swapped_columns, options)
        if not ends.coordinates.size:
            continue
        finished = run_levenberg_marquardt(problem, ends.coordinates, options=options.solved_search)
        found.append(finished)
        least_chi_square = finished.ranking.min()[None]
        if is_plausible(least_chi_square, problem.degrees_of_freedom, options.significance).any():
            break
    if not found:
        return ends
    return _select_distinct(problem, concatenate_results(found), swapped_columns, options)


def _make_coarse_problem(
    problem: LocationProblem, response: SolvedResponse, options: LocateOptions
) -> LocationProblem:
    """Return the problem with coarse solves, whose error counts as a deviation of the charges.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    response : SolvedResponse
        The response with fine solves.
    options : LocateOptions
        Tolerance of the coarse solves.
    """
    coarse_response = replace(response, error_bound=options.coarse_tolerance)
    solve_error = options.coarse_tolerance / 3**0.5 * problem.charges_pC
    deviations = np.hypot(problem.deviations_pC, solve_error)
    return replace(problem, response=coarse_response, deviations_pC=deviations)


def search_along_weak_direction(
    problem: LocationProblem, ends: SearchResult, options: LocateOptions
) -> SearchResult:
    """Search beside the best end along the direction that the charges determine least.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    ends : SearchResult
        Ends of searches.
    options : LocateOptions
        Distances beside the end, and how often this is repeated about a better end.

    Returns
    -------
    SearchResult
        All ends, the given ones first.

    Notes
    -----
    At a fold of the charges two touches close together have almost the same charges, and a search
    on one side of the fold does not reach the touch on the other side. Along a valley a search may
    end before the bottom. The direction is the right singular vector of the least singular value of
    the Jacobian by longest steps.
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


def _make_cold_problems(problem: LocationProblem) -> Iterator[LocationProblem]:
    """Make the problems of cold touches from which candidates come.

    The first one has the charges of all electrodes. If a temperature is unknown, others without
    each electrode in turn follow, since a warm probe may be above that electrode.
    """
    quantities = problem.response.quantity_names
    cold_columns = []
    for column in problem.unknown.tolist():
        if get_base_quantity(quantities[column]) != "temperature_K":
            cold_columns.append(column)
    all_electrodes = replace(problem, unknown=np.array(cold_columns))
    yield all_electrodes
    if len(cold_columns) == len(problem.unknown):
        return
    for left_out in range(len(problem.electrodes)):
        yield replace(
            all_electrodes,
            electrodes=np.delete(problem.electrodes, left_out),
            charges_pC=np.delete(problem.charges_pC, left_out, axis=1),
            deviations_pC=np.delete(problem.deviations_pC, left_out, axis=1),
        )


def _take_preliminary_steps(
    problem: LocationProblem, scene_touch: Array, options: LocateOptions
) -> Array:
    """Take a few steps from all candidates.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    scene_touch : ndarray, shape (k,)
        Values of the fixed quantities.
    options : LocateOptions
        Candidates, and number of steps.

    Returns
    -------
    ndarray, shape (n, k)
        Coordinates after these steps, the best first.
    """
    preliminary = replace(options.solved_search, max_steps=options.preliminary_steps)
    candidates = find_superposed_candidates(problem, scene_touch, options)
    ends = run_levenberg_marquardt(problem, candidates, options=preliminary)
    return ends.coordinates[np.argsort(ends.chi_square)]


def _select_distinct(
    problem: LocationProblem, ends: SearchResult, swapped_columns: Indices, options: LocateOptions
) -> SearchResult:
    """Select the distinct ends of searches where the scene could be solved.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    ends : SearchResult
        All ends; equal probes are exchanged in place so that the first has the smaller x.
    swapped_columns : ndarray of int
        As `SolvedResponse.swapped_columns`.
    options : LocateOptions
        Which ends are duplicates.
    """
    if swapped_columns.size:
        first_x = ends.coordinates[:, TouchColumn.X]
        second_x = ends.coordinates[:, len(TOUCH_QUANTITIES) + TouchColumn.X]
        is_swapped = first_x > second_x
        ends.coordinates[is_swapped] = ends.coordinates[is_swapped][:, swapped_columns]
        ends.jacobian[is_swapped] = ends.jacobian[is_swapped][..., swapped_columns]
    chi_square_unsolved = np.square(UNSOLVED_PC / problem.deviations_pC).min()
    ends = ends.select(np.flatnonzero(ends.chi_square < 1e-6 * chi_square_unsolved))
    if not ends.coordinates.size:
        return ends
    return ends.select(find_distinct_ends(problem, ends, options))


class SingleTouches(NamedTuple):
    """Charges of a probe alone under 1 N."""

    places_mm: Array  #: Places on the film, (n, 2).
    charges_pC: Array  #: Charges of all electrodes, (n, electrodes).


class _Superpositions(NamedTuple):
    """Combinations of single touches that are fitted to measured charges."""

    places_mm: Array  #: Places of the probes on the film, (n, probes, 2).
    shares: Array  #: Factors of the single touches' changes of the charges, (n, probes).


def find_superposed_candidates(
    problem: LocationProblem, scene_touch: Array, options: LocateOptions
) -> Array:
    """Find initial candidates where superposed charges of single touches are like the measured.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    scene_touch : ndarray, shape (k,)
        Values of the quantities that are fixed or that superposition does not find.
    options : LocateOptions
        Rasters, and number and distance of the candidates.

    Returns
    -------
    ndarray, shape (n, k)
        Coordinates, the best first.

    Notes
    -----
    A force is its share a_i times (Σ a)^`STIFFENING`.
    """
    response = problem.response
    scenes = []
    for index in range(count_probes(response)):
        scenes.append(make_single_probe_scene(response.scene, index))
    tables = []
    for scene in pin_profile_files(scenes):
        table = _tabulate_single_touches(
            scene,
            response.domain.reach_mm,
            solved_pitch_mm=options.solved_pitch_mm,
            fine_pitch_mm=options.superposed_pitch_mm,
        )
        tables.append(table)
    superpositions = _fit_superpositions(problem, tables)
    chosen = _choose_apart(superpositions.places_mm, options)
    shares = superpositions.shares[chosen]
    coordinates = np.tile(problem.to_coordinates(scene_touch[None]), (len(chosen), 1))
    candidates = coordinates.copy()
    probes = problem.view_by_probe(candidates)
    stage = response.scene.stage or Stage()
    probes[..., POSITION] = superpositions.places_mm[chosen] @ stage.rotation.T
    log_stiffening = STIFFENING * np.log(shares.sum(axis=1))
    probes[..., TouchColumn.FORCE] = np.log(shares) + log_stiffening[:, None]
    is_unknown = np.isin(np.arange(coordinates.shape[1]), problem.unknown)
    return np.where(is_unknown, candidates, coordinates)


def _fit_superpositions(
    problem: LocationProblem, tables: Sequence[SingleTouches]
) -> _Superpositions:
    """Fit every combination of single touches to the measured charges.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges.
    tables : sequence of SingleTouches
        Single touches of each probe; the same object for equal probes.

    Returns
    -------
    _Superpositions
        Combinations in which all probes press, those that explain most of the charges first.

    Notes
    -----
    The changes D of the charges over their deviations give the normal equations DDᵀ a = D q of the
    shares a for the measured change q. The part (D q)ᵀa of |q|² is explained.
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
    members = _list_combinations(tables)
    products = whitened @ whitened.T
    right_sides = (whitened @ measured)[members]
    matrices = products[members[:, :, None], members[:, None, :]]
    regularisation = 1e-9 * products.diagonal().mean() * np.eye(members.shape[1])
    solved = np.linalg.solve(matrices + regularisation, right_sides[:, :, None])
    shares = solved[:, :, 0]
    explained = (right_sides * shares).sum(axis=1)
    total = np.abs(shares).sum(axis=1, keepdims=True)
    is_pressing = (shares > MIN_FORCE_FRACTION * total).all(axis=1)
    order = np.argsort(-np.where(is_pressing, explained, -np.inf))[: is_pressing.sum()]
    places = np.concatenate([table.places_mm for table in tables])
    return _Superpositions(places[members[order]], shares[order])


def _list_combinations(tables: Sequence[SingleTouches]) -> Indices:
    """List combinations of one touch of each probe, (n, probes), by rows of all tables together.

    Two equal probes are combined once, whichever of them is first.
    """
    first_rows = range(len(tables[0].places_mm))
    if len(tables) == 1:
        return np.array(first_rows)[:, None]
    if tables[0] is tables[1]:
        return np.array(list(combinations(first_rows, 2)))
    count = len(tables[0].places_mm) + len(tables[1].places_mm)
    return np.array(list(product(first_rows, range(len(first_rows), count))))


def _choose_apart(places_mm: Array, options: LocateOptions) -> list[int]:
    """Choose the first candidates whose places differ enough from those of the ones before.

    Parameters
    ----------
    places_mm : ndarray, shape (n, probes, 2)
        Places of the probes of each candidate, the best first.
    options : LocateOptions
        Number of candidates, and least difference of one coordinate.
    """
    chosen: list[int] = []
    for row in range(len(places_mm)):
        differences = np.abs(places_mm[chosen] - places_mm[row])
        distances = differences.max(axis=(1, 2), initial=0.0)
        if (distances >= options.candidate_distance_mm).all():
            chosen.append(row)
        if len(chosen) == options.superposed_candidates:
            break
    return chosen


@lru_cache(maxsize=8)
def _tabulate_single_touches(
    scene: Scene, reach_mm: float, solved_pitch_mm: float, fine_pitch_mm: float
) -> SingleTouches:
    """Solve single touches on rings and interpolate their charges on a finer raster.

    Parameters
    ----------
    scene : Scene
        A scene with one probe under 1 N.
    reach_mm : float
        Largest distance of the probe from the centre.
    solved_pitch_mm : float
        Distance of the places that are solved. The probe turns with its place about the centre, so
        that a round film needs few solves.
    fine_pitch_mm : float
        Distance of the places of the finer raster.

    Raises
    ------
    NotConvergedError
        If fewer than three places can be solved.
    """
    radii = []
    angles_deg = []
    for radius in np.linspace(0.0, reach_mm, round(reach_mm / solved_pitch_mm) + 1):
        count = max(1, round(2.0 * np.pi * radius / solved_pitch_mm))
        radii += [radius] * count
        angles_deg += [360.0 * index / count for index in range(count)]
    angles = np.radians(angles_deg)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    places = np.array(radii)[:, None] * directions
    scenes = []
    for (x_mm, y_mm), angle_deg in zip(places.tolist(), angles_deg, strict=True):
        place = {"probe.x_mm": x_mm, "probe.y_mm": y_mm, "probe.rotation_deg": angle_deg}
        scenes.append(scene.with_(**place))
    records = solve_scenes(scenes, processes=1)
    solved = [index for index, record in enumerate(records) if record.converged]
    if len(solved) < 3:
        raise NotConvergedError(f"{records[0].status}: one touch alone: {records[0].reason}")
    film = scene.film
    charges = []
    for index in solved:
        by_name = records[index].charges_pC(film.d31_pC_N, film.d32_pC_N, scene.numerics.observable)
        charges.append(list(by_name.values()))
    ticks = np.arange(-reach_mm, reach_mm + 0.5 * fine_pitch_mm, fine_pitch_mm)
    raster = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    raster = raster[np.hypot(raster[:, 0], raster[:, 1]) <= reach_mm]
    return SingleTouches(raster, RBFInterpolator(places[solved], np.array(charges))(raster))
