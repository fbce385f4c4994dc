"""The adaptive loop: solve on ever better meshes until the errors are small enough."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, Protocol, TypeVar

from skfem import MeshTri2

from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes, SizeField
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.solver.history import MeshRecord, StageTimer, Stop
from pvdf_fem.solver.nonlinear.budget import Budget, estimate_iteration_seconds
from pvdf_fem.solver.nonlinear.newton import FailedAttempt
from pvdf_fem.solver.nonlinear.status import Status

logger = logging.getLogger(__name__)


class Level(Protocol):
    """A solve on one mesh, as the adaptive loop uses it."""

    @property
    def status(self) -> Status:
        """How the solve ended."""

    @property
    def worst(self) -> float:
        """Largest relative error; 0 without a result."""

    @property
    def bound(self) -> float:
        """Largest likely error, which is compared with the tolerance."""

    @property
    def unknowns(self) -> int:
        """Number of equations."""

    @property
    def iterations(self) -> int:
        """Newton iterations that led to the result."""

    @property
    def failed_attempts(self) -> tuple[FailedAttempt, ...]:
        """Solvers that failed before."""


T = TypeVar("T", bound=Level)


class TooManyUnknownsError(RuntimeError):
    """A mesh would have more unknowns than allowed; the text names the key to raise."""

    def __init__(self, unknowns: float, allowed: str, stop: Stop) -> None:
        super().__init__(
            f"a mesh needs about {unknowns:.0f} unknowns, but {allowed}; raise it, or raise"
            " numerics.tolerance"
        )
        self.stop = stop


@dataclass(frozen=True)
class AdaptiveRules:
    """How meshes follow each other."""

    #: Sizes aim at this part of the tolerance. Each mesh that was slow lowers the aim by this
    #: factor once more: at singular corners the error falls slower than sizes are chosen for.
    safety: float = 0.5
    #: A mesh that leaves more than this part of the error is slow.
    slow: float = 0.7
    #: A mesh has at most this factor more unknowns than the mesh before, since a coarse mesh shows
    #: singular corners and kinks larger than they are and in the wrong places.
    growth: float = 2.5
    #: A mesh with at most this part of the last mesh's unknowns would not be better.
    least: float = 0.7
    most_meshes: int = 10
    #: Affordable unknowns grow with this power of the work on a mesh.
    work_exponent: float = 0.8
    #: Newton iterations that a solve on a mesh, with the estimate of its error, takes at least.
    least_iterations: int = 3
    #: The estimated number of elements is at most this factor too large.
    overestimate: float = 2.5


@dataclass
class AdaptiveLoop(Generic[T]):
    """Solves of a problem on a sequence of meshes."""

    problem: Problem
    #: Element sizes of the first mesh.
    first_sizes: Callable[[], GradedSizes | SizeField]
    #: Solves on a mesh, from the solution on the coarser one if there is.
    solve_on: Callable[[MeshTri2, T | None], T]
    #: Element sizes for a level, the error aimed at, and the largest number of unknowns.
    next_sizes: Callable[[T, float, float], GradedSizes | SizeField]
    budget: Budget
    timer: StageTimer
    unknowns_per_element: float
    #: The sector of the film that is meshed.
    sector: SymmetrySector = WHOLE_FILM
    #: Outlines of contacts with tips by patch name, after the level before or None.
    find_contacts: Callable[[T | None], Mapping[str, Outline]] = lambda level: {}
    rules: AdaptiveRules = field(default_factory=AdaptiveRules)
    history: list[MeshRecord] = field(default_factory=list)

    def run(self) -> tuple[T, Stop]:
        """Solve on ever better meshes until the error bound is within the tolerance.

        Returns
        -------
        level : Level
            The best of the solves, or the first one without a result.
        stop : Stop
            Why no further mesh was made.

        Raises
        ------
        MeshError
            When gmsh cannot make the first mesh.
        TooManyUnknownsError
            When the first mesh needs more unknowns or work than allowed.
        """
        rules = self.rules
        tolerance = self.problem.scene.numerics.tolerance
        aim = rules.safety * tolerance
        spent = self.budget.spent_seconds
        level = best = self.solve_level(self.first_sizes(), None)
        while level.bound > tolerance:
            if len(self.history) == rules.most_meshes:
                return best, Stop.MESHES
            most, limit = self._find_affordable_unknowns(level, self.budget.spent_seconds - spent)
            if most < rules.least * level.unknowns:
                return best, limit
            spent = self.budget.spent_seconds
            with self.timer("refine"):
                sizes = self.next_sizes(level, aim, most)
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
            was_large = level.unknowns > rules.least * self.budget.max_unknowns
            level = finer
            if finer.status is Status.CONVERGED and finer.worst < best.worst:
                best = finer
            if is_slow and was_large and level.bound > tolerance:
                return best, Stop.UNKNOWNS
        has_converged = level.status is Status.CONVERGED
        return level, Stop.ACCURATE if has_converged else Stop.NO_EQUILIBRIUM

    def _find_affordable_unknowns(self, level: T, seconds: float) -> tuple[float, Stop]:
        """Find how many unknowns the next mesh may have.

        Parameters
        ----------
        level : Level
            The last solve.
        seconds : float
            Work that it took, in s.

        Returns
        -------
        most : float
            Largest number of unknowns.
        limit : Stop
            The limit that is reached with it.
        """
        work = self.budget.remaining_seconds / seconds
        by_work = work**self.rules.work_exponent * level.unknowns
        by_growth = self.rules.growth * level.unknowns
        most = min(by_growth, self.budget.max_unknowns, by_work)
        return most, Stop.SECONDS if most == by_work else Stop.UNKNOWNS

    def solve_level(self, sizes: GradedSizes | SizeField, coarser: T | None) -> T:
        """Make a mesh and solve on it.

        Parameters
        ----------
        sizes : GradedSizes or SizeField
            Element sizes of the mesh.
        coarser : Level or None
            The solve on the mesh before.
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
                    self._require_affordable, overestimate=self.rules.overestimate
                ),
            )
        if coarser is None:
            self._require_affordable(mesh.nelements)
        return self.solve_on_given_mesh(mesh, coarser=coarser, start=start)

    def _require_affordable(self, elements: float, overestimate: float = 1.0) -> None:
        """Refuse a mesh whose number of elements is at most `overestimate` times too large."""
        budget = self.budget
        unknowns = elements * self.unknowns_per_element
        least = unknowns / overestimate
        if budget.bounds_first_mesh and least > budget.max_unknowns:
            allowed = f"numerics.max_unknowns allows {budget.max_unknowns}"
            raise TooManyUnknownsError(unknowns, allowed, Stop.UNKNOWNS)
        iteration = estimate_iteration_seconds(least, self.problem.film)
        if self.rules.least_iterations * iteration > budget.max_seconds:
            allowed = f"numerics.max_seconds allows {budget.max_seconds:g} s of work"
            raise TooManyUnknownsError(unknowns, allowed, Stop.SECONDS)

    def solve_on_given_mesh(self, mesh: MeshTri2, *, coarser: T | None, start: float) -> T:
        """Solve on a mesh and add a row to the history.

        Parameters
        ----------
        mesh : MeshTri2
            The mesh.
        coarser : Level or None
            The solve on the mesh before.
        start : float
            When the work on this level began, by `time.perf_counter`.
        """
        level = self.solve_on(mesh, coarser)
        failed = [(a.solver, str(a.status), a.iterations) for a in level.failed_attempts]
        record = MeshRecord(
            elements=mesh.nelements,
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
