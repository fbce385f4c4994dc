"""Vibration of the stretched film: frequencies and shapes of its lowest modes.

Small oscillations about an equilibrium: K phi = omega^2 M phi, K the tangent stiffness there and M
the mass rho h of all three displacement components. Bending is part of K where the scene says so,
which with ``film.bending = "auto"`` here is where it could change a frequency by more than the
tolerance. The unknowns are the scene's, so the film under
a rigid punch moves as one; the punch itself has no mass.

Frequencies converge from above, with the fourth power of the element size for quadratic elements.
The mesh starts from that law for the flat film and is refined until the estimated error, the
difference from cubic elements on the same mesh, is below ``numerics.tolerance``.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, SuperLU, eigs, eigsh
from skfem import Basis, MeshTri2

from pvdf_fem.film.bending_effect import bending_effect, layer_size
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import Array, Membrane
from pvdf_fem.mesh.gmsh_mesh import FILM, PROBE, MeshError, Sizes, mesh_scene, outlines
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.clock import Clock
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.solvers.newton import Status, factorise, newton, seed
from pvdf_fem.solvers.wrinkling import corrected

MOST_MODES = 200
MAX_MESHES = 6
MAX_ELEMENTS = 30_000
# Relative error of a frequency of the flat disc over (wavenumber x element size)^4, measured.
FLAT_ERROR = 4e-4
ORDER = 4.0
# Sizes aim at this part of the tolerance.
SAFETY = 0.5
# Eigenvalues of an unsymmetric tangent with a relative imaginary part above this are complex;
# rounding splits a pair of modes into complex ones by the square root of the machine's precision.
COMPLEX = 1e-6
# kg/m^3, at room temperature
AIR_DENSITY = 1.2


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Frequencies, their errors, eigenvectors; the equations and the unknowns that they are of."""

    equilibrium: Equilibrium
    q: Array
    frequencies: Array
    errors: Array
    vectors: Array


@dataclass(frozen=True, eq=False)
class Modes:
    """How the eigenvalue problem ended and, if it converged, the lowest modes.

    Attributes
    ----------
    scene : Scene
    loaded : bool
        About the loaded film, not the flat one.
    status : Status
        `Status.CONVERGED`, or why there are no modes.
    reason : str
        The status in words, with what to change.
    left_out : tuple of str
        What the model neglects.
    seconds : dict
        ``mesh``, ``solve``, ``modes`` and ``total``.
    """

    scene: Scene
    loaded: bool
    status: Status
    reason: str
    left_out: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    _spectrum: Spectrum | None = None

    @property
    def spectrum(self) -> Spectrum:
        """The modes as unknowns; raises `NotConvergedError`."""
        if self._spectrum is None or self.status is not Status.CONVERGED:
            raise NotConvergedError(f"{self.status}: {self.reason}")
        return self._spectrum

    @property
    def frequencies_Hz(self) -> Array:
        """Lowest frequencies, ascending, (n,); both of a pair of equal ones."""
        return self.spectrum.frequencies

    @property
    def frequency_errors_Hz(self) -> Array:
        """Estimated discretisation errors of the frequencies, absolute, (n,)."""
        return self.spectrum.errors

    @property
    def mesh(self) -> MeshTri2:
        """Mesh in metres; without the probe where it makes no difference."""
        return self.spectrum.equilibrium.membrane.mesh

    @property
    def basis(self) -> Basis:
        """Scalar basis of each component of `shapes`."""
        return self.spectrum.equilibrium.membrane.basis

    @property
    def shapes(self) -> Array:
        """u, v, w of each mode at the dofs of `basis`, (n, dofs, 3).

        Scaled to a largest displacement of 1, positive where it is largest. The shapes of two
        modes of equal frequency are an arbitrary pair of their combinations.
        """
        expand = self.spectrum.equilibrium.unknowns.expand
        shapes = np.array([expand(vector) for vector in self.spectrum.vectors.T])
        peaks = np.abs(shapes).argmax(axis=1)[:, None]
        return (shapes / np.take_along_axis(shapes, peaks, axis=1)).reshape(len(shapes), -1, 3)

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem modes --json` prints; without frequencies unless converged."""
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is Status.CONVERGED:
            results = {
                "frequencies_Hz": self.frequencies_Hz.tolist(),
                "frequency_errors_Hz": self.frequency_errors_Hz.tolist(),
                "unknowns": self.spectrum.equilibrium.unknowns.count,
            }
        return {
            "status": str(self.status),
            **results,
            "loaded": self.loaded,
            "left_out": list(self.left_out),
            "seconds": self.seconds,
        }


def modes(scene: Scene, count: int = 6, loaded: bool = False) -> Modes:
    """Lowest modes of vibration of a scene's film.

    Parameters
    ----------
    scene : Scene
        Its ``numerics.tolerance`` is the relative error wanted in every frequency.
    count : int
        How many, from 1 to 200.
    loaded : bool
        About the equilibrium under the load instead of the flat film. The flat film has no
        frequencies without tension (``film.temperature_change_K`` below zero).

    Returns
    -------
    Modes
        Its `status` tells whether there are frequencies.

    Raises
    ------
    ValueError
        For a `count` out of range.
    """
    if not 1 <= count <= MOST_MODES:
        raise ValueError(f"count = {count!r}: is out of range; give 1 to {MOST_MODES}")
    clock, tolerance = Clock(), scene.numerics.tolerance
    # On the flat film only a rigid probe matters, by the unknowns that it binds together.
    bare = scene if loaded or scene.load.kind == "rigid" else scene.with_(probe=None)
    share = _bending_share(bare, count, loaded)
    joins = share > tolerance if scene.film.bending == "auto" else scene.film.bending
    bare = bare.with_(**{"film.bending": joins})
    sizes, worst = _first_sizes(bare, count, share), np.inf
    for _ in range(MAX_MESHES):
        if _elements(sizes, scene) > MAX_ELEMENTS:
            break
        try:
            with clock("mesh"):
                mesh = mesh_scene(bare, sizes)
        except MeshError as error:
            reason = f"{Status.MESH_FAILED.advice} ({error})"
            return Modes(scene, loaded, Status.MESH_FAILED, reason, (), clock.seconds())
        found = _modes_on(bare, mesh, count, loaded, clock)
        if isinstance(found, Status):
            return Modes(scene, loaded, found, found.advice, (), clock.seconds())
        worst = float(np.max(found.errors / found.frequencies))
        if worst <= tolerance:
            status, neglected = Status.CONVERGED, _left_out(scene, share, joins)
            return Modes(scene, loaded, status, status.advice, neglected, clock.seconds(), found)
        factor = (SAFETY * tolerance / worst) ** (1.0 / ORDER)
        sizes = sizes.scaled(float(np.clip(factor, 0.25, 0.8)))
    reached = f"; {worst:.1e} was reached" if np.isfinite(worst) else ""
    reason = f"{tolerance:g} needs too fine a mesh; raise numerics.tolerance{reached}"
    return Modes(scene, loaded, Status.TOLERANCE, reason, (), clock.seconds())


def _first_sizes(scene: Scene, count: int, bending: float) -> Sizes:
    """Sizes that meet the tolerance for the flat film; `bending` is the share of its effect."""
    share = (SAFETY * scene.numerics.tolerance / FLAT_ERROR) ** (1.0 / ORDER)
    size = scene.film.radius * min(share / _wavenumber(count), 0.3)
    shapes = outlines(scene)
    patches = {}
    if scene.probe is not None:
        patches[PROBE] = min(size, shapes[PROBE].area / shapes[PROBE].perimeter)
    if scene.film.bending:
        length = bending_effect(scene).rim_length
        layer = layer_size(length, bending, scene.numerics.tolerance)
        if layer < size:
            patches[FILM] = layer
    return Sizes(patches, 0.4, size)


def _elements(sizes: Sizes, scene: Scene) -> float:
    """Number of elements of the largest size on the film, roughly."""
    return float(np.pi / np.sqrt(3.0 / 16.0)) * (scene.film.radius / sizes.film) ** 2


def _modes_on(
    scene: Scene, mesh: MeshTri2, count: int, loaded: bool, clock: Clock
) -> Spectrum | Status:
    """Modes with their errors, or why there are none."""
    order = 3 if scene.film.bending else 2
    coarse, rich = Equilibrium(scene, mesh, order), Equilibrium(scene, mesh, order + 1)
    q, q_rich = np.zeros(coarse.unknowns.count), np.zeros(rich.unknowns.count)
    if loaded and coarse.load.force > 0.0:
        with clock("solve"):
            result = newton(coarse, seed(coarse))
            if result.status is not Status.CONVERGED or result.factors is None:
                return result.status
            q = result.q
            correction = corrected(coarse, q, result.factors, rich)
            if isinstance(correction, Status):
                return correction
            q_rich = correction.q
    with clock("modes"):
        found = _eigen(coarse, q, count)
        if isinstance(found, Status):
            return found
        reference = _eigen(rich, q_rich, count)
        if isinstance(reference, Status):
            return reference
    errors = np.abs(found[0] - reference[0])
    return Spectrum(coarse, q, found[0], errors, found[1])


def _eigen(equilibrium: Equilibrium, q: Array, count: int) -> tuple[Array, Array] | Status:
    """Lowest frequencies in Hz (n,) and eigenvectors (unknowns, n) at `q`, or why not."""
    stiffness = equilibrium.tangent(equilibrium.state(q))
    mass = equilibrium.assembly.matrix(element_mass(equilibrium.membrane))
    try:
        factors = factorise(stiffness)
    except RuntimeError:  # SuperLU: exactly singular
        return Status.SINGULAR
    symmetric = equilibrium.load.conservative or not q.any()
    values, vectors = _lowest(eigsh if symmetric else eigs, stiffness, mass, factors, count)
    if np.any(np.abs(values.imag) > COMPLEX * np.abs(values)) or np.any(values.real <= 0.0):
        return Status.UNSTABLE
    order = np.argsort(values.real)
    return np.sqrt(values.real[order]) / (2.0 * np.pi), vectors.real[:, order]


def _lowest(
    solver: Any, stiffness: sp.csc_matrix, mass: sp.csc_matrix, factors: SuperLU, count: int
) -> Any:
    """Eigenvalues nearest to zero and their vectors by shift-invert Lanczos or Arnoldi."""
    inverse = LinearOperator(stiffness.shape, matvec=factors.solve, dtype=float)
    # a fixed start, so that results repeat; random, so that it is orthogonal to no mode
    start = np.random.default_rng(0).standard_normal(stiffness.shape[0])
    return solver(stiffness, count, M=mass, sigma=0.0, OPinv=inverse, v0=start)


def element_mass(membrane: Membrane) -> Array:
    """Mass matrices rho h in kg, (elements, dofs, dofs of an element)."""
    film, weights = membrane.film, membrane.weights
    values = [np.broadcast_to(s[0], weights.shape) for s in membrane.basis.basis]
    shapes = np.stack(values, axis=-1)
    weighted = shapes * (film.density * film.thickness * weights)[..., None]
    scalar = np.matmul(weighted.swapaxes(1, 2), shapes)
    blocks = np.einsum("eab,ij->eaibj", scalar, np.eye(3))
    return blocks.reshape(membrane.element_dofs.shape + membrane.element_dofs.shape[1:])


def _bending_share(scene: Scene, count: int, loaded: bool) -> float:
    """What bending adds to the highest of `count` frequencies, roughly, in parts of it.

    Within the length l = sqrt(D/N) of the rim, which makes the membrane smaller by l all round, and
    by the stiffness D k^4 beside N k^2 for waves of number k.
    """
    effect = bending_effect(scene)
    length = (effect.rim_length if loaded else effect.rest_length) / scene.film.radius
    return float(length + 0.5 * (_wavenumber(count) * length) ** 2)


def _wavenumber(count: int) -> float:
    """k a of the `count`-th mode of the disc, by Weyl's law n = (k a)^2/4 - k a/2."""
    return 1.0 + float(np.sqrt(1.0 + 4.0 * count))


def _left_out(scene: Scene, share: float, joins: bool) -> tuple[str, ...]:
    """Bending, unless it is part of the model, and air, with their sizes.

    The air that moves along weighs about its density times the radius per area.
    """
    film = scene.film
    bending = f"bending: raises the highest of these frequencies by about {share:.1%}"
    if share > 0.3:
        bending = 'bending: the film vibrates as a plate; give film.bending = "auto" or true'
    weight = AIR_DENSITY * film.radius / (film.density * film.thickness)
    air = (
        f"air: lowers the lowest frequencies; what moves along weighs about {weight:.2g} times as"
        " much as the film"
    )
    return (air,) if joins else (bending, air)
