"""A located touch made better with the finite-element model itself.

Where a touch was found, the finite-element charges tell how far the model is off. With that
difference added it is right there. Searching on from the touch, and again from where that ends, is
Newton's method with the model's slopes: each round gains a factor of their relative error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import ROTATION, Model, scene_of_touch
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve
from pvdf_fem.solvers.status import Status
from pvdf_fem.touch.least_squares import Descent, descend, joined
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.measurement import Deviations, Measurement
from pvdf_fem.touch.problem import Adapted, Problem, along_stage
from pvdf_fem.touch.search import location

#: Rounds of polishing end when a touch moves by less than this share of a standard deviation.
SETTLED = 1e-2
MAX_ROUNDS = 5  #: Rounds after which a touch counts as unsettled.


class PolishError(RuntimeError):
    """A touch could not be polished; the text says why."""


def polish(
    model: Model,
    found: Location,
    charges_pC: Mapping[str, float],
    sigma: Deviations = 0.01,
    *,
    tolerance: float = 1e-4,
    noise_pC: Deviations | None = None,
    solver: Callable[[Scene], Solution] = solve,
) -> Location:
    """The touches of a location with the finite-element model's charges.

    `found` is from the model, of the same readings with the same `sigma` and `noise_pC`. The
    `tolerance` is the relative error of the finite-element charges, which takes the place of the
    model's bound. Raises `PolishError` when a solve does not converge, or rounds do not settle.
    """
    if not found.touches:
        return found
    better = Adapted.of(model, error_bound=tolerance)
    measurement = Measurement.of(better, tuple(charges_pC), sigma, noise_pC, found.reading)
    readings = np.array([list(charges_pC.values())], dtype=float)
    problem = measurement.problem(readings, found.problem.unknown)
    ends = [_polished(problem, better, touch.values, solver) for touch in found.touches]
    problems, descents = zip(*ends, strict=True)
    polished = location(problems[0], joined(descents))
    return replace(polished, reading=found.reading, explanations=found.explanations)


def _polished(
    problem: Problem, better: Adapted, at: Array, solver: Callable[[Scene], Solution]
) -> tuple[Problem, Descent]:
    """Where rounds from a touch `at` (4,) settle, and the problem that is right there."""
    start = problem.coordinates(at[None])
    for _ in range(MAX_ROUNDS):
        x, y, rotation, force = on_film = problem.touches(start)[0]
        place = f"({x:.4g}, {y:.4g}) mm, {rotation:.4g}°, {force:.4g} N"
        if stage := better.scene.stage:
            on_film[:2], on_film[ROTATION] = stage.to_film([x, y], rotation)
        solution = solver(scene_of_touch(better.scene, on_film, better.error_bound))
        if solution.status is not Status.CONVERGED:
            raise PolishError(f"polish: the solve at {place} ended {solution.status}")
        exact = np.array([solution.charges_pC[name] for name in better.names])
        added = exact - better.model.evaluate(on_film[None])[0][0]
        problem = replace(problem, model=along_stage(replace(better, added_pC=added)))
        end = descend(problem, start)
        if not end.arrived[0]:
            raise PolishError(f"polish: the search from {place} did not end")
        moved, start = end.at[0] - start[0], end.at
        if np.square(end.slopes[0] @ moved).sum() < SETTLED**2:
            return problem, end
    raise PolishError(f"polish: {MAX_ROUNDS} rounds did not settle near {place}")
