"""Budget of a solve: unknowns in a mesh, and work in seconds.

Work is counted and not measured by a clock: results do not depend on a machine's load. A Newton
iteration costs the seconds that a core from 2024 takes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from pvdf_fem.film.models import FilmModel
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem


def estimate_iteration_seconds(
    count: float,
    model: FilmModel,
    per_second: float = 1.4e5,
    fixed: float = 150.0,
    factorising: float = 22_500.0,
) -> float:
    """Work for a Newton iteration with a new tangent and `count` unknowns.

    A second is enough for `per_second` unknowns of a small mesh. An iteration takes a time
    equivalent to `fixed` unknowns on every mesh, and factorising takes equal time to the rest at
    `factorising` unknowns; both numbers are fitted to the times of 38 solves with wrinkled films.
    """
    unknowns = fixed + count * (1.0 + (count / factorising) ** 0.5)
    return model.mesh_policy.iteration_cost * unknowns / per_second


@dataclass
class Budget:
    """What a solve may cost and has cost."""

    max_unknowns: int  #: Of a mesh (``numerics.max_unknowns``).
    max_seconds: float  #: Of work (``numerics.max_seconds``).
    #: Whether `max_unknowns` holds for the first mesh, too, which has what the outlines and the
    #: tolerance need. It does where the scene gives the number.
    bounds_first_mesh: bool = False
    spent_seconds: float = field(default=0.0)  #: Work so far.
    #: Largest part of `max_seconds` for the search for an equilibrium on a mesh.
    equilibrium_share: float = 0.4

    @classmethod
    def for_problem(
        cls, problem: Problem, seconds: float = 20.0, usual_tolerance: float = 1e-3
    ) -> Budget:
        """What a scene's numerics allow. By default the work takes `seconds` at tolerances from
        `usual_tolerance` on; a finer tolerance multiplies defaults by the root of its ratio."""
        numerics = problem.scene.numerics
        patience = max(1.0, usual_tolerance / numerics.tolerance) ** 0.5
        unknowns, given = numerics.max_unknowns, numerics.max_seconds
        if unknowns is None:
            unknowns = int(problem.film.mesh_policy.max_unknowns * patience)
        work = seconds * patience if given is None else given
        return cls(unknowns, work, numerics.max_unknowns is not None)

    @property
    def left_seconds(self) -> float:
        """Work that may still be done."""
        return max(self.max_seconds - self.spent_seconds, 0.0)

    def spend(self, equilibrium: Equilibrium, iterations: float) -> None:
        """Count Newton iterations with a new tangent."""
        count = equilibrium.unknowns.count
        self.spent_seconds += iterations * estimate_iteration_seconds(count, equilibrium.model)

    def iterations(self, equilibrium: Equilibrium) -> int:
        """Most Newton iterations in the search for an equilibrium."""
        share = self.equilibrium_share * self.max_seconds
        return int(
            share / estimate_iteration_seconds(equilibrium.unknowns.count, equilibrium.model)
        )
