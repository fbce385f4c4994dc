"""The modes of a film on a sequence of meshes: element sizes, solves and errors.

With quadratic elements, frequencies converge from above with the fourth power of the element size.
The first mesh is chosen by this law for the flat film. Meshes are refined until the estimated
errors are below ``numerics.tolerance``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from pvdf_fem.dynamics.spectrum import EquilibriumState, Spectrum, compute_spectra
from pvdf_fem.film.bending.effect import choose_layer_size, estimate_bending_effect
from pvdf_fem.mesh.corner_sizes import choose_corner_sizes
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive_loop import AdaptiveLoop
from pvdf_fem.solver.estimate.correction import correct_in_richer_space
from pvdf_fem.solver.history import StageTimer, Stop
from pvdf_fem.solver.mesh_level import UNKNOWNS_PER_ELEMENT
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import FailedAttempt, NewtonResult
from pvdf_fem.solver.nonlinear.status import Status

#: Relative error of a frequency of the flat disc, divided by (wavenumber x element size)^4;
#: measured.
FLAT_ERROR = 4e-4
#: Order of convergence of a frequency with the element size.
ERROR_ORDER = 4.0
#: Fraction of the tolerance that the re-entrant corners of the film may use.
CORNER_SHARE = 0.25
#: Wavenumber of the lowest mode of a disc, times its radius; `estimate_wavenumber` is larger.
LOWEST_WAVENUMBER = 2.4
#: Number of Newton iterations that cost as much as one eigenvalue problem.
ITERATIONS_PER_EIGENPROBLEM = 3


@dataclass(frozen=True, eq=False)
class ModalLevel:
    """Modes on one mesh, or the reason why there are none."""

    equilibrium: Equilibrium
    status: Status  #: `Status.CONVERGED`, or why there are no modes.
    #: Number of Newton iterations to the equilibrium.
    iterations: int = 0
    #: Solvers of the fallback chain that failed.
    failed_attempts: tuple[FailedAttempt, ...] = ()
    #: Modes in `VACUUM` and `AIR`; empty unless converged.
    spectra: Mapping[str, Spectrum] = field(default_factory=dict)

    @property
    def worst(self) -> float:
        """Largest relative error of a frequency; zero if there are no modes."""
        largest = 0.0
        for spectrum in self.spectra.values():
            largest = max(largest, float(np.max(spectrum.errors / spectrum.frequencies)))
        return largest

    @property
    def bound(self) -> float:
        """Error that `AdaptiveLoop` compares with the tolerance."""
        return self.worst

    @property
    def unknowns(self) -> int:
        """Number of unknowns on this mesh."""
        return self.equilibrium.unknowns.count


@dataclass(eq=False)
class ModalProblem:
    """Problem of the lowest modes of one film, solved on a sequence of meshes."""

    #: Film with those probes that affect its modes.
    problem: Problem
    #: Number of modes.
    count: int
    #: Whether the film vibrates about its loaded equilibrium.
    loaded: bool
    #: Rough relative increase of the highest frequency due to bending.
    bending_increase: float
    #: Limits of unknowns and time.
    budget: Budget
    timer: StageTimer = field(default_factory=StageTimer)
    #: Element sizes of the last mesh; set by `choose_first_sizes` and `choose_next_sizes`.
    sizes: GradedSizes | None = None
    #: Function that is called at each linear solve of an eigenvalue problem.
    on_solve: Callable[[], None] = lambda: None

    @classmethod
    def with_default_budget(
        cls, problem: Problem, count: int, loaded: bool, bending_increase: float
    ) -> ModalProblem:
        """Make the modal problem with the budget from ``[numerics]`` of the scene.

        Parameters
        ----------
        problem : Problem
            Film with those probes that affect its modes.
        count : int
            Number of modes.
        loaded : bool
            Whether the film vibrates about its loaded equilibrium.
        bending_increase : float
            Relative increase of the highest frequency due to bending, see
            `estimate_bending_increase`.
        """
        return cls(problem, count, loaded, bending_increase, budget=_make_budget(problem))

    def solve(self) -> tuple[ModalLevel, Stop]:
        """Solve for the modes on increasingly fine meshes.

        Returns
        -------
        level : ModalLevel
            The best level.
        stop : Stop
            Reason why no finer mesh was solved.

        Raises
        ------
        MeshError
            If the first mesh cannot be made.
        TooManyUnknownsError
            If the first mesh would have too many unknowns.
        """
        loop = AdaptiveLoop(
            self.problem,
            order=max(2, self.problem.film.kinematics.lowest_order + 1),
            first_sizes=self.choose_first_sizes,
            solve_equations=self.solve_modes,
            next_sizes=self.choose_next_sizes,
            budget=self.budget,
            timer=self.timer,
            unknowns_per_element=UNKNOWNS_PER_ELEMENT[2],
        )
        return loop.run()

    def choose_first_sizes(self) -> GradedSizes:
        """Choose and store element sizes whose error is half the tolerance for the flat film.

        Elements at probes, at re-entrant corners, and at the rim of a film that bends, are smaller
        if necessary.
        """
        scene = self.problem.scene
        tolerance = scene.numerics.tolerance
        wavelengths = (0.5 * tolerance / FLAT_ERROR) ** (1.0 / ERROR_ORDER)
        wavenumber = estimate_wavenumber(scene.film.outline, self.count)
        size = scene.film.radius * min(wavelengths / wavenumber, 0.3)
        patch_sizes = {}
        for load in scene.loaded_probes:
            width = load.outline.area / load.outline.perimeter
            patch_sizes[load.patch] = min(size, width)
        if self.problem.film.bends:
            layer = choose_layer_size(
                estimate_bending_effect(scene).rim_length, self.bending_increase, tolerance
            )
            patch_sizes[FILM] = min(size, layer)
        corner_sizes = choose_corner_sizes(
            scene.film,
            CORNER_SHARE * tolerance,
            scale=scene.film.radius * LOWEST_WAVENUMBER / wavenumber,
            largest=size,
        )
        self.sizes = GradedSizes(patch_sizes, 0.4, film=size, points=corner_sizes)
        return self.sizes

    def choose_next_sizes(
        self, level: ModalLevel, tolerance: float, max_unknowns: float
    ) -> GradedSizes:
        """Choose and store element sizes whose error would be the tolerance, by extrapolation.

        The sizes are scaled by a factor between 0.25 and 0.8. They are larger than the error
        requires if the mesh would have more than `max_unknowns` unknowns.

        Parameters
        ----------
        level : ModalLevel
            Modes on the last mesh, with their errors.
        tolerance : float
            Desired relative error of the frequencies.
        max_unknowns : float
            Rough maximum number of unknowns of the next mesh.
        """
        assert self.sizes is not None
        by_error = (tolerance / level.worst) ** (1.0 / ERROR_ORDER)
        smallest = max(0.25, (level.unknowns / max_unknowns) ** 0.5)
        self.sizes = self.sizes.scale(float(np.clip(by_error, smallest, 0.8)))
        return self.sizes

    def solve_modes(self, coarse: Equilibrium, coarser: ModalLevel | None) -> ModalLevel:
        """Solve for the modes on a mesh, with their errors from elements of the next order.

        If there is no equilibrium or there are no modes, the status of the level says why.

        Parameters
        ----------
        coarse : Equilibrium
            Equations on the mesh.
        coarser : ModalLevel or None
            Not used; `AdaptiveLoop` passes the level on the previous mesh.
        """
        rich = coarse.at_order(coarse.space.order + 1)
        q = np.zeros(coarse.unknowns.count)
        rich_q = np.zeros(rich.unknowns.count)
        iterations = 0
        failed: tuple[FailedAttempt, ...] = ()
        if not coarse.is_flat:
            with self.timer("solve"):
                result = find_equilibrium(coarse, budget=self.budget)
                iterations = len(result.iterations)
                failed = result.failed_attempts
                self.budget.spend(coarse, result.tangent_count)
                if not result.converged or result.factors is None:
                    return ModalLevel(coarse, result.status, iterations, failed)
                correction = correct_in_richer_space(
                    coarse, result.q, factors=result.factors, rich=rich, budget=self.budget
                )
                if isinstance(correction, NewtonResult):
                    return ModalLevel(coarse, correction.status, iterations, failed)
                q = result.q
                rich_q = correction.q
        elif _is_slack(coarse):
            return ModalLevel(coarse, Status.SINGULAR)
        with self.timer("modes"):
            spectra = compute_spectra(
                EquilibriumState(coarse, q),
                EquilibriumState(rich, rich_q),
                self.count,
                on_solve=self.on_solve,
            )
        self.budget.spend(coarse, ITERATIONS_PER_EIGENPROBLEM)
        self.budget.spend(rich, ITERATIONS_PER_EIGENPROBLEM)
        if isinstance(spectra, Status):
            return ModalLevel(coarse, spectra, iterations, failed)
        return ModalLevel(coarse, Status.CONVERGED, iterations, failed, spectra=spectra)


def _is_slack(equilibrium: Equilibrium) -> bool:
    """Return whether a flat film has no tension in some direction; False if it resists bending."""
    if equilibrium.model.bends:
        return False
    min_stress = equilibrium.film.prestress[:2].min()
    return bool(min_stress == 0.0 or (equilibrium.model.wrinkles and min_stress < 0.0))


def _make_budget(problem: Problem, default_unknowns: int = 180_000) -> Budget:
    """Make the budget of a modal problem, whose number of unknowns limits the first mesh, too.

    Parameters
    ----------
    problem : Problem
        Film with the limits in ``[numerics]`` of its scene.
    default_unknowns : int, optional
        Maximum number of unknowns if the scene does not give one.
    """
    max_unknowns = problem.scene.numerics.max_unknowns or default_unknowns
    return replace(Budget.for_problem(problem), max_unknowns=max_unknowns, bounds_first_mesh=True)


def estimate_bending_increase(scene: Scene, count: int, loaded: bool) -> float:
    """Estimate roughly the relative increase of the highest frequency due to bending.

    Parameters
    ----------
    scene : Scene
        Scene with the film and the probes.
    count : int
        Number of modes.
    loaded : bool
        Whether the film vibrates about its loaded equilibrium.

    Notes
    -----
    Bending has two effects, which are added. At the clamped rim, a boundary layer of the length
    l = sqrt(D/N), with the bending stiffness D and the tension N, reduces the effective radius a of
    the membrane by l, which increases the frequencies by l/a. Waves with the wavenumber k have the
    stiffness N k^2 + D k^4, which increases the frequencies by (k l)^2/2.
    """
    effect = estimate_bending_effect(scene)
    length = (effect.rim_length if loaded else effect.unloaded_length) / scene.film.radius
    return float(length + 0.5 * (estimate_wavenumber(scene.film.outline, count) * length) ** 2)


def estimate_wavenumber(rim: Outline, count: int) -> float:
    """Estimate the wavenumber, times the hydraulic radius, of the highest of several modes.

    Notes
    -----
    Weyl's law for n modes of a membrane with the area A and the perimeter P is
    n = A k^2/(4 π) - P k/(4 π). With the hydraulic radius a = 2 A/P and q = 4 π A/P^2, which is 1
    for a disc, k a = 1 + sqrt(1 + 4 q n).
    """
    q = 2.0 * np.pi * rim.hydraulic_radius / rim.perimeter
    return 1.0 + float(np.sqrt(1.0 + 4.0 * q * count))
