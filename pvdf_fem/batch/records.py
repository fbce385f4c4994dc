"""Records of scenes from their common solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.batch.store import Record
from pvdf_fem.electrodes.observables import OBSERVABLES, Observable
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.electrodes.unloaded import compute_uniform_integrals
from pvdf_fem.mesh.subdomains import make_subdomain_name
from pvdf_fem.problem.equivalence import DIGITS
from pvdf_fem.problem.outputs import Output
from pvdf_fem.problem.problem import Problem
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.acceptance import list_cancellation_warnings
from pvdf_fem.solver.adaptive import UnloadedFilmError, solve_outputs
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution

#: Statuses that may be due to the outputs of other scenes, or to a mesh without electrodes.
RETRIED = (Status.TOLERANCE, Status.SLACK, Status.MESH_FAILED)


def make_records(scenes: Sequence[Scene], frames: Array) -> list[Record]:
    """Solve scenes whose films have the same deformation together, and make their records.

    The mesh follows the first scene's electrodes if the electrodes of all scenes coincide with
    these, and otherwise no electrodes. If the solve of several scenes ends with one of the statuses
    `RETRIED`, each of them is solved separately.

    Parameters
    ----------
    scenes : sequence of Scene
        Scenes with the same mechanical key.
    frames : ndarray, shape (scenes, 2, 2)
        Orthogonal matrices from the scenes' axes to those of the first scene; the first one is the
        identity.

    Returns
    -------
    list of Record
        One for each scene, without the stress integrals of the unloaded film.
    """
    problems = [Problem.from_scene(scene) for scene in scenes]
    outputs, indices = _collect_outputs(problems, frames)
    followed = _replace_mesh_patches(outputs, problems[0])
    if followed is not None:
        outputs = followed
        solution = solve_outputs(Problem.from_scene(scenes[0], outputs=outputs))
    else:
        # Electrodes that differ share a solve only if they just read the stress
        # (`Problem.has_passive_electrodes`): the film may be solved without them.
        bare = _remove_electrodes(problems[0])
        solution = solve_outputs(Problem.from_scene(bare, outputs=outputs))
    if len(scenes) > 1 and solution.status in RETRIED:
        records = []
        for scene in scenes:
            records += make_records([scene], frames[:1])
        return records
    return _split_solution(solution, outputs, problems=problems, indices=indices)


def _remove_electrodes(problem: Problem) -> Scene:
    """Return a copy of the scene without electrodes; it bends if the problem's film bends."""
    film = problem.scene.film.model_copy(update={"bending": problem.film.bends})
    return problem.scene.model_copy(update={"electrodes": (), "film": film})


def add_unloaded_integrals(record: Record, problem: Problem, unloaded: Record | None) -> Record:
    """Add the stress integrals of the unloaded film to a scene's record.

    Parameters
    ----------
    record : Record
        The record of the problem's scene.
    problem : Problem
        The loaded problem, from which the unloaded film is derived.
    unloaded : Record or None
        The record of the unloaded film; None if this needs no solve or is the scene itself.

    Returns
    -------
    Record
        A copy with the integrals. If the unloaded film has no solution, it is a copy with a warning
        about that, or `record` itself if the scene has no solution either. If the solve of the
        unloaded film has crashed, its status and reason become those of the copy.
    """
    scene = problem.scene
    uniform = compute_uniform_integrals(problem)
    if uniform is not None:
        return _add_unloaded_film_integrals(record, uniform)
    solved = record if unloaded is None else unloaded
    if solved.status not in Status.__members__.values():  # the solve has crashed
        return replace(record, status=solved.status, reason=solved.reason)
    if solved.converged:
        integrals = solved.integrals_by(str(scene.numerics.observable))
        return _add_unloaded_film_integrals(record, integrals)
    if not record.converged:
        return record
    error = UnloadedFilmError.from_status(scene, solved.status, solved.reason)
    return replace(record, warnings=(*record.warnings, *error.problems))


def _add_unloaded_film_integrals(record: Record, integrals: StressIntegrals) -> Record:
    """Return a copy of a record with the stress integrals of the unloaded film."""
    return replace(
        record,
        unloaded_integrals=integrals.values.tolist(),
        unloaded_integral_errors=integrals.errors.tolist(),
    )


def _split_solution(
    solution: Solution,
    outputs: Sequence[Output],
    *,
    problems: Sequence[Problem],
    indices: Sequence[Sequence[int]],
) -> list[Record]:
    """Make the records of scenes from their common solution.

    `indices` has a list for each scene: the indices of its electrodes in `outputs`. Without a
    converged solution the records have no stress integrals.

    Parameters
    ----------
    solution : Solution
        The common solution.
    outputs : sequence of Output
        Outputs of the common solution.
    problems : sequence of Problem
        Problems of the scenes.
    indices : sequence of sequence of int
        For each scene, the indices of its electrodes in `outputs`.
    """
    names = []
    for problem in problems:
        names.append(tuple(electrode.name for electrode in problem.scene.electrode_list))
    has_converged = solution.status is Status.CONVERGED
    shared = Record(
        status=str(solution.status),
        reason=solution.reason,
        electrodes=(),
        deflection_max_mm=solution.deflection_max_mm if has_converged else 0.0,
        warnings=solution.warnings,
        seconds=solution.seconds["total"] / len(problems),
    )
    if not has_converged:
        return [replace(shared, electrodes=electrodes) for electrodes in names]
    # a thicker film under more force may share the solve, but not the warnings about bending
    own_warnings = solution.problem.film.warnings
    common_warnings = [text for text in solution.warnings if text not in own_warnings]
    integrals = {}
    for name, observable in OBSERVABLES.items():
        integrals[name] = _evaluate_observable(solution, outputs, observable)
    records = []
    for problem, electrodes, rows in zip(problems, names, indices, strict=True):
        scene = problem.scene
        defined = {}
        for name, values in integrals.items():
            if all(OBSERVABLES[name].is_defined_for(outputs[row]) for row in rows):
                defined[name] = values[rows].tolist()
        solved = solution.discrete.stress_integrals.of(rows)
        warnings = [*problem.film.warnings, *common_warnings]
        warnings += list_cancellation_warnings(scene, solved)
        record = replace(
            shared,
            electrodes=electrodes,
            integrals=defined,
            integral_errors={str(scene.numerics.observable): solved.errors.tolist()},
            warnings=tuple(warnings),
        )
        records.append(record)
    return records


def _collect_outputs(
    problems: Sequence[Problem], frames: Array
) -> tuple[list[Output], list[list[int]]]:
    """Collect the distinct outputs of problems.

    Parameters
    ----------
    problems : sequence of Problem
        The problems.
    frames : ndarray, shape (problems, 2, 2)
        Matrices from the axes of the problems to those of the mesh.

    Returns
    -------
    outputs : list of Output
        The outputs, without repetitions.
    indices : list of list of int
        For each problem, the indices of its electrodes in `outputs`.
    """
    outputs: list[Output] = []
    index_of: dict[tuple[object, ...], int] = {}
    indices: list[list[int]] = []
    for problem, frame in zip(problems, frames, strict=True):
        own_indices = []
        for electrode in problem.outputs:
            output = replace(electrode, patch=None, frame=frame)
            outline = output.placed.make_signature(problem.scene.film.reach, DIGITS)
            directions = np.round(output.directions, DIGITS).tobytes()
            key = (outline, directions, output.observable, output.d)
            if key not in index_of:
                index_of[key] = len(outputs)
                outputs.append(output)
            own_indices.append(index_of[key])
        indices.append(own_indices)
    return outputs, indices


def _replace_mesh_patches(outputs: Sequence[Output], problem: Problem) -> list[Output] | None:
    """Return copies of outputs with the mesh patches of the electrodes of `problem`.

    Return None if an output does not coincide with one of these electrodes, or if its axes are not
    parallel to those of the mesh.
    """
    unit = problem.scene.film.reach
    patches = {}
    for electrode in problem.scene.electrode_list:
        signature = electrode.outline.make_signature(unit, DIGITS)
        patches[signature] = make_subdomain_name(electrode.name)
    followed = []
    for output in outputs:
        patch = patches.get(output.placed.make_signature(unit, DIGITS))
        is_parallel = np.isin(output.frame, (-1.0, 0.0, 1.0)).all()
        if patch is None or not is_parallel:
            return None
        followed.append(replace(output, patch=patch))
    return followed


def _evaluate_observable(
    solution: Solution, outputs: Sequence[Output], observable: Observable
) -> Array:
    """Evaluate the stress integrals X and Y of all outputs for an observable.

    Parameters
    ----------
    solution : Solution
        The solution.
    outputs : sequence of Output
        Outputs of the solution.
    observable : Observable
        The observable.

    Returns
    -------
    ndarray, shape (outputs, 2)
        In N: those of the solve if it used this observable, and zero for an output for which the
        observable is not defined.
    """
    integrals = np.zeros((len(outputs), 2))
    is_solved = np.array([output.observable == observable.name for output in outputs], bool)
    integrals[is_solved] = solution.discrete.stress_integrals.values[is_solved]
    others = []
    for i in np.flatnonzero(~is_solved).tolist():
        if observable.is_defined_for(outputs[i]):
            others.append(i)
    if others:
        requested = [replace(outputs[i], observable=observable.name) for i in others]
        integrals[others] = solution.discrete.integrals_of(requested)
    return integrals
