"""Scene to solution: mesh, equilibrium, charges and their errors, refined until these are met.

A first mesh comes from sizes that the tolerance sets a priori (`first_sizes`); while the estimated
error of a charge exceeds the tolerance, the next mesh follows the indicators of that error.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from skfem import Basis, MeshTri2

from pvdf_fem import admissible
from pvdf_fem.bending import LOWEST_ORDER
from pvdf_fem.bending_effect import (
    CONSIDERABLE,
    BendingEffect,
    bending_effect,
    bending_joins,
)
from pvdf_fem.charge import Goal, goal_forces, goal_gradients, goals_of
from pvdf_fem.equilibrium import Equilibrium
from pvdf_fem.estimate import Correction, indicators, prolongation
from pvdf_fem.membrane import Array
from pvdf_fem.mesh import MeshError, SizeField, Sizes, mesh_scene
from pvdf_fem.newton import Iteration, NewtonResult, Status
from pvdf_fem.refine import refined_sizes, transferred
from pvdf_fem.scene import Scene
from pvdf_fem.scene_file import quote
from pvdf_fem.sizes import first_sizes, order_for
from pvdf_fem.tension_newton import barely_loaded, corrected, equilibrate

# Sizes aim at this part of the tolerance.
SAFETY = 0.5
# Newton's last step in the orders below, whose discretisation errors are larger.
START_TOLERANCE = 3e-2
MAX_MESHES = 6
# Charges that a refined mesh follows, those with the largest errors.
MOST_DUALS = 32
# Meshes of more unknowns are not made, so that a solve takes less than 20 s on one core at the
# usual tolerance; a finer one may take longer.
USUAL = 1e-3
MAX_UNKNOWNS = {"refuse": 60_000, "tension-field": 20_000}
# The largest deflection is sought on this many points around the best one, on ever smaller scales.
ZOOM, ROUNDS = 8, 5
# Nor of so many iterations times unknowns: tension that concentrates in lines, as in a film that a
# load is far too small to pull taut, needs ever more of both.
HARD = 1e6
# A film that wrinkles has kinks that a coarse mesh shows in the wrong places, so that the next one
# has at most so many times its unknowns.
GROWTH = 5.0
# Of the charge that the film's mean stress would make: less is none, whose error is not relative.
NOTHING = 1e-6
# Unknowns of an element, by order of the displacement.
UNKNOWNS = {1: 1.5, 2: 6.0, 3: 13.5}
# The next order takes away only 0.55 to 0.8 of the error that the singular edge of a rigid probe
# makes, and the kinks of a film that wrinkles (measured on uniform and on refined meshes);
# estimates are raised by this.
EDGE_FACTOR = 1.6
# The same where bending acts within less than an element of an edge: 0.65 to 1.1.
LAYER_FACTOR = 1.5


class NotConvergedError(RuntimeError):
    """A result was asked of a solve that has none; the text says its status and what to change."""


@dataclass(frozen=True, eq=False)
class Solution:
    """How a solve ended and, if it converged, its fields and charges.

    Attributes
    ----------
    scene : Scene
    status : Status
        `Status.CONVERGED`, or why there is no result.
    iterations : tuple of Iteration
        Newton's table on the last mesh.
    left_out, included, warnings : tuple of str
        What the model neglects in this scene; what it has beyond the membrane; what to look at.
    seconds : dict
        ``mesh``, ``solve``, ``estimate`` and ``total``.
    reason : str
        The status in words, with what to change.
    """

    scene: Scene
    status: Status
    reason: str
    iterations: tuple[Iteration, ...] = ()
    left_out: tuple[str, ...] = ()
    included: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    _fields: Fields | None = None

    @property
    def fields(self) -> Fields:
        """The converged solution on its mesh; raises `NotConvergedError`."""
        if self._fields is None or self.status is not Status.CONVERGED:
            raise NotConvergedError(f"{self.status}: {self.reason}")
        return self._fields

    @property
    def mesh(self) -> MeshTri2:
        """Mesh in metres, with the patches as subdomains."""
        return self.fields.equilibrium.membrane.mesh

    @property
    def basis(self) -> Basis:
        """Scalar basis of each displacement component."""
        return self.fields.equilibrium.membrane.basis

    @property
    def displacement(self) -> Array:
        """u, v, w in m at the dofs of `basis`, (dofs, 3)."""
        return self.fields.displacement.reshape(-1, 3)

    @property
    def charges_pC(self) -> dict[str, float]:
        """Charge of each electrode."""
        return self.charges(self.scene.film.d31_pC_N, self.scene.film.d32_pC_N)

    @property
    def charge_errors_pC(self) -> dict[str, float]:
        """Estimated discretisation error of each charge, absolute."""
        return self.charge_errors(self.scene.film.d31_pC_N, self.scene.film.d32_pC_N)

    def charges(self, d31_pC_N: float, d32_pC_N: float) -> dict[str, float]:
        """Charges in pC of a film with other piezoelectric coefficients."""
        values = self.fields.forces @ [d31_pC_N, d32_pC_N]
        return dict(zip(self._names, values.tolist(), strict=True))

    def charge_errors(self, d31_pC_N: float, d32_pC_N: float) -> dict[str, float]:
        """Estimated errors in pC of `charges`."""
        values = np.abs(self.fields.force_errors @ [d31_pC_N, d32_pC_N])
        return dict(zip(self._names, values.tolist(), strict=True))

    @property
    def _names(self) -> list[str]:
        return [electrode.name for electrode in self.scene.electrode_list]

    @property
    def deflection_max_mm(self) -> float:
        """Largest deflection."""
        return 1e3 * largest(self.basis, self.displacement[:, 2])

    @property
    def force_balance(self) -> float:
        """|rim reaction + applied force| over the applied force."""
        equilibrium, state = self.fields.equilibrium, self.fields.state
        applied = equilibrium.applied_force(state)
        return abs(equilibrium.rim_reaction(state) + applied) / applied if applied else 0.0

    @property
    def unknowns(self) -> int:
        """Number of equations on the last mesh."""
        return self._fields.equilibrium.unknowns.count if self._fields else 0

    @property
    def newton_iterations(self) -> int:
        """Newton iterations on the last mesh."""
        return len(self.iterations)

    def to_json(self) -> dict[str, Any]:
        """What `pvdf-fem solve --json` prints; without results unless converged."""
        results: dict[str, Any] = {"reason": self.reason}
        if self.status is Status.CONVERGED:
            results = {
                "charges_pC": self.charges_pC,
                "charge_errors_pC": self.charge_errors_pC,
                "deflection_max_mm": self.deflection_max_mm,
                "force_balance": self.force_balance,
            }
        return {
            "status": str(self.status),
            **results,
            "observable": self.scene.numerics.observable,
            "unknowns": self.unknowns,
            "newton_iterations": self.newton_iterations,
            "left_out": list(self.left_out),
            "included": list(self.included),
            "warnings": list(self.warnings),
            "seconds": self.seconds,
        }

    def to_vtu(self, path: str | Path) -> None:
        """Write displacement, stresses and patches to a VTU file."""
        from pvdf_fem.export import write_vtu  # meshio is slow to import

        write_vtu(self, Path(path))


def largest(basis: Basis, values: Array) -> float:
    """Largest absolute value of a field with the nodal `values`, also between the nodes."""
    s = np.arange(-ZOOM, ZOOM + 1) / ZOOM
    offsets, width = np.stack(np.meshgrid(s, s), axis=-1).reshape(-1, 2), 0.5
    dofs = basis.element_dofs[:, np.abs(values)[basis.element_dofs].max(axis=0).argsort()[-ZOOM:]]
    best, places = 0.0, np.full((dofs.shape[1], 2), 0.5)
    for _ in range(ROUNDS):
        points = np.clip(places[:, None] + width * offsets, 0.0, 1.0)
        points /= np.maximum(points.sum(axis=-1, keepdims=True), 1.0)
        functions = [basis.elem.lbasis(points.reshape(-1, 2).T, i)[0] for i in range(basis.Nbfun)]
        found = np.einsum(
            "fep,fe->ep", np.reshape(functions, (-1, *points.shape[:2])), values[dofs]
        )
        places = points[np.arange(len(points)), np.abs(found).argmax(axis=1)]
        best, width = max(best, float(np.abs(found).max())), width / ZOOM * 2.0
    return best


@dataclass(frozen=True, eq=False)
class Fields:
    """A discrete solution: equations, unknowns, and the electrodes' forces with their errors."""

    equilibrium: Equilibrium
    q: Array
    forces: Array
    force_errors: Array

    @cached_property
    def displacement(self) -> Array:
        return self.equilibrium.unknowns.expand(self.q)

    @cached_property
    def state(self) -> Any:
        return self.equilibrium.state(self.q)


def solve(
    scene: Scene,
    *,
    mesh: MeshTri2 | None = None,
    order: int | None = None,
) -> Solution:
    """Charges and fields of a scene.

    Parameters
    ----------
    scene : Scene
    mesh : MeshTri2, optional
        Solve on this mesh of `mesh_scene`, whatever the error, instead of meshing for
        ``scene.numerics.tolerance``.
    order : int, optional
        Polynomial order of the displacement, 1, 2 or 3. When not given 3, or 2 for a rigid probe,
        whose singular edge needs small elements rather than a high order.

    Returns
    -------
    Solution
        Its `status` tells whether there is a result.
    """
    return solve_goals(scene, goals_of(scene), mesh=mesh, order=order)


def solve_goals(
    scene: Scene,
    goals: Sequence[Goal],
    *,
    mesh: MeshTri2 | None = None,
    order: int | None = None,
) -> Solution:
    """`solve` for other charges than those of the scene's electrodes.

    The charges that meet the tolerance, and the `forces` and `force_errors` of the solution's
    `fields`, are those of the goals; a solution's charges by electrode have no meaning here.
    """
    clock = Clock()
    order = order or order_for(scene)
    if mesh is not None:
        return _finish(_solve_on(scene, goals, mesh, order, clock), clock)
    tolerance = scene.numerics.tolerance
    try:
        first = _meshed(scene, first_sizes(scene, order), clock)
        attempt = _solve_on(scene, goals, first, order, clock)
        for _ in range(MAX_MESHES - 1):
            if attempt.result.status is not Status.CONVERGED or attempt.worst <= tolerance:
                break
            with clock("refine"):
                sizes = _refined(attempt, SAFETY * tolerance)
            unknowns = attempt.fields.equilibrium.unknowns.count
            most = MAX_UNKNOWNS[scene.film.compression] * max(1.0, USUAL / tolerance) ** 0.5
            if unknowns > 0.7 * most:
                break
            if scene.film.compression == "tension-field":
                most = min(most, GROWTH * unknowns)
                if len(attempt.result.iterations) * most > HARD:
                    break
            sizes = sizes.coarsened(most / UNKNOWNS[order])
            finer = _solve_on(scene, goals, _meshed(scene, sizes, clock), order, clock, attempt)
            if finer.result.status is Status.MAX_ITERATIONS:
                break
            attempt = finer
    except MeshError as error:
        reason = f"{Status.MESH_FAILED.advice} ({error})"
        return Solution(scene, Status.MESH_FAILED, reason, seconds=clock.seconds())
    solution = _finish(attempt, clock)
    if solution.status is Status.CONVERGED and attempt.worst > tolerance:
        reason = f"{Status.TOLERANCE.advice} to at least {attempt.worst:.1e}, which was reached"
        solution = replace(solution, status=Status.TOLERANCE, reason=reason)
    missed = solution.status in (Status.MAX_ITERATIONS, Status.UNBALANCED)
    if missed and barely_loaded(scene):
        solution = replace(solution, status=Status.SLACK, reason=Status.SLACK.advice)
    return solution


def _meshed(scene: Scene, sizes: Sizes | SizeField, clock: Clock) -> MeshTri2:
    with clock("mesh"):
        return mesh_scene(scene, sizes)


@dataclass(frozen=True, eq=False)
class Attempt:
    """A solve on one mesh: Newton's result, the correction and the worst charge's error."""

    scene: Scene
    goals: Sequence[Goal]
    result: NewtonResult
    fields: Fields
    correction: Correction | None

    @property
    def worst(self) -> float:
        """Largest of the `charge_errors`."""
        return float(np.max(self.charge_errors, initial=0.0))

    @property
    def charge_errors(self) -> Array:
        """Estimated error of each charge over the sizes of its two contributions, (goals,)."""
        return np.abs((self.fields.force_errors * self._d).sum(axis=1)) / self.charge_sizes

    @property
    def charge_sizes(self) -> Array:
        """|d31 X| + |d32 Y| of each electrode in C, (goals,), or what is nothing beside the film's.

        An electrode on slack film, or under a probe that holds it, has next to none.
        """
        membrane, state = self.fields.equilibrium.membrane, self.fields.state
        stress = np.abs(membrane.stress(state.strain)[..., :2]) * membrane.weights[..., None]
        mean = stress.sum(axis=(0, 1)) / membrane.weights.sum()
        areas = np.array([goal.outline.area for goal in self.goals])
        sizes = np.abs(self.fields.forces * self._d).sum(axis=1)
        sizes = np.maximum(sizes, NOTHING * areas * (np.abs(self._d) @ mean))
        return np.where(sizes > 0.0, sizes, 1.0)

    @property
    def _d(self) -> Array:
        return np.reshape([goal.d for goal in self.goals], (-1, 2))


def _solve_on(
    scene: Scene,
    goals: Sequence[Goal],
    mesh: MeshTri2,
    order: int,
    clock: Clock,
    coarser: Attempt | None = None,
) -> Attempt:
    with clock("solve"):
        equilibrium = Equilibrium(scene, mesh, order)
        # what a change of mesh leaves of a heated film's stress leads nowhere
        if coarser is None or scene.film.thermal_strain > 0.0:
            start = _start(equilibrium)
        else:
            start = _carried_over(coarser, equilibrium)
        result = equilibrate(equilibrium, start, near=start is not None)
        x = equilibrium.unknowns.expand(result.q)
        forces = goal_forces(goals, equilibrium.membrane, x)
    correction, errors = None, np.zeros_like(forces)
    if result.status is Status.CONVERGED and result.factors is not None:
        with clock("estimate"):
            rich = Equilibrium(scene, mesh, order + 1)
            found = corrected(equilibrium, result.q, result.factors, rich)
        if isinstance(found, Status):
            result = replace(result, status=found)
        else:
            correction = found
            x = rich.unknowns.expand(correction.q)
            errors = goal_forces(goals, rich.membrane, x) - forces
            if equilibrium.bending is not None:
                errors *= LAYER_FACTOR
            elif scene.load.kind == "rigid" or scene.film.compression == "tension-field":
                errors *= EDGE_FACTOR
    return Attempt(scene, goals, result, Fields(equilibrium, result.q, forces, errors), correction)


def _start(equilibrium: Equilibrium) -> Array | None:
    """The solution of the order below, which costs less than the iterations that it saves."""
    order = equilibrium.membrane.order
    if order == (1 if equilibrium.bending is None else LOWEST_ORDER):
        return None
    lower = Equilibrium(equilibrium.scene, equilibrium.membrane.mesh, order - 1)
    start = _start(lower)
    result = equilibrate(lower, start, START_TOLERANCE, near=start is not None)
    if result.status is not Status.CONVERGED:
        return None
    return prolongation(lower, equilibrium) @ result.q


def _carried_over(coarser: Attempt, equilibrium: Equilibrium) -> Array:
    known = coarser.fields.equilibrium.membrane.basis
    x = transferred(known, coarser.fields.displacement, equilibrium.membrane.basis)
    return equilibrium.unknowns.restrict(x)


def _refined(attempt: Attempt, tolerance: float) -> SizeField:
    """Element sizes at which the worst error would be `tolerance`."""
    correction, factors = attempt.correction, attempt.result.factors
    if correction is None or factors is None:
        raise ValueError("only a converged attempt can be refined")
    rich = correction.rich
    x = rich.unknowns.expand(correction.start)
    worst = np.argsort(attempt.charge_errors)[-MOST_DUALS:]
    goals = [attempt.goals[i] for i in worst]
    gradients = goal_gradients(goals, rich.membrane, x) / attempt.charge_sizes[worst]
    shares = indicators(correction, factors, gradients)
    return refined_sizes(rich.membrane.mesh, shares.max(axis=1), tolerance / attempt.worst)


def _finish(attempt: Attempt, clock: Clock) -> Solution:
    status, fields = attempt.result.status, attempt.fields
    if status is Status.CONVERGED:
        factors = attempt.result.factors
        status = admissible.refusal(fields.equilibrium, fields.state, factors) or status
    scene, effect = attempt.scene, bending_effect(attempt.scene)
    return Solution(
        scene,
        status,
        status.advice,
        attempt.result.iterations,
        *_bending(scene, effect),
        (*_considerable(scene, effect), *admissible.warnings(fields.equilibrium, fields.state)),
        clock.seconds(),
        fields,
    )


def _bending(scene: Scene, effect: BendingEffect) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What the model leaves out and what it includes: bending, with the reason."""
    remark = f"bending (film.bending = {quote(scene.film.bending)}): {effect}"
    return ((), (remark,)) if bending_joins(scene) else ((remark,), ())


def _considerable(scene: Scene, effect: BendingEffect) -> Iterator[str]:
    """A warning where bending, left out, could change a charge considerably."""
    change = effect.change
    if not bending_joins(scene) and change > max(scene.numerics.tolerance, CONSIDERABLE):
        yield (
            f"bending: left out, it could change a charge by up to {change:.1e} of it;"
            ' give film.bending = "auto" or true'
        )


class Clock:
    """Adds up the seconds of named stages."""

    def __init__(self) -> None:
        self._start = time.perf_counter()
        self._stages: dict[str, float] = {}

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            elapsed = time.perf_counter() - start
            self._stages[stage] = self._stages.get(stage, 0.0) + elapsed

    def seconds(self) -> dict[str, float]:
        """Seconds by stage, and ``total`` since the clock was made."""
        return {**self._stages, "total": time.perf_counter() - self._start}
