"""Scene to solution: mesh, equilibrium, charges and their errors, refined until these are met.

A first mesh comes from sizes that the tolerance sets a priori (`first_sizes`); while the estimated
error of a charge exceeds the tolerance, the next mesh follows the indicators of that error. Of a
symmetric scene only a part is meshed; the whole film is put together when it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from skfem import Basis, MeshTri2

from pvdf_fem.charges.errors import charge_errors
from pvdf_fem.charges.forces import Goal, goals_of
from pvdf_fem.film.bending_effect import (
    CONSIDERABLE,
    BendingEffect,
    bending_effect,
    bending_joins,
)
from pvdf_fem.film.membrane import Array
from pvdf_fem.mesh.gmsh_mesh import MeshError, SizeField, Sizes, mesh_scene
from pvdf_fem.mesh.symmetry import WHOLE, Part, part_of
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import quote
from pvdf_fem.solution import admissible
from pvdf_fem.solution.attempt import Attempt, refined, solve_on
from pvdf_fem.solution.clock import Clock
from pvdf_fem.solution.fields import Fields, largest
from pvdf_fem.solution.first_sizes import ORDER, first_sizes
from pvdf_fem.solvers.newton import Iteration, Status
from pvdf_fem.solvers.wrinkling import barely_loaded

# Sizes aim at this part of the tolerance, and at this part of that whenever a mesh leaves more than
# the second part of the error: at singular corners it falls slower than sizes are chosen for.
SAFETY, SLOW = 0.5, 0.7
MAX_MESHES = 10
# Neither meshes of more unknowns are made nor more work is done, so that a solve takes less than
# 20 s on one core at the usual tolerance; a finer one may take longer. Work is that of Newton's
# iterations, of which an error estimate costs as much as so many unless it has its own, as in a
# film that wrinkles.
USUAL = 1e-3
MAX_UNKNOWNS = {"refuse": 60_000, "tension-field": 30_000}
MAX_WORK = {"refuse": 2.8e6, "tension-field": 1.9e6}
ESTIMATE = 8
# Of a film that bends only iterations with a fresh tangent count, each for so many, by unknowns.
ESTIMATE_BENT, FRESH = 14, 4
# A coarse mesh shows singular corners, and the kinks of a film that wrinkles, larger than they are
# and in the wrong places, so that the next one has at most so many times its unknowns. One that
# may only have less than the second part of them would not be better.
GROWTH, LEAST = 2.5, 0.7
# Unknowns grow as this power of the work of an iteration.
STEEPNESS = 0.8
# Relative error of a charge above which a film that is barely loaded is called slack.
UNKNOWN = 0.1
# Unknowns of an element, by order of the displacement.
UNKNOWNS = {1: 1.5, 2: 6.0, 3: 13.5}


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
        fields, d = self.fields, (d31_pC_N, d32_pC_N)
        values = charge_errors(fields.forces, fields.force_errors, d)
        return dict(zip(self._names, values.tolist(), strict=True))

    @property
    def _names(self) -> list[str]:
        return [electrode.name for electrode in self.scene.electrode_list]

    @property
    def deflection_max_mm(self) -> float:
        """Largest deflection."""
        fields = self.fields
        return 1e3 * largest(fields.solved.membrane.basis, fields.solved_dofs[2::3])

    @property
    def force_balance(self) -> float:
        """|rim reaction + applied force| over the applied force."""
        equilibrium, state = self.fields.solved, self.fields.solved_state
        applied = equilibrium.applied_force(state)
        return abs(equilibrium.rim_reaction(state) + applied) / applied if applied else 0.0

    @property
    def unknowns(self) -> int:
        """Number of equations on the last mesh, which may be that of a part of the film."""
        return self._fields.solved.unknowns.count if self._fields else 0

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
        from pvdf_fem.output.export import write_vtu  # meshio is slow to import

        write_vtu(self, Path(path))


def solve(
    scene: Scene,
    *,
    mesh: MeshTri2 | None = None,
    order: int = ORDER,
) -> Solution:
    """Charges and fields of a scene.

    Parameters
    ----------
    scene : Scene
    mesh : MeshTri2, optional
        Solve on this mesh of `mesh_scene`, of the whole film, whatever the error, instead of
        meshing for ``scene.numerics.tolerance``.
    order : int, optional
        Polynomial order of the displacement, 1, 2 or 3.

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
    order: int = ORDER,
) -> Solution:
    """`solve` for other charges than those of the scene's electrodes.

    The charges that meet the tolerance, and the `forces` and `force_errors` of the solution's
    `fields`, are those of the goals; a solution's charges by electrode have no meaning here.
    """
    clock, tolerance = Clock(), scene.numerics.tolerance
    if mesh is not None:
        return _finish(solve_on(scene, goals, mesh, WHOLE, order, clock), clock)
    try:
        attempt = _on_part(scene, goals, order, clock)
        if attempt is None:
            attempt = _adapted(scene, goals, WHOLE, order, clock)
    except MeshError as error:
        reason = f"{Status.MESH_FAILED.advice} ({error})"
        return Solution(scene, Status.MESH_FAILED, reason, seconds=clock.seconds())
    solution = _finish(attempt, clock)
    if solution.status is Status.CONVERGED and attempt.worst > tolerance:
        reason = f"{Status.TOLERANCE.advice} to at least {attempt.worst:.1e}, which was reached"
        solution = replace(solution, status=Status.TOLERANCE, reason=reason)
    missed = solution.status in (Status.MAX_ITERATIONS, Status.LIMIT, Status.UNBALANCED)
    unknown = solution.status is Status.TOLERANCE and attempt.worst > UNKNOWN
    if (missed or unknown) and barely_loaded(scene):
        solution = replace(solution, status=Status.SLACK, reason=Status.SLACK.advice)
    return solution


def _on_part(scene: Scene, goals: Sequence[Goal], order: int, clock: Clock) -> Attempt | None:
    """The solution on a part of a symmetric film, or None where it is not that of the film."""
    part = part_of(scene)
    if not part.mirrored:
        return None
    with suppress(MeshError):
        attempt = _adapted(scene, goals, part, order, clock)
        fields, converged = attempt.fields, attempt.result.status is Status.CONVERGED
        with clock("solve"):
            if converged and admissible.keeps_symmetry(fields.solved, fields.solved_state):
                return attempt
    return None


def _adapted(scene: Scene, goals: Sequence[Goal], part: Part, order: int, clock: Clock) -> Attempt:
    """The best of the solves on ever better meshes, or the first that has no result."""
    tolerance = scene.numerics.tolerance

    def solved(sizes: Sizes | SizeField, coarser: Attempt | None = None) -> Attempt:
        with clock("mesh"):
            mesh = mesh_scene(scene, sizes, part)
        return solve_on(scene, goals, mesh, part, order, clock, coarser)

    patience = max(1.0, USUAL / tolerance) ** 0.5
    largest_mesh, work = (x[scene.film.compression] * patience for x in (MAX_UNKNOWNS, MAX_WORK))
    attempt = best = solved(first_sizes(scene, order))
    aim = SAFETY * tolerance
    for _ in range(MAX_MESHES - 1):
        if attempt.result.status is not Status.CONVERGED or attempt.worst <= tolerance:
            break
        with clock("refine"):
            sizes = refined(attempt, aim)
        unknowns = attempt.fields.solved.unknowns.count
        done = _work(attempt)
        work -= done
        affordable = max(work / done, 0.0) ** STEEPNESS * unknowns
        most = min(GROWTH * unknowns, largest_mesh, affordable)
        if most < LEAST * unknowns:
            break
        finer = solved(sizes.coarsened(most / UNKNOWNS[order]), attempt)
        if finer.result.status is Status.MAX_ITERATIONS:
            break
        slow = finer.worst > SLOW * attempt.worst
        if slow:
            aim *= SAFETY
        attempt = finer
        if finer.result.status is Status.CONVERGED and finer.worst < best.worst:
            best = finer
        if slow and unknowns > LEAST * largest_mesh:
            break
    return best if attempt.result.status is Status.CONVERGED else attempt


def _work(attempt: Attempt) -> float:
    """The work of Newton's iterations, and what start and error estimate are worth in these."""
    solved, correction = attempt.fields.solved, attempt.correction
    result, rich = attempt.result, correction.iterations if correction else 0
    if solved.bending is not None:
        fresh = sum(row.fresh for row in result.iterations) + rich
        return solved.unknowns.count * (FRESH * fresh + ESTIMATE_BENT)
    own = attempt.lower_work + result.iteration_count * solved.iteration_work
    if correction is not None and rich > 0:
        return own + rich * correction.rich.iteration_work
    return own + ESTIMATE * solved.iteration_work


def _finish(attempt: Attempt, clock: Clock) -> Solution:
    status, fields = attempt.result.status, attempt.fields
    if status is Status.CONVERGED:
        factors = attempt.result.factors
        status = admissible.refusal(fields.solved, fields.solved_state, factors) or status
    scene, effect = attempt.scene, bending_effect(attempt.scene)
    return Solution(
        scene,
        status,
        status.advice,
        attempt.result.iterations,
        *_bending(scene, effect),
        (*_considerable(scene, effect), *admissible.warnings(fields.solved, fields.solved_state)),
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
