"""The eigenvalue problem on one mesh: frequencies, modes and errors, in vacuum and in air."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigs, eigsh

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.air import AirLoad
from pvdf_fem.film.low_rank import LowRankUpdate
from pvdf_fem.film.unknowns import make_prolongation
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.factors import factorise
from pvdf_fem.solver.nonlinear.status import Status

VACUUM, AIR = "in vacuum", "in air"


class Pencil(NamedTuple):
    """Matrices of a generalised eigenvalue problem K x = omega^2 M x."""

    stiffness: sp.csc_matrix  #: Tangent stiffness K in N/m.
    #: Mass M in kg: a sparse matrix, or a `LowRankUpdate` if the mass of air is included.
    mass: Any


class EigenPairs(NamedTuple):
    """Lowest modes of a pencil."""

    frequencies: Array  #: Frequencies in Hz in ascending order, shape (n,).
    vectors: Array  #: Eigenvectors, shape (unknowns, n).


class EquilibriumState(NamedTuple):
    """Equations of a film with their solution, about which it vibrates."""

    equilibrium: Equilibrium
    q: Array  #: Unknowns at equilibrium.


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Lowest modes about an equilibrium, with the errors of their frequencies."""

    equilibrium: Equilibrium
    q: Array  #: Unknowns at equilibrium.
    frequencies: Array  #: Frequencies in Hz in ascending order, shape (n,).
    errors: Array  #: Estimated discretisation errors of the frequencies in Hz, shape (n,).
    vectors: Array  #: Eigenvectors, shape (unknowns, n).

    @property
    def shapes(self) -> Array:
        """Displacements u, v, w of the modes, see `Modes.shapes` for their scale.

        Returns
        -------
        ndarray, shape (n, dofs, 3)
        """
        shapes = np.array([self.equilibrium.unknowns.expand(vector) for vector in self.vectors.T])
        peaks = np.abs(shapes).argmax(axis=1)[:, None]
        normalised = shapes / np.take_along_axis(shapes, peaks, axis=1)
        return normalised.reshape(len(shapes), -1, 3)


def compute_spectra(
    coarse: EquilibriumState,
    rich: EquilibriumState,
    count: int,
    on_solve: Callable[[], None] = lambda: None,
) -> dict[str, Spectrum] | Status:
    """Compute the lowest modes in vacuum and, with ``[air]``, in air, with their errors.

    Parameters
    ----------
    coarse : EquilibriumState
        Equilibrium of the film whose modes are computed.
    rich : EquilibriumState
        Equilibrium of this film in elements of the next order on the same mesh, for the errors.
    count : int
        Number of modes.
    on_solve : callable, optional
        Function that is called at each linear solve.

    Returns
    -------
    dict of str to Spectrum, or Status
        Modes by `VACUUM` and `AIR`, or the reason why there are none.
    """
    pencil = assemble_pencil(*coarse)
    rich_pencil = assemble_pencil(*rich)
    vacuum = _compute_spectrum(coarse, rich, pencil, rich_pencil, count, on_solve=on_solve)
    if isinstance(vacuum, Status):
        return vacuum
    if coarse.equilibrium.scene.air is None:
        return {VACUUM: vacuum}
    pencil = _add_air_mass(coarse.equilibrium, pencil)
    rich_pencil = _add_air_mass(rich.equilibrium, rich_pencil)
    air = _compute_spectrum(coarse, rich, pencil, rich_pencil, count, on_solve=on_solve)
    assert isinstance(air, Spectrum)  # The stiffness is the same as in vacuum, and had modes there.
    return {VACUUM: vacuum, AIR: air}


def _add_air_mass(equilibrium: Equilibrium, pencil: Pencil) -> Pencil:
    """Return a copy of a pencil that includes the added mass of the scene's air."""
    air = AirLoad.from_equilibrium(equilibrium)
    return Pencil(pencil.stiffness, LowRankUpdate(pencil.mass, air.root))


def _compute_spectrum(
    coarse: EquilibriumState,
    rich: EquilibriumState,
    pencil: Pencil,
    rich_pencil: Pencil,
    count: int,
    on_solve: Callable[[], None],
    min_fraction: float = 0.25,
) -> Spectrum | Status:
    """Compute the modes of a pencil, and their errors from the pencil of the next order.

    Parameters
    ----------
    coarse : EquilibriumState
        Equilibrium of the film whose modes are computed.
    rich : EquilibriumState
        Equilibrium of this film in elements of the next order.
    pencil : Pencil
        Stiffness and mass of the coarse state.
    rich_pencil : Pencil
        Stiffness and mass of the rich state.
    count : int
        Number of modes.
    on_solve : callable
        Function that is called at each linear solve.
    min_fraction : float, optional
        Lower bound of an error, as a fraction of the sum of the magnitudes of its contributions.

    Returns
    -------
    Spectrum or Status
        Modes, or the reason why there are none.

    Notes
    -----
    The next order changes a frequency in two ways: the stress of the film changes, which the
    Rayleigh quotient of the coarse shape in the rich pencil shows, and the shape of the mode
    changes. The error is the magnitude of the sum of both changes, but at least a fraction of the
    sum of their magnitudes, since they may cancel by chance.
    """
    is_symmetric = coarse.equilibrium.conservative or not coarse.q.any()
    modes = _solve_eigenproblem(pencil, is_symmetric, count, on_solve)
    if isinstance(modes, Status):
        return modes
    rich_modes = _solve_eigenproblem(rich_pencil, is_symmetric, count, on_solve)
    if isinstance(rich_modes, Status):
        return rich_modes
    # Frequencies from the Rayleigh quotients of the coarse shapes in the rich pencil.
    shapes = make_prolongation(coarse.equilibrium, rich.equilibrium) @ modes.vectors
    energies = (shapes * (rich_pencil.stiffness @ shapes)).sum(axis=0)
    inertias = (shapes * (rich_pencil.mass @ shapes)).sum(axis=0)
    rayleigh_frequencies = np.sqrt(energies / inertias) / (2.0 * np.pi)
    due_to_stress = modes.frequencies - rayleigh_frequencies
    due_to_shape = rayleigh_frequencies - rich_modes.frequencies
    min_errors = min_fraction * (np.abs(due_to_stress) + np.abs(due_to_shape))
    errors = np.maximum(np.abs(due_to_stress + due_to_shape), min_errors)
    return Spectrum(
        coarse.equilibrium,
        coarse.q,
        frequencies=modes.frequencies,
        errors=errors,
        vectors=modes.vectors,
    )


def assemble_pencil(equilibrium: Equilibrium, q: Array) -> Pencil:
    """Assemble the tangent stiffness and the mass of a film with its layers, without air.

    Parameters
    ----------
    equilibrium : Equilibrium
        Equations of the film.
    q : ndarray, shape (unknowns,)
        Unknowns at equilibrium.
    """
    film = equilibrium.film
    space = equilibrium.space
    unit_mass = space.mass_matrices()
    element_masses = film.density * film.thickness * unit_mass
    for name, layer in film.layers.items():
        covered = space.mesh.subdomains[name]
        element_masses[covered] += layer.density * layer.patch.thickness * unit_mass[covered]
    stiffness = equilibrium.tangent(equilibrium.state(q))
    return Pencil(stiffness, equilibrium.assembly.matrix(element_masses))


def _solve_eigenproblem(
    pencil: Pencil,
    is_symmetric: bool,
    count: int,
    on_solve: Callable[[], None],
    max_imaginary: float = 1e-6,
) -> EigenPairs | Status:
    """Solve for the lowest modes of a pencil by shift-and-invert iterations.

    Parameters
    ----------
    pencil : Pencil
        Stiffness and mass.
    is_symmetric : bool
        Whether the stiffness is symmetric, so that Lanczos's method is used instead of Arnoldi's.
    count : int
        Number of modes.
    on_solve : callable
        Function that is called at each linear solve.
    max_imaginary : float, optional
        Relative imaginary part above which an eigenvalue of an unsymmetric stiffness counts as
        complex. Round-off splits a double eigenvalue by about the square root of the machine
        precision.

    Returns
    -------
    EigenPairs or Status
        `Status.SINGULAR` if the stiffness is singular, `Status.UNSTABLE` if an eigenvalue is not
        real and positive.
    """
    try:
        factors = factorise(pencil.stiffness)
    except RuntimeError:  # SuperLU raises it for an exactly singular matrix.
        return Status.SINGULAR

    def solve(right: Array) -> Array:
        """Count a linear solve with the stiffness, and return its solution."""
        on_solve()
        return np.asarray(factors.solve(right))

    inverse = LinearOperator(pencil.stiffness.shape, matvec=solve, dtype=float)
    # A random start vector is not orthogonal to any mode; a fixed seed makes results repeatable.
    start = np.random.default_rng(0).standard_normal(pencil.stiffness.shape[0])
    solver: Any = eigsh if is_symmetric else eigs
    values, vectors = solver(
        pencil.stiffness, count, M=pencil.mass, sigma=0.0, OPinv=inverse, v0=start
    )
    is_complex = np.abs(values.imag) > max_imaginary * np.abs(values)
    if np.any(is_complex) or np.any(values.real <= 0.0):
        return Status.UNSTABLE
    order = np.argsort(values.real)
    return EigenPairs(np.sqrt(values.real[order]) / (2.0 * np.pi), vectors.real[:, order])
