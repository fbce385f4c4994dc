"""Records of scenes from their common solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.batch.equivalence import DIGITS
from pvdf_fem.batch.store import Record
from pvdf_fem.electrodes.observables import OBSERVABLES, Observable
from pvdf_fem.electrodes.outputs import Output, make_outputs
from pvdf_fem.electrodes.stress_integrals import StressIntegrals
from pvdf_fem.electrodes.unloaded import find_uniform_integrals, unload
from pvdf_fem.film.models import resolve_film_model
from pvdf_fem.mesh.gmsh_mesh import make_subdomain_name
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.acceptance import warn_of_cancelled_charges
from pvdf_fem.solver.adaptive import UnloadedFilmError, solve_outputs
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.solution import Solution

# Ends of a solve perhaps due to further scenes' goals or a mesh without electrodes.
_RETRIED = (Status.TOLERANCE, Status.SLACK, Status.MESH_FAILED)


def make_records(scenes: Sequence[Scene], frames: Array) -> list[Record]:
    """Records of scenes whose films deform alike. `frames` (n, 2, 2) are the orthogonal matrices
    from their axes to those of the first scene. The mesh follows the first scene's electrodes if
    further scenes' electrodes lie on them, otherwise only the probe. Scenes that miss the tolerance
    together are solved separately."""
    scene = scenes[0]
    outputs, indices = _distinct_goals(scenes, frames)
    followed = _followed(outputs, scene)
    if followed is not None:
        solution = solve_outputs(scene, followed)
    else:
        # Scenes with different electrodes share a solve only if electrodes just read the stress
        # (`FilmModel.electrodes_only_read`): the film may be solved without them.
        film = scene.film.model_copy(update={"bending": resolve_film_model(scene).bends})
        solution = solve_outputs(scene.model_copy(update={"electrodes": (), "film": film}), outputs)
    if len(scenes) > 1 and solution.status in _RETRIED:
        return [make_records([scene], frames[:1])[0] for scene in scenes]
    return _records(solution, followed or outputs, scenes, indices)


def add_unloaded_integrals(record: Record, scene: Scene, film: Record | None) -> Record:
    """A scene's record with its forces at rest, or with a warning about their absence. `film`
    is the record of the untouched film if that needs a solve and is another scene; if its solve
    crashed, so has the scene."""
    if (known := find_uniform_integrals(unload(scene))) is not None:
        return _rested(record, known)
    solved = film or record
    if solved.status not in Status.__members__.values():
        return replace(record, status=solved.status, reason=solved.reason)
    if solved.converged:
        return _rested(record, solved.forces_by(str(scene.numerics.observable)))
    told = (
        UnloadedFilmError.of(scene, solved.status, solved.reason).problems
        if record.converged
        else ()
    )
    return replace(record, warnings=(*record.warnings, *told))


def _rested(record: Record, at_rest: StressIntegrals) -> Record:
    values, errors = at_rest.values.tolist(), at_rest.errors.tolist()
    return replace(record, rest_forces=values, rest_force_errors=errors)


def _records(
    solution: Solution,
    outputs: Sequence[Output],
    scenes: Sequence[Scene],
    indices: Sequence[Sequence[int]],
) -> list[Record]:
    """Records of scenes; `indices` are, by scene, the positions of its electrodes in `outputs`."""
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
    forces = {name: _forces(solution, outputs, known) for name, known in OBSERVABLES.items()}
    records = []
    for scene, electrodes, rows in zip(scenes, names, indices, strict=True):
        defined = {
            name: values[rows].tolist()
            for name, values in forces.items()
            if all(OBSERVABLES[name].defined_for(outputs[row]) for row in rows)
        }
        solved = solution.discrete.stress_integrals.of(rows)
        records.append(
            replace(
                shared,
                electrodes=electrodes,
                forces=defined,
                force_errors={str(scene.numerics.observable): solved.errors.tolist()},
                warnings=(
                    *resolve_film_model(scene).warnings,
                    *others,
                    *warn_of_cancelled_charges(scene, solved),
                ),
            )
        )
    return records


def _distinct_goals(scenes: Sequence[Scene], frames: Array) -> tuple[list[Output], list[list[int]]]:
    """Distinct goals over the scenes, and by scene the goal indices of its electrodes."""
    outputs: list[Output] = []
    index_of: dict[tuple[object, ...], int] = {}
    indices: list[list[int]] = []
    for scene, frame in zip(scenes, frames, strict=True):
        indices.append([])
        for output in (replace(output, patch=None, frame=frame) for output in make_outputs(scene)):
            directions = np.round(output.directions, DIGITS).tobytes()
            place = output.placed.make_signature(scene.film.radius, DIGITS)
            key = place, directions, output.observable, output.d
            if key not in index_of:
                index_of[key] = len(outputs)
                outputs.append(output)
            indices[-1].append(index_of[key])
    return outputs, indices


def _followed(outputs: Sequence[Output], scene: Scene) -> list[Output] | None:
    """The goals on a mesh that follows a scene's electrodes, or None if a goal is no electrode in
    this scene with parallel axes."""
    patches = {
        electrode.outline.make_signature(scene.film.radius, DIGITS): make_subdomain_name(
            electrode.name
        )
        for electrode in scene.electrode_list
    }
    followed = []
    for output in outputs:
        patch = patches.get(output.placed.make_signature(scene.film.radius, DIGITS))
        if patch is None or not np.isin(output.frame, (-1.0, 0.0, 1.0)).all():
            return None
        followed.append(replace(output, patch=patch))
    return followed


def _forces(solution: Solution, outputs: Sequence[Output], observable: Observable) -> Array:
    """The forces X, Y by an observable, (goals, 2); zero for electrodes it is not defined for."""
    forces = np.zeros((len(outputs), 2))
    solved = np.array([output.observable == observable.name for output in outputs], bool)
    forces[solved] = solution.discrete.stress_integrals.values[solved]
    others = [i for i in np.flatnonzero(~solved).tolist() if observable.defined_for(outputs[i])]
    if others:
        asked = [replace(outputs[i], observable=observable.name) for i in others]
        forces[others] = solution.discrete.integrals_of(asked)
    return forces
