"""The adaptive loop: solve on refined meshes until the error bound is within the tolerance."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, Protocol, TypeVar

from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes, SizeField
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.solver.history import MeshRecord, StageTimer, Stop
from pvdf_fem.solver.nonlinear.budget import Budget, estimate_iteration_seconds
from pvdf_fem.solver.nonlinear.newton import FailedAttempt
from pvdf_fem.solver.nonlinear.status import Status

logger = logging.getLogger(__name__)


class Level(Protocol):
    """Interface of a solve on one mesh, as the adaptive loop uses it."""

    @property
    def status(self) -> Status:
        """How the solve ended."""

    @property
    def worst(self) -> float:
        """Largest estimated relative error; 0 without a result."""

    @property
    def bound(self) -> float:
        """Cautious bound of the relative error, which is compared with the tolerance."""

    @property
    def unknowns(self) -> int:
        """Number of equations."""

    @property
    def iterations(self) -> int:
        """Number of Newton iterations that led to the result."""

    @property
    def failed_attempts(self) -> tuple[FailedAttempt, ...]:
        """Solvers that failed on this mesh."""


T = TypeVar("T", bound=Level)


class TooManyUnknownsError(RuntimeError):
    """A mesh would need more unknowns or work than allowed; the text names the key to raise.

    Parameters
    ----------
    unknowns : float
        Estimated number of unknowns.
    allowed : str
        Clause of the message about the exceeded limit, which begins with its key.
    stop : Stop
        The exceeded limit, `Stop.UNKNOWNS` or `Stop.SECONDS`.
    """

    def __init__(self, unknowns: float, allowed: str, stop: Stop) -> None:
        super().__init__(
            f"a mesh needs about {unknowns:.0f} unknowns, but {allowed}; raise it, or raise"
            " numerics.tolerance"
        )
        self.stop = stop


@dataclass(frozen=True)
class AdaptiveRules:
    """Rules for the sequence of meshes: target error, growth, and when to stop."""

    #: Sizes are chosen for this fraction of the tolerance. The target is multiplied by it again
    #: after each slow mesh, as the error decreases more slowly than predicted at singular corners.
    safety: float = 0.5
    #: A mesh is slow if its error is more than this fraction of the error before.
    slow: float = 0.7
    #: Maximum ratio of the unknowns of successive meshes. On a coarse mesh, indicators overestimate
    #: and misplace the errors at singular corners and kinks.
    growth: float = 2.5
    #: No mesh is made if it may have less than this fraction of the unknowns of the last one.
    min_growth: float = 0.7
    max_meshes: int = 10  #: Maximum number of meshes.
    #: The number of affordable unknowns is proportional to the affordable work to this power.
    work_exponent: float = 0.8
    #: Minimum number of Newton iterations of a solve on a mesh, including the error estimate.
    min_iterations: int = 3
    #: Before meshing, the number of elements is overestimated by at most this factor.
    overestimate: float = 2.5


@dataclass
class AdaptiveLoop(Generic[T]):
    """Solver of a problem on a sequence of meshes, generic in the kind of solve on each mesh."""

    problem: Problem
    order: int  #: Polynomial order of the displacement.
    #: Returns the element sizes of the first mesh.
    first_sizes: Callable[[], GradedSizes | SizeField]
    #: Solves the equations on a mesh, given the solve on the mesh before or None.
    solve_equations: Callable[[Equilibrium, T | None], T]
    #: Returns the sizes of the next mesh for a level, a target error and a maximum of unknowns.
    next_sizes: Callable[[T, float, float], GradedSizes | SizeField]
    budget: Budget  #: Limits of unknowns and work; `solve_equations` adds the work.
    timer: StageTimer  #: Receives the times of the stages ``mesh``, ``solve`` and ``refine``.
    unknowns_per_element: float  #: Average number of unknowns per element.
    #: The symmetry sector that is meshed.
    sector: SymmetrySector = WHOLE_FILM
    #: Returns outlines of tip contacts by patch name, given the level before or None.
    find_contacts: Callable[[T | None], Mapping[str, Outline]] = lambda level: {}
    rules: AdaptiveRules = field(default_factory=AdaptiveRules)
    history: list[MeshRecord] = field(default_factory=list)  #: Records of the solved meshes.

    def run(self) -> tuple[T, Stop]:
        """Solve on refined meshes until the error bound is within the tolerance, or a limit is met.

        Returns
        -------
        level : Level
            If the bound is within the tolerance, or if a solve has no result, the last solve;
            otherwise the solve with the smallest error.
        stop : Stop
            Reason why no further mesh was made.

        Raises
        ------
        MeshError
            If gmsh cannot make the first mesh. Later failures only end the loop.
        TooManyUnknownsError
            If the first mesh needs more unknowns or work than allowed.
        """
        rules = self.rules
        tolerance = self.problem.scene.numerics.tolerance
        aim = rules.safety * tolerance
        spent = self.budget.spent_seconds
        level = best = self.solve_level(self.first_sizes(), None)
        while level.bound > tolerance:
            if len(self.history) == rules.max_meshes:
                return best, Stop.MESHES
            level_seconds = self.budget.spent_seconds - spent
            max_unknowns, limit = self._find_affordable_unknowns(level, level_seconds)
            if max_unknowns < rules.min_growth * level.unknowns:
                return best, limit
            spent = self.budget.spent_seconds
            with self.timer("refine"):
                sizes = self.next_sizes(level, aim, max_unknowns)
            try:
                finer = self.solve_level(sizes, level)
            except MeshError:
                return best, Stop.MESH_FAILED
            except TooManyUnknownsError as error:
                return best, error.stop
            if finer.status is Status.MAX_ITERATIONS:
                return best, Stop.FINER_FAILED
            is_slow = finer.worst > rules.slow * level.worst
            if is_slow:
                aim *= rules.safety
            was_large = level.unknowns > rules.min_growth * self.budget.max_unknowns
            level = finer
            if finer.status is Status.CONVERGED and finer.worst < best.worst:
                best = finer
            if is_slow and was_large and level.bound > tolerance:
                return best, Stop.UNKNOWNS
        has_converged = level.status is Status.CONVERGED
        return level, Stop.ACCURATE if has_converged else Stop.NO_EQUILIBRIUM

    def _find_affordable_unknowns(self, level: T, seconds: float) -> tuple[float, Stop]:
        """Compute how many unknowns the next mesh may have.

        Parameters
        ----------
        level : Level
            The last solve.
        seconds : float
            Work of the last solve, in s.

        Returns
        -------
        max_unknowns : float
            The smallest number that the growth, ``budget.max_unknowns`` and the remaining work
            allow.
        limit : Stop
            `Stop.SECONDS` if the remaining work is the limit, otherwise `Stop.UNKNOWNS`.
        """
        work_ratio = self.budget.remaining_seconds / seconds
        by_work = work_ratio**self.rules.work_exponent * level.unknowns
        by_growth = self.rules.growth * level.unknowns
        max_unknowns = min(by_growth, self.budget.max_unknowns, by_work)
        return max_unknowns, Stop.SECONDS if max_unknowns == by_work else Stop.UNKNOWNS

    def solve_level(self, sizes: GradedSizes | SizeField, coarser: T | None) -> T:
        """Make a mesh, solve on it, and append a record to the history.

        Parameters
        ----------
        sizes : GradedSizes or SizeField
            Element sizes of the mesh.
        coarser : Level or None
            The solve on the mesh before; None for the first mesh.

        Raises
        ------
        MeshError
            If gmsh cannot make the mesh.
        TooManyUnknownsError
            If the mesh needs more unknowns or work than allowed. This is estimated before meshing,
            and checked for the first mesh.
        """
        start = time.perf_counter()
        with self.timer("mesh"):
            mesh = mesh_scene(
                self.problem.scene,
                sizes,
                self.sector,
                self.problem.film.mesh_policy.min_jacobian_ratio,
                contacts=self.find_contacts(coarser),
                check_element_count=partial(
                    self._require_affordable_mesh, overestimate=self.rules.overestimate
                ),
            )
        if coarser is None:
            self._require_affordable_mesh(mesh.nelements)
        with self.timer("solve"):
            equilibrium = Equilibrium(self.problem, mesh, self.order, sector=self.sector)
        return self.solve_and_record(equilibrium, coarser=coarser, start=start)

    def _require_affordable_mesh(self, elements: float, overestimate: float = 1.0) -> None:
        """Raise `TooManyUnknownsError` if a mesh certainly exceeds the budget.

        The true number of elements is at least `elements` divided by `overestimate`.
        """
        budget = self.budget
        unknowns = elements * self.unknowns_per_element
        min_unknowns = unknowns / overestimate
        if budget.bounds_first_mesh and min_unknowns > budget.max_unknowns:
            allowed = f"numerics.max_unknowns allows {budget.max_unknowns}"
            raise TooManyUnknownsError(unknowns, allowed, Stop.UNKNOWNS)
        iteration = estimate_iteration_seconds(min_unknowns, self.problem.film)
        if self.rules.min_iterations * iteration > budget.max_seconds:
            allowed = f"numerics.max_seconds allows {budget.max_seconds:g} s of work"
            raise TooManyUnknownsError(unknowns, allowed, Stop.SECONDS)

    def solve_and_record(self, equilibrium: Equilibrium, *, coarser: T | None, start: float) -> T:
        """Solve the equations on a mesh, and append a record to the history.

        Parameters
        ----------
        equilibrium : Equilibrium
            The equations on the mesh.
        coarser : Level or None
            The solve on the mesh before; None for the first mesh.
        start : float
            Value of `time.perf_counter` before meshing, for the recorded time.
        """
        level = self.solve_equations(equilibrium, coarser)
        failed = [(a.solver, str(a.status), a.iterations) for a in level.failed_attempts]
        record = MeshRecord(
            elements=equilibrium.space.mesh.nelements,
            unknowns=level.unknowns,
            iterations=level.iterations,
            worst_error=level.worst if level.status is Status.CONVERGED else None,
            seconds=time.perf_counter() - start,
            status=str(level.status),
            failed_attempts=tuple(failed),
        )
        self.history.append(record)
        logger.info(
            "mesh %d: %d elements, %d unknowns, %d iterations, worst error %.1e, %s",
            len(self.history),
            record.elements,
            record.unknowns,
            record.iterations,
            level.worst,
            record.status,
        )
        return level
