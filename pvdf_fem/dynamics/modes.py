"""Vibration of the stretched film: frequencies and shapes of its lowest modes.

Small oscillations about an equilibrium: K phi = omega^2 M phi, K the tangent stiffness there and M
the mass rho h of all three displacement components. Bending is part of K where the scene says so,
which with ``film.bending = "auto"`` here is where it could change a frequency by more than the
tolerance. The unknowns are the scene's: film under a rigid punch, which is massless, moves as one.

Frequencies converge from above, with the fourth power of the element size for quadratic elements.
The mesh starts from that law for the flat film and is refined until the estimated errors are below
``numerics.tolerance``. Elements of the next order on the same mesh change a frequency through the
film's stress and through the mode's shape. The estimate is the change of both, and at least a part
of the sum of their sizes: the first can have either sign, so that they may cancel by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import LinearOperator, eigs, eigsh
from skfem import Basis, MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.air import AirLoad
from pvdf_fem.film.bending_effect import bending_effect, layer_size
from pvdf_fem.film.electric.coupling import coupling_remarks
from pvdf_fem.film.electric.raised import Raised
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.loads.kinds import LOADS
from pvdf_fem.film.models import film_model
from pvdf_fem.film.unknowns import prolongation
from pvdf_fem.mesh.gmsh_mesh import FILM, MeshError
from pvdf_fem.mesh.size_field import Sizes
from pvdf_fem.scene.film import Air
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.attempt import UNKNOWNS_PER_ELEMENT
from pvdf_fem.solution.estimate import corrected
from pvdf_fem.solution.history import Clock
from pvdf_fem.solution.refinement import MeshLoop, TooManyUnknownsError
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.ladder import equilibrate
from pvdf_fem.solvers.newton import NewtonResult, Tried, factorise
from pvdf_fem.solvers.status import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MOST_MODES = 200  #: Largest number of modes that may be asked for.
#: Relative error of a frequency of the flat disc over (wavenumber x element size)^4, measured.
FLAT_ERROR = 4e-4
ORDER = 4.0  #: Order of a frequency's error in the element size.
UNCANCELLED = 0.25  #: Part of the sum of both changes of a frequency that its error is at least.
EIGEN_ITERATIONS = 3  #: Newton iterations that an eigenvalue problem costs as much as.
#: Relative imaginary part above which an eigenvalue of an unsymmetric tangent is complex; rounding
#: splits a pair of modes into complex ones by the square root of the machine's precision.
COMPLEX = 1e-6
Pencil = tuple[sp.csc_matrix, Any]  #: Stiffness and mass; that of air is a `Raised`.


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Frequencies, errors and eigenvectors, with the equilibrium and its unknowns `q`."""

    equilibrium: Equilibrium
    q: Array
    frequencies: Array
    errors: Array
    vectors: Array
    in_air: Spectrum | None = None  #: With the scene's air, where it has air.

    @property
    def shapes(self) -> Array:
        """Those of `Modes`."""
        expand = self.equilibrium.unknowns.expand
        shapes = np.array([expand(vector) for vector in self.vectors.T])
        peaks = np.abs(shapes).argmax(axis=1)[:, None]
        return (shapes / np.take_along_axis(shapes, peaks, axis=1)).reshape(len(shapes), -1, 3)


@dataclass(frozen=True, eq=False)
class Modes:
    """How the eigenvalue problem ended and, if it converged, the lowest modes."""

    scene: Scene
    loaded: bool  #: About the loaded film, not the flat one.
    status: Status  #: `Status.CONVERGED`, or why there are no modes.
    reason: str  #: The status in words, with what to change.
    left_out: tuple[str, ...] = ()  #: What the model neglects.
    seconds: dict[str, float] = field(default_factory=dict)  #: mesh, solve, modes, total.
    _spectrum: Spectrum | None = None

    def __repr__(self) -> str:
        if self._spectrum is None:
            return f"<Modes: {self.status}: {self.reason}>"
        told = [", ".join(f"{f:.4g}" for f in self.frequencies_Hz) + " Hz in vacuum"]
        if self.frequencies_in_air_Hz is not None:
            told += [", ".join(f"{f:.4g}" for f in self.frequencies_in_air_Hz) + " Hz in air"]
        return f"<Modes: {'; '.join([*told, *self.left_out])}>"

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
    def frequencies_in_air_Hz(self) -> Array | None:
        """Lowest frequencies with the scene's air, ascending, (n,); None without ``[air]``."""
        return None if self.spectrum.in_air is None else self.spectrum.in_air.frequencies

    @property
    def mesh(self) -> MeshTri2:
        """Mesh in metres; without the probe where it makes no difference."""
        return self.spectrum.equilibrium.space.mesh

    @property
    def basis(self) -> Basis:
        """Scalar basis of each component of `shapes`."""
        return self.spectrum.equilibrium.space.basis

    @property
    def shapes(self) -> Array:
        """u, v, w of each mode at the dofs of `basis`, (n, dofs, 3).

        Scaled to a largest displacement of 1, positive where it is largest. The shapes of two
        modes of equal frequency are an arbitrary pair of their combinations.
        """
        return self.spectrum.shapes

    def plot(self) -> Figure:
        """Draw the shapes of the modes with their frequencies, those in air below."""
        from pvdf_fem.output.charts import mode_shapes  # output/ is above

        return mode_shapes(self)

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem modes --json` prints; without frequencies unless converged."""
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is Status.CONVERGED:
            results = {
                "frequencies_Hz": self.frequencies_Hz.tolist(),
                "frequency_errors_Hz": self.frequency_errors_Hz.tolist(),
                "unknowns": self.spectrum.equilibrium.unknowns.count,
            }
            if (in_air := self.spectrum.in_air) is not None:
                results["frequencies_in_air_Hz"] = in_air.frequencies.tolist()
                results["frequency_errors_in_air_Hz"] = in_air.errors.tolist()
        told = {"left_out": list(self.left_out), "seconds": self.seconds}
        return {"status": str(self.status), **results, "loaded": self.loaded, **told}


def modes(scene: Scene, count: int = 6, loaded: bool = False) -> Modes:
    """Lowest modes of vibration of a scene's film.

    Parameters
    ----------
    scene : Scene
        Its ``numerics.tolerance`` is the relative error wanted in every frequency.
    count : int
        How many, from 1 to 200.
    loaded : bool
        About the equilibrium under the load instead of the flat film, which has no frequencies
        without tension in all directions.
    """
    if count not in range(1, MOST_MODES + 1):
        raise ValueError(f"count = {count!r}: is no number of modes; give 1 to {MOST_MODES}")
    count = int(count)
    if loaded:
        scene.require_no_tips("frequencies about the load")
        bare = scene
    else:  # on the flat film only rigid probes matter, by the unknowns that they bind together
        rigid = [touch for touch in scene.loaded_probes if LOADS[touch.load.kind].rigid]
        bare = scene.loaded([replace(t, load=t.load.unloaded) for t in rigid])
    share = _bending_share(bare, count, loaded)
    bends = scene.film.bending
    if bends == "auto":
        bends = share > scene.numerics.tolerance
    touch = {} if loaded else dict.fromkeys(bare.warm_probes)
    bare = bare.with_(**{"film.bending": bends}, **touch)
    problem = _ModalProblem(bare, count, loaded, share, _modal_budget(bare), Clock())
    steps = problem.first_sizes, problem.solve_on, problem.next_sizes
    loop = MeshLoop(bare, *steps, problem.budget, problem.clock, UNKNOWNS_PER_ELEMENT[2])
    try:
        attempt, stop = loop.run()
    except MeshError as error:
        reason = f"{Status.MESH_FAILED.advice} ({error})"
        return Modes(scene, loaded, Status.MESH_FAILED, reason)
    except TooManyUnknownsError as error:
        return Modes(scene, loaded, Status.TOLERANCE, str(error))
    voltages = coupling_remarks(bare) if loaded else ()
    status, reason = attempt.status, attempt.status.advice
    if status is Status.CONVERGED and attempt.worst > scene.numerics.tolerance:
        status = Status.TOLERANCE
        reason = f"{status.advice}, to at least {attempt.worst:.1e}, which was reached ({stop})"
    told = tuple(text for included, text in voltages if not included)
    left_out = (*_left_out(scene, share, bends), *told)
    results = left_out, loop.clock.seconds(), attempt.spectrum
    return Modes(scene, loaded, status, reason, *results)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """The modes on one mesh, or why there are none."""

    equilibrium: Equilibrium
    status: Status
    spectrum: Spectrum | None = None
    iterations: int = 0
    tried: tuple[Tried, ...] = ()

    @property
    def worst(self) -> float:
        """Largest relative error of a frequency."""
        spectra = [s for s in (self.spectrum, self.spectrum and self.spectrum.in_air) if s]
        return max((float(np.max(s.errors / s.frequencies)) for s in spectra), default=0.0)

    @property
    def bound(self) -> float:
        return self.worst

    @property
    def unknowns(self) -> int:
        return self.equilibrium.unknowns.count


@dataclass(eq=False)
class _ModalProblem:
    """What is solved on every mesh."""

    scene: Scene  # bending decided, and without a probe that makes no difference
    count: int
    loaded: bool
    bending_share: float  # part of the highest frequency that bending adds, roughly
    budget: Budget
    clock: Clock
    sizes: Sizes | None = None  # those of the last mesh

    def first_sizes(self) -> Sizes:
        """Sizes that meet half of the tolerance for the flat film."""
        scene, tolerance = self.scene, self.scene.numerics.tolerance
        share = (0.5 * tolerance / FLAT_ERROR) ** (1.0 / ORDER)
        size = scene.film.radius * min(share / _wavenumber(self.count), 0.3)
        patches = {}
        for touch in scene.loaded_probes:
            patches[touch.patch] = min(size, touch.outline.area / touch.outline.perimeter)
        if film_model(scene).bends:
            length = bending_effect(scene).rim_length
            layer = layer_size(length, self.bending_share, tolerance)
            if layer < size:
                patches[FILM] = layer
        self.sizes = Sizes(patches, 0.4, size)
        return self.sizes

    def next_sizes(self, attempt: _Attempt, tolerance: float, most_unknowns: float) -> Sizes:
        """Sizes at which the worst error would be `tolerance`, by the law of its order."""
        assert self.sizes is not None
        factor = (tolerance / attempt.worst) ** (1.0 / ORDER)
        smallest = max(0.25, (attempt.unknowns / most_unknowns) ** 0.5)
        self.sizes = self.sizes.scaled(float(np.clip(factor, smallest, 0.8)))
        return self.sizes

    def solve_on(self, mesh: MeshTri2, coarser: _Attempt | None) -> _Attempt:
        """Modes with their errors, or why there are none."""
        order = max(2, film_model(self.scene).lowest_order + 1)
        coarse, rich = (Equilibrium(self.scene, mesh, p) for p in (order, order + 1))
        q, q_rich = np.zeros(coarse.unknowns.count), np.zeros(rich.unknowns.count)
        least, iterations = self.scene.film.stress_at_rest[:2].min(), 0
        tried: tuple[Tried, ...] = ()
        if not coarse.is_flat:
            with self.clock("solve"):
                result = equilibrate(coarse, budget=self.budget)
                iterations, tried = len(result.iterations), result.tried
                self.budget.spend(coarse, result.fresh_count)
                if not result.converged or result.factors is None:
                    return _Attempt(coarse, result.status, None, iterations, tried)
                correction = corrected(coarse, result.q, result.factors, rich, self.budget)
                if isinstance(correction, NewtonResult):
                    return _Attempt(coarse, correction.status, None, iterations, tried)
                q, q_rich = result.q, correction.q
        elif not coarse.model.bends and (least == 0.0 or (coarse.model.wrinkles and least < 0.0)):
            return _Attempt(coarse, Status.SINGULAR)  # slack in a direction: no mode is the lowest
        with self.clock("modes"):
            pencils = pencil_of(coarse, q), pencil_of(rich, q_rich)
            spectrum = self._spectrum(coarse, rich, q, pencils)
            if self.scene.air is not None and isinstance(spectrum, Spectrum):
                spectrum = self._with_air(spectrum, rich, pencils)
        for equilibrium in (coarse, rich):
            self.budget.spend(equilibrium, EIGEN_ITERATIONS)
        if isinstance(spectrum, Status):
            return _Attempt(coarse, spectrum, None, iterations, tried)
        return _Attempt(coarse, Status.CONVERGED, spectrum, iterations, tried)

    def _spectrum(
        self, coarse: Equilibrium, rich: Equilibrium, q: Array, pencils: Sequence[Pencil]
    ) -> Spectrum | Status:
        """The modes of the first pencil, whose errors the second one, of `rich`, tells."""
        symmetric = coarse.conservative or not q.any()
        modes, reference = (_eigen(*pencil, symmetric, self.count) for pencil in pencils)
        if isinstance(modes, Status):
            return modes
        if isinstance(reference, Status):
            return reference
        shapes = prolongation(coarse, rich) @ modes[1]
        energy, inertia = ((shapes * (matrix @ shapes)).sum(axis=0) for matrix in pencils[1])
        same_shape = np.sqrt(energy / inertia) / (2.0 * np.pi)
        by_stress, by_shape = modes[0] - same_shape, same_shape - reference[0]
        least = UNCANCELLED * (np.abs(by_stress) + np.abs(by_shape))
        errors = np.maximum(np.abs(by_stress + by_shape), least)
        return Spectrum(coarse, q, modes[0], errors, modes[1])

    def _with_air(self, vacuum: Spectrum, rich: Equilibrium, pencils: Sequence[Pencil]) -> Spectrum:
        """The spectrum in vacuum with that in air beside it."""
        coarse = vacuum.equilibrium
        airs = [AirLoad.of(equilibrium) for equilibrium in (coarse, rich)]
        loaded = [(K, Raised(M, air.root)) for air, (K, M) in zip(airs, pencils, strict=True)]
        found = self._spectrum(coarse, rich, vacuum.q, loaded)
        assert isinstance(found, Spectrum)  # the stiffness has modes in vacuum
        inertia = (found.vectors * (loaded[0][1] @ found.vectors)).sum(axis=0)
        lacking = 0.5 * found.frequencies * airs[0].lacking(found.vectors) / inertia
        return replace(vacuum, in_air=replace(found, errors=found.errors + lacking))


def pencil_of(equilibrium: Equilibrium, q: Array) -> Pencil:
    """Tangent stiffness in N/m at `q` and mass in kg of the unknowns."""
    film, space = equilibrium.film, equilibrium.space
    by_area = space.mass()
    mass = film.density * film.thickness * by_area
    for name, layer in film.layers.items():
        covered = space.mesh.subdomains[name]
        mass[covered] += layer.density * layer.patch.thickness * by_area[covered]
    return equilibrium.tangent(equilibrium.state(q)), equilibrium.assembly.matrix(mass)


def _eigen(
    stiffness: sp.csc_matrix, mass: Any, symmetric: bool, count: int
) -> tuple[Array, Array] | Status:
    """Lowest frequencies in Hz (n,) and eigenvectors (unknowns, n), or why there are none."""
    try:
        factors = factorise(stiffness)
    except RuntimeError:  # SuperLU: exactly singular
        return Status.SINGULAR
    inverse = LinearOperator(stiffness.shape, matvec=factors.solve, dtype=float)
    # a fixed seed repeats results; a random start is orthogonal to no mode
    start = np.random.default_rng(0).standard_normal(stiffness.shape[0])
    how = {"M": mass, "sigma": 0.0, "OPinv": inverse, "v0": start}
    solver: Any = eigsh if symmetric else eigs  # shift-invert Lanczos or Arnoldi
    values, vectors = solver(stiffness, count, **how)
    if np.any(np.abs(values.imag) > COMPLEX * np.abs(values)) or np.any(values.real <= 0.0):
        return Status.UNSTABLE
    order = np.argsort(values.real)
    return np.sqrt(values.real[order]) / (2.0 * np.pi), vectors.real[:, order]


def _modal_budget(scene: Scene, most_unknowns: int = 180_000) -> Budget:
    """What the modes may cost: by default as many unknowns at any tolerance."""
    budget = Budget.of(scene)
    if scene.numerics.max_unknowns is None:
        budget = replace(budget, max_unknowns=most_unknowns)
    return replace(budget, bounds_first_mesh=True)


def _bending_share(scene: Scene, count: int, loaded: bool) -> float:
    """What bending adds to the highest of `count` frequencies, roughly, in parts of it. Within the
    length l = sqrt(D/N) of the rim, which makes the membrane smaller by l all round, and by the
    stiffness D k^4 beside N k^2 for waves of number k."""
    effect = bending_effect(scene)
    length = (effect.rim_length if loaded else effect.rest_length) / scene.film.radius
    return float(length + 0.5 * (_wavenumber(count) * length) ** 2)


def _wavenumber(count: int) -> float:
    """k a of the `count`-th mode of the disc, by Weyl's law n = (k a)^2/4 - k a/2."""
    return 1.0 + float(np.sqrt(1.0 + 4.0 * count))


def _left_out(scene: Scene, share: float, joins: bool) -> tuple[str, ...]:
    """Bending, unless it is part of the model, and air, where the scene has none."""
    raised = f"bending: raises the highest of these frequencies by about {share:.1%}"
    bending = f"{raised}; to include it give film.bending = true"
    if share > 0.3:
        bending = 'bending: the film vibrates as a plate; give film.bending = "auto" or true'
    air = () if scene.air else (air_remark(scene),)
    return air if joins else (bending, *air)


def air_remark(scene: Scene) -> str:
    """What a vacuum leaves out: per area about the density of air times the radius."""
    film = scene.film
    weight = Air().density_kg_m3 * film.radius / (film.density * film.thickness)
    mass = f"adds about {weight:.2g} times the film's mass, which lowers the lowest frequencies"
    return f"air: {mass}; to include it give [air]"
