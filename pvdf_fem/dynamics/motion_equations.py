"""Small oscillations about a loaded film, and the few vectors that follow them in a band.

With the tangent K at the state, the mass M of film and air, a force F exp(i omega t) along f and
the rates g of the electrodes' charges,

    (K + i tan(delta) K_e - omega^2 M + i omega^3 r v v^T) q = f F,   Q = (1 + i tan(delta)) g . q.

The loss tangent is that of the moduli: K_e is K without the tension's stiffness, which has no
losses, and the charge has the stress's phase. r v v^T is the sound of a baffled film.

The equations are projected on load-dependent Ritz vectors (Wilson, Yuan and Dickens 1982): first
the static displacement K^-1 f, so that charges at rest are exact, then K^-1 M of the one before,
orthonormal by M. K has its losses there; where film radiates, vectors from K^-1 v join.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.air import AirLoad
from pvdf_fem.dynamics.spectrum import assemble_pencil
from pvdf_fem.electrodes.stress_integrals import differentiate_charges
from pvdf_fem.film.loads.probe_load import UP
from pvdf_fem.film.low_rank import LowRankUpdate
from pvdf_fem.film.term import Load, State
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.progress import Progress, ignore_progress
from pvdf_fem.solver.next_order import factorise_tangent, solve_next_order
from pvdf_fem.solver.nonlinear.newton import factorise
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.solver.solution import Solution

TINY = np.finfo(float).tiny
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class MotionEquations:
    """Linear equations of motion for unknowns or for amplitudes of vectors."""

    stiffness: Any  #: K in N/m.
    elastic: Any  #: K_e in N/m.
    mass: Any  #: M in kg, with that of the air.
    force: Array  #: f, (unknowns,).
    rates: Array  #: g in C/m, (unknowns, electrodes).
    volume: Array  #: v in m^2, (unknowns,).
    radiation: float  #: r in kg s/m^4.
    loss_tangent: float

    @classmethod
    def of(cls, equilibrium: Equilibrium, q: Array) -> MotionEquations:
        """About the state of the unknowns `q`, by a force of the first probe along z."""
        state, air = equilibrium.state(q), AirLoad.of(equilibrium)
        stiffness, mass = assemble_pencil(equilibrium, q)
        force = equilibrium.loads[0].with_components(UP).forces(state)
        rates = differentiate_charges(equilibrium.problem.outputs, equilibrium.membrane, state.dofs)
        f, g = (equilibrium.unknowns.fold(forces) for forces in (force, rates))
        loss = equilibrium.film.loss_tangent or 0.0
        elastic = _elastic(equilibrium, state) if loss else 0.0 * stiffness
        moving = LowRankUpdate(mass, air.root)
        return cls(stiffness, elastic, moving, f, g, air.volume, air.radiation, loss)

    def projected(self, vectors: Any) -> MotionEquations:
        """Equations for amplitudes of `vectors` (unknowns, n), as dense matrices."""
        matrices = {k: getattr(self, k) @ vectors for k in ("stiffness", "elastic", "mass")}
        loads = {k: getattr(self, k) for k in ("force", "rates", "volume")}
        return replace(self, **{k: vectors.T @ value for k, value in (matrices | loads).items()})

    def charges(self, frequencies: Array, together: int = 256) -> ComplexArray:
        """Charges in C/N, (frequencies, electrodes), of dense equations, at frequencies in Hz. Few
        are solved for `together` to keep memory small."""
        if len(frequencies) > together:
            parts = np.array_split(frequencies, len(frequencies) // together + 1)
            return np.concatenate([self.charges(part) for part in parts])
        omega = 2.0 * np.pi * frequencies[:, None, None]
        sound = self.radiation * np.outer(self.volume, self.volume)
        elastic = self.stiffness + 1j * self.loss_tangent * self.elastic
        q = np.linalg.solve(elastic - omega**2 * self.mass + 1j * omega**3 * sound, self.force)
        return np.asarray((1.0 + 1j * self.loss_tangent) * (q @ self.rates))

    def resonances(self, highest_Hz: float) -> Array:
        """Frequencies in Hz (n,) of dense equations without their losses, up to a highest one."""
        squares = scipy.linalg.eigvals(self.stiffness, self.mass).real
        frequencies = np.sqrt(np.sort(squares[squares > 0.0])) / (2.0 * np.pi)
        return np.asarray(frequencies[frequencies <= highest_Hz])

    def reduced(
        self,
        frequencies: Array,
        progress: Progress = ignore_progress,
        tolerance: float = 1e-7,
        most: int = 426,
        tests: int = 24,
    ) -> MotionEquations:
        """The projection on Ritz vectors, enough to keep charges at test frequencies in Hz within
        the tolerance, relative to the charge plus the largest charge at rest."""
        some = np.linspace(0, len(frequencies) - 1, tests).round().astype(int)
        frequencies, stiffness = np.sort(frequencies)[some], self.stiffness
        if self.loss_tangent:
            stiffness = stiffness + 1j * self.loss_tangent * self.elastic
        solve, starts = factorise(stiffness).solve, [self.force, self.volume]
        queue = [solve(v.astype(stiffness.dtype)) for v in starts[: 1 + (self.radiation > 0.0)]]
        vectors = np.empty((len(self.force), most), stiffness.dtype)
        charges, tested = np.zeros((1, 1), dtype=complex), 16
        for i in range(most):
            progress(i, most)
            vectors[:, i] = self._unit(queue.pop(0), vectors[:, :i])
            queue.append(solve(self.mass @ vectors[:, i]))
            if i + 1 == tested:
                tested += tested // 4
                small = self.projected(vectors[:, : i + 1])
                before, charges = charges, small.charges(frequencies)
                unit = np.abs(charges) + np.abs(small.charges(np.zeros(1))).max() + TINY
                if np.all(np.abs(charges - before) <= tolerance * unit):
                    return small
        told = f"{most} vectors do not follow the film up to {frequencies.max():g} Hz"
        raise NotConvergedError(f"{Status.TOLERANCE}: {told}; give lower frequencies")

    def _unit(self, vector: Any, basis: Any) -> Any:
        """The normalised part of a vector orthogonal to a basis, both by the mass."""
        for _ in range(2):
            vector = vector - basis @ (basis.T.conj() @ (self.mass @ vector))
        return vector / np.sqrt(np.vdot(vector, self.mass @ vector).real)


def linearize_about(solution: Solution) -> tuple[MotionEquations, MotionEquations]:
    """About a solution, and the same of the order above on the same mesh."""
    factorised = factorise_tangent(solution.discrete)
    better = solve_next_order(factorised)
    return MotionEquations.of(factorised.equilibrium, factorised.q), MotionEquations.of(
        better.rich, better.q
    )


def _elastic(equilibrium: Equilibrium, state: State) -> Any:
    """The film's stiffness in N/m without geometric stiffness by tension."""
    space, membrane = equilibrium.space, equilibrium.membrane
    film = equilibrium.with_terms([t for t in equilibrium.terms if not isinstance(t, Load)])
    tension = (state.stress * membrane.volumes[..., None])[..., [[0, 2], [2, 1]]]
    slopes = space.gradients
    by_tension = np.matmul(np.matmul(slopes, tension), slopes.swapaxes(2, 3)).sum(axis=1)
    return film.tangent(state) - equilibrium.assembly.matrix(space.by_component(by_tension))
