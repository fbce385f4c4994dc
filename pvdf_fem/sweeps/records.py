"""What is kept of the solution that several scenes share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.charges.forces import OBSERVABLES, Goal, goals_of
from pvdf_fem.film.bending_effect import bending_joins
from pvdf_fem.film.membrane import Array
from pvdf_fem.mesh.gmsh_mesh import electrode_patch
from pvdf_fem.scene.outline import Circle, Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.solution import Solution, solve_goals
from pvdf_fem.solvers.newton import Status
from pvdf_fem.sweeps.store import Record

# Outlines in mm, and directions, are equal to so many digits.
DIGITS = 7


def records_of(scenes: Sequence[Scene], frames: Array) -> list[Record]:
    """Records of scenes whose films deform alike.

    Parameters
    ----------
    scenes : sequence of Scene
    frames : (n, 2, 2)
        For each scene the orthogonal matrix from its axes to those of the first.

    Notes
    -----
    The mesh follows the electrodes of the first scene if those of the others lie on them, else
    the probe only. Scenes that do not meet the tolerance together are solved one by one.
    """
    scene = scenes[0]
    goals, rows = _goals(scenes, frames)
    followed = _followed(goals, scene)
    if followed is None:
        # no scene that a file could give, but all that counts here are its goals
        film = scene.film.model_copy(update={"bending": bending_joins(scene)})
        scene = scene.model_copy(update={"electrodes": (), "film": film})
    else:
        goals = followed
    solution = solve_goals(scene, goals)
    retried = (Status.TOLERANCE, Status.SLACK, Status.MESH_FAILED)
    if len(scenes) > 1 and solution.status in retried:
        return [records_of([scene], frames[:1])[0] for scene in scenes]
    return _records(solution, goals, scenes, rows)


def record_of(solution: Solution) -> Record:
    """The record of a scene's own solution."""
    scene = solution.scene
    goals = goals_of(scene)
    return _records(solution, goals, [scene], [list(range(len(goals)))])[0]


def _records(
    solution: Solution,
    goals: Sequence[Goal],
    scenes: Sequence[Scene],
    rows: Sequence[Sequence[int]],
) -> list[Record]:
    """Records of scenes with the goals of `rows`, of the solution for `goals`."""
    shared = _shared(solution, len(scenes))
    if solution.status is not Status.CONVERGED:
        return [replace(shared, electrodes=_names(scene)) for scene in scenes]
    forces = {name: _forces(solution, goals, name) for name in OBSERVABLES}
    records = []
    for scene, mine in zip(scenes, rows, strict=True):
        edged = all(goals[i].has_edges for i in mine)
        found = {n: forces[n][mine].tolist() for n in OBSERVABLES if edged or n == "material"}
        errors = {str(scene.numerics.observable): solution.fields.force_errors[mine].tolist()}
        records.append(replace(shared, electrodes=_names(scene), forces=found, force_errors=errors))
    return records


def _names(scene: Scene) -> tuple[str, ...]:
    return tuple(electrode.name for electrode in scene.electrode_list)


def _goals(scenes: Sequence[Scene], frames: Array) -> tuple[list[Goal], list[list[int]]]:
    """The different goals of the scenes, and for each scene the indices of its own."""
    goals: list[Goal] = []
    index: dict[tuple[object, ...], int] = {}
    rows = []
    for scene, frame in zip(scenes, frames, strict=True):
        d, observable = (scene.film.d31, scene.film.d32), scene.numerics.observable
        mine = []
        for electrode in scene.electrode_list:
            goal = Goal(electrode.outline, observable, d, None, frame)
            turned = np.round(goal.directions, DIGITS).tobytes()
            name = (_signature(goal.placed), turned, observable, d)
            if name not in index:
                index[name] = len(goals)
                goals.append(goal)
            mine.append(index[name])
        rows.append(mine)
    return goals, rows


def _followed(goals: Sequence[Goal], scene: Scene) -> list[Goal] | None:
    """The goals on a mesh of the scene, if they are its electrodes and the axes its axes."""
    patches = {
        _signature(electrode.outline): electrode_patch(electrode.name)
        for electrode in scene.electrode_list
    }
    found = []
    for goal in goals:
        patch = patches.get(_signature(goal.placed))
        if patch is None or not np.isin(goal.frame, (-1.0, 0.0, 1.0)).all():
            return None
        found.append(replace(goal, patch=patch))
    return found


def _signature(outline: Outline) -> tuple[float, frozenset[tuple[float, ...]]]:
    """What outlines have in common if they cover the same points: radius and corners in mm."""
    if isinstance(outline, Circle):
        radius, points = outline.radius, outline.centre[None]
    else:
        radius, points = 0.0, outline.vertices
    rounded = np.round(1e3 * points, DIGITS) + 0.0
    return round(1e3 * radius, DIGITS), frozenset(map(tuple, rounded.tolist()))


def _forces(solution: Solution, goals: Sequence[Goal], observable: str) -> Array:
    """The forces by an observable, (goals, 2); NaN for electrodes that it is not defined for."""
    fields = solution.fields
    forces = np.full((len(goals), 2), np.nan)
    own = np.array([goal.observable == observable for goal in goals])
    forces[own] = fields.forces[own]
    defined = observable == "material"
    others = [i for i in np.flatnonzero(~own).tolist() if defined or goals[i].has_edges]
    asked = [replace(goals[i], observable=observable) for i in others]
    if asked:
        forces[others] = fields.forces_of(asked)
    return forces


def _shared(solution: Solution, count: int) -> Record:
    """The part of the records that is the same for all of them."""
    converged = solution.status is Status.CONVERGED
    return Record(
        status=str(solution.status),
        reason=solution.reason,
        electrodes=(),
        forces={},
        force_errors={},
        deflection_max_mm=solution.deflection_max_mm if converged else 0.0,
        unknowns=solution.unknowns,
        newton_iterations=solution.newton_iterations,
        warnings=solution.warnings,
        seconds=solution.seconds["total"] / count,
    )
