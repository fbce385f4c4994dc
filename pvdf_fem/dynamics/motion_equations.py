"""Small oscillations about a loaded film, and the few vectors that describe them in a band.

With the tangent K at the equilibrium, the mass M of film and air, a force F exp(i omega t) along f
and the derivatives g of the electrodes' charges,

    (K + i tan(delta) K_e - omega^2 M + i omega^3 r v v^T) q = f F,   Q = (1 + i tan(delta)) g . q.

The loss tangent is that of the moduli: K_e is K without the stiffness by tension, which has no
losses, and the charge has the phase of the stress. r v v^T is the sound of a film in a baffle.

The equations are projected on load-dependent Ritz vectors (Wilson, Yuan and Dickens, Earthquake
Engineering and Structural Dynamics 10 (1982) 813-821): first the static displacement K^-1 f, so
that static charges are exact, then K^-1 M of the vector before, all orthonormal by M. K has its
losses there. Where the film radiates sound, vectors from K^-1 v are added.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.air import AirLoad
from pvdf_fem.dynamics.spectrum import assemble_pencil
from pvdf_fem.electrodes.stress_integrals import differentiate_charges
from pvdf_fem.film.loads.probe_load import UP
from pvdf_fem.film.low_rank import LowRankUpdate
from pvdf_fem.film.term import LoadTerm, State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.progress import Progress, ignore_progress
from pvdf_fem.solver.estimate.next_order import factorise_tangent, solve_next_order
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.solution import Solution

TINY = np.finfo(float).tiny
#: Number of Ritz vectors at which the charges are first compared.
FIRST_COMPARISON = 16
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class MotionEquations:
    """Linear equations of motion, for unknowns of the film or for amplitudes of vectors."""

    stiffness: Any  #: K in N/m.
    elastic: Any  #: K_e in N/m.
    mass: Any  #: M in kg, with that of the air.
    force: Array  #: f, (unknowns,).
    rates: Array  #: g in C/m, (unknowns, electrodes).
    volume: Array  #: v in m^2, (unknowns,).
    radiation: float  #: r in kg s/m^4.
    loss_tangent: float

    @classmethod
    def linearise(cls, equilibrium: Equilibrium, q: Array) -> MotionEquations:
        """Linearise the motion about an equilibrium, with a force of the first probe along z.

        Parameters
        ----------
        equilibrium : Equilibrium
            Equations of the loaded film.
        q : ndarray, shape (unknowns,)
            Their solution.
        """
        state = equilibrium.state(q)
        air = AirLoad.from_equilibrium(equilibrium)
        pencil = assemble_pencil(equilibrium, q)
        force = equilibrium.loads[0].with_components(UP).forces(state)
        outputs = equilibrium.problem.outputs
        rates = differentiate_charges(outputs, equilibrium.membrane, state.dofs)
        loss_tangent = equilibrium.film.loss_tangent or 0.0
        if loss_tangent:
            elastic = _assemble_elastic_stiffness(equilibrium, state)
        else:
            elastic = 0.0 * pencil.stiffness
        return cls(
            stiffness=pencil.stiffness,
            elastic=elastic,
            mass=LowRankUpdate(pencil.mass, air.root),
            force=equilibrium.unknowns.fold(force),
            rates=equilibrium.unknowns.fold(rates),
            volume=air.volume,
            radiation=air.radiation,
            loss_tangent=loss_tangent,
        )

    def project(self, vectors: Any) -> MotionEquations:
        """Return the dense equations for amplitudes of vectors (unknowns, n)."""
        return MotionEquations(
            stiffness=vectors.T @ (self.stiffness @ vectors),
            elastic=vectors.T @ (self.elastic @ vectors),
            mass=vectors.T @ (self.mass @ vectors),
            force=vectors.T @ self.force,
            rates=vectors.T @ self.rates,
            volume=vectors.T @ self.volume,
            radiation=self.radiation,
            loss_tangent=self.loss_tangent,
        )

    def without_losses(self) -> MotionEquations:
        """Return the equations without losses of the film and without sound."""
        return replace(self, radiation=0.0, loss_tangent=0.0)

    def compute_charges(self, frequencies_Hz: Array, at_once: int = 256) -> ComplexArray:
        """Compute the charges of dense equations under a force of amplitude 1 N.

        Parameters
        ----------
        frequencies_Hz : ndarray, shape (n,)
            Frequencies of the force.
        at_once : int, optional
            Number of frequencies solved together, small to save memory.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Complex amplitudes in C/N.
        """
        if len(frequencies_Hz) > at_once:
            chunks = np.array_split(frequencies_Hz, len(frequencies_Hz) // at_once + 1)
            return np.concatenate([self.compute_charges(chunk) for chunk in chunks])
        omega = 2.0 * np.pi * frequencies_Hz[:, None, None]
        sound = self.radiation * np.outer(self.volume, self.volume)
        stiffness = self.stiffness + 1j * self.loss_tangent * self.elastic
        dynamic_stiffness = stiffness - omega**2 * self.mass + 1j * omega**3 * sound
        q = np.linalg.solve(dynamic_stiffness, self.force)
        return np.asarray((1.0 + 1j * self.loss_tangent) * (q @ self.rates))

    def find_resonances_Hz(self, highest_Hz: float) -> Array:
        """Return the resonances (n,) of dense equations without losses, up to a highest one."""
        squares = scipy.linalg.eigvals(self.stiffness, self.mass).real
        frequencies_Hz = np.sqrt(np.sort(squares[squares > 0.0])) / (2.0 * np.pi)
        return np.asarray(frequencies_Hz[frequencies_Hz <= highest_Hz])

    def reduce(
        self,
        frequencies_Hz: Array,
        progress: Progress = ignore_progress,
        tolerance: float = 1e-7,
        max_vectors: int = 426,
        tests: int = 24,
    ) -> MotionEquations:
        """Reduce the equations to as many Ritz vectors as their charges need.

        Parameters
        ----------
        frequencies_Hz : ndarray, shape (n,)
            Frequencies of interest.
        progress : callable, optional
            Called with the number of vectors and the largest number.
        tolerance : float, optional
            Largest change of a charge by the last fifth of the vectors, relative to the charge plus
            the largest static charge.
        max_vectors : int, optional
            Largest number of vectors.
        tests : int, optional
            Number of the frequencies at which charges are compared.

        Returns
        -------
        MotionEquations
            Dense equations for amplitudes of the vectors.

        Raises
        ------
        NotConvergedError
            When the largest number of vectors does not suffice.
        """
        picked = np.linspace(0, len(frequencies_Hz) - 1, tests).round().astype(int)
        tested_Hz = np.sort(frequencies_Hz)[picked]
        charges: Any = np.zeros((1, 1), dtype=complex)
        vectors: Any = np.empty((len(self.force), 0))
        next_comparison = FIRST_COMPARISON
        for count, vectors in enumerate(self._iterate_ritz_vectors(max_vectors), 1):
            progress(count - 1, max_vectors)
            if count < next_comparison:
                continue
            next_comparison += next_comparison // 4
            reduced = self.project(vectors)
            charges_before = charges
            charges = reduced.compute_charges(tested_Hz)
            static_charges = reduced.compute_charges(np.zeros(1))
            scale = np.abs(charges) + np.abs(static_charges).max() + TINY
            if np.all(np.abs(charges - charges_before) <= tolerance * scale):
                return reduced
        raise NotConvergedError(
            f"{Status.TOLERANCE}: {max_vectors} vectors do not describe the film up to"
            f" {tested_Hz.max():g} Hz; give lower frequencies"
        )

    def _iterate_ritz_vectors(self, max_vectors: int) -> Iterator[Any]:
        """Yield the first 1, 2, 3 ... Ritz vectors, (unknowns, n), orthonormal by the mass."""
        stiffness = self.stiffness
        if self.loss_tangent:
            stiffness = stiffness + 1j * self.loss_tangent * self.elastic
        factors = factorise(stiffness)
        queue = [factors.solve(self.force.astype(stiffness.dtype))]
        if self.radiation > 0.0:
            queue.append(factors.solve(self.volume.astype(stiffness.dtype)))
        vectors = np.empty((len(self.force), max_vectors), stiffness.dtype)
        for i in range(max_vectors):
            vectors[:, i] = self._orthonormalise(queue.pop(0), vectors[:, :i])
            queue.append(factors.solve(self.mass @ vectors[:, i]))
            yield vectors[:, : i + 1]

    def _orthonormalise(self, vector: Any, basis: Any) -> Any:
        """Return the part of a vector orthogonal to a basis, normalised, both by the mass."""
        for _ in range(2):  # twice is enough to remove the effect of rounding
            vector = vector - basis @ (basis.T.conj() @ (self.mass @ vector))
        return vector / np.sqrt(np.vdot(vector, self.mass @ vector).real)


class LinearisedMotion(NamedTuple):
    """Equations of motion about a solution."""

    equations: MotionEquations
    #: Those in elements of the next order on the same mesh, for errors.
    next_order: MotionEquations


def linearise_about(solution: Solution) -> LinearisedMotion:
    """Linearise the motion about a solution, and about its refinement by the next order.

    Raises
    ------
    NotConvergedError
        When there is no solution of the next order.
    """
    factorised = factorise_tangent(solution.discrete)
    correction = solve_next_order(factorised)
    return LinearisedMotion(
        MotionEquations.linearise(factorised.equilibrium, factorised.q),
        MotionEquations.linearise(correction.rich, correction.q),
    )


def _assemble_elastic_stiffness(equilibrium: Equilibrium, state: State) -> Any:
    """Assemble the film's stiffness in N/m without the geometric stiffness by its tension."""
    space, membrane = equilibrium.space, equilibrium.membrane
    film_terms = [term for term in equilibrium.terms if not isinstance(term, LoadTerm)]
    film = equilibrium.with_terms(film_terms)
    # (elements, points, 2, 2)
    tension = (state.stress * membrane.volumes[..., None])[..., [[0, 2], [2, 1]]]
    gradients = space.gradients
    products = np.matmul(np.matmul(gradients, tension), gradients.swapaxes(2, 3))
    geometric = equilibrium.assembly.matrix(space.expand_to_components(products.sum(axis=1)))
    return film.tangent(state) - geometric
