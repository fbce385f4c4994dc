"""Vibration of the stretched film: frequencies and shapes of its lowest modes.

Small oscillations about an equilibrium: K phi = omega^2 M phi, K the tangent stiffness there and M
the mass rho h of all three displacement components. Bending is part of K if the scene says so. Here
``film.bending = "auto"`` includes bending where it could change a frequency by more than the
tolerance. The unknowns are the scene's: film under a rigid, massless punch moves as a whole.

Frequencies converge from above, with the fourth power of the element size for quadratic elements.
The mesh starts from that law for the flat film and is refined until the estimated errors are below
``numerics.tolerance``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from skfem import Basis, MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.dynamics.spectrum import AIR, VACUUM, Spectrum, compute_spectra
from pvdf_fem.film.bending.effect import choose_layer_size, estimate_bending_effect
from pvdf_fem.film.electric.coupling import describe_coupling
from pvdf_fem.film.loads.load_classes import PROBE_LOADS
from pvdf_fem.mesh.gmsh_mesh import FILM, MeshError
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.progress import Progress, SolveCounter, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.scene.film import Air
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive_loop import AdaptiveLoop, TooManyUnknownsError
from pvdf_fem.solver.estimate import correct_in_richer_space
from pvdf_fem.solver.history import StageTimer
from pvdf_fem.solver.mesh_level import UNKNOWNS_PER_ELEMENT
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import FailedAttempt, NewtonResult
from pvdf_fem.solver.nonlinear.status import NotConvergedError, Status
from pvdf_fem.summary import Result, Summary, TextTable, format_with_error

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_MODES = 200  #: Largest number of modes that may be asked for.


@dataclass(frozen=True, eq=False, repr=False)
class Modes(Result):
    """How the eigenvalue problem ended and, if it converged, the lowest modes."""

    scene: Scene
    loaded: bool  #: About the loaded film, not the flat one.
    status: Status  #: `Status.CONVERGED`, or why there are no modes.
    reason: str  #: The status in words, with what to change.
    neglected: tuple[str, ...] = ()  #: What the model neglects.
    seconds: dict[str, float] = field(default_factory=dict)  #: mesh, solve, modes, total.
    _spectra: Mapping[str, Spectrum] = field(default_factory=dict)

    @property
    def spectra(self) -> Mapping[str, Spectrum]:
        """The modes as unknowns, `VACUUM` and, with ``[air]``, `AIR`; raises
        `NotConvergedError`."""
        if self.status is not Status.CONVERGED:
            raise NotConvergedError(f"{self.status}: {self.reason}")
        return self._spectra

    @property
    def frequencies_Hz(self) -> Array:
        """Lowest frequencies, ascending, (n,); both of a pair of equal ones."""
        return self.spectra[VACUUM].frequencies

    @property
    def frequency_errors_Hz(self) -> Array:
        """Estimated discretisation errors of the frequencies, absolute, (n,)."""
        return self.spectra[VACUUM].errors

    @property
    def frequencies_in_air_Hz(self) -> Array | None:
        """Lowest frequencies with the scene's air, ascending, (n,); None without ``[air]``."""
        return self.spectra[AIR].frequencies if AIR in self.spectra else None

    @property
    def basis(self) -> Basis:
        """Scalar basis for every component in `shapes`, on a mesh in m without irrelevant
        probes."""
        return self.spectra[VACUUM].equilibrium.space.basis

    @property
    def shapes(self) -> Array:
        """u, v, w by mode at the dofs of `basis`, (n, dofs, 3).

        Scaled to a largest displacement 1, positive where largest. Two modes with equal frequency
        have an arbitrary pair of combinations as shapes.
        """
        return self.spectra[VACUUM].shapes

    @property
    def _about(self) -> str:
        return "film under its load" if self.loaded else "flat film"

    def plot(self) -> Figure:
        """Draw the shapes of the modes with their frequencies, with the scene's air if any."""
        from pvdf_fem.view.charts import draw_mode_shapes

        where, spectrum = [*self.spectra.items()][-1]
        shapes = [
            (f"{i}: {frequency:.4g} Hz", shape[:, 2])
            for i, (frequency, shape) in enumerate(
                zip(spectrum.frequencies, spectrum.shapes, strict=True), 1
            )
        ]
        film = spectrum.equilibrium.space.basis, self.scene.film.radius_mm
        return draw_mode_shapes(shapes, *film, f"Modes of the {self._about} {where}")

    def summary(self) -> Summary:
        """Status, film or reason, a table each in vacuum and in air, and what is left out."""
        converged, grids = self.status is Status.CONVERGED, []
        for where, spectrum in self.spectra.items() if converged else ():
            pairs = zip(spectrum.frequencies.tolist(), spectrum.errors.tolist(), strict=True)
            rows = tuple((str(i), *format_with_error(*pair)) for i, pair in enumerate(pairs, 1))
            grids.append(TextTable((where, "Hz", "± Hz"), rows))
        reason = self.reason
        if converged:
            lowest = ", ".join(f"{frequency:.4g}" for frequency in self.frequencies_Hz[:3])
            reason = f"{len(self.frequencies_Hz)} modes of the {self._about}, from {lowest} Hz on"
        notes = [f"left out: {text}" for text in self.neglected]
        return Summary(self.status, [reason], tables=grids, notes=notes)

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem modes --json` prints; without frequencies unless converged."""
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is Status.CONVERGED:
            results = {"unknowns": self.spectra[VACUUM].equilibrium.unknowns.count}
            for where, spectrum in self.spectra.items():
                end = "in_air_Hz" if where == AIR else "Hz"
                results[f"frequencies_{end}"] = spectrum.frequencies.tolist()
                results[f"frequency_errors_{end}"] = spectrum.errors.tolist()
        told = {"neglected": list(self.neglected), "seconds": self.seconds}
        return {"status": str(self.status), **results, "loaded": self.loaded, **told}


def modes(
    scene: SceneLike,
    count: int = 6,
    loaded: bool = False,
    progress: Progress | bool | None = None,
) -> Modes:
    """Lowest modes of vibration of a scene's film.

    Parameters
    ----------
    scene : Scene, path of its file, dict of its tables, or a result of it
        Its ``numerics.tolerance`` is the relative error wanted in every frequency.
    count : int
        How many, from 1 to 200.
    loaded : bool
        About the equilibrium under the load instead of the flat film, which has no frequencies
        without tension in all directions.
    progress : callable or bool, optional
        Called with the numbers of linear solves that are done and that are expected; or whether
        these are shown, see `pvdf_fem.progress.show_progress`.

    Examples
    --------
    >>> found = modes(Scene(air={"baffle": False}), count=3)
    >>> found.frequencies_Hz, found.frequencies_in_air_Hz
    """
    scene = as_scene(scene)
    count, bare = coerce("count", count, int, (1, MAX_MODES)), scene
    if coerce("loaded", loaded, bool):
        scene.require_no_tips("frequencies about the load")
    else:  # on the flat film only rigid probes matter, by the unknowns that they bind together
        rigid = [touch for touch in scene.loaded_probes if PROBE_LOADS[touch.load.kind].is_rigid]
        bare = scene.with_loaded_probes([replace(t, load=t.load.unloaded) for t in rigid])
    share = _bending_share(bare, count, loaded)
    bends = scene.film.bending
    if bends == "auto":
        bends = share > scene.numerics.tolerance
    cold = {} if loaded else dict.fromkeys(bare.warm_probes)
    bare = bare.with_(**{"film.bending": bends}, **cold)
    expected = 4 * count * 2 * (2 if scene.air else 1)  # Lanczos steps of both pencils
    resolved = Problem.from_scene(bare)
    problem = _ModalProblem(resolved, count, loaded, share, _budget_of(resolved), StageTimer())
    steps = problem.first_sizes, problem.solve_on, problem.next_sizes
    loop = AdaptiveLoop(resolved, *steps, problem.budget, problem.clock, UNKNOWNS_PER_ELEMENT[2])
    try:
        with show_progress("solves", progress) as show:
            problem.step = SolveCounter(show, expected)
            attempt, stop = loop.run()
    except MeshError as error:
        reason = f"{Status.MESH_FAILED.advice} ({error})"
        return Modes(scene, loaded, Status.MESH_FAILED, reason)
    except TooManyUnknownsError as error:
        return Modes(scene, loaded, Status.TOLERANCE, str(error))
    status, reason = attempt.status, attempt.status.advice
    if status is Status.CONVERGED and attempt.worst > scene.numerics.tolerance:
        status = Status.TOLERANCE
        reason = f"{status.advice}, to at least {attempt.worst:.1e}, which was reached ({stop})"
    voltages = describe_coupling(bare) if loaded else ()
    left_out = _left_out(scene, share, bends), (text for included, text in voltages if not included)
    results = (*left_out[0], *left_out[1]), loop.timer.seconds(), attempt.spectra
    return Modes(scene, loaded, status, reason, *results)


@dataclass(frozen=True, eq=False)
class _Attempt:
    """The modes on a mesh, or the reason for their absence."""

    equilibrium: Equilibrium
    status: Status
    iterations: int = 0
    failed_attempts: tuple[FailedAttempt, ...] = ()
    spectra: Mapping[str, Spectrum] = field(default_factory=dict)

    @property
    def worst(self) -> float:
        """Largest relative error of a frequency."""
        errors = [float(np.max(s.errors / s.frequencies)) for s in self.spectra.values()]
        return max(errors, default=0.0)

    @property
    def bound(self) -> float:
        return self.worst

    @property
    def unknowns(self) -> int:
        return self.equilibrium.unknowns.count


@dataclass(eq=False)
class _ModalProblem:
    """What is solved on every mesh."""

    problem: Problem  # bending decided, and without a probe that makes no difference
    count: int
    loaded: bool
    bending_share: float  # part of the highest frequency that bending adds, roughly
    budget: Budget
    clock: StageTimer
    sizes: GradedSizes | None = None  # those of the last mesh
    step: Callable[[], None] = lambda: None  # called at each linear solve
    flat_error: float = 4e-4  # error of the flat disc over (wavenumber x element size)^4, measured
    order: float = 4.0  # of a frequency's error in the element size
    eigen_iterations: int = 3  # Newton iterations that cost as much as an eigenvalue problem

    def first_sizes(self) -> GradedSizes:
        """Sizes that meet half the tolerance for the flat film."""
        scene, tolerance = self.problem.scene, self.problem.scene.numerics.tolerance
        share = (0.5 * tolerance / self.flat_error) ** (1.0 / self.order)
        size = scene.film.radius * min(share / _wavenumber(self.count), 0.3)
        patches = {}
        for touch in scene.loaded_probes:
            patches[touch.patch] = min(size, touch.outline.area / touch.outline.perimeter)
        if self.problem.film.bends:
            length = estimate_bending_effect(scene).rim_length
            patches[FILM] = min(size, choose_layer_size(length, self.bending_share, tolerance))
        self.sizes = GradedSizes(patches, 0.4, size)
        return self.sizes

    def next_sizes(self, attempt: _Attempt, tolerance: float, most_unknowns: float) -> GradedSizes:
        """Sizes at which the worst error would be `tolerance`, by the law of its order."""
        assert self.sizes is not None
        factor = (tolerance / attempt.worst) ** (1.0 / self.order)
        smallest = max(0.25, (attempt.unknowns / most_unknowns) ** 0.5)
        self.sizes = self.sizes.scaled(float(np.clip(factor, smallest, 0.8)))
        return self.sizes

    def solve_on(self, mesh: MeshTri2, coarser: _Attempt | None) -> _Attempt:
        """Modes with their errors, or why there are none."""
        order = max(2, self.problem.film.lowest_order + 1)
        coarse, rich = (Equilibrium(self.problem, mesh, p) for p in (order, order + 1))
        q, q_rich = np.zeros(coarse.unknowns.count), np.zeros(rich.unknowns.count)
        least = self.problem.scene.film.prestress[:2].min()
        solver: tuple[int, tuple[FailedAttempt, ...]] = (0, ())
        if not coarse.is_flat:
            with self.clock("solve"):
                result = find_equilibrium(coarse, budget=self.budget)
                solver = len(result.iterations), result.failed_attempts
                self.budget.spend(coarse, result.fresh_count)
                if not result.converged or result.factors is None:
                    return _Attempt(coarse, result.status, *solver)
                correction = correct_in_richer_space(
                    coarse, result.q, factors=result.factors, rich=rich, budget=self.budget
                )
                if isinstance(correction, NewtonResult):
                    return _Attempt(coarse, correction.status, *solver)
                q, q_rich = result.q, correction.q
        elif not coarse.model.bends and (least == 0.0 or (coarse.model.wrinkles and least < 0.0)):
            return _Attempt(coarse, Status.SINGULAR)  # slack in a direction: no mode is the lowest
        with self.clock("modes"):
            found = compute_spectra(coarse, rich, (q, q_rich), self.count, self.step)
        for equilibrium in (coarse, rich):
            self.budget.spend(equilibrium, self.eigen_iterations)
        if isinstance(found, Status):
            return _Attempt(coarse, found, *solver)
        return _Attempt(coarse, Status.CONVERGED, *solver, found)


def _budget_of(problem: Problem, most_unknowns: int = 180_000) -> Budget:
    """Budget of the modes: by default an equal number of unknowns at every tolerance."""
    most = problem.scene.numerics.max_unknowns or most_unknowns
    return replace(Budget.for_problem(problem), max_unknowns=most, bounds_first_mesh=True)


def _bending_share(scene: Scene, count: int, loaded: bool) -> float:
    """Relative increase by bending in the highest of `count` frequencies, roughly. Within the
    length l = sqrt(D/N) of the rim, which makes the membrane smaller by l all round, and by the
    stiffness D k^4 beside N k^2 for waves of number k."""
    effect = estimate_bending_effect(scene)
    length = (effect.rim_length if loaded else effect.rest_length) / scene.film.radius
    return float(length + 0.5 * (_wavenumber(count) * length) ** 2)


def _wavenumber(count: int) -> float:
    """k a of the `count`-th mode of the disc, by Weyl's law n = (k a)^2/4 - k a/2."""
    return 1.0 + float(np.sqrt(1.0 + 4.0 * count))


def _left_out(scene: Scene, share: float, joins: bool) -> tuple[str, ...]:
    """Bending, unless part of the model, and air, where the scene has no air."""
    raised = f"bending: raises the highest of these frequencies by about {share:.1%}"
    bending = f"{raised}; to include it give film.bending = true"
    if share > 0.3:
        bending = 'bending: the film vibrates as a plate; give film.bending = "auto" or true'
    air = () if scene.air else (format_air_note(scene),)
    return air if joins else (bending, *air)


def format_air_note(scene: Scene, baffled: float = 1.5) -> str:
    """What a vacuum leaves out: in the lowest mode, per area, about the density of air times the
    radius, and `baffled` times as much in a baffle."""
    film = scene.film
    weight = Air().density_kg_m3 * film.radius / (film.density * film.thickness)
    sizes = f"about {baffled * weight:.2g} times the film's mass, {weight:.2g} without a baffle"
    return f"air: adds {sizes}, to the lowest mode; to include it give [air]"
