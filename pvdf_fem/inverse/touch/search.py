"""Searches for a touch from everywhere, and what they found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

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
from pvdf_fem.inverse.touch.location_problem import LocationProblem, compute_extents, slice_quantity
from pvdf_fem.inverse.touch.touch import (
    Touch,
    compute_covariance_roots,
    compute_p_values,
    is_plausible,
)
from pvdf_fem.surrogate.touch_domain import TouchColumn


@dataclass(frozen=True)
class LocateOptions:
    """Which touches are listed, and how they are searched for."""

    #: A touch is listed unless its chi-square exceeds the least by more than this: at 25 it is e^12
    #: times less likely.
    listed: float = 25.0
    #: Two minima are duplicates if the squared change of the residuals between them, by the
    #: Jacobian at the better minimum, is below `same`, and the rotation's change below `same_deg`.
    same: float = 0.1
    same_deg: float = 8.0
    search: SearchOptions = field(default_factory=SearchOptions)
    #: Starts at each rotation. Of starts this close (mm, mm, degrees, logarithm of the force) only
    #: the best is kept. A start is left out whose charges are farther than those of the best start
    #: by more than the root of `listed` and this share of the charges, which a step neglects.
    begun: int = 12
    close: tuple[float, ...] = (0.2, 0.2, 1e-9, 0.05)
    neglected: float = 0.01
    retries: int = 8  #: Starts of the second search for a row of `locate_many`.

    # ---- by full solves

    #: Tolerance of coarse solves, and of the final ones, whose slopes give the deviations: to 1 %
    #: at 1e-4, to 6 % at 1e-3, measured where the probe's rim crosses an electrode.
    first_tolerance: float = 1e-2
    tolerance: float = 1e-4
    #: Distance of the places of single touches that are solved, and that are superposed.
    pitch_mm: float = 2.5
    fine_mm: float = 1.0
    #: Number of starts, least distance between starts, number of steps from every start.
    starts: int = 25
    apart_mm: float = 3.0
    first_steps: int = 3
    #: How many searches go on; the others go on where these lead to no touch that explains the
    #: charges, as a larger chi-square is less probable than `significance`.
    followed: int = 5
    significance: float = 0.05
    #: Further starts are about the best end, in longest steps along what the charges determine
    #: least; again about a better end, for some rounds at most.
    aside: tuple[float, ...] = (-0.5, 0.5)
    rounds: int = 3
    solved_search: SearchOptions = field(
        default_factory=lambda: SearchOptions(
            40, chi_square_tolerance=0.02, step_tolerance=0.04, damping_factor=0.3
        )
    )


DEFAULT_OPTIONS = LocateOptions()


def search_everywhere(
    problem: LocationProblem, known: Mapping[int, float], options: LocateOptions
) -> SearchResult:
    """Searches from everywhere for the touch of a problem's only row. `known` are coordinates by
    their index in `QUANTITIES`. A sought rotation is held at first, at many values: a few degrees
    change charges by less than the pitch of the table of starts does."""
    held = {i: np.array([value]) for i, value in known.items()}
    at, misfit = (of[0] for of in find_initial_candidates(problem, held, options.begun, each=True))
    size = np.linalg.norm(problem.charges_pC / problem.deviations_pC)
    excess = options.listed**0.5 + options.neglected * size
    likely = ~(np.sqrt(misfit) > np.sqrt(misfit.min(axis=1, keepdims=True)) + excess)
    at = at[likely][~mark_repeated(at[likely], misfit[likely], np.array(options.close))]
    without_rotation = problem.unknown[problem.unknown != TouchColumn.ROTATION]
    if 0 < len(without_rotation) < len(problem.unknown):
        at = run_levenberg_marquardt(
            replace(problem, unknown=without_rotation), at, options=options.search
        ).coordinates
    return run_levenberg_marquardt(problem, at, max_excess=options.listed, options=options.search)


def search_rows(
    problem: LocationProblem,
    known: Mapping[int, Array],
    few: int,
    how: SearchOptions = DEFAULT_OPTIONS.search,
) -> SearchResult:
    """The best end of searches from a few starts for each row of a problem's charges. `known` are
    coordinates (rows,) by their index."""
    at = find_initial_candidates(problem, known, few, each=False)[0][:, 0]
    rows, at = np.repeat(np.arange(len(at)), at.shape[1]), at.reshape(-1, at.shape[2])
    # neighbouring touches in sequence share the coefficients that the model reads
    order = np.lexsort((at[:, TouchColumn.Y], at[:, TouchColumn.X]))
    ends = run_levenberg_marquardt(problem, at[order], rows[order], options=how).select(
        np.argsort(order)
    )
    best = ends.ranking.reshape(len(problem.charges_pC), -1).argmin(axis=1)
    return ends.select(np.searchsorted(rows, np.arange(len(best))) + best)


def mark_explained(problem: LocationProblem, ends: SearchResult) -> Mask:
    """Which searches arrived where the charges are explained, (n,)."""
    return ends.converged & is_plausible(ends.chi_square, problem.degrees_of_freedom)


def make_location(
    problem: LocationProblem, ends: SearchResult | None, options: LocateOptions = DEFAULT_OPTIONS
) -> Location:
    """The location whose touches are the distinct ends of searches for one touch; None where no
    search was made."""
    quantities = problem.response.quantities
    names = tuple(quantities[i] for i in problem.unknown.tolist())
    ends = ends and ends.select(find_distinct(problem, ends, options))
    if ends is None or not ends.converged.size:
        return Location((), names, -np.inf, problem)
    # likelihood times a normal prior of the domain's extents, integrated by Laplace's method
    sizes = np.linalg.svd(ends.jacobian * compute_extents(problem.response), compute_uv=False)
    logs = -0.5 * (ends.chi_square + np.log1p(np.square(sizes)).sum(axis=1))
    total = float(np.logaddexp.reduce(logs))
    weights = np.exp(logs - total).tolist()
    columns = zip(
        *describe_touches(problem, ends),
        weights,
        problem.find_active_limits(ends.coordinates),
        strict=True,
    )
    touches = [Touch(quantities, names, *attributes) for attributes in columns]
    if (
        problem.degrees_of_freedom <= 0
    ):  # chi-square is zero but for where searches stop, and ranks nothing
        touches.sort(key=lambda touch: (touch.explained, touch.weight), reverse=True)
    spread = math.log(2.0 * math.pi) / 2.0 + np.log(problem.deviations_pC[0])
    return Location(tuple(touches), names, total - float(spread.sum()), problem)


def describe_touches(
    problem: LocationProblem, ends: SearchResult
) -> tuple[Array, Array, Mask, Array, Array, Mask]:
    """Of the touches at some ends: values (n, k), roots of their covariances, chi-square, its
    p-value, and whether the charges are explained, (n,)."""
    values, sought = problem.to_touches(ends.coordinates), problem.unknown
    scale = problem.compute_touch_scale(values)[:, sought]
    slopes, extent = (
        ends.jacobian[:, :, sought] / scale[:, None],
        compute_extents(problem.response)[sought],
    )
    chi_square, freedom = ends.chi_square, problem.degrees_of_freedom
    fit = chi_square, compute_p_values(chi_square, freedom), is_plausible(chi_square, freedom)
    return values, *compute_covariance_roots(slopes, extent * scale), *fit


def find_distinct(problem: LocationProblem, ends: SearchResult, options: LocateOptions) -> Indices:
    """The likely ends of searches that do not repeat a better one, the best first."""
    ranking, turns = ends.ranking, slice_quantity(problem.response, TouchColumn.ROTATION)
    order = ranking.argsort(kind="stable")
    rows = order[ranking[order] <= ranking.min() + options.listed]
    rows = rows[ends.converged[rows]]
    kept = rows[:0]
    while len(rows) > 1:
        apart = problem.compute_differences(ends.coordinates[rows], ends.coordinates[rows[0]])
        same = np.square(apart @ ends.jacobian[rows[0]].T).sum(axis=1) < options.same
        same &= (np.abs(apart[:, turns]) < options.same_deg).all(axis=1)
        kept, rows = np.append(kept, rows[0]), rows[~same]
    return np.append(kept, rows)
