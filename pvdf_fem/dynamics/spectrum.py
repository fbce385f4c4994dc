"""The eigenvalue problem on one mesh: frequencies, modes and errors, in vacuum and in air."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigs, eigsh

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.air import AirLoad
from pvdf_fem.film.low_rank import LowRankUpdate
from pvdf_fem.film.unknowns import make_prolongation
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.solver.nonlinear.newton import factorise
from pvdf_fem.solver.nonlinear.status import Status

VACUUM, AIR = "in vacuum", "in air"
Pencil = tuple[sp.csc_matrix, Any]  #: Stiffness and mass; that of air is a `LowRankUpdate`.


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Frequencies, errors and eigenvectors, with the equilibrium and its unknowns `q`."""

    equilibrium: Equilibrium
    q: Array
    frequencies: Array
    errors: Array
    vectors: Array

    @property
    def shapes(self) -> Array:
        """Those of `Modes`."""
        expand = self.equilibrium.unknowns.expand
        shapes = np.array([expand(vector) for vector in self.vectors.T])
        peaks = np.abs(shapes).argmax(axis=1)[:, None]
        return (shapes / np.take_along_axis(shapes, peaks, axis=1)).reshape(len(shapes), -1, 3)


def compute_spectra(
    coarse: Equilibrium,
    rich: Equilibrium,
    at: tuple[Array, Array],
    count: int,
    step: Callable[[], None] = lambda: None,
) -> dict[str, Spectrum] | Status:
    """The lowest modes in `VACUUM` and, with ``[air]``, in `AIR`, or why there are none. Their
    errors are told by the equations of the next order, `rich`; `at` has the unknowns of both.
    `step` is called at each linear solve."""
    pencils = [assemble_pencil(*pair) for pair in zip((coarse, rich), at, strict=True)]
    vacuum = _spectrum(coarse, rich, at[0], pencils, count, step)
    if isinstance(vacuum, Status):
        return vacuum
    if coarse.scene.air is None:
        return {VACUUM: vacuum}
    airs = [AirLoad.of(equilibrium) for equilibrium in (coarse, rich)]
    loaded = [(K, LowRankUpdate(M, air.root)) for air, (K, M) in zip(airs, pencils, strict=True)]
    found = _spectrum(coarse, rich, at[0], loaded, count, step)
    assert isinstance(found, Spectrum)  # the stiffness has modes in vacuum
    return {VACUUM: vacuum, AIR: found}


def _spectrum(
    coarse: Equilibrium,
    rich: Equilibrium,
    q: Array,
    pencils: Sequence[Pencil],
    count: int,
    step: Callable[[], None],
    uncancelled: float = 0.25,
) -> Spectrum | Status:
    """The modes of the first pencil. The second pencil, of elements of the next order, changes a
    frequency through the film's stress and through the mode's shape. The error is the sum of both
    changes, and at least the part `uncancelled` of the sum of their magnitudes: the first change
    can have either sign, and they may cancel by chance."""
    symmetric = coarse.conservative or not q.any()
    modes, reference = (_eigen(*pencil, symmetric, count, step) for pencil in pencils)
    if isinstance(modes, Status):
        return modes
    if isinstance(reference, Status):
        return reference
    shapes = make_prolongation(coarse, rich) @ modes[1]
    energy, inertia = ((shapes * (matrix @ shapes)).sum(axis=0) for matrix in pencils[1])
    same_shape = np.sqrt(energy / inertia) / (2.0 * np.pi)
    by_stress, by_shape = modes[0] - same_shape, same_shape - reference[0]
    least = uncancelled * (np.abs(by_stress) + np.abs(by_shape))
    errors = np.maximum(np.abs(by_stress + by_shape), least)
    return Spectrum(coarse, q, modes[0], errors, modes[1])


def assemble_pencil(equilibrium: Equilibrium, q: Array) -> Pencil:
    """Tangent stiffness in N/m at `q` and mass in kg of the unknowns."""
    film, space = equilibrium.film, equilibrium.space
    by_area = space.mass()
    mass = film.density * film.thickness * by_area
    for name, layer in film.layers.items():
        covered = space.mesh.subdomains[name]
        mass[covered] += layer.density * layer.patch.thickness * by_area[covered]
    return equilibrium.tangent(equilibrium.state(q)), equilibrium.assembly.matrix(mass)


def _eigen(
    stiffness: sp.csc_matrix,
    mass: Any,
    symmetric: bool,
    count: int,
    step: Callable[[], None],
    imaginary: float = 1e-6,
) -> tuple[Array, Array] | Status:
    """Lowest frequencies in Hz (n,) and eigenvectors (unknowns, n), or why there are none. An
    eigenvalue of an unsymmetric tangent is complex above this relative imaginary part; rounding
    splits a pair of modes by the root of the machine's precision."""
    try:
        factors = factorise(stiffness)
    except RuntimeError:  # SuperLU: exactly singular
        return Status.SINGULAR

    def solve(right: Array) -> Array:
        step()
        return np.asarray(factors.solve(right))

    inverse = LinearOperator(stiffness.shape, matvec=solve, dtype=float)
    # a fixed seed repeats results; a random start is orthogonal to no mode
    start = np.random.default_rng(0).standard_normal(stiffness.shape[0])
    how = {"M": mass, "sigma": 0.0, "OPinv": inverse, "v0": start}
    solver: Any = eigsh if symmetric else eigs  # shift-invert Lanczos or Arnoldi
    values, vectors = solver(stiffness, count, **how)
    if np.any(np.abs(values.imag) > imaginary * np.abs(values)) or np.any(values.real <= 0.0):
        return Status.UNSTABLE
    order = np.argsort(values.real)
    return np.sqrt(values.real[order]) / (2.0 * np.pi), vectors.real[:, order]
