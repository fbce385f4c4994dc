"""Budget of a solve: maximum number of unknowns in a mesh, and maximum work in seconds.

Work is estimated, not measured by a clock, so that results do not depend on how busy the machine
is. A Newton iteration counts as the seconds that a processor core of 2024 takes for it.
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
    """Estimate the time of a Newton iteration that assembles and factorises a new tangent.

    Parameters
    ----------
    count : float
        Number of unknowns n.
    model : FilmModel
        Film model; its mesh policy has the cost of an iteration relative to a membrane, c.
    per_second : float, optional
        Number of unknowns r that an iteration without factorisation processes per second.
    fixed : float, optional
        Time that does not depend on the mesh, as a number of unknowns n0.
    factorising : float, optional
        Number of unknowns n1 at which the factorisation takes as long as the rest.

    Returns
    -------
    float
        c (n0 + n (1 + sqrt(n / n1))) / r, in s.

    Notes
    -----
    n0 and n1 are fitted to the times of 38 solves of films that wrinkle.
    """
    unknowns = fixed + count * (1.0 + (count / factorising) ** 0.5)
    return model.mesh_policy.iteration_cost * unknowns / per_second


@dataclass
class Budget:
    """Limits of unknowns and work of a solve, and the work that it has used so far."""

    max_unknowns: int  #: Maximum number of unknowns of a mesh (``numerics.max_unknowns``).
    max_seconds: float  #: Maximum work in s (``numerics.max_seconds``).
    #: Whether `max_unknowns` also limits the first mesh. By default it limits only refined meshes,
    #: and the first mesh has as many unknowns as the outlines and the tolerance need.
    bounds_first_mesh: bool = False
    spent_seconds: float = field(default=0.0)  #: Work so far in s.
    #: Maximum fraction of `max_seconds` for finding the equilibrium on one mesh.
    equilibrium_fraction: float = 0.4

    @classmethod
    def for_problem(
        cls, problem: Problem, seconds: float = 20.0, *, usual_tolerance: float = 1e-3
    ) -> Budget:
        """Make the budget of the scene's ``numerics``, with defaults for missing limits.

        A given ``numerics.max_unknowns`` also limits the first mesh.

        Parameters
        ----------
        problem : Problem
            Problem whose scene and film model set the limits.
        seconds : float, optional
            Default of ``numerics.max_seconds``.
        usual_tolerance : float, optional
            If the tolerance of the scene is smaller than this, both defaults are multiplied by
            sqrt(usual_tolerance / tolerance).
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
        """Work in s that is left; 0 if the budget is exceeded."""
        return max(self.max_seconds - self.spent_seconds, 0.0)

    def spend(self, equilibrium: Equilibrium, iterations: float) -> None:
        """Add the estimated work of Newton iterations with new tangents to `spent_seconds`."""
        count = equilibrium.unknowns.count
        self.spent_seconds += iterations * estimate_iteration_seconds(count, equilibrium.model)

    def count_affordable_iterations(self, equilibrium: Equilibrium) -> int:
        """Return how many Newton iterations one mesh may take, regardless of the work so far."""
        seconds = self.equilibrium_fraction * self.max_seconds
        count = equilibrium.unknowns.count
        return int(seconds / estimate_iteration_seconds(count, equilibrium.model))
