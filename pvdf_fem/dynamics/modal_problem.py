"""The modes of a film on a sequence of meshes: sizes of elements, solves and errors.

Frequencies converge from above, with the fourth power of the element size for quadratic elements.
The mesh starts from that law for the flat film and is refined until the estimated errors are below
``numerics.tolerance``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from skfem import MeshTri2

from pvdf_fem.dynamics.spectrum import EquilibriumState, Spectrum, compute_spectra
from pvdf_fem.film.bending.effect import choose_layer_size, estimate_bending_effect
from pvdf_fem.mesh.size_field import GradedSizes
from pvdf_fem.mesh.subdomains import FILM
from pvdf_fem.problem.equilibrium import Equilibrium
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive_loop import AdaptiveLoop
from pvdf_fem.solver.estimate.correction import correct_in_richer_space
from pvdf_fem.solver.history import StageTimer, Stop
from pvdf_fem.solver.mesh_level import UNKNOWNS_PER_ELEMENT
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.fallback import find_equilibrium
from pvdf_fem.solver.nonlinear.newton import FailedAttempt, NewtonResult
from pvdf_fem.solver.nonlinear.status import Status

#: Error of a frequency of the flat disc over (wavenumber x element size)^4, measured.
FLAT_ERROR = 4e-4
#: Order of a frequency's error in the element size.
ERROR_ORDER = 4.0
#: Newton iterations that cost as much as an eigenvalue problem.
ITERATIONS_PER_EIGENPROBLEM = 3


@dataclass(frozen=True, eq=False)
class ModalLevel:
    """The modes on one mesh, or the reason for which there are none."""

    equilibrium: Equilibrium
    status: Status
    #: Newton iterations to the equilibrium.
    iterations: int = 0
    #: Solvers that failed before.
    failed_attempts: tuple[FailedAttempt, ...] = ()
    #: By `VACUUM` and `AIR`; empty unless converged.
    spectra: Mapping[str, Spectrum] = field(default_factory=dict)

    @property
    def worst(self) -> float:
        """Largest relative error of a frequency; zero without modes."""
        largest = 0.0
        for spectrum in self.spectra.values():
            largest = max(largest, float(np.max(spectrum.errors / spectrum.frequencies)))
        return largest

    @property
    def bound(self) -> float:
        """The error that is compared with the tolerance."""
        return self.worst

    @property
    def unknowns(self) -> int:
        """Number of unknowns."""
        return self.equilibrium.unknowns.count


@dataclass(eq=False)
class ModalProblem:
    """The modes of one film, to be solved on any mesh."""

    #: The film, with the probes that have an effect on its modes.
    problem: Problem
    #: Number of modes.
    count: int
    #: Whether the film vibrates about its equilibrium under the load.
    loaded: bool
    #: Relative increase of the highest frequency by bending, roughly.
    bending_share: float
    budget: Budget
    timer: StageTimer = field(default_factory=StageTimer)
    #: Sizes of the last mesh.
    sizes: GradedSizes | None = None
    #: Called at each linear solve of an eigenvalue problem.
    on_solve: Callable[[], None] = lambda: None

    @classmethod
    def with_default_budget(
        cls, problem: Problem, count: int, loaded: bool, bending_share: float
    ) -> ModalProblem:
        """Make the modal problem with the budget that follows from its numerics.

        Parameters
        ----------
        problem : Problem
            The film, with the probes that have an effect on its modes.
        count : int
            Number of modes.
        loaded : bool
            Whether the film vibrates about its equilibrium under the load.
        bending_share : float
            Relative increase of the highest frequency by bending, from `estimate_bending_share`.
        """
        return cls(problem, count, loaded, bending_share, budget=_make_budget(problem))

    def solve(self) -> tuple[ModalLevel, Stop]:
        """Solve on ever finer meshes, and return the best level with the reason to stop.

        Raises
        ------
        MeshError
            When there is no first mesh.
        TooManyUnknownsError
            When the first mesh would be too large.
        """
        loop = AdaptiveLoop(
            self.problem,
            self.choose_first_sizes,
            self.solve_on,
            self.choose_next_sizes,
            self.budget,
            self.timer,
            UNKNOWNS_PER_ELEMENT[2],
        )
        return loop.run()

    def choose_first_sizes(self) -> GradedSizes:
        """Choose sizes that meet half the tolerance for the flat film."""
        scene = self.problem.scene
        tolerance = scene.numerics.tolerance
        wavelengths = (0.5 * tolerance / FLAT_ERROR) ** (1.0 / ERROR_ORDER)
        size = scene.film.radius * min(wavelengths / estimate_wavenumber(self.count), 0.3)
        patch_sizes = {}
        for load in scene.loaded_probes:
            width = load.outline.area / load.outline.perimeter
            patch_sizes[load.patch] = min(size, width)
        if self.problem.film.bends:
            layer = choose_layer_size(
                estimate_bending_effect(scene).rim_length, self.bending_share, tolerance
            )
            patch_sizes[FILM] = min(size, layer)
        self.sizes = GradedSizes(patch_sizes, 0.4, size)
        return self.sizes

    def choose_next_sizes(
        self, level: ModalLevel, tolerance: float, max_unknowns: float
    ) -> GradedSizes:
        """Choose sizes at which the largest error would be a tolerance, by the law of its order.

        Parameters
        ----------
        level : ModalLevel
            The solve with the last sizes.
        tolerance : float
            Relative error of a frequency.
        max_unknowns : float
            Largest number of unknowns.
        """
        assert self.sizes is not None
        by_error = (tolerance / level.worst) ** (1.0 / ERROR_ORDER)
        smallest = max(0.25, (level.unknowns / max_unknowns) ** 0.5)
        self.sizes = self.sizes.scale(float(np.clip(by_error, smallest, 0.8)))
        return self.sizes

    def solve_on(self, mesh: MeshTri2, coarser: ModalLevel | None) -> ModalLevel:
        """Solve for the modes on a mesh.

        Parameters
        ----------
        mesh : MeshTri2
            Mesh of six-node triangles.
        coarser : ModalLevel or None
            The solve on the mesh before, which is not used.
        """
        order = max(2, self.problem.film.kinematics.lowest_order + 1)
        coarse = Equilibrium(self.problem, mesh, order)
        rich = Equilibrium(self.problem, mesh, order + 1)
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
    """Return whether a flat film has no stiffness in some direction, so that no mode is lowest."""
    if equilibrium.model.bends:
        return False
    least_stress = equilibrium.film.prestress[:2].min()
    return bool(least_stress == 0.0 or (equilibrium.model.wrinkles and least_stress < 0.0))


def _make_budget(problem: Problem, default_unknowns: int = 180_000) -> Budget:
    """Return the budget of the modes; by default the same number of unknowns at any tolerance."""
    max_unknowns = problem.scene.numerics.max_unknowns or default_unknowns
    return replace(Budget.for_problem(problem), max_unknowns=max_unknowns, bounds_first_mesh=True)


def estimate_bending_share(scene: Scene, count: int, loaded: bool) -> float:
    """Estimate the relative increase of the highest frequency by bending, roughly.

    Parameters
    ----------
    scene : Scene
        Film and probes.
    count : int
        Number of modes.
    loaded : bool
        Whether the film vibrates about its equilibrium under the load.

    Notes
    -----
    Bending stiffens the film within the length l = sqrt(D/N) of the rim, which makes the membrane
    smaller by l all round, and by the stiffness D k^4 beside N k^2 for waves of number k.
    """
    effect = estimate_bending_effect(scene)
    length = (effect.rim_length if loaded else effect.unloaded_length) / scene.film.radius
    return float(length + 0.5 * (estimate_wavenumber(count) * length) ** 2)


def estimate_wavenumber(count: int) -> float:
    """Return k a of the disc's mode of a number n, by Weyl's law n = (k a)^2/4 - k a/2."""
    return 1.0 + float(np.sqrt(1.0 + 4.0 * count))
