"""Budget of a solve: unknowns in a mesh, and work in seconds.

Work is counted and not measured by a clock, so that results do not depend on the load of a machine.
A Newton iteration counts as the seconds that a processor core of 2024 takes for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pvdf_fem.film.models import FilmModel
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem


def estimate_iteration_seconds(
    count: float,
    model: FilmModel,
    *,
    per_second: float = 1.4e5,
    fixed: float = 150.0,
    factorising: float = 22_500.0,
) -> float:
    """Estimate the work of a Newton iteration with a new tangent.

    Parameters
    ----------
    count : float
        Number of unknowns.
    model : FilmModel
        The film model, whose iterations cost more or less than a membrane's.
    per_second : float, optional
        Unknowns of a small mesh that an iteration treats in a second.
    fixed : float, optional
        Unknowns whose time an iteration takes in addition on every mesh.
    factorising : float, optional
        Unknowns of the mesh on which factorising takes as long as the rest of an iteration.

    Returns
    -------
    float
        Work in s.

    Notes
    -----
    `fixed` and `factorising` are fitted to the times of 38 solves of films that wrinkle.
    """
    unknowns = fixed + count * (1.0 + (count / factorising) ** 0.5)
    return model.mesh_policy.iteration_cost * unknowns / per_second


@dataclass
class Budget:
    """What a solve may cost, and has cost so far."""

    max_unknowns: int  #: Unknowns of a mesh (``numerics.max_unknowns``).
    max_seconds: float  #: Work in s (``numerics.max_seconds``).
    #: Whether `max_unknowns` holds for the first mesh, too, as it does where the scene gives the
    #: number. Otherwise the first mesh has what the outlines and the tolerance need.
    bounds_first_mesh: bool = False
    spent_seconds: float = field(default=0.0)  #: Work so far in s.
    #: Largest share of `max_seconds` for finding the equilibrium on one mesh.
    equilibrium_share: float = 0.4

    @classmethod
    def for_problem(
        cls, problem: Problem, seconds: float = 20.0, *, usual_tolerance: float = 1e-3
    ) -> Budget:
        """Return what a scene's numerics allow.

        Parameters
        ----------
        problem : Problem
            The problem.
        seconds : float, optional
            Default of ``numerics.max_seconds``.
        usual_tolerance : float, optional
            A finer tolerance of the scene multiplies both defaults by the root of the ratio.
        """
        numerics = problem.scene.numerics
        factor = max(1.0, usual_tolerance / numerics.tolerance) ** 0.5
        max_unknowns = numerics.max_unknowns
        if max_unknowns is None:
            max_unknowns = int(problem.film.mesh_policy.max_unknowns * factor)
        max_seconds = numerics.max_seconds
        if max_seconds is None:
            max_seconds = seconds * factor
        is_given = numerics.max_unknowns is not None
        return cls(max_unknowns, max_seconds, bounds_first_mesh=is_given)

    @property
    def remaining_seconds(self) -> float:
        """Work in s that may still be done."""
        return max(self.max_seconds - self.spent_seconds, 0.0)

    def spend(self, equilibrium: Equilibrium, iterations: float) -> None:
        """Count Newton iterations with a new tangent as work."""
        count = equilibrium.unknowns.count
        self.spent_seconds += iterations * estimate_iteration_seconds(count, equilibrium.model)

    def count_affordable_iterations(self, equilibrium: Equilibrium) -> int:
        """Return how many Newton iterations finding an equilibrium may take."""
        seconds = self.equilibrium_share * self.max_seconds
        count = equilibrium.unknowns.count
        return int(seconds / estimate_iteration_seconds(count, equilibrium.model))
