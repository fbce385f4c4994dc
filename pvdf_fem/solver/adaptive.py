"""Scene to solution: mesh, solve, estimate, and refine until every charge is within the tolerance.

A first mesh comes from sizes that the tolerance sets a priori (`choose_first_sizes`); while an
estimated charge error exceeds the tolerance, the next mesh follows its error indicators. Of a
symmetric scene only a part is meshed; the whole film is put together when it is asked for.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
from skfem import MeshTri2

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.outputs import Output, make_outputs
from pvdf_fem.electrodes.stress_integrals import (
    StressIntegrals,
    combine_charges,
    select_larger_errors,
)
from pvdf_fem.electrodes.thickness import describe_thickness_effect
from pvdf_fem.electrodes.unloaded import find_uniform_integrals, unload
from pvdf_fem.film.electric.coupling import describe_coupling
from pvdf_fem.film.loads.contact_edge import measure_contact_outlines
from pvdf_fem.film.loads.contact_estimate import estimate_tip_outlines
from pvdf_fem.film.loads.contact_result import select_tips
from pvdf_fem.film.loads.load_spec import DEFAULT_OPTIONS, Pressure, SolveOptions
from pvdf_fem.film.loads.profiles import make_profile, pin_profile_files
from pvdf_fem.film.loads.uneven_strain import describe_heat_effects
from pvdf_fem.film.loads.weight import describe_weight
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.mesh.gmsh_mesh import MeshError
from pvdf_fem.mesh.mesh_file import as_mesh
from pvdf_fem.mesh.symmetry import WHOLE_FILM, SymmetrySector, find_symmetry_sector
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.scene.outlines.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import SceneError, format_error
from pvdf_fem.solver import acceptance as admissible
from pvdf_fem.solver.adaptive_loop import AdaptiveLoop, TooManyUnknownsError
from pvdf_fem.solver.first_sizes import ORDER, choose_first_sizes
from pvdf_fem.solver.history import MeshRecord, StageTimer, Stop
from pvdf_fem.solver.mesh_level import (
    UNKNOWNS_PER_ELEMENT,
    MeshLevel,
    Problem,
    choose_next_sizes,
    solve_on_mesh,
)
from pvdf_fem.solver.nonlinear.budget import Budget
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.nonlinear.wrinkling import is_barely_loaded
from pvdf_fem.solver.solution import Solution

#: Relative charge error above which a barely loaded film is called slack.
UNKNOWN_CHARGE = 0.1


class UnloadedFilmError(SceneError):
    """The untouched film has no charges at rest; the line names the key and the reason."""

    @classmethod
    def of(cls, scene: Scene, status: str, reason: str) -> UnloadedFilmError:
        """The error of a scene, by how the solve of its untouched film ended."""
        film = scene.film
        moved = ["rim_displacement_um", "patches"] if film.has_unbalanced_prestress else []
        keys = [*moved, "gravity_m_s2", "pretension_N_m", "temperature_change_K"]
        key = next(key for key in keys if getattr(film, key) is not None)
        if status == Status.UNSTABLE:
            reason = "it is in compression; stretch it more"
            wrinkles = ', or let it wrinkle (film.compression = "tension-field")'
            reason += "" if film.has_unbalanced_prestress else wrinkles
        told = f"leaves the untouched film without charges at rest ({status}): {reason}"
        return cls([format_error(f"film.{key}", getattr(film, key), told)])


def solve(
    scene: SceneLike,
    *,
    mesh: MeshTri2 | str | Path | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
    pressure: Pressure | None = None,
) -> Solution:
    """`pvdf_fem.solve`, without deviations by the scene's uncertain numbers."""
    scene = as_scene(scene)
    options = SolveOptions.for_pressure(scene, pressure)
    order = coerce("order", order, int, (1, max(UNKNOWNS_PER_ELEMENT)))
    budget = coerce("budget", budget or Budget.of(scene), Budget)
    if mesh is not None:
        mesh = as_mesh(mesh, scene)
    start, outputs = time.perf_counter(), make_outputs(scene)
    solution = solve_outputs(scene, outputs, mesh=mesh, order=order, budget=budget, options=options)
    warnings, at_rest = [*scene.warnings, *solution.warnings], None
    if solution.status is Status.CONVERGED:
        warnings += admissible.warn_of_cancelled_charges(scene, solution.discrete.stress_integrals)
        at_rest = _at_rest(unload(scene), budget)
    if isinstance(at_rest, UnloadedFilmError):
        warnings, at_rest = [*warnings, *at_rest.problems], None
    seconds = solution.seconds | {"total": time.perf_counter() - start}
    return replace(solution, warnings=tuple(warnings), at_rest=at_rest, seconds=seconds)


def compute_unloaded_integrals(scene: Scene, needed: bool = True) -> StressIntegrals:
    """Forces X, Y by electrode on the untouched film, with their errors. Without a result the
    forces are NaN, or raise `UnloadedFilmError` if `needed`."""
    found = _kept_at_rest(unload(scene))
    if not isinstance(found, UnloadedFilmError):
        return found
    if needed:
        raise found
    return StressIntegrals.unknown(len(scene.electrode_list))


def compute_unloaded_charges(scene: Scene) -> Array:
    """Charges in C of `compute_unloaded_integrals`, (electrodes,)."""
    return compute_unloaded_integrals(scene).charges((scene.film.d31, scene.film.d32))


def _at_rest(film: Scene, budget: Budget) -> StressIntegrals | UnloadedFilmError:
    """Electrode forces on an untouched film, or the reason for their absence."""
    if (known := find_uniform_integrals(film)) is not None:
        return known
    solution = solve_outputs(film, make_outputs(film), budget=budget)
    if solution.status is not Status.CONVERGED:
        return UnloadedFilmError.of(film, solution.status, solution.reason)
    return solution.discrete.stress_integrals


@lru_cache(maxsize=64)
def _kept_at_rest(film: Scene) -> StressIntegrals | UnloadedFilmError:
    return _at_rest(film, Budget.of(film))


def solve_outputs(
    scene: Scene,
    outputs: Sequence[Output],
    *,
    mesh: MeshTri2 | None = None,
    order: int = ORDER,
    budget: Budget | None = None,
    options: SolveOptions = DEFAULT_OPTIONS,
) -> Solution:
    """`solve` for the charges in `outputs` instead of the scene's electrodes.

    The goals' charges meet the tolerance, and `forces` in the solution's `fields` are the goals'
    forces; a solution's charges by electrode have no meaning here.
    """
    for touch in options.load_specs(scene):  # before any mesh, files and functions are refused
        make_profile(touch).mean(touch.outline.equal_area_polygon)
    (scene,) = pin_profile_files([scene])
    if mesh is not None:
        scene.require_no_tips("a mesh that is given")
    budget = Budget.of(scene) if budget is None else budget

    solution = _solved(Problem(scene, outputs, order, budget, StageTimer(), options), mesh)
    included = (*options.notes, *solution.included)
    return replace(solution, scene=scene, pressure=options.pressure, included=included)


def _solved(problem: Problem, mesh: MeshTri2 | None) -> Solution:
    """The solution of a problem on a given mesh, or on meshes for its tolerance."""
    scene = problem.scene
    loop = _mesh_loop(problem, WHOLE_FILM if mesh is not None else _part(problem))
    if mesh is not None:
        attempt = loop.attempt_on(mesh, None, time.perf_counter())
        return _solution(attempt, Stop.GIVEN_MESH, loop.history)
    try:
        attempt, stop = loop.run()
    except MeshError as error:
        reason = f"{Status.MESH_FAILED.advice} ({error})"
        seconds = problem.clock.seconds()
        return Solution(scene, Status.MESH_FAILED, reason, Stop.NO_MESH, seconds=seconds)
    except TooManyUnknownsError as error:
        seconds = problem.clock.seconds()
        return Solution(scene, Status.TOLERANCE, str(error), error.stop, seconds=seconds)
    return _solution(attempt, stop, loop.history)


def _part(problem: Problem) -> SymmetrySector:
    """The part of a symmetric film to unfold; else the whole film."""
    scene, model = problem.scene, resolve_film_model(problem.scene)
    leaning = scene.tips or any(touch.load.tilt == "free" for touch in scene.loaded_probes)
    whole = leaning or problem.options.pressure
    if whole or not (model.solved_on_parts and model.electrodes_only_read):
        return WHOLE_FILM
    return find_symmetry_sector(scene)


def _mesh_loop(problem: Problem, part: SymmetrySector) -> AdaptiveLoop[MeshLevel]:
    return AdaptiveLoop(
        problem.scene,
        partial(choose_first_sizes, problem.scene, problem.order),
        partial(solve_on_mesh, problem, part),
        choose_next_sizes,
        problem.budget,
        problem.clock,
        UNKNOWNS_PER_ELEMENT[problem.order],
        part,
        partial(_contacts, problem.scene),
    )


def _contacts(scene: Scene, attempt: MeshLevel | None) -> dict[str, Outline]:
    """Contact outlines for a mesh: guessed, or found by an attempt."""
    if attempt is None:
        return estimate_tip_outlines(scene)
    state = attempt.discrete.solved_state
    found = (measure_contact_outlines(tip, state) for tip in select_tips(attempt.equilibrium))
    return {name: outline for outlines in found for name, outline in outlines.items()}


def _solution(attempt: MeshLevel, stop: Stop, history: Sequence[MeshRecord]) -> Solution:
    """The attempt as a solution, with its status."""
    problem, fields, change = attempt.problem, attempt.discrete, None
    if (changes := admissible.estimate_wrinkling_changes(attempt)) is not None:
        by_charge = np.abs(combine_charges(problem.outputs, changes)) / attempt.charge_sizes
        change = float(by_charge.max(initial=0.0))
        errors = select_larger_errors(fields.stress_integrals.errors, changes, problem.outputs)
        fields = replace(fields, stress_integrals=replace(fields.stress_integrals, errors=errors))
    scene, status = problem.scene, _status(attempt, stop, change)
    model = resolve_film_model(scene)
    by_stress = fields.stress_integrals.charges((scene.film.d31_pC_N, scene.film.d32_pC_N)).tolist()
    names = [electrode.name for electrode in scene.electrode_list]
    # scenes solved together in a sweep share a list of goals, longer than the electrodes
    charges_pC = dict(zip(names, by_stress, strict=True)) if len(names) == len(by_stress) else None
    remarks = [model.remark, *describe_coupling(scene)]
    remarks += describe_thickness_effect(scene, charges_pC, problem.options)
    remarks += [*describe_heat_effects(scene, charges_pC), *describe_weight(scene)]
    reason = status.advice
    if status is Status.TOLERANCE:
        enough = 1.05 * attempt.bound  # no smaller in two digits
        reason = f"{reason}, to at least {enough:.1e}, which can be reached ({stop.value})"
    elif status is Status.CONVERGED and (change or 0.0) > problem.scene.numerics.tolerance:
        reason = f"{reason}, but for {change:.1e} of a charge that wrinkles would change"
    return Solution(
        problem.scene,
        status,
        reason,
        stop,
        tuple(history),
        attempt.result.iterations,
        tuple(text for included, text in remarks if not included),
        tuple(text for included, text in remarks if included),
        (*model.warnings, *admissible.list_warnings(fields.solved, fields.solved_state, change)),
        problem.clock.seconds(),
        _discrete=fields,
    )


def _status(attempt: MeshLevel, stop: Stop, change: float | None) -> Status:
    """How the solve ended; `change` is the relative change of a charge by wrinkles."""
    scene, fields, status = attempt.problem.scene, attempt.discrete, attempt.result.status
    if status is Status.CONVERGED:
        status = admissible.find_rejection_status(fields, attempt.result.factors, change) or status
    if stop is Stop.GIVEN_MESH:
        return status
    if status is Status.CONVERGED and attempt.bound > scene.numerics.tolerance:
        status = Status.TOLERANCE
    missed = status in (Status.MAX_ITERATIONS, Status.UNBALANCED)
    if missed and admissible.is_tip_at_rim(fields):
        return Status.RIM
    unknown = status is Status.TOLERANCE and attempt.worst > UNKNOWN_CHARGE
    slack = resolve_film_model(scene).wrinkles and is_barely_loaded(scene)
    return Status.SLACK if slack and (missed or unknown) else status
