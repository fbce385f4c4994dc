"""The mesh loop: solve on ever better meshes until the errors are small enough."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Generic, Protocol, TypeVar

from skfem import MeshTri2

from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.mesh.gmsh_mesh import MeshError, mesh_scene
from pvdf_fem.mesh.size_field import GradedSizes, SizeField
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.history import MeshRecord, StageTimer, Stop
from pvdf_fem.solver.nonlinear.budget import Budget, estimate_iteration_seconds
from pvdf_fem.solver.nonlinear.newton import FailedAttempt
from pvdf_fem.solver.nonlinear.status import Status


class Attempted(Protocol):
    """Data of a solve on a mesh for the loop."""

    @property
    def status(self) -> Status: ...
    @property
    def worst(self) -> float:
        """Largest relative error; 0 without a result."""

    @property
    def bound(self) -> float:
        """Largest likely error, to compare with the tolerance."""

    @property
    def unknowns(self) -> int: ...
    @property
    def iterations(self) -> int: ...
    @property
    def failed_attempts(self) -> tuple[FailedAttempt, ...]: ...


T = TypeVar("T", bound=Attempted)


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
    """Solves on a sequence of meshes."""

    scene: Scene
    #: Element sizes of the first mesh.
    first_sizes: Callable[[], GradedSizes | SizeField]
    #: Solves on a mesh, from the solution on the coarser one if there is.
    solve_on: Callable[[MeshTri2, T | None], T]
    #: Element sizes for an attempt, the error aimed at, and the largest number of unknowns.
    next_sizes: Callable[[T, float, float], GradedSizes | SizeField]
    budget: Budget
    clock: StageTimer
    unknowns_per_element: float
    #: The part of the film that is meshed.
    part: SymmetrySector = WHOLE_FILM
    #: Outlines of contacts with tips by patch name, after the attempt before or None.
    contacts_of: Callable[[T | None], Mapping[str, Outline]] = lambda attempt: {}
    rules: AdaptiveRules = field(default_factory=AdaptiveRules)
    history: list[MeshRecord] = field(default_factory=list)

    def run(self) -> tuple[T, Stop]:
        """The best of the solves on ever better meshes, or the first that has no result.

        Raises
        ------
        MeshError
            When gmsh cannot make the first mesh.
        TooManyUnknownsError
        """
        rules, tolerance = self.rules, self.scene.numerics.tolerance
        aim, spent = rules.safety * tolerance, self.budget.spent_seconds
        attempt = best = self.attempt(self.first_sizes(), None)
        while attempt.bound > tolerance:
            if len(self.history) == rules.most_meshes:
                return best, Stop.MESHES
            most, limit = self._affordable(attempt, self.budget.spent_seconds - spent)
            if most < rules.least * attempt.unknowns:
                return best, limit
            spent = self.budget.spent_seconds
            with self.clock("refine"):
                sizes = self.next_sizes(attempt, aim, most)
            try:
                finer = self.attempt(sizes, attempt)
            except MeshError:
                return best, Stop.MESH_FAILED
            except TooManyUnknownsError as error:
                return best, error.stop
            if finer.status is Status.MAX_ITERATIONS:
                return best, Stop.FINER_FAILED
            slow = finer.worst > rules.slow * attempt.worst
            aim *= rules.safety if slow else 1.0
            large = attempt.unknowns > rules.least * self.budget.max_unknowns
            attempt = finer
            if finer.status is Status.CONVERGED and finer.worst < best.worst:
                best = finer
            if slow and large and attempt.bound > tolerance:
                return best, Stop.UNKNOWNS
        converged = attempt.status is Status.CONVERGED
        return attempt, Stop.ACCURATE if converged else Stop.NO_EQUILIBRIUM

    def _affordable(self, attempt: T, seconds: float) -> tuple[float, Stop]:
        """Most unknowns of the next mesh after `attempt` took `seconds` of work, and the limit."""
        work = self.budget.left_seconds / seconds
        by_work = work**self.rules.work_exponent * attempt.unknowns
        most = min(self.rules.growth * attempt.unknowns, self.budget.max_unknowns, by_work)
        return most, Stop.SECONDS if most == by_work else Stop.UNKNOWNS

    def attempt(self, sizes: GradedSizes | SizeField, coarser: T | None) -> T:
        """Mesh and solve."""
        start = time.perf_counter()
        require = partial(self._require_affordable, overestimate=self.rules.overestimate)
        with self.clock("mesh"):
            jacobian, contacts = (
                resolve_film_model(self.scene).least_jacobian,
                self.contacts_of(coarser),
            )
            mesh = mesh_scene(
                self.scene, sizes, self.part, jacobian, contacts=contacts, require=require
            )
        if coarser is None:
            self._require_affordable(mesh.nelements)
        return self.attempt_on(mesh, coarser, start)

    def _require_affordable(self, elements: float, overestimate: float = 1.0) -> None:
        """Refuse a mesh whose number of elements is at most `overestimate` times too large."""
        budget, unknowns = self.budget, elements * self.unknowns_per_element
        least = unknowns / overestimate
        if budget.bounds_first_mesh and least > budget.max_unknowns:
            allowed = f"numerics.max_unknowns allows {budget.max_unknowns}"
            raise TooManyUnknownsError(unknowns, allowed, Stop.UNKNOWNS)
        work = self.rules.least_iterations * estimate_iteration_seconds(
            least, resolve_film_model(self.scene)
        )
        if work > budget.max_seconds:
            allowed = f"numerics.max_seconds allows {budget.max_seconds:g} s of work"
            raise TooManyUnknownsError(unknowns, allowed, Stop.SECONDS)

    def attempt_on(self, mesh: MeshTri2, coarser: T | None, start: float) -> T:
        """Solve on a mesh and note it in the history, with the seconds since `start`."""
        attempt = self.solve_on(mesh, coarser)
        self.history.append(
            MeshRecord(
                mesh.nelements,
                attempt.unknowns,
                attempt.iterations,
                attempt.worst if attempt.status is Status.CONVERGED else None,
                time.perf_counter() - start,
                str(attempt.status),
                tuple((t.solver, str(t.status), t.iterations) for t in attempt.failed_attempts),
            )
        )
        return attempt
