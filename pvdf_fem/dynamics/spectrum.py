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
    """The matrices of an eigenvalue problem."""

    stiffness: sp.csc_matrix  #: K in N/m.
    mass: Any  #: M in kg, sparse; a `LowRankUpdate` with the mass of air.


class EigenPairs(NamedTuple):
    """The lowest modes of a pencil."""

    frequencies: Array  #: In Hz, ascending, (n,).
    vectors: Array  #: Eigenvectors, (unknowns, n).


class EquilibriumState(NamedTuple):
    """Equations of a film with their solution, about which it vibrates."""

    equilibrium: Equilibrium
    q: Array  #: Unknowns.


@dataclass(frozen=True, eq=False)
class Spectrum:
    """The lowest modes about an equilibrium."""

    equilibrium: Equilibrium
    q: Array  #: Unknowns of the equilibrium.
    frequencies: Array  #: In Hz, ascending, (n,).
    errors: Array  #: Estimated discretisation errors in Hz, (n,).
    vectors: Array  #: Eigenvectors, (unknowns, n).

    @property
    def shapes(self) -> Array:
        """u, v, w by mode, (n, scalar dofs, 3), scaled as those of `Modes`."""
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
    """Compute the lowest modes with their errors.

    Parameters
    ----------
    coarse : EquilibriumState
        The film whose modes are computed.
    rich : EquilibriumState
        The film in elements of the next order on the same mesh, for the errors.
    count : int
        Number of modes.
    on_solve : callable, optional
        Called at each linear solve.

    Returns
    -------
    dict of Spectrum, or Status
        The modes in `VACUUM` and, with ``[air]``, in `AIR`; or the reason for which there are none.
    """
    pencil = assemble_pencil(*coarse)
    rich_pencil = assemble_pencil(*rich)
    vacuum = _compute_spectrum(coarse, rich, pencil, rich_pencil, count, on_solve=on_solve)
    if isinstance(vacuum, Status):
        return vacuum
    if coarse.equilibrium.scene.air is None:
        return {VACUUM: vacuum}
    pencil = _add_air(coarse.equilibrium, pencil)
    rich_pencil = _add_air(rich.equilibrium, rich_pencil)
    air = _compute_spectrum(coarse, rich, pencil, rich_pencil, count, on_solve=on_solve)
    assert isinstance(air, Spectrum)  # the same stiffness has modes in vacuum
    return {VACUUM: vacuum, AIR: air}


def _add_air(equilibrium: Equilibrium, pencil: Pencil) -> Pencil:
    """Return a pencil with the mass of the scene's air added."""
    air = AirLoad.from_equilibrium(equilibrium)
    return Pencil(pencil.stiffness, LowRankUpdate(pencil.mass, air.root))


def _compute_spectrum(
    coarse: EquilibriumState,
    rich: EquilibriumState,
    pencil: Pencil,
    rich_pencil: Pencil,
    count: int,
    on_solve: Callable[[], None],
    least_share: float = 0.25,
) -> Spectrum | Status:
    """Compute the modes of a pencil, and their errors by the pencil of the next order.

    Parameters
    ----------
    coarse : EquilibriumState
        The film whose modes are computed.
    rich : EquilibriumState
        The film in elements of the next order.
    pencil : Pencil
        Stiffness and mass of the coarse state.
    rich_pencil : Pencil
        Stiffness and mass of the rich state.
    count : int
        Number of modes.
    on_solve : callable
        Called at each linear solve.
    least_share : float, optional
        Least error over the sum of the magnitudes of its two contributions.

    Notes
    -----
    The next order changes a frequency through the film's stress and through the mode's shape. The
    error is the sum of both changes, and at least a share of the sum of their magnitudes: the
    first change can have either sign, and they may cancel by chance.
    """
    is_symmetric = coarse.equilibrium.conservative or not coarse.q.any()
    modes = _solve_eigenproblem(pencil, is_symmetric, count, on_solve)
    if isinstance(modes, Status):
        return modes
    rich_modes = _solve_eigenproblem(rich_pencil, is_symmetric, count, on_solve)
    if isinstance(rich_modes, Status):
        return rich_modes
    # Rayleigh quotients of the coarse shapes in the rich pencil
    shapes = make_prolongation(coarse.equilibrium, rich.equilibrium) @ modes.vectors
    energies = (shapes * (rich_pencil.stiffness @ shapes)).sum(axis=0)
    inertias = (shapes * (rich_pencil.mass @ shapes)).sum(axis=0)
    same_shape = np.sqrt(energies / inertias) / (2.0 * np.pi)
    by_stress = modes.frequencies - same_shape
    by_shape = same_shape - rich_modes.frequencies
    least = least_share * (np.abs(by_stress) + np.abs(by_shape))
    errors = np.maximum(np.abs(by_stress + by_shape), least)
    return Spectrum(
        coarse.equilibrium,
        coarse.q,
        frequencies=modes.frequencies,
        errors=errors,
        vectors=modes.vectors,
    )


def assemble_pencil(equilibrium: Equilibrium, q: Array) -> Pencil:
    """Assemble the tangent stiffness in N/m at the unknowns `q`, and the mass of the film in kg."""
    film, space = equilibrium.film, equilibrium.space
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
    largest_imaginary: float = 1e-6,
) -> EigenPairs | Status:
    """Solve for the lowest modes of a pencil.

    Parameters
    ----------
    pencil : Pencil
        Stiffness and mass.
    is_symmetric : bool
        Whether the stiffness is symmetric: Lanczos's method is then used instead of Arnoldi's,
        both by shift and invert.
    count : int
        Number of modes.
    on_solve : callable
        Called at each linear solve.
    largest_imaginary : float, optional
        Relative imaginary part above which an eigenvalue of an unsymmetric stiffness counts as
        complex. Rounding splits a pair of modes by the root of the machine's precision.

    Returns
    -------
    EigenPairs or Status
        `Status.SINGULAR` or `Status.UNSTABLE` if the film has no such modes.
    """
    try:
        factors = factorise(pencil.stiffness)
    except RuntimeError:  # SuperLU: exactly singular
        return Status.SINGULAR

    def solve(right: Array) -> Array:
        on_solve()
        return np.asarray(factors.solve(right))

    inverse = LinearOperator(pencil.stiffness.shape, matvec=solve, dtype=float)
    # a random start is orthogonal to no mode; a fixed seed makes results repeatable
    start = np.random.default_rng(0).standard_normal(pencil.stiffness.shape[0])
    solver: Any = eigsh if is_symmetric else eigs
    values, vectors = solver(
        pencil.stiffness, count, M=pencil.mass, sigma=0.0, OPinv=inverse, v0=start
    )
    is_complex = np.abs(values.imag) > largest_imaginary * np.abs(values)
    if np.any(is_complex) or np.any(values.real <= 0.0):
        return Status.UNSTABLE
    order = np.argsort(values.real)
    return EigenPairs(np.sqrt(values.real[order]) / (2.0 * np.pi), vectors.real[:, order])
