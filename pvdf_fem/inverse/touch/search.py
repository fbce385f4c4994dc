"""Searches for touches all over the response's domain, and the touches that they find."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.inverse.least_squares import (
    SearchOptions,
    SearchResult,
    mark_repeated,
    run_levenberg_marquardt,
)
from pvdf_fem.inverse.touch.initial_candidates import find_initial_candidates
from pvdf_fem.inverse.touch.location import Location
from pvdf_fem.inverse.touch.location_problem import (
    LocationProblem,
    compute_extents,
    slice_quantity,
)
from pvdf_fem.inverse.touch.touch import (
    Touch,
    compute_covariance_roots,
    compute_p_values,
    is_plausible,
)
from pvdf_fem.surrogate.touch_domain import TouchColumn


@dataclass(frozen=True)
class LocateOptions:
    """Numbers and tolerances of searches for touches."""

    #: A touch is listed unless its chi-square exceeds the least one by more than this: at 25 it is
    #: e^12 times less likely than the best.
    max_excess: float = 25.0
    #: Two minima are duplicates if the squared change of the whitened residuals between them, by
    #: the Jacobian at the better minimum, is below the first number, and the rotation's change
    #: below the second.
    duplicate_chi_square: float = 0.1
    duplicate_rotation_deg: float = 8.0
    search: SearchOptions = field(default_factory=SearchOptions)
    #: Initial candidates at each rotation.
    candidates: int = 12
    #: Of candidates this close (mm, mm, degrees, logarithm of the force) the best one is kept.
    candidate_distances: tuple[float, ...] = (0.2, 0.2, 1e-9, 0.05)
    #: Share of the charges that the linear step to a candidate neglects. A candidate is left out if
    #: its charges are farther from the measured ones than those of the best candidate, by more than
    #: this share and the root of `max_excess` standard deviations.
    neglected_fraction: float = 0.01
    retry_candidates: int = 8  #: Candidates of the second search for a row of `locate_many`.

    # ---- by full solves

    #: Tolerance of coarse solves.
    coarse_tolerance: float = 1e-2
    #: Tolerance of the final solves, whose derivatives give the deviations: to 1 % at 1e-4, to 6 %
    #: at 1e-3, measured where the probe's rim crosses an electrode.
    tolerance: float = 1e-4
    solved_pitch_mm: float = 2.5  #: Distance of the places at which single touches are solved.
    superposed_pitch_mm: float = 1.0  #: Distance of the places at which these are superposed.
    superposed_candidates: int = 25  #: Initial candidates by superposition.
    candidate_distance_mm: float = 3.0  #: Least distance between these.
    preliminary_steps: int = 3  #: Steps from every candidate before the best are chosen.
    #: How many candidates are refined; the others follow if no touch from these explains the
    #: charges with a p-value of `significance` or more.
    refined_candidates: int = 5
    significance: float = 0.05
    #: Further searches begin beside the best end, at these multiples of the longest step along
    #: the direction that the charges determine least. They are repeated about a better end,
    #: `side_rounds` times at most.
    side_steps: tuple[float, ...] = (-0.5, 0.5)
    side_rounds: int = 3
    solved_search: SearchOptions = field(
        default_factory=lambda: SearchOptions(
            max_steps=40, chi_square_tolerance=0.02, step_tolerance=0.04, damping_factor=0.3
        )
    )


DEFAULT_OPTIONS = LocateOptions()


def search_everywhere(
    problem: LocationProblem, fixed: Mapping[int, float], options: LocateOptions
) -> SearchResult:
    """Search all over the domain for the touch that gave a problem's only row of charges.

    Parameters
    ----------
    problem : LocationProblem
        One row of charges of one touch.
    fixed : mapping
        Coordinates of the fixed quantities by column.
    options : LocateOptions
        Numbers and tolerances.

    Returns
    -------
    SearchResult
        The ends of all searches, among them duplicates.

    Notes
    -----
    An unknown rotation is fixed at many values at first and becomes free in a second search: a few
    degrees of rotation change the charges by less than the pitch of the coarse grid does.
    """
    fixed_rows = {column: np.array([value]) for column, value in fixed.items()}
    candidates = find_initial_candidates(
        problem, fixed_rows, options.candidates, each_rotation=True
    )
    coordinates = candidates.coordinates[0]
    chi_square = candidates.chi_square[0]
    distance = np.sqrt(chi_square)
    size = np.linalg.norm(problem.charges_pC / problem.deviations_pC)
    allowance = options.max_excess**0.5 + options.neglected_fraction * size
    is_unlikely = distance > distance.min(axis=1, keepdims=True) + allowance
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
    """Search for the touch of each row of charges from a few candidates.

    Parameters
    ----------
    problem : LocationProblem
        Rows of charges.
    fixed : mapping
        Coordinates (rows,) of the fixed quantities by column.
    count : int
        Number of candidates for each row.
    options : SearchOptions
        Termination and damping of the searches.

    Returns
    -------
    SearchResult
        The best end for each row.
    """
    candidates = find_initial_candidates(problem, fixed, count, each_rotation=False)
    coordinates = candidates.coordinates[:, 0]
    row_count, count, width = coordinates.shape
    rows = np.repeat(np.arange(row_count), count)
    coordinates = coordinates.reshape(-1, width)
    # Neighbouring touches one after the other share the coefficients that a response reads.
    order = np.lexsort((coordinates[:, TouchColumn.Y], coordinates[:, TouchColumn.X]))
    ordered = run_levenberg_marquardt(problem, coordinates[order], rows[order], options=options)
    ends = ordered.select(np.argsort(order))
    best = ends.ranking.reshape(row_count, count).argmin(axis=1)
    return ends.select(count * np.arange(row_count) + best)


def mark_explained(problem: LocationProblem, ends: SearchResult) -> Mask:
    """Mark the searches that converged at touches that explain the charges, (n,)."""
    return ends.converged & is_plausible(ends.chi_square, problem.degrees_of_freedom)


def make_location(
    problem: LocationProblem,
    ends: SearchResult | None,
    options: LocateOptions = DEFAULT_OPTIONS,
) -> Location:
    """Make the location of a problem's first row of charges from the ends of searches.

    Parameters
    ----------
    problem : LocationProblem
        The charges.
    ends : SearchResult or None
        Ends of searches, or None where no search was made.
    options : LocateOptions
        Which touches are listed, and which ends are duplicates.

    Returns
    -------
    Location
        The distinct touches with their weights, which are the integrals of likelihood times prior
        about each maximum.

    Notes
    -----
    With a normal prior whose standard deviations are the extents S of the response's domain,
    Laplace's method gives exp(-χ²/2) / √det(1 + SJᵀJS) for the integral about a maximum.
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
    if problem.degrees_of_freedom <= 0:
        # Chi-square is zero except for where searches stop, and does not rank touches.
        touches.sort(key=lambda touch: (touch.explained, touch.weight), reverse=True)
    log_norm = math.log(2.0 * math.pi) / 2.0 + np.log(problem.deviations_pC[0])
    log_evidence = log_total - float(log_norm.sum())
    return Location(tuple(touches), unknown, log_evidence, problem)


class TouchDescriptions(NamedTuple):
    """The touches at n ends of searches."""

    values: Array  #: Quantities in their units, (n, k).
    covariance_roots: Array  #: Square roots of the covariances, (n, unknown, unknown).
    undetermined: Mask  #: Principal directions that charges do not determine, (n, unknown).
    chi_square: Array  #: (n,)
    p_value: Array  #: Probabilities of a larger chi-square, (n,).
    explained: Mask  #: Whether the touch explains the charges, (n,).


def describe_touches(problem: LocationProblem, ends: SearchResult) -> TouchDescriptions:
    """Compute values, covariances and fit of the touches at ends of searches."""
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
        explained=is_plausible(ends.chi_square, problem.degrees_of_freedom),
    )


def find_distinct_ends(
    problem: LocationProblem, ends: SearchResult, options: LocateOptions
) -> Indices:
    """Find the likely ends of searches that are not duplicates of a better one.

    Parameters
    ----------
    problem : LocationProblem
        The problem that was searched.
    ends : SearchResult
        Ends of all searches.
    options : LocateOptions
        Which ends are likely, and which are duplicates.

    Returns
    -------
    ndarray of int
        Indices of the distinct ends, the best first.
    """
    ranking = ends.ranking
    rotations = slice_quantity(problem.response, TouchColumn.ROTATION)
    order = ranking.argsort(kind="stable")
    rows = order[ranking[order] <= ranking.min() + options.max_excess]
    rows = rows[ends.converged[rows]]
    distinct = []
    while len(rows):
        best = rows[0]
        distinct.append(best)
        if len(rows) == 1:
            break
        differences = problem.compute_differences(ends.coordinates[rows], ends.coordinates[best])
        change = np.square(differences @ ends.jacobian[best].T).sum(axis=1)
        is_duplicate = change < options.duplicate_chi_square
        turns = np.abs(differences[:, rotations])
        is_duplicate &= (turns < options.duplicate_rotation_deg).all(axis=1)
        rows = rows[~is_duplicate]
    return np.array(distinct, dtype=int)
