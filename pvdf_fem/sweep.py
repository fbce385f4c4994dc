"""Many scenes: each solved once, on all cores, and kept as soon as it is done."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress

import joblib

from pvdf_fem.charge import OBSERVABLES, electrode_forces
from pvdf_fem.newton import Status
from pvdf_fem.scene import Scene, SceneError
from pvdf_fem.solution import Solution, solve
from pvdf_fem.store import Record, Store

#: Status of a scene whose solve ended in an exception. It is not stored, so the next run tries it.
CRASHED = "crashed"


def solve_all(
    scenes: Sequence[Scene],
    store: Store | None = None,
    *,
    processes: int = -1,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> list[Record]:
    """Records of scenes, in their order.

    Parameters
    ----------
    scenes : sequence of Scene
        Equal scenes are solved once.
    store : Store, optional
        Scenes found in it are not solved; others are added one by one, except crashed ones.
    processes : int
        Number of processes, -1 for all cores; 1 solves in this one.
    progress : callable
        Called with the numbers of finished and of all distinct scenes to be solved.
    """
    found: dict[str, Record] = {}
    missing: dict[str, Scene] = {}
    keys = [scene.model_dump_json() for scene in scenes]
    for name, scene in zip(keys, scenes, strict=True):
        record = store.get(scene) if store and name not in found else None
        if record is not None:
            found[name] = record
        elif name not in found:
            missing[name] = scene
    progress(0, len(missing))
    tasks = (joblib.delayed(_solved)(name, scene) for name, scene in missing.items())
    with joblib.parallel_config("loky", inner_max_num_threads=1):
        solved = joblib.Parallel(processes, return_as="generator_unordered")(tasks)
    for done, (name, record) in enumerate(solved, start=1):
        found[name] = record
        if store and record.status != CRASHED:
            store.put(missing[name], record)
        progress(done, len(missing))
    return [found[name] for name in keys]


def _solved(name: str, scene: Scene) -> tuple[str, Record]:
    try:
        return name, record_of(solve(scene))
    except Exception as error:  # whatever it is, the other scenes go on
        names = tuple(electrode.name for electrode in scene.electrode_list)
        reason = f"{type(error).__name__}: {error}"
        return name, Record(CRASHED, reason, names, {}, {}, 0.0, 0, 0, (), 0.0)


def record_of(solution: Solution) -> Record:
    """What is kept of a solution, its charges by both observables where electrodes have edges."""
    forces: dict[str, list[list[float]]] = {}
    errors: dict[str, list[list[float]]] = {}
    deflection = 0.0
    if solution.status is Status.CONVERGED:
        fields, deflection = solution.fields, solution.deflection_max_mm
        errors[solution.scene.numerics.observable] = fields.force_errors.tolist()
        for observable in OBSERVABLES:
            with suppress(SceneError):
                scene = solution.scene.with_(**{"numerics.observable": observable})
                values = electrode_forces(scene, fields.equilibrium.membrane, fields.displacement)
                forces[observable] = values.tolist()
    return Record(
        status=str(solution.status),
        reason=solution.reason,
        electrodes=tuple(electrode.name for electrode in solution.scene.electrode_list),
        forces=forces,
        force_errors=errors,
        deflection_max_mm=deflection,
        unknowns=solution.unknowns,
        newton_iterations=solution.newton_iterations,
        warnings=solution.warnings,
        seconds=solution.seconds["total"],
    )
