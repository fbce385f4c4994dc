"""Touches that are held out of a response's build: full solves with which it is compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.surrogate.response_file import FileArray
from pvdf_fem.surrogate.touch_domain import apply_touch

if TYPE_CHECKING:
    from pvdf_fem.electrodes.stress_integrals import StressIntegrals


def make_solve_tasks(
    scene: Scene, touches: Array, tolerance: float, share: float = 0.1
) -> list[tuple[Any, ...]]:
    """Tasks of full solves of touches (n, 4), to a share of a response's tolerance."""
    return [(solve_stress_integrals, scene, touch, share * tolerance) for touch in touches]


def solve_stress_integrals(scene: Scene, touch: Array, tolerance: float) -> StressIntegrals | str:
    """Forces X, Y of the electrodes under a touch (4,), or why there are none."""
    from pvdf_fem.solver.adaptive import solve_outputs

    touched = apply_touch(scene, touch, tolerance)
    solution = solve_outputs(Problem.from_scene(touched))
    converged = solution.status is Status.CONVERGED
    return solution.discrete.stress_integrals if converged else solution.reason


@dataclass(frozen=True, eq=False)
class ValidationSolves:
    """Forces X, Y of electrodes in full solves of touches, and their estimated errors."""

    touches: FileArray
    #: In N, (n, electrodes, 2); errors have signs.
    forces: FileArray
    errors: FileArray

    @classmethod
    def of(cls, touches: Array, found: Sequence[StressIntegrals | str]) -> ValidationSolves:
        """The touches that have a solution, with their forces or else a reason.

        Raises `NotConvergedError` when fewer than half of the touches have a solution.
        """
        failed = [i for i, forces in enumerate(found) if isinstance(forces, str)]
        if 2 * len(failed) > len(touches):
            x, y, rotation, force = touches[failed[0]]
            place = f"({x:.6g}, {y:.6g}) mm, {rotation:.6g} deg, {force:.6g} N"
            raise NotConvergedError(f"touch at {place}: {found[failed[0]]}")
        known = [forces for forces in found if not isinstance(forces, str)]
        values = np.array([forces.values for forces in known])
        return cls(np.delete(touches, failed, 0), values, np.array([f.errors for f in known]))

    def relative_errors(self, film: Film, charges_pC: Array) -> tuple[Array, float]:
        """Errors of charges (n, electrodes) of these touches over |d31 X| + |d32 Y|.

        The second value is the largest error that the full solves state of themselves.
        """
        from pvdf_fem.electrodes.stress_integrals import StressIntegrals  # with scikit-fem

        d = film.d31_pC_N, film.d32_pC_N
        sizes = (np.abs(self.forces) * np.abs(d)).sum(axis=-1)
        sizes[sizes == 0.0] = 1.0
        both = zip(self.forces, self.errors, strict=True)
        stated = np.array([StressIntegrals(*rows).charge_errors(d) for rows in both])
        apart = np.abs(charges_pC - (self.forces * d).sum(axis=-1))
        return apart / sizes, float((stated / sizes).max())
