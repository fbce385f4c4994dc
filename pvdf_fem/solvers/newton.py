"""Newton's method: a seed near the solution, an exact line search, a named end.

A flat film without pretension has a singular tangent, so the first iterate is not the flat film.
`seed` solves the linear membrane under an estimate of the tension that the load itself makes, then
the in-plane equations at that deflection, and scales the result to the least energy. From there
the energy along a Newton direction is an exact quartic, and its least value costs a few sums.
Far from the solution the seed's compressive stresses, which vanish with it, would make the
tangent indefinite; there the geometric stiffness takes the tensile part of the stress only.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from enum import StrEnum
from itertools import pairwise

import numpy as np
import scipy.sparse as sp
from numpy.polynomial import polynomial
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import (
    IDENTITY,
    Array,
    MembraneState,
    strain_of,
    strain_rate,
    tensile_part,
)

# Relative size, in the energy norm, of the last Newton step that is made with a fresh tangent. The
# next one, by the quadratic convergence, would be some 1e-12.
STEP_TOLERANCE = 1e-6
# Above this size compressive stress adds no stiffness, so that every step lowers the energy.
NEAR = 0.1
# Below this size full steps keep the quadratic convergence.
LOCAL = 1e-2
# Tension, as a part of the largest stress, that keeps a slack film's convex tangent regular.
CONVEX_FLOOR = 1e-6
# A tangent serves on after a step below the first size, as long as steps shrink by the second.
DEFER = 0.3
CONTRACTION = 0.5
MAX_ITERATIONS = 60
# Under a load that follows the film, whose energy along a step is not known, and for which there is
# another way (`continuation`).
MAX_FOLLOWING = 25
# A film that is still in compression after so many, and moves or has an indefinite tangent, finds
# no equilibrium that is a minimum; after so many with fresh tangents if these took so much work,
# some 15 s of one core where it bends.
PATIENCE, LEAST_PATIENCE, PATIENT_WORK = 20, 9, 1.2e6
# Full steps from near by: so many, and none larger, nor a third or later one that grows.
MOST_FULL, LARGEST_FULL = 8, 3.0


class Status(StrEnum):
    """How a solve ended."""

    CONVERGED = "converged"
    MAX_ITERATIONS = "max_iterations"
    SINGULAR = "singular_tangent"
    UNSTABLE = "unstable"
    LIMIT = "limit_point"
    UNBALANCED = "unbalanced"
    TOLERANCE = "tolerance_not_reached"
    SLACK = "slack"
    MESH_FAILED = "mesh_failed"

    @property
    def advice(self) -> str:
        """What the status means and what to change."""
        return ADVICE[self]


ADVICE = {
    Status.CONVERGED: "the Newton iteration converged",
    Status.MAX_ITERATIONS: f"no convergence in {MAX_ITERATIONS} Newton iterations; lower"
    " load.force_N, or give the film more tension (film.temperature_change_K below zero)",
    Status.LIMIT: "the pressure, which follows the film, blows its patch up or turns it over until"
    " no equilibrium is found any more; lower load.force_N, make the probe larger, or let it press"
    ' along z (load.kind = "dead")',
    Status.SINGULAR: "the tangent is singular: the film has no tension; cool it"
    " (film.temperature_change_K below zero)",
    Status.UNBALANCED: "the forces on the film found do not balance to 1e-6 of the load, which"
    " rounding does to a film of extreme proportions; make the probe larger",
    Status.TOLERANCE: "the finest mesh allowed misses the tolerance; raise numerics.tolerance",
    Status.SLACK: "the load is too small to pull taut what heating has made too large, and the"
    " tension runs in folds finer than any mesh allowed; raise load.force_N or lower"
    " film.temperature_change_K",
    Status.MESH_FAILED: "gmsh could not mesh the scene; move or resize the probe slightly",
    Status.UNSTABLE: "no equilibrium found is a minimum of the energy: the film is in compression,"
    ' which it cannot carry; let it wrinkle (film.compression = "tension-field") or cool it'
    " (film.temperature_change_K below zero)",
}


@dataclass(frozen=True)
class Iteration:
    """One row of the iteration table.

    Attributes
    ----------
    step : float
        Size of the Newton step in the energy norm over that of the solution.
    length : float
        Length that the line search chose.
    convex : bool
        Whether compressive stress was left out of the tangent.
    fresh : bool
        Whether the tangent is that of this state, not of an earlier one.
    """

    step: float
    length: float
    convex: bool
    fresh: bool


@dataclass(frozen=True)
class NewtonResult:
    """Unknowns, how the iteration ended, its table and the last factorised tangent.

    `earlier` counts the iterations of other solves that it took to get to the table's first.
    """

    q: Array
    status: Status
    iterations: tuple[Iteration, ...]
    factors: SuperLU | None
    earlier: int = 0

    @property
    def iteration_count(self) -> int:
        """All iterations that the result took."""
        return self.earlier + len(self.iterations)


def factorise(matrix: sp.csc_matrix) -> SuperLU:
    """LU of a matrix of symmetric pattern without pivoting: the signs of U are the inertia."""
    return splu(
        matrix,
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )


def newton(
    equilibrium: Equilibrium, q: Array, tolerance: float = STEP_TOLERANCE, *, near: bool = False
) -> NewtonResult:
    """Solve ``equilibrium`` from the unknowns `q`.

    Parameters
    ----------
    equilibrium : Equilibrium
    q : (unknowns,)
    tolerance : float
        Relative size, in the energy norm, of a last step with a fresh tangent.
    near : bool
        Whether `q` is a solution of less resolution, not a mere seed.
    """
    if equilibrium.load.force == 0.0:
        return _unloaded(equilibrium, q)
    table: list[Iteration] = []
    size, state = NEAR if near else np.inf, equilibrium.state(q)
    tangent: _Tangent | None = None
    most = MAX_ITERATIONS if equilibrium.load.conservative else MAX_FOLLOWING
    try:
        while len(table) < most and not _ended(table, tolerance):
            fresh = tangent is None or _outdated(tangent, table)
            if tangent is None or fresh:
                tangent = _tangent(equilibrium, state, size)
            residual = equilibrium.residual(state)
            step = tangent.step(residual)
            slope = float(residual @ step)
            size = float(np.sqrt(abs(slope / equilibrium.work(state, q))))
            length = 1.0
            if size > LOCAL:
                length = _least(equilibrium.energy_along(state, step, slope))
            table.append(Iteration(size, length, tangent.convex, fresh))
            tangent.remember(residual, length * step)
            q = q + length * step
            state = equilibrium.state(q)
            unsettled = size > LOCAL**2 or tangent.convex
            if unsettled and _lasts(equilibrium, table) and compressed(state):
                return NewtonResult(q, Status.UNSTABLE, tuple(table), None)
        if tangent is None or not _ended(table, tolerance):
            stuck = tangent is not None and tangent.convex and compressed(state)
            status = Status.UNSTABLE if stuck else Status.MAX_ITERATIONS
            return NewtonResult(q, status, tuple(table), None)
        if tangent.convex or compressed(state):
            tangent = _Tangent(factorise(equilibrium.tangent(state)), False)
    except RuntimeError:  # SuperLU: exactly singular
        return NewtonResult(q, Status.SINGULAR, tuple(table), None)
    stable = not compressed(state) or _stable(equilibrium, tangent.factors)
    status = Status.CONVERGED if stable else Status.UNSTABLE
    return NewtonResult(q, status, tuple(table), tangent.factors)


@dataclass(frozen=True)
class _Tangent:
    """A factorised tangent, whether compressive stress was left out of it, and the steps made.

    While the tangent serves on, its inverse follows the residuals met (L-BFGS: Nocedal, Math.
    Comp. 35, 1980, 773-782), which takes the few modes that change most, those of the tension.
    """

    factors: SuperLU
    convex: bool
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


def _ended(table: list[Iteration], tolerance: float) -> bool:
    """Whether what the last step leaves is smaller than the square of the tolerance.

    The steps shrink quadratically with fresh tangents, and else at the rate of the last two.
    """
    if not table:
        return False
    step, fresh = table[-1].step, table[-1].fresh
    return step * (step if fresh else step / table[-2].step) < tolerance**2


def _lasts(equilibrium: Equilibrium, table: list[Iteration]) -> bool:
    """Whether the iteration has lasted too long for a film in compression."""
    fresh = sum(row.fresh for row in table)
    laborious = fresh >= LEAST_PATIENCE and fresh * equilibrium.iteration_work >= PATIENT_WORK
    return laborious or len(table) >= PATIENCE


def _outdated(tangent: _Tangent, table: list[Iteration]) -> bool:
    """Whether a new tangent would save more steps than it costs."""
    if tangent.convex or table[-1].step > DEFER:
        return True
    return not table[-1].fresh and table[-1].step > CONTRACTION * table[-2].step


def _tangent(equilibrium: Equilibrium, state: MembraneState, size: float) -> _Tangent:
    """The full tangent near the solution, otherwise the convex one.

    Where no stress is compressive they are the same, and positive definite.
    """
    under_compression = compressed(state)
    if size <= NEAR or not under_compression:
        factors = factorise(equilibrium.tangent(state))
        if not under_compression or _stable(equilibrium, factors):
            return _Tangent(factors, False)
    return _Tangent(factorise(_convex_tangent(equilibrium, state)), True)


def compressed(state: MembraneState) -> bool:
    """Whether a principal stress is compressive anywhere."""
    s11, s22, s12 = np.moveaxis(state.stress, -1, 0)
    return bool(np.any((s11 + s22 < 0.0) | (s11 * s22 < s12**2)))


def full_steps(equilibrium: Equilibrium, q: Array, tolerance: float) -> NewtonResult:
    """A few steps of Newton's method from a near `q`, as long as they do not grow."""
    table: list[Iteration] = []
    while len(table) < MOST_FULL:
        state = equilibrium.state(q)
        residual = equilibrium.residual(state)
        try:
            factors = factorise(equilibrium.tangent(state))
        except RuntimeError:  # SuperLU: exactly singular
            return NewtonResult(q, Status.SINGULAR, tuple(table), None)
        step = -factors.solve(residual)
        size = float(np.sqrt(abs(residual @ step / equilibrium.work(state, q))))
        table.append(Iteration(size, 1.0, False, True))
        if not size < LARGEST_FULL or (len(table) > 2 and size > table[-2].step):
            break
        q = q + step
        if size < tolerance:
            return NewtonResult(q, Status.CONVERGED, tuple(table), factors)
    return NewtonResult(q, Status.MAX_ITERATIONS, tuple(table), None)


def _stable(equilibrium: Equilibrium, factors: SuperLU) -> bool:
    return not equilibrium.load.conservative or negative_pivots(factors) == 0


def balanced(
    equilibrium: Equilibrium, state: MembraneState, factors: SuperLU, allowed: float
) -> bool:
    """Whether a state lacks no more than `allowed` of balance.

    Of the displacement, in the energy norm, by the residual; of the load by the rim's reaction.
    """
    residual = equilibrium.residual(state)
    lacking = abs(float(residual @ factors.solve(residual)))
    forces = equilibrium.load.forces(state.deformation_gradient)
    work = float((forces * state.dofs[equilibrium.membrane.element_dofs]).sum())
    balance = abs(equilibrium.rim_reaction(state) + equilibrium.applied_force(state))
    return lacking <= allowed**2 * work and balance <= allowed * equilibrium.load.force


def negative_pivots(factors: SuperLU) -> int:
    """Number of negative eigenvalues of a symmetric matrix, by Sylvester's law of inertia."""
    return int((factors.U.diagonal() < 0).sum())


def _convex_tangent(equilibrium: Equilibrium, state: MembraneState) -> sp.csc_matrix:
    """The tangent without the geometric stiffness of compressive stress: never indefinite."""
    stress = tensile_part(state.stress)
    floor = CONVEX_FLOOR * np.abs(state.stress).max() * np.array([1.0, 1.0, 0.0])
    return equilibrium.tangent(replace(state, stress=stress + floor))


def _unloaded(equilibrium: Equilibrium, q: Array) -> NewtonResult:
    """The flat film: an equilibrium for any tension, a stable one unless it is compressed.

    A film that bends bears the compression below that at which it buckles.
    """
    unstable = equilibrium.film.thermal_strain > 0.0
    if unstable and equilibrium.bending is not None:
        factors = factorise(equilibrium.tangent(equilibrium.state(q)))
        unstable = negative_pivots(factors) > 0
    return NewtonResult(q, Status.UNSTABLE if unstable else Status.CONVERGED, (), None)


def _least(energy: Array) -> float:
    """The s > 0 of least energy among the stationary points of the quartic, 1 without any."""
    roots = np.roots(polynomial.polyder(energy)[::-1])
    lengths = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    if not len(lengths):
        return 1.0
    return float(lengths[np.argmin(polynomial.polyval(lengths, energy))])


def seed(equilibrium: Equilibrium) -> Array:
    """Unknowns near the solution: linear deflection, in-plane response, least energy."""
    film, membrane = equilibrium.film, equilibrium.membrane
    q = np.zeros(equilibrium.unknowns.count)
    if equilibrium.load.force == 0.0:
        return q
    deflections = np.flatnonzero(equilibrium.unknowns.deflections())
    in_plane = np.flatnonzero(~equilibrium.unknowns.deflections())
    flat = membrane.state(np.zeros(membrane.dof_count))
    forces = equilibrium.assembly.vector(equilibrium.load.forces(flat.deformation_gradient))

    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    induced = 0.3 * np.cbrt(stiffness * (equilibrium.load.force / film.radius) ** 2)
    tension = induced + max(-2.0 * stiffness * film.thermal_strain, 0.0)
    laplace = equilibrium.assembly.matrix(membrane.laplace() * tension)
    if equilibrium.bending is not None:
        laplace = laplace + equilibrium.bending.matrix
    tangent = equilibrium.tangent(flat)
    q[deflections] = _solve_block(laplace, forces, deflections)
    residual = equilibrium.residual(equilibrium.state(q))
    q[in_plane] = -_solve_block(tangent, residual, in_plane)

    length = _least(_energy_of_scaled(equilibrium, q, deflections, forces))
    q[deflections] *= length
    q[in_plane] *= length**2
    return q


def _solve_block(matrix: sp.csc_matrix, right: Array, block: NDArray[np.intp]) -> Array:
    return factorise(matrix[block][:, block].tocsc()).solve(right[block])


def _energy_of_scaled(
    equilibrium: Equilibrium, q: Array, deflections: NDArray[np.intp], forces: Array
) -> Array:
    """Föppl-von Kármán energy of (s^2 u, s^2 v, s w), coefficients (5,) of 1, s, ... s^4."""
    membrane, film = equilibrium.membrane, equilibrium.film
    w = np.zeros_like(q)
    w[deflections] = q[deflections]
    deflection = membrane.gradient(equilibrium.unknowns.expand(w))
    plane = membrane.gradient(equilibrium.unknowns.expand(q - w))
    strain = strain_rate(IDENTITY, plane) + strain_of(deflection)
    weighted = strain * (film.thickness * membrane.weights)[..., None]
    stress = strain @ film.stiffness
    thermal = film.thermal_strain * film.stiffness[:, :2].sum(axis=1)
    work, released = float(forces @ w), float((weighted @ thermal).sum())
    quadratic = -released
    if equilibrium.bending is not None:
        quadratic += equilibrium.bending.energy(w)
    return np.array([0.0, -work, quadratic, 0.0, 0.5 * float((stress * weighted).sum())])
