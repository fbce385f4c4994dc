"""Full solves of random touches, which measure the error of a response.

The response is not built from these solves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.surrogate.response_file import FileArray
from pvdf_fem.surrogate.touch_domain import apply_touch

if TYPE_CHECKING:
    from pvdf_fem.electrodes.stress_integrals import StressIntegrals


class RelativeErrors(NamedTuple):
    """Errors of charges as fractions of |d31 X| + |d32 Y|, with the stress integrals X, Y."""

    of_charges: Array  #: Differences from the full solves, shape (n, electrodes).
    of_solves: float  #: Largest estimated error of the full solves.


def make_solve_tasks(
    scene: Scene, touches: Array, tolerance: float, fraction: float = 0.1
) -> list[tuple[Any, ...]]:
    """Make a task for a `TaskRunner` for each touch, which solves the touch in full.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    touches : ndarray, shape (n, 4)
        Rows of x and y in mm, rotation in degrees and force in N.
    tolerance : float
        Tolerance of the response.
    fraction : float, optional
        Tolerance of the solves as a fraction of `tolerance`.
    """
    return [(solve_stress_integrals, scene, touch, fraction * tolerance) for touch in touches]


def solve_stress_integrals(scene: Scene, touch: Array, tolerance: float) -> StressIntegrals | str:
    """Solve a touch in full, and return the stress integrals of all electrodes.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    touch : ndarray, shape (4,)
        Position x and y in mm, rotation in degrees and force in N.
    tolerance : float
        Tolerance of the solve.

    Returns
    -------
    StressIntegrals or str
        Stress integrals, or the reason as a text if the solve did not converge.
    """
    from pvdf_fem.problem.problem import Problem  # imports gmsh
    from pvdf_fem.solver.adaptive import solve_outputs

    loaded_scene = apply_touch(scene, touch, tolerance)
    solution = solve_outputs(Problem.from_scene(loaded_scene))
    if solution.status is not Status.CONVERGED:
        return solution.reason
    return solution.discrete.stress_integrals


@dataclass(frozen=True, eq=False)
class ValidationSolves:
    """Stress integrals X, Y of the electrodes from full solves, with their estimated errors."""

    #: Rows of x and y in mm, rotation in degrees and force in N, shape (n, 4).
    touches: FileArray
    #: Stress integrals in N, shape (n, electrodes, 2).
    integrals: FileArray
    #: Estimated errors of the stress integrals in N, with signs, shape (n, electrodes, 2).
    errors: FileArray

    @classmethod
    def collect(cls, touches: Array, results: Sequence[StressIntegrals | str]) -> ValidationSolves:
        """Collect the results of full solves, without the touches that could not be solved.

        Parameters
        ----------
        touches : ndarray, shape (n, 4)
            Rows of x and y in mm, rotation in degrees and force in N.
        results : sequence of StressIntegrals or str
            Results of `solve_stress_integrals` for each touch.

        Raises
        ------
        NotConvergedError
            If more than half of the touches could not be solved.
        """
        failed = [i for i, result in enumerate(results) if isinstance(result, str)]
        if 2 * len(failed) > len(touches):
            x, y, rotation, force = touches[failed[0]]
            touch = f"({x:.6g}, {y:.6g}) mm, {rotation:.6g} deg, {force:.6g} N"
            raise NotConvergedError(f"touch at {touch}: {results[failed[0]]}")
        solved = [result for result in results if not isinstance(result, str)]
        integrals = np.array([result.values for result in solved])
        errors = np.array([result.errors for result in solved])
        return cls(np.delete(touches, failed, axis=0), integrals, errors)

    def compute_relative_errors(self, film: Film, charges_pC: Array) -> RelativeErrors:
        """Compute the relative errors of charges of `touches` by comparison with the full solves.

        Parameters
        ----------
        film : Film
            Film with d31 and d32.
        charges_pC : ndarray, shape (n, electrodes)
            Charges in pC from a response, for each of `touches`.
        """
        from pvdf_fem.electrodes.stress_integrals import StressIntegrals  # imports scikit-fem

        d_pC_N = (film.d31_pC_N, film.d32_pC_N)
        sizes = (np.abs(self.integrals) * np.abs(d_pC_N)).sum(axis=-1)
        sizes[sizes == 0.0] = 1.0  # Without stress or d31 and d32, the error in pC is absolute.
        estimated = np.zeros_like(sizes)
        for row, (integrals, errors) in enumerate(zip(self.integrals, self.errors, strict=True)):
            estimated[row] = StressIntegrals(integrals, errors).charge_errors(d_pC_N)
        differences = np.abs(charges_pC - (self.integrals * d_pC_N).sum(axis=-1))
        return RelativeErrors(differences / sizes, float((estimated / sizes).max()))
