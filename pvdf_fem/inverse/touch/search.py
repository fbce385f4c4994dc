"""Searches for touches throughout the response's domain, and locations made from their results."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.coordinates import compute_extents, slice_quantity
from pvdf_fem.inverse.least_squares import (
    SearchOptions,
    SearchResult,
    mark_repeated,
    run_levenberg_marquardt,
)
from pvdf_fem.inverse.touch.initial_candidates import find_initial_candidates
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.location_problem import LocationProblem
from pvdf_fem.inverse.touch.touch import (
    Touch,
    compute_covariance_roots,
    compute_p_values,
    mark_plausible,
)
from pvdf_fem.surrogate.touch_domain import TouchColumn


@dataclass(frozen=True)
class LocateOptions:
    """Numbers and tolerances of searches for touches."""

    #: A touch is listed unless its chi-square exceeds the lowest one by more than this. At 25 it is
    #: less likely than the best touch by a factor of exp(12.5).
    max_excess: float = 25.0
    #: Maximum squared change of the whitened residuals between duplicates of one minimum, as
    #: predicted by the Jacobian at the better end point.
    duplicate_chi_square: float = 0.1
    #: Maximum difference in rotation between duplicates of one minimum.
    duplicate_rotation_deg: float = 8.0
    #: Termination and damping of searches that use a response.
    search: SearchOptions = field(default_factory=SearchOptions)
    candidates: int = 12  #: Number of initial candidates at each rotation of the coarse grid.
    #: Of candidates that are closer than this along every coordinate (mm, mm, degrees, logarithm
    #: of the force) only the one with the lowest chi-square is used.
    candidate_distances: tuple[float, ...] = (0.2, 0.2, 1e-9, 0.05)
    #: Estimated error of the linear step to a candidate, as a fraction of the charges. A candidate
    #: is discarded if its √chi-square exceeds that of the best candidate at its rotation by more
    #: than this error in standard deviations plus √`max_excess`.
    neglected_fraction: float = 0.01
    retry_candidates: int = 8  #: Number of candidates of the second search in `locate_many`.

    # ---- by full solves

    coarse_tolerance: float = 1e-2  #: Tolerance of the solves during most of the search.
    #: Tolerance of the final solves. Their derivatives give the deviations, with an error of 1 % at
    #: 1e-4 and of 6 % at 1e-3, measured with the probe's rim across an electrode.
    tolerance: float = 1e-4
    solved_pitch_mm: float = 2.5  #: Spacing of the positions at which single touches are solved.
    #: Spacing of the raster to which the charges of single touches are interpolated.
    superposed_pitch_mm: float = 1.0
    superposed_candidates: int = 25  #: Maximum number of initial candidates by superposition.
    #: Minimum difference of two such candidates in at least one coordinate of a position.
    candidate_distance_mm: float = 3.0
    preliminary_steps: int = 3  #: Steps from every candidate before the best ones are chosen.
    #: Number of candidates that are refined first. The others follow if no touch found from these
    #: explains the charges with a p-value of at least `significance`.
    refined_candidates: int = 5
    significance: float = 0.05  #: Minimum p-value at which no further candidates are refined.
    #: Offsets of further searches from the best end point, in multiples of the maximum step along
    #: the direction that the charges determine least.
    side_steps: tuple[float, ...] = (-0.5, 0.5)
    #: Maximum number of rounds of such further searches, each beside a better end point.
    side_rounds: int = 3
    #: Termination and damping of searches by full solves.
    solved_search: SearchOptions = field(
        default_factory=lambda: SearchOptions(
            max_steps=40, chi_square_tolerance=0.02, step_tolerance=0.04, damping_factor=0.3
        )
    )


DEFAULT_OPTIONS = LocateOptions()


def search_everywhere(
    problem: LocationProblem, fixed: Mapping[int, float], options: LocateOptions
) -> SearchResult:
    """Search throughout the response's domain for touches that fit one row of charges.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges of a touch by one probe.
    fixed : mapping
        Coordinates of the fixed quantities by column.
    options : LocateOptions
        Numbers and tolerances of the searches.

    Returns
    -------
    SearchResult
        End points of all final searches, with duplicates and abandoned searches.

    Notes
    -----
    Candidates that are repeated, or much less likely than the best one of their rotation, are
    discarded. If the rotation and another quantity are unknown, first searches fix the rotation at
    each of many values, and final searches with a free rotation begin at their end points. This is
    robust, since rotating the probe by a few degrees changes the charges less than moving it by the
    pitch of the coarse grid.
    """
    fixed_rows = {column: np.array([value]) for column, value in fixed.items()}
    candidates = find_initial_candidates(
        problem, fixed_rows, options.candidates, each_rotation=True
    )
    coordinates = candidates.coordinates[0]
    chi_square = candidates.chi_square[0]
    residual_norm = np.sqrt(chi_square)
    values = (problem.charges_pC / problem.deviations_pC)[~problem.is_limit]
    charge_norm = np.linalg.norm(values)
    allowance = options.max_excess**0.5 + options.neglected_fraction * charge_norm
    is_unlikely = residual_norm > residual_norm.min(axis=1, keepdims=True) + allowance
    coordinates = coordinates[~is_unlikely]
    distances = np.array(options.candidate_distances)
    is_repeated = mark_repeated(coordinates, chi_square[~is_unlikely], distances)
    coordinates = coordinates[~is_repeated]
    without_rotation = problem.unknown[problem.unknown != TouchColumn.ROTATION]
    if 0 < len(without_rotation) < len(problem.unknown):
        rotation_fixed = replace(problem, unknown=without_rotation)
        ends = run_levenberg_marquardt(rotation_fixed, coordinates, options=options.search)
        coordinates = ends.coordinates
    return run_levenberg_marquardt(
        problem, coordinates, max_excess=options.max_excess, options=options.search
    )


def search_rows(
    problem: LocationProblem,
    fixed: Mapping[int, Array],
    count: int,
    options: SearchOptions = DEFAULT_OPTIONS.search,
) -> SearchResult:
    """Search for the touch that fits each row of charges best, from a few candidates per row.

    Parameters
    ----------
    problem : LocationProblem
        Rows of charges.
    fixed : mapping
        Coordinates of the fixed quantities by column, arrays of shape (rows,).
    count : int
        Maximum number of candidates for each row.
    options : SearchOptions
        Termination and damping of the searches.

    Returns
    -------
    SearchResult
        For each row the converged end point with the lowest chi-square, or an end point that did
        not converge if no search did.
    """
    candidates = find_initial_candidates(problem, fixed, count, each_rotation=False)
    coordinates = candidates.coordinates[:, 0]
    row_count, count, width = coordinates.shape
    rows = np.repeat(np.arange(row_count), count)
    coordinates = coordinates.reshape(-1, width)
    # Evaluating neighbouring touches one after the other is faster: they use the same coefficients
    # of the response, which are then in the processor's cache.
    order = np.lexsort((coordinates[:, TouchColumn.Y], coordinates[:, TouchColumn.X]))
    ordered = run_levenberg_marquardt(problem, coordinates[order], rows[order], options=options)
    ends = ordered.select(np.argsort(order))
    best = ends.ranking.reshape(row_count, count).argmin(axis=1)
    return ends.select(count * np.arange(row_count) + best)


def mark_explained(problem: LocationProblem, ends: SearchResult) -> Mask:
    """Mark the searches that converged at a touch that explains the charges; shape (n,)."""
    return ends.converged & mark_plausible(ends.chi_square, problem.degrees_of_freedom)


def make_location(
    problem: LocationProblem,
    ends: SearchResult | None,
    options: LocateOptions = DEFAULT_OPTIONS,
) -> Location:
    """Select the distinct touches among end points of searches, and compute their probabilities.

    Parameters
    ----------
    problem : LocationProblem
        Measured charges, of which the first row is located.
    ends : SearchResult or None
        End points of searches, with duplicates; None if no search was made.
    options : LocateOptions
        Limits that decide which touches are in the location, and which are duplicates.

    Returns
    -------
    Location
        The distinct touches, with weights that sum to 1, in the order of `Location.touches`. A
        location without touches if no search converged.

    Notes
    -----
    The weights are proportional to the integrals of likelihood times prior about each maximum. The
    prior is normal; its standard deviations are the extents of the response's domain, the diagonal
    matrix S. Laplace's method then gives exp(-χ²/2) / √det(1 + SJᵀJS) for an integral, up to a
    common factor.
    """
    quantities = problem.response.quantity_names
    unknown = tuple(quantities[column] for column in problem.unknown.tolist())
    if ends is not None:
        ends = ends.select(find_distinct_ends(problem, ends, options))
    if ends is None or not ends.converged.size:
        return Location((), unknown, log_evidence=-np.inf, problem=problem)
    scaled_jacobian = ends.jacobian * compute_extents(problem.response)
    singular_values = np.linalg.svd(scaled_jacobian, compute_uv=False)
    log_determinants = np.log1p(np.square(singular_values)).sum(axis=1)
    log_integrals = -0.5 * (ends.chi_square + log_determinants)
    log_total = float(np.logaddexp.reduce(log_integrals))
    weights = np.exp(log_integrals - log_total).tolist()
    limits = problem.find_active_limits(ends.coordinates)
    described = describe_touches(problem, ends)
    touches = []
    for index in range(len(weights)):
        touch = Touch(
            quantity_names=quantities,
            unknown=unknown,
            values=described.values[index],
            covariance_root=described.covariance_roots[index],
            undetermined=described.undetermined[index],
            chi_square=described.chi_square[index],
            p_value=described.p_value[index],
            explained=described.explained[index],
            weight=weights[index],
            at_edge=limits[index],
        )
        touches.append(touch)
    if problem.degrees_of_freedom[0] <= 0:
        # Every touch can fit exactly; chi-square depends on where searches stop and ranks nothing.
        touches.sort(key=lambda touch: (touch.explained, touch.weight), reverse=True)
    # Limits have probabilities instead of densities, so that nothing is to be normalised.
    deviations_pC = problem.deviations_pC[0][~problem.is_limit[0]]
    log_norm = math.log(2.0 * math.pi) / 2.0 + np.log(deviations_pC)
    log_evidence = log_total - float(log_norm.sum())
    return Location(tuple(touches), unknown, log_evidence, problem)


class TouchDescriptions(NamedTuple):
    """Arrays of values, covariances and goodness of fit of n touches, for the fields of `Touch`."""

    values: Array  #: Quantities in their units; shape (n, k).
    covariance_roots: Array  #: Square roots of the covariances; shape (n, unknown, unknown).
    #: Whether the charges do not determine each principal direction; shape (n, unknown).
    undetermined: Mask
    chi_square: Array  #: Sums of the squared whitened residuals; shape (n,).
    p_value: Array  #: Probabilities of a larger chi-square; shape (n,).
    explained: Mask  #: Whether the touch explains the charges; shape (n,).


def describe_touches(problem: LocationProblem, ends: SearchResult) -> TouchDescriptions:
    """Compute values, covariances and goodness of fit of the touches at end points of searches.

    Parameters
    ----------
    problem : LocationProblem
        A single row of charges, or one row for each end point.
    ends : SearchResult
        End points of the searches.
    """
    unknown = problem.unknown
    values = problem.to_touches(ends.coordinates)
    scale = problem.compute_touch_scale(values)[:, unknown]
    jacobian = ends.jacobian[:, :, unknown] / scale[:, None]
    extents = compute_extents(problem.response)[unknown] * scale
    covariances = compute_covariance_roots(jacobian, extents)
    return TouchDescriptions(
        values=values,
        covariance_roots=covariances.roots,
        undetermined=covariances.undetermined,
        chi_square=ends.chi_square,
        p_value=compute_p_values(ends.chi_square, problem.degrees_of_freedom),
        explained=mark_plausible(ends.chi_square, problem.degrees_of_freedom),
    )


def evaluate_ends(problem: LocationProblem, ends: SearchResult) -> SearchResult:
    """Return end points of searches with the residuals and derivatives of another problem."""
    system = problem.linearise(ends.coordinates)
    return replace(
        ends,
        jacobian=system[:, :, 1:],
        chi_square=np.square(system[:, :, 0]).sum(axis=1),
    )


def find_distinct_ends(
    problem: LocationProblem, ends: SearchResult, options: LocateOptions
) -> Indices:
    """Find the likely end points of searches, without duplicates of end points that fit better.

    Parameters
    ----------
    problem : LocationProblem
        The problem that was solved.
    ends : SearchResult
        End points of all searches.
    options : LocateOptions
        Limits that decide which end points are likely, and which are duplicates.

    Returns
    -------
    ndarray of int
        Indices of distinct end points of converged searches, whose chi-square exceeds the lowest
        one by at most `max_excess`; the lowest chi-square first, empty if no search converged.
    """
    ranking = ends.ranking
    rotations = slice_quantity(problem.response, TouchColumn.ROTATION)
    order = ranking.argsort(kind="stable")
    lowest = ranking.min(initial=np.inf)  # infinite if no search was made
    rows = order[ranking[order] <= lowest + options.max_excess]
    rows = rows[ends.converged[rows]]
    distinct = []
    while len(rows):
        best, rows = rows[0], rows[1:]
        distinct.append(best)
        differences = problem.compute_differences(ends.coordinates[rows], ends.coordinates[best])
        change = np.square(differences @ ends.jacobian[best].T).sum(axis=1)
        is_duplicate = change < options.duplicate_chi_square
        rotations_deg = np.abs(differences[:, rotations])
        is_duplicate &= (rotations_deg < options.duplicate_rotation_deg).all(axis=1)
        rows = rows[~is_duplicate]
    return np.array(distinct, dtype=int)
