"""Records of scenes from their common solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.batch.equivalence import DIGITS
from pvdf_fem.batch.store import Record
from pvdf_fem.electrodes.observables import OBSERVABLES, Observable
from pvdf_fem.electrodes.outputs import Goal, goals_of
from pvdf_fem.electrodes.stress_integrals import Forces
from pvdf_fem.electrodes.unloaded import known_at_rest, untouched
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.mesh.gmsh_mesh import make_subdomain_name
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.adaptive import RestError, solve_goals
from pvdf_fem.solver.admissible import cancelled_charges
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution

# Ends of a solve perhaps due to further scenes' goals or a mesh without electrodes.
_RETRIED = (Status.TOLERANCE, Status.SLACK, Status.MESH_FAILED)


def records_of(scenes: Sequence[Scene], frames: Array) -> list[Record]:
    """Records of scenes whose films deform alike. `frames` (n, 2, 2) are the orthogonal matrices
    from their axes to those of the first scene. The mesh follows the first scene's electrodes if
    further scenes' electrodes lie on them, otherwise only the probe. Scenes that miss the tolerance
    together are solved separately."""
    scene = scenes[0]
    goals, indices = _distinct_goals(scenes, frames)
    followed = _followed(goals, scene)
    if followed is not None:
        solution = solve_goals(scene, followed)
    else:
        # Scenes with different electrodes share a solve only if electrodes just read the stress
        # (`FilmModel.electrodes_only_read`): the film may be solved without them.
        film = scene.film.model_copy(update={"bending": resolve_film_model(scene).bends})
        solution = solve_goals(scene.model_copy(update={"electrodes": (), "film": film}), goals)
    if len(scenes) > 1 and solution.status in _RETRIED:
        return [records_of([scene], frames[:1])[0] for scene in scenes]
    return _records(solution, followed or goals, scenes, indices)


def with_rest(record: Record, scene: Scene, film: Record | None) -> Record:
    """A scene's record with its forces at rest, or with a warning about their absence. `film`
    is the record of the untouched film if that needs a solve and is another scene; if its solve
    crashed, so has the scene."""
    if (known := known_at_rest(untouched(scene))) is not None:
        return _rested(record, known)
    solved = film or record
    if solved.status not in Status.__members__.values():
        return replace(record, status=solved.status, reason=solved.reason)
    if solved.converged:
        return _rested(record, solved.forces_by(str(scene.numerics.observable)))
    told = RestError.of(scene, solved.status, solved.reason).problems if record.converged else ()
    return replace(record, warnings=(*record.warnings, *told))


def _rested(record: Record, at_rest: Forces) -> Record:
    values, errors = at_rest.values.tolist(), at_rest.errors.tolist()
    return replace(record, rest_forces=values, rest_force_errors=errors)


def _records(
    solution: Solution,
    goals: Sequence[Goal],
    scenes: Sequence[Scene],
    indices: Sequence[Sequence[int]],
) -> list[Record]:
    """Records of scenes; `indices` are, by scene, the positions of its electrodes in `goals`."""
    names = [tuple(electrode.name for electrode in scene.electrode_list) for scene in scenes]
    converged = solution.status is Status.CONVERGED
    shared = Record(
        status=str(solution.status),
        reason=solution.reason,
        electrodes=(),
        deflection_max_mm=solution.deflection_max_mm if converged else 0.0,
        warnings=solution.warnings,
        seconds=solution.seconds["total"] / len(scenes),
    )
    if not converged:
        return [replace(shared, electrodes=electrodes) for electrodes in names]
    # a thicker film under more force may share the solve, and not what bending would change
    left_out = resolve_film_model(solution.scene).warnings
    others = [text for text in solution.warnings if text not in left_out]
    forces = {name: _forces(solution, goals, known) for name, known in OBSERVABLES.items()}
    records = []
    for scene, electrodes, rows in zip(scenes, names, indices, strict=True):
        defined = {
            name: values[rows].tolist()
            for name, values in forces.items()
            if all(OBSERVABLES[name].defined_for(goals[row]) for row in rows)
        }
        solved = solution.fields.forces.of(rows)
        records.append(
            replace(
                shared,
                electrodes=electrodes,
                forces=defined,
                force_errors={str(scene.numerics.observable): solved.errors.tolist()},
                warnings=(
                    *resolve_film_model(scene).warnings,
                    *others,
                    *cancelled_charges(scene, solved),
                ),
            )
        )
    return records


def _distinct_goals(scenes: Sequence[Scene], frames: Array) -> tuple[list[Goal], list[list[int]]]:
    """Distinct goals over the scenes, and by scene the goal indices of its electrodes."""
    goals: list[Goal] = []
    index_of: dict[tuple[object, ...], int] = {}
    indices: list[list[int]] = []
    for scene, frame in zip(scenes, frames, strict=True):
        indices.append([])
        for goal in (replace(goal, patch=None, frame=frame) for goal in goals_of(scene)):
            directions = np.round(goal.directions, DIGITS).tobytes()
            place = goal.placed.signature(scene.film.radius, DIGITS)
            key = place, directions, goal.observable, goal.d
            if key not in index_of:
                index_of[key] = len(goals)
                goals.append(goal)
            indices[-1].append(index_of[key])
    return goals, indices


def _followed(goals: Sequence[Goal], scene: Scene) -> list[Goal] | None:
    """The goals on a mesh that follows a scene's electrodes, or None if a goal is no electrode in
    this scene with parallel axes."""
    patches = {
        electrode.outline.signature(scene.film.radius, DIGITS): make_subdomain_name(electrode.name)
        for electrode in scene.electrode_list
    }
    followed = []
    for goal in goals:
        patch = patches.get(goal.placed.signature(scene.film.radius, DIGITS))
        if patch is None or not np.isin(goal.frame, (-1.0, 0.0, 1.0)).all():
            return None
        followed.append(replace(goal, patch=patch))
    return followed


def _forces(solution: Solution, goals: Sequence[Goal], observable: Observable) -> Array:
    """The forces X, Y by an observable, (goals, 2); zero for electrodes it is not defined for."""
    forces = np.zeros((len(goals), 2))
    solved = np.array([goal.observable == observable.name for goal in goals], bool)
    forces[solved] = solution.fields.forces.values[solved]
    others = [i for i in np.flatnonzero(~solved).tolist() if observable.defined_for(goals[i])]
    if others:
        asked = [replace(goals[i], observable=observable.name) for i in others]
        forces[others] = solution.fields.forces_of(asked)
    return forces
