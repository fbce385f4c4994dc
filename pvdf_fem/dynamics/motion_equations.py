"""Small oscillations about a loaded film, and their reduction to a few Ritz vectors.

Let K be the tangent stiffness at the equilibrium, M the mass of film and air, F exp(i omega t) a
force with the load vector f per unit, and g the derivatives of the electrodes' charges. The
amplitudes q of the unknowns and Q of the charges satisfy

    (K + i tan(delta) K_e - omega^2 M + i omega^3 r v v^T) q = f F,   Q = (1 + i tan(delta)) g . q.

The loss tangent tan(delta) is that of the elastic moduli: K_e is K without the geometric stiffness
due to tension, which has no losses, and the charges have the phase of the stress. The term with
r v v^T is the sound that a film in a baffle radiates.

The equations are projected onto load-dependent Ritz vectors (Wilson, Yuan and Dickens, Earthquake
Engineering and Structural Dynamics 10 (1982) 813-821). The first is the static displacement K^-1 f,
so that static charges are exact; each further one is K^-1 M times the previous vector. All are
orthonormal with respect to M, and K includes its losses. If the film radiates sound, a second
sequence begins with K^-1 v.
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
from pvdf_fem.film.term import LoadTerm, State, Support
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.progress import Progress, ignore_progress
from pvdf_fem.solver.estimate.next_order import factorise_tangent, solve_next_order
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.solution import Solution

TINY = np.finfo(float).tiny
#: Number of Ritz vectors at which the convergence of the charges is tested first.
FIRST_COMPARISON = 16
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class MotionEquations:
    """Linear equations of motion, see the head of this module for the symbols.

    The unknowns are those of the film, with sparse matrices, or the amplitudes of vectors, with
    dense matrices.
    """

    stiffness: Any  #: Tangent stiffness K in N/m.
    elastic: Any  #: Elastic stiffness K_e in N/m.
    mass: Any  #: Mass M in kg, including the added mass of air.
    force: Array  #: Load vector f per newton, shape (unknowns,).
    rates: Array  #: Derivatives g of the charges in C/m, shape (unknowns, electrodes).
    volume: Array  #: Displaced volume v per unknown in m^2, shape (unknowns,).
    radiation: float  #: Coefficient r in kg s/m^4.
    loss_tangent: float  #: tan(delta).

    @classmethod
    def linearise(cls, equilibrium: Equilibrium, q: Array) -> MotionEquations:
        """Linearise the motion about an equilibrium; the force acts on the first probe along z.

        Parameters
        ----------
        equilibrium : Equilibrium
            Equations of the loaded film.
        q : ndarray, shape (unknowns,)
            Unknowns at equilibrium.
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
        """Project the equations onto vectors (Galerkin); the result is dense.

        Parameters
        ----------
        vectors : ndarray, shape (unknowns, n)
            Basis, which may be complex. It is transposed without conjugation.
        """
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
        """Return a copy of the equations without losses of the film and without sound."""
        return replace(self, radiation=0.0, loss_tangent=0.0)

    def compute_charges(self, frequencies_Hz: Array, at_once: int = 256) -> ComplexArray:
        """Compute the charges due to a force with the amplitude 1 N; for dense equations only.

        Parameters
        ----------
        frequencies_Hz : ndarray, shape (n,)
            Frequencies of the force.
        at_once : int, optional
            Maximum number of frequencies to solve together, which limits the memory.

        Returns
        -------
        ndarray, shape (n, electrodes)
            Complex amplitudes in C/N.
        """
        if len(frequencies_Hz) > at_once:
            chunks = np.array_split(frequencies_Hz, len(frequencies_Hz) // at_once + 1)
            return np.concatenate([self.compute_charges(chunk, at_once) for chunk in chunks])
        omega = 2.0 * np.pi * frequencies_Hz[:, None, None]
        sound = self.radiation * np.outer(self.volume, self.volume)
        stiffness = self.stiffness + 1j * self.loss_tangent * self.elastic
        dynamic_stiffness = stiffness - omega**2 * self.mass + 1j * omega**3 * sound
        q = np.linalg.solve(dynamic_stiffness, self.force)
        return np.asarray((1.0 + 1j * self.loss_tangent) * (q @ self.rates))

    def find_resonances_Hz(self, highest_Hz: float) -> Array:
        """Compute the undamped resonances of dense equations up to a highest frequency.

        Eigenvalues that are not positive have no resonance and are left out.

        Returns
        -------
        ndarray, shape (n,)
            Resonances in Hz in ascending order.
        """
        squares = scipy.linalg.eigvals(self.stiffness, self.mass).real
        frequencies_Hz = np.sqrt(np.sort(squares[squares > 0.0])) / (2.0 * np.pi)
        return np.asarray(frequencies_Hz[frequencies_Hz <= highest_Hz])

    def reduce(
        self,
        frequencies_Hz: Array,
        progress: Progress = ignore_progress,
        tolerance: float = 1e-7,
        max_vectors: int = 426,
        test_count: int = 24,
    ) -> MotionEquations:
        """Project the equations onto Ritz vectors, and add vectors until the charges converge.

        Parameters
        ----------
        frequencies_Hz : ndarray, shape (n,)
            Frequencies of interest.
        progress : callable, optional
            Function that is called with the number of vectors and their maximum number.
        tolerance : float, optional
            Maximum change of a charge due to the last fifth of the vectors, relative to the sum of
            the magnitudes of this charge and of the largest static charge.
        max_vectors : int, optional
            Maximum number of vectors. The charges are tested only with 16 vectors and then each
            time their number has grown by a quarter: with 20, 25, 31, ..., 340, 425 vectors. The
            default stops after the test with 425, since the next would need 531 vectors.
        test_count : int, optional
            Number of the frequencies at which the charges are tested for convergence.

        Returns
        -------
        MotionEquations
            Dense equations for the amplitudes of the vectors.

        Raises
        ------
        NotConvergedError
            If the charges have not converged in the last test with at most `max_vectors` vectors.
        """
        indices = np.linspace(0, len(frequencies_Hz) - 1, test_count).round().astype(int)
        tested_Hz = np.sort(frequencies_Hz)[indices]
        # The first test compares with zero charges, so that at least two tests are needed.
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
        """Yield the first 1, 2, 3, ... Ritz vectors, orthonormal with respect to the mass.

        Parameters
        ----------
        max_vectors : int
            Number of Ritz vectors after which the iteration ends.

        Yields
        ------
        ndarray, shape (unknowns, n)
            View of an array to which the next vectors are added; complex if the film has losses.
        """
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
        """Orthogonalise a vector to a basis and normalise it, both with respect to the mass."""
        for _ in range(2):  # A second pass removes the round-off of the first (Gram-Schmidt).
            vector = vector - basis @ (basis.T.conj() @ (self.mass @ vector))
        return vector / np.sqrt(np.vdot(vector, self.mass @ vector).real)


class LinearisedMotion(NamedTuple):
    """Equations of motion about a solution, and more accurate ones for error estimates."""

    equations: MotionEquations
    #: Equations in elements of the next order on the same mesh.
    next_order: MotionEquations


def linearise_about(solution: Solution) -> LinearisedMotion:
    """Linearise the motion about a solution, and about its correction in the next element order.

    Raises
    ------
    NotConvergedError
        If the solve in elements of the next order does not converge.
    """
    factorised = factorise_tangent(solution.discrete)
    correction = solve_next_order(factorised)
    return LinearisedMotion(
        MotionEquations.linearise(factorised.equilibrium, factorised.q),
        MotionEquations.linearise(correction.rich, correction.q),
    )


def _assemble_elastic_stiffness(equilibrium: Equilibrium, state: State) -> Any:
    """Assemble the tangent stiffness of the film in N/m, without its geometric stiffness.

    Terms of loads and supports are left out, too.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the loaded film.
    state : State
        State at equilibrium, with the stress.
    """
    space = equilibrium.space
    membrane = equilibrium.membrane
    outside = (LoadTerm, Support)
    film_terms = [term for term in equilibrium.terms if not isinstance(term, outside)]
    film = equilibrium.with_terms(film_terms)
    # Membrane tension times quadrature weights. Its components 11, 22, 12 become a matrix of the
    # shape (elements, points, 2, 2).
    weighted_stress = state.stress * membrane.volumes[..., None]
    tension = weighted_stress[..., [[0, 2], [2, 1]]]
    gradients = space.gradients
    products = np.matmul(np.matmul(gradients, tension), gradients.swapaxes(2, 3))
    geometric = equilibrium.assembly.matrix(space.expand_to_components(products.sum(axis=1)))
    return film.tangent(state) - geometric
