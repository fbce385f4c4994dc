"""Newton's method: one loop, and the variants that differ in tangents, step lengths and ends.

The energy along a Newton direction of a film that does not wrinkle is an exact quartic, and its
least value costs a few sums. A seed's compressive stresses, which the solution does not have, would
make the tangent indefinite; so far from the solution the geometric stiffness takes the tensile part
of the stress only.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import polynomial
from scipy.sparse.linalg import SuperLU, splu

from pvdf_fem.arrays import Array
from pvdf_fem.film.low_rank import LowRankFactors, LowRankUpdate
from pvdf_fem.film.membrane import compute_tensile_part
from pvdf_fem.film.term import State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.status import Status

#: Relative size, in the energy norm, of the last Newton step that is made with a fresh tangent. The
#: next one, by the quadratic convergence, would be about 1e-12.
STEP_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Iteration:
    """One row of the iteration table."""

    step: float  #: Size of the Newton step in the energy norm over that of the solution.
    length: float  #: Length that the line search chose.
    convex: bool  #: Whether compressive stress was left out of the tangent.
    fresh: bool  #: Whether the tangent is that of this state, not of an earlier one.


@dataclass(frozen=True)
class FailedAttempt:
    """A solver that was tried."""

    solver: str
    status: Status
    iterations: int
    tangents: int  #: Number of its iterations with a new tangent.


@dataclass(frozen=True)
class NewtonResult:
    """How Newton's method ended."""

    q: Array  #: (unknowns,)
    status: Status
    iterations: tuple[Iteration, ...]  #: The table of the solve that led to `q`.
    factors: SuperLU | None  #: The last tangent; None for the flat film and without a result.
    failed_attempts: tuple[FailedAttempt, ...] = ()  #: What was tried before.

    @property
    def converged(self) -> bool:
        """Whether `q` is an equilibrium."""
        return self.status is Status.CONVERGED

    @property
    def fresh_count(self) -> int:
        """Number of factorised tangents, earlier tries included."""
        return sum(earlier.tangents for earlier in self.failed_attempts) + self._tangents

    @property
    def _tangents(self) -> int:
        return sum(row.fresh for row in self.iterations)

    def as_failed_attempts(self, solver: str) -> tuple[FailedAttempt, ...]:
        """Records of earlier tries and this result, for `failed_attempts` in a later result."""
        return (
            *self.failed_attempts,
            FailedAttempt(solver, self.status, len(self.iterations), self._tangents),
        )


def factorise(matrix: sp.csc_matrix | LowRankUpdate) -> SuperLU:
    """LU of a matrix with symmetric pattern, without pivoting: the signs in U give the inertia."""
    if isinstance(matrix, LowRankUpdate):
        return LowRankFactors(matrix, factorise(matrix.sparse))
    return splu(
        matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


def count_negative_pivots(factors: SuperLU) -> int:
    """Number of negative eigenvalues in a symmetric matrix, by Sylvester's law of inertia."""
    if isinstance(factors, LowRankFactors):
        raised = int((np.linalg.eigvalsh(factors.small) < 0.0).sum())
        return count_negative_pivots(factors.factors) - raised
    return int((factors.U.diagonal() < 0).sum())


def has_negative_determinant(factors: SuperLU | None) -> bool:
    """Whether a tangent's determinant is negative."""
    return factors is not None and count_negative_pivots(factors) % 2 == 1


def is_compressed(state: State) -> bool:
    """Whether a principal stress is compressive anywhere."""
    s11, s22, s12 = np.moveaxis(state.stress, -1, 0)
    return bool(np.any((s11 + s22 < 0.0) | (s11 * s22 < s12**2)))


def is_stable(equilibrium: Equilibrium, factors: SuperLU) -> bool:
    """Whether a tangent in compression belongs to a minimum, where the tangent can tell. The
    tangent cannot tell without an energy, nor for a membrane: a compressed membrane is unstable on
    fine meshes."""
    tells = equilibrium.conservative and equilibrium.model.bends
    return not tells or count_negative_pivots(factors) == 0


def is_balanced(equilibrium: Equilibrium, state: State, factors: SuperLU, allowed: float) -> bool:
    """Whether a state's imbalance is at most `allowed`. By the residual the displacement is
    that far from the solution, in the energy norm; the rim's reaction shows load that is not
    borne."""
    residual = equilibrium.residual(state)
    lacking = abs(float(residual @ factors.solve(residual)))
    work = equilibrium.work(state, equilibrium.restrict(state.dofs))
    enough = equilibrium.imbalance(state) <= allowed * equilibrium.force
    return lacking <= allowed**2 * work and enough


@dataclass(frozen=True)
class Tangent:
    """A factorised tangent and the steps made with it. While the tangent serves on, its inverse
    follows the residuals met (L-BFGS: Nocedal, Math. Comp. 35, 1980, 773-782), for the few modes
    that change most, by the tension."""

    factors: SuperLU
    convex: bool = False
    residuals: list[Array] = field(default_factory=list)
    steps: list[Array] = field(default_factory=list)

    def step(self, residual: Array) -> Array:
        """The quasi-Newton step."""
        changes = [b - a for a, b in pairwise([*self.residuals, residual])]
        right, shares = residual, []
        for s, y in reversed(list(zip(self.steps, changes, strict=True))):
            shares.append((s @ right) / (s @ y))
            right = right - shares[-1] * y
        step = self.factors.solve(right)
        for s, y, share in zip(self.steps, changes, reversed(shares), strict=True):
            step = step + (share - (y @ step) / (s @ y)) * s
        return -step

    def remember(self, residual: Array, step: Array) -> None:
        """Keep the residual at which `step` was made."""
        self.residuals.append(residual)
        self.steps.append(step)


@dataclass(frozen=True)
class Step:
    """A Newton step about to be made."""

    q: Array  #: Where it starts, (unknowns,).
    state: State  #: The fields there.
    change: Array  #: The full step, (unknowns,).
    slope: float  #: Derivative of the energy along it, J.
    size: float  #: Relative size in the energy norm.


class NewtonVariant(ABC):
    """Tangent, step length and end for a variant of Newton's method."""

    max_iterations = 60
    factors: SuperLU | None = None  #: Factorised tangent of the solution, once it is found.

    def __init__(self, equilibrium: Equilibrium) -> None:
        self.equilibrium = equilibrium

    @abstractmethod
    def tangent(self, state: State, table: Sequence[Iteration]) -> tuple[Tangent, bool]:
        """The tangent for the step, and whether it belongs to this state."""

    def size(self, q: Array, state: State, slope: float) -> float:
        """Energy norm of a full step over the energy norm of the displacement."""
        return float(np.sqrt(abs(slope / self.equilibrium.work(state, q))))

    def length(self, step: Step) -> float:
        """How much of a step is made; 0 of a hopeless one."""
        return 1.0

    @abstractmethod
    def ended(self, step: Step, state: State, table: Sequence[Iteration]) -> Status | None:
        """Status after a step that led to `state`; None to go on."""


@np.errstate(over="raise", invalid="raise")
def run_newton(variant: NewtonVariant, q: Array) -> NewtonResult:
    """Iterate from the unknowns `q` until the variant ends."""
    table: list[Iteration] = []
    equilibrium = variant.equilibrium
    state = equilibrium.state(q)
    try:
        while len(table) < variant.max_iterations:
            tangent, fresh = variant.tangent(state, table)
            residual = equilibrium.residual(state)
            change = tangent.step(residual)
            slope = float(residual @ change)
            step = Step(q, state, change, slope, variant.size(q, state, slope))
            length = variant.length(step)
            table.append(Iteration(step.size, length, tangent.convex, fresh))
            tangent.remember(residual, length * change)
            q = q + length * change
            state = equilibrium.state(q)
            if status := variant.ended(replace(step, change=length * change), state, table):
                factors = variant.factors if status is Status.CONVERGED else None
                return NewtonResult(q, status, tuple(table), factors)
    except (FloatingPointError, ZeroDivisionError):  # the steps lead to infinity, or off all tips
        return NewtonResult(q, Status.MAX_ITERATIONS, tuple(table), None)
    except RuntimeError:  # SuperLU: exactly singular
        return NewtonResult(q, Status.SINGULAR, tuple(table), None)
    return NewtonResult(q, Status.MAX_ITERATIONS, tuple(table), None)


@dataclass(frozen=True)
class NewtonOptions:
    """Choice of tangents in Newton's method, and when to give up. Sizes of steps are relative,
    in the energy norm."""

    tolerance: float = STEP_TOLERANCE  #: Of a last step with a fresh tangent.
    #: After a larger step compressive stress adds no stiffness: every step lowers the energy.
    near_size: float = 0.1
    #: Below this size full steps keep the quadratic convergence, and no line search is made.
    local_size: float = 1e-2
    defer_size: float = 0.3  #: A tangent serves on after a smaller step ...
    contraction: float = 0.5  #: ... as long as each step is at most this part of the one before.
    max_iterations: int = 60
    #: The same under a load that follows the film, whose energy along a step is not known.
    max_following: int = 30
    #: A film still in compression after this number of iterations that moves or has an
    #: indefinite tangent, has no equilibrium that is a minimum.
    patience: int = 30


class DeferredNewton(NewtonVariant):
    """Newton's method with an exact line search, whose tangents serve on near the solution. `near`
    says that the start is a solution of less resolution, not a mere seed."""

    def __init__(self, equilibrium: Equilibrium, options: NewtonOptions, *, near: bool) -> None:
        super().__init__(equilibrium)
        self.options, self._tangent = options, None
        self._start_size = options.near_size if near else np.inf
        conservative = equilibrium.conservative
        self.max_iterations = options.max_iterations if conservative else options.max_following

    _tangent: Tangent | None

    def tangent(self, state: State, table: Sequence[Iteration]) -> tuple[Tangent, bool]:
        if self._tangent is not None and not self._outdated(self._tangent, table):
            return self._tangent, False
        self._tangent = self._fresh_tangent(state, table[-1].step if table else self._start_size)
        return self._tangent, True

    def _outdated(self, tangent: Tangent, table: Sequence[Iteration]) -> bool:
        """Whether steps with the tangent are large, or shrink slowly."""
        if tangent.convex or table[-1].step > self.options.defer_size:
            return True
        return not table[-1].fresh and self.options.contraction * table[-2].step < table[-1].step

    def _fresh_tangent(self, state: State, size: float) -> Tangent:
        """The full tangent near the solution, otherwise the convex one. Where no stress is
        compressive they are the same, and positive definite."""
        under_compression = is_compressed(state)
        if size <= self.options.near_size or not under_compression:
            factors = factorise(self.equilibrium.tangent(state))
            if not under_compression or count_negative_pivots(factors) == 0:
                return Tangent(factors)
        return Tangent(factorise(make_convex_tangent(self.equilibrium, state)), convex=True)

    def length(self, step: Step) -> float:
        """Where the energy along the step is least, unless it is small."""
        if step.size <= self.options.local_size:
            return 1.0
        return find_least_energy(self.equilibrium.energy_along(step.state, step.change, step.slope))

    def ended(self, step: Step, state: State, table: Sequence[Iteration]) -> Status | None:
        assert self._tangent is not None
        moves = step.size > self.options.local_size**2 or self._tangent.convex
        if moves and len(table) >= self.options.patience and is_compressed(state):
            return Status.UNSTABLE
        if not self._small(table):
            return None
        self.factors, under_compression = self._tangent.factors, is_compressed(state)
        if self._tangent.convex or under_compression:
            self.factors = factorise(self.equilibrium.tangent(state))
        stable = not under_compression or is_stable(self.equilibrium, self.factors)
        return Status.CONVERGED if stable else Status.UNSTABLE

    def _small(self, table: Sequence[Iteration]) -> bool:
        """Whether the last step leaves less than the squared tolerance. The steps shrink
        quadratically with fresh tangents, and else at the rate of the last two."""
        step, fresh = table[-1].step, table[-1].fresh
        return step * (step if fresh else step / table[-2].step) < self.options.tolerance**2


class UndampedNewton(NewtonVariant):
    """Undamped Newton from a near start."""

    max_iterations = 20

    def __init__(self, equilibrium: Equilibrium, tolerance: float) -> None:
        super().__init__(equilibrium)
        self.tolerance = tolerance

    def tangent(self, state: State, table: Sequence[Iteration]) -> tuple[Tangent, bool]:
        self.factors = factorise(self.equilibrium.tangent(state))
        return Tangent(self.factors), True

    def ended(self, step: Step, state: State, table: Sequence[Iteration]) -> Status | None:
        return Status.CONVERGED if step.size < self.tolerance else None


def make_convex_tangent(
    equilibrium: Equilibrium, state: State, least_tension: float = 1e-6
) -> sp.csc_matrix:
    """The tangent without the geometric stiffness of compressive stress: never indefinite.
    `least_tension`, over the largest stress, keeps it regular where the film is slack."""
    floor = least_tension * np.abs(state.stress).max() * np.array([1.0, 1.0, 0.0])
    return equilibrium.tangent(replace(state, stress=compute_tensile_part(state.stress) + floor))


def find_least_energy(energy: Array) -> float:
    """The s > 0 with least energy among a quartic's stationary points; 1 without stationary
    points."""
    roots = np.roots(polynomial.polyder(energy)[::-1])
    lengths = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    if not len(lengths):
        return 1.0
    return float(lengths[np.argmin(polynomial.polyval(lengths, energy))])
