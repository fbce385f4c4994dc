"""Searches for a touch: from everywhere, about what charges determine least, and what they found.

At a fold of the charges two touches close together have almost the same charges, and a search on
one side of the fold does not see the touch on the other side. A fold is near where the longest step
along some direction changes the charges by less than a small share of themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pvdf_fem.arrays import Array, Indices, Mask
from pvdf_fem.response.model import ROTATION, periods_deg
from pvdf_fem.touch.least_squares import Descent, SearchOptions, descend, joined
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.problem import Problem, extents, rows_of
from pvdf_fem.touch.starts import starts
from pvdf_fem.touch.touch import Touch, explains, p_values, roots_of


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
    retries: int = 8  #: Starts of the second search for a row of `locate_many`.
    #: A fold of the charges is near where the longest step along some direction changes them by
    #: less than the share `fold` of themselves, and is searched about where this share is more than
    #: `resolved` standard deviations: from starts along the direction, in longest steps.
    fold: float = 0.02
    resolved: float = 10.0
    offsets: tuple[float, ...] = (-0.3, -0.1, -0.03, 0.0, 0.03, 0.1, 0.3)
    fold_search: SearchOptions = field(default_factory=lambda: SearchOptions(short=1e-4))

    # ---- by full solves

    #: Largest distance of a touch from the centre in mm; by default 1.5 times the distance of the
    #: farthest electrode. Least and largest force in N.
    reach_mm: float | None = None
    forces_N: tuple[float, float] = (1e-3, 1e3)
    #: Tolerance of coarse solves, and of the final ones, whose slopes give the deviations: to 1 %
    #: at 1e-4, to 6 % at 1e-3, measured where the probe's rim crosses an electrode.
    first_tolerance: float = 1e-2
    tolerance: float = 1e-4
    #: Distance of the places of single touches that are solved, and that are superposed. A force
    #: is its share times this power of the sum of shares: the common tension stiffens the film.
    pitch_mm: float = 2.5
    fine_mm: float = 1.0
    stiffening: float = 0.35
    #: Number of starts, least distance between starts, number of steps from every start.
    starts: int = 25
    apart_mm: float = 3.0
    first_steps: int = 3
    #: How many searches go on; the others go on where these lead to no touch that explains the
    #: charges, as a larger chi-square is less probable than `significance`.
    followed: int = 5
    significance: float = 0.05
    #: Starts about the best end, in longest steps along what the charges determine least, and how
    #: often there are such starts where they led to a better end.
    valley: tuple[float, ...] = (-0.5, 0.5)
    rounds: int = 3
    solve_search: SearchOptions = field(
        default_factory=lambda: SearchOptions(40, arrived=0.02, short=0.04, relief=0.3)
    )


DEFAULTS = LocateOptions()


def search(problem: Problem, known: Mapping[int, float], options: LocateOptions) -> Descent:
    """Searches from everywhere for the touch of a problem. `known` are coordinates by their index
    in `QUANTITIES`. A sought rotation is held at first, at many values: a few degrees change
    charges by less than the pitch of the table of starts does."""
    at = starts(problem, known)
    without_rotation = problem.unknown[problem.unknown != ROTATION]
    if 0 < len(without_rotation) < len(problem.unknown):
        at = descend(replace(problem, unknown=without_rotation), at, options=options.search).at
    ends = descend(problem, at, hopeless=options.listed, options=options.search)
    # in separate calls: within a call, searches close to each other are merged
    about_fold = _starts_about_fold(problem, ends, options)[:, None]
    return joined([ends, *(descend(problem, at, options=options.fold_search) for at in about_fold)])


def _starts_about_fold(problem: Problem, ends: Descent, options: LocateOptions) -> Array:
    """Starts (n, 4) on both sides of a fold of the charges, if one is near the best end."""
    none, moving = ends.at[:0], problem.moving
    size = float(np.linalg.norm(problem.charges_pC / problem.deviations_pC))
    resolved = options.fold * size >= options.resolved and len(problem.electrodes) > len(moving)
    if not resolved or not ends.arrived.any():
        return none
    best = ends.take(np.array([ends.ranking.argmin()]))
    _, values, _ = np.linalg.svd(best.slopes[0][:, moving] * problem.longest[moving])
    if values[-1] > options.fold * size:
        return none
    return best.at + np.outer(options.offsets, weakest(problem, best))


def weakest(problem: Problem, ends: Descent) -> Array:
    """A longest step (k,) along what the charges determine least at the first of some ends."""
    longest = problem.longest * np.isin(np.arange(ends.at.shape[1]), problem.moving)
    weak = np.linalg.svd(ends.slopes[0][:, problem.moving] * longest[problem.moving])[2][-1]
    step = np.zeros(len(longest))
    step[problem.moving] = longest[problem.moving] * weak / np.abs(weak).max()
    return step


def location(problem: Problem, ends: Descent | None, options: LocateOptions = DEFAULTS) -> Location:
    """The location whose touches are the distinct ends of searches for one touch; None where no
    search was made."""
    quantities = problem.model.quantities
    names = tuple(quantities[i] for i in problem.unknown.tolist())
    ends = ends and ends.take(distinct(problem, ends, options))
    if ends is None or not ends.arrived.size:
        return Location((), names, -np.inf, problem)
    # likelihood times a normal prior of the domain's extents, integrated by Laplace's method
    slopes = ends.slopes * extents(problem.model)
    normal = np.matmul(slopes.swapaxes(1, 2), slopes) + np.eye(slopes.shape[2])
    logs = -0.5 * (ends.chi_square + np.log(np.linalg.det(normal)))
    total = float(np.logaddexp.reduce(logs))
    weights = np.exp(logs - total).tolist()
    columns = zip(*described(problem, ends), weights, problem.edges(ends.at), strict=True)
    touches = tuple(Touch(quantities, names, *attributes) for attributes in columns)
    spread = math.log(2.0 * math.pi) / 2.0 + np.log(problem.deviations_pC[0])
    return Location(touches, names, total - float(spread.sum()), problem)


def described(problem: Problem, ends: Descent) -> tuple[Array, Array, Mask, Array, Array, Mask]:
    """Of the touches at some ends: values (n, k), `roots_of` their covariances, chi-square, its
    p-value, and whether the charges are explained, (n,)."""
    values, sought = problem.touches(ends.at), problem.unknown
    scale = problem.per_coordinate(values)[:, sought]
    slopes, extent = ends.slopes[:, :, sought] / scale[:, None], extents(problem.model)[sought]
    chi_square, freedom = ends.chi_square, problem.freedom
    fit = chi_square, p_values(chi_square, freedom), explains(chi_square, freedom)
    return values, *roots_of(slopes, extent * scale), *fit


def distinct(problem: Problem, ends: Descent, options: LocateOptions) -> Indices:
    """The likely ends of searches that do not repeat a better one, the best first."""
    ranking, turns = ends.ranking, rows_of(problem.model, ROTATION)
    order = ranking.argsort(kind="stable")
    rows = order[ranking[order] <= ranking.min() + options.listed]
    rows = rows[ends.arrived[rows]]
    periods, kept = periods_deg(problem.model), rows[:0]
    while len(rows) > 1:
        apart = ends.at[rows] - ends.at[rows[0]]
        apart[:, turns] -= periods * np.rint(apart[:, turns] / periods)
        same = np.square(apart @ ends.slopes[rows[0]].T).sum(axis=1) < options.same
        same &= (np.abs(apart[:, turns]) < options.same_deg).all(axis=1)
        kept, rows = np.append(kept, rows[0]), rows[~same]
    return np.append(kept, rows)
