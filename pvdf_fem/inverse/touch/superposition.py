"""The search by full solves, from starts where charges of single touches, added up, are alike."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import lru_cache
from itertools import combinations, product

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
from pvdf_fem.inverse.touch.location_problem import LocationProblem, get_base_quantity
from pvdf_fem.inverse.touch.search import LocateOptions, find_distinct
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


def search_by_solves(
    problem: LocationProblem, model: SolvedResponse, options: LocateOptions
) -> SearchResult:
    """Distinct ends of searches for the touch of a problem by its model: coarse ones from the most
    likely starts, then about the best end, then the final ones."""
    rough = replace(model, error_bound=options.first_tolerance)
    spread = np.hypot(problem.deviations_pC, options.first_tolerance / 3**0.5 * problem.charges_pC)
    coarse, how = replace(problem, response=rough, deviations_pC=spread), options.solved_search
    other = model.other_probe
    begun = [_begun(cold, model.touch, options) for cold in _cold(coarse)]
    freedom, found = problem.degrees_of_freedom, []
    for part in (slice(options.followed), slice(options.followed, None)):
        starts = np.concatenate([likely[part] for likely in begun])
        ends = run_levenberg_marquardt(coarse, starts, options=how)
        ends = _ordered(coarse, search_along_weak_direction(coarse, ends, options), other, options)
        if ends.coordinates.size:
            found.append(run_levenberg_marquardt(problem, ends.coordinates, options=how))
        if (
            found
            and is_plausible(found[-1].ranking.min()[None], freedom, options.significance).any()
        ):
            break
    return _ordered(problem, concatenate_results(found), other, options) if found else ends


def search_along_weak_direction(
    problem: LocationProblem, ends: SearchResult, options: LocateOptions
) -> SearchResult:
    """The ends of searches, and ends of others about the best along what the charges determine
    least.

    At a fold of the charges two touches close together have almost the same charges, and a search
    on one side of the fold does not see the touch on the other side. Along a valley a search may
    end before its bottom.
    """
    moving, longest = problem.free_columns, problem.longest_steps[problem.free_columns]
    for _ in range(options.rounds):
        best = ends.select(ends.ranking.argsort()[:1])
        if not best.converged.any():
            break
        *_, directions = np.linalg.svd(best.jacobian[0][:, moving] * longest)
        step = longest * directions[-1] / np.abs(directions[-1]).max()
        at = np.repeat(best.coordinates, len(options.aside), axis=0)
        at[:, moving] += np.outer(options.aside, step)
        more = run_levenberg_marquardt(problem, at, options=options.solved_search)
        ends = concatenate_results([ends, more])
        if more.ranking.min() > best.chi_square[0] - options.solved_search.chi_square_tolerance:
            break
    return ends


def _cold(problem: LocationProblem) -> Iterator[LocationProblem]:
    """Problems for starts, with cold touches: by the charges of all electrodes, then, if a
    temperature is unknown, without each electrode in turn, since a warm touch may be above it."""
    names, unknown = problem.response.quantities, problem.unknown.tolist()
    cold = [i for i in unknown if get_base_quantity(names[i]) != "temperature_K"]
    yield (whole := replace(problem, unknown=np.array(cold)))
    for left in range(len(problem.electrodes) if len(cold) < len(unknown) else 0):
        electrodes = np.delete(problem.electrodes, left)
        charges = np.delete(problem.charges_pC, left, axis=1)
        spread = np.delete(problem.deviations_pC, left, axis=1)
        yield replace(whole, electrodes=electrodes, charges_pC=charges, deviations_pC=spread)


def _begun(problem: LocationProblem, touch: Array, options: LocateOptions) -> Array:
    """Where first steps from the starts lead, (n, k), the likeliest first."""
    first = replace(options.solved_search, max_steps=options.first_steps)
    ends = run_levenberg_marquardt(
        problem, find_superposed_candidates(problem, touch, options), options=first
    )
    return ends.coordinates[np.argsort(ends.chi_square)]


def _ordered(
    problem: LocationProblem, ends: SearchResult, other: Indices, options: LocateOptions
) -> SearchResult:
    """The distinct ends; equal probes are in the order of their first coordinates. `other` is
    `Solves.other_probe`."""
    if other.size:
        swap = ends.coordinates[:, 0] > ends.coordinates[:, len(TOUCH_QUANTITIES)]
        ends.coordinates[swap], ends.jacobian[swap] = (
            ends.coordinates[swap][:, other],
            ends.jacobian[swap][..., other],
        )
    solved = ends.chi_square < 1e-6 * np.square(UNSOLVED_PC / problem.deviations_pC).min()
    ends = ends.select(np.flatnonzero(solved))
    return ends.select(find_distinct(problem, ends, options)) if ends.coordinates.size else ends


def find_superposed_candidates(
    problem: LocationProblem, touch: Array, options: LocateOptions, stiffening: float = 0.35
) -> Array:
    """Starts (n, k) where charges of single touches, added up, are most like those measured. What
    is not sought is that of a `touch` (k,). A force is its share times the power `stiffening` of
    the sum of shares: the common tension stiffens the film."""
    model, reach_mm = problem.response, problem.response.domain.reach_mm
    electrodes, spread = problem.electrodes, problem.deviations_pC[0]
    rest = np.nan_to_num(compute_unloaded_charges_pC(model.scene)[0, electrodes])
    singles = pin_profile_files(
        make_single_probe_scene(model.scene, i) for i in range(count_probes(model))
    )
    tables = [_single(one, reach_mm, options.pitch_mm, options.fine_mm) for one in singles]
    changes = np.concatenate([(c[:, electrodes] - rest) for _, c in tables]) / spread
    places = np.concatenate([p for p, _ in tables])
    count, alike = len(tables[0][0]), tables[0] is tables[-1]
    sets = [range(count), range(count, len(places))][: len(tables)]
    chosen = np.array([*(combinations(sets[0], len(sets)) if alike else product(*sets))])
    gram, right = changes @ changes.T, changes @ ((problem.charges_pC[0] - rest) / spread)
    normal = gram[chosen[:, :, None], chosen[:, None, :]]
    normal = normal + 1e-9 * gram.diagonal().mean() * np.eye(len(sets))
    shares = np.linalg.solve(normal, right[chosen][:, :, None])[:, :, 0]
    explained = (right[chosen] * shares).sum(axis=1)
    pressing = (shares > 0.03 * np.abs(shares).sum(axis=1, keepdims=True)).all(axis=1)
    order = np.argsort(-np.where(pressing, explained, -np.inf))[: pressing.sum()]
    kept: list[int] = []
    for row in order.tolist():
        apart = np.abs(places[chosen[kept]] - places[chosen[row]]).max(axis=(1, 2), initial=0.0)
        if (apart >= options.apart_mm).all():
            kept.append(row)
        if len(kept) == options.starts:
            break
    at = np.tile(problem.to_coordinates(touch[None]), (len(kept), 1))
    of_probes, share = problem.view_by_probe(at), shares[kept]
    starts = of_probes.copy()
    stage = model.scene.stage or Stage()
    starts[..., : TouchColumn.ROTATION] = places[chosen[kept]] @ stage.rotation.T
    starts[..., TouchColumn.FORCE] = np.log(share) + stiffening * np.log(share.sum(axis=1))[:, None]
    sought = np.isin(np.arange(at.shape[1]), problem.unknown)
    of_probes[...] = np.where(
        problem.view_by_probe(np.tile(sought, (len(at), 1))), starts, of_probes
    )
    return at


@lru_cache(maxsize=8)
def _single(scene: Scene, reach_mm: float, pitch_mm: float, fine_mm: float) -> tuple[Array, Array]:
    """Places (n, 2) within reach, and charges (n, electrodes) of a touch there.

    Those of a probe turned with its place, which a round film gives by few solves, interpolated.
    """
    places = []
    for radius in np.linspace(0.0, reach_mm, round(reach_mm / pitch_mm) + 1):
        count = max(1, round(2.0 * np.pi * radius / pitch_mm))
        places += [(radius, 360.0 * i / count) for i in range(count)]
    radii, turns = np.array(places).T
    solved = radii[:, None] * np.stack([np.cos(np.radians(turns)), np.sin(np.radians(turns))], -1)
    keys = ("probe.x_mm", "probe.y_mm", "probe.rotation_deg")
    rows = np.column_stack([solved, turns]).tolist()
    scenes = [scene.with_(**dict(zip(keys, row, strict=True))) for row in rows]
    records = solve_scenes(scenes, processes=1)
    good = [i for i, record in enumerate(records) if record.converged]
    if len(good) < 3:
        raise NotConvergedError(f"{records[0].status}: one touch alone: {records[0].reason}")
    reads = scene.film.d31_pC_N, scene.film.d32_pC_N, scene.numerics.observable
    charges = np.array([[*records[i].charges_pC(*reads).values()] for i in good])
    ticks = np.arange(-reach_mm, reach_mm + 0.5 * fine_mm, fine_mm)
    grid = np.stack(np.meshgrid(ticks, ticks), axis=-1).reshape(-1, 2)
    grid = grid[np.hypot(*grid.T) <= reach_mm]
    return grid, RBFInterpolator(solved[good], charges)(grid)
