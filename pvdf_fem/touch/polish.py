"""A located touch made better with the finite-element model itself.

The response model is off by up to its error bound. Where a touch was found, the finite-element
charges tell by how much; the model with that difference added is right there, and its slopes are as
good as before. Searching on with it from the touch, and again from where that ends, is Newton's
method with the model's slopes: each round gains a factor of the slopes' relative error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE, QUANTITIES, Domain, Model, scene_of_touch
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution
from pvdf_fem.solution.solve import solve
from pvdf_fem.solvers.status import Status
from pvdf_fem.touch.descent import Descent, descend, joined
from pvdf_fem.touch.locate import deviations, location
from pvdf_fem.touch.location import Location
from pvdf_fem.touch.problem import Problem
from pvdf_fem.touch.touch import Touch

#: Rounds of polishing end when a touch moves by less than this share of a standard deviation.
SETTLED = 1e-2


class PolishError(RuntimeError):
    """A touch could not be polished; the text says why."""


@dataclass(frozen=True, eq=False)
class Corrected:
    """A model with constants added to its charges, right within a tolerance about one touch."""

    model: Model
    added_pC: Array
    error_bound: float

    @property
    def names(self) -> tuple[str, ...]:
        """Of the electrodes."""
        return self.model.names

    @property
    def scene(self) -> Scene:
        """Of the model."""
        return self.model.scene

    @property
    def domain(self) -> Domain:
        """Of the model."""
        return self.model.domain

    def evaluate(self, touches: Array) -> tuple[Array, Array]:
        """Charges and slopes as the model's."""
        charges, slopes = self.model.evaluate(touches)
        return charges + self.added_pC, slopes


def polish(
    model: Model,
    found: Location,
    charges_pC: Mapping[str, float],
    sigma: float = 0.01,
    *,
    tolerance: float = 1e-4,
    noise_pC: float = 0.0,
    solver: Callable[[Scene], Solution] = solve,
    max_rounds: int = 5,
) -> Location:
    """The touches of a location with the finite-element model's charges.

    Parameters
    ----------
    model : Model
        The one that `found` is from, of the same charges, `sigma` and `noise_pC`.
    found : Location
    charges_pC : mapping
    sigma, noise_pC : float
    tolerance : float
        Relative error of the finite-element charges, which takes the place of the model's bound.
    solver : callable
        From a scene to its solution.
    max_rounds : int
        Rounds after which a touch counts as unsettled.

    Raises
    ------
    PolishError
        When a solve does not converge, or rounds do not settle.
    """
    ends = [
        _polished(model, touch, charges_pC, sigma, noise_pC, tolerance, solver, max_rounds)
        for touch in found.touches
    ]
    if not ends:
        return found
    problems, descents = zip(*ends, strict=True)
    return location(problems[0], joined(descents))


def _polished(
    model: Model,
    touch: Touch,
    charges_pC: Mapping[str, float],
    sigma: float,
    noise_pC: float,
    tolerance: float,
    solver: Callable[[Scene], Solution],
    max_rounds: int,
) -> tuple[Problem, Descent]:
    electrodes = np.array([model.names.index(name) for name in charges_pC])
    charges = np.array(list(charges_pC.values()))
    better = Corrected(model, np.zeros(len(model.names)), tolerance)
    spread = deviations(better, charges, np.array(sigma), noise_pC)
    sought = np.array([QUANTITIES.index(name) for name in touch.unknown])
    problem = Problem(better, electrodes, charges[None], spread[None], sought)
    at = touch.values
    for _ in range(max_rounds):
        added = (
            _finite_element_charges(model, at, tolerance, solver) - model.evaluate(at[None])[0][0]
        )
        problem = replace(problem, model=replace(better, added_pC=added))
        start = at.copy()
        start[FORCE] = np.log(at[FORCE])
        end = descend(problem, start[None])
        if not end.arrived[0]:
            raise PolishError(f"polish: the search from {_place(at)} did not end")
        moved = end.at[0] - start
        at = end.at[0].copy()
        at[FORCE] = np.exp(at[FORCE])
        if np.square(end.slopes[0] @ moved).sum() < SETTLED**2:
            return problem, end
    raise PolishError(f"polish: {max_rounds} rounds did not settle near {_place(at)}")


def _finite_element_charges(
    model: Model, at: Array, tolerance: float, solver: Callable[[Scene], Solution]
) -> Array:
    solution = solver(scene_of_touch(model.scene, at, tolerance))
    if solution.status is not Status.CONVERGED:
        raise PolishError(f"polish: the solve at {_place(at)} ended {solution.status}")
    return np.array([solution.charges_pC[name] for name in model.names])


def _place(at: Array) -> str:
    x, y, rotation, force = at.tolist()
    return f"({x:.4g}, {y:.4g}) mm, {rotation:.4g}°, {force:.4g} N"
