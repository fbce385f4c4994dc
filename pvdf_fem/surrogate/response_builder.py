"""The build of a response: solves of the stress, the spline of the charges, and the true error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pvdf_fem.arrays import Array
from pvdf_fem.files import require_writable
from pvdf_fem.progress import Progress, TaskRunner, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import PLACE
from pvdf_fem.surrogate.charge_spline import make_axes, tabulate_charges
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.response_options import (
    ResponseOptions,
    choose_options,
    find_validation_errors,
)
from pvdf_fem.surrogate.stress.probe_stress import solve_mean_stress
from pvdf_fem.surrogate.stress.stress_modes import StressModes
from pvdf_fem.surrogate.touch_domain import Domain, draw_touches, resolve_response_settings
from pvdf_fem.surrogate.validation_solves import ValidationSolves, make_solve_tasks


def build_response(
    scene: SceneLike,
    reach_mm: float | None = None,
    force_range_N: tuple[float, float] | None = None,
    tolerance: float | None = None,
    processes: int | None = None,
    *,
    file: Path | str | None = None,
    progress: Progress | bool | None = None,
    options: ResponseOptions | None = None,
) -> Response:
    """Build the response of a sensor: its charges as a fast function of the touch.

    Parameters
    ----------
    scene : Scene, or whatever `solve` takes for a scene
        Film, electrodes and probe.
    reach_mm : float, optional
        Largest distance of the probe from the film's centre; by default that of the scene's
        ``[model]``.
    force_range_N : tuple of float, optional
        Minimum and maximum force; by default those of the scene's ``[model]``.
    tolerance : float, optional
        Largest error bound; by default that of the scene's ``[model]``. A response that exceeds it
        is returned with its true bound, and its `notes` say what would help.
    processes : int, optional
        Number of processes; by default all cores.
    file : path, optional
        Where the response is saved.
    progress : callable or bool, optional
        Called with the seconds of one core that the build has taken, and with those that it will
        take in all, estimated from the solves so far; or whether these are shown, see
        `pvdf_fem.progress.show_progress`.
    options : ResponseOptions, optional
        By default those for the tolerance.

    Returns
    -------
    Response

    Raises
    ------
    ValueError
        For a scene, a domain or a tolerance without a response.
    FileError
        For a file that cannot be written.
    NotConvergedError
        When the stress about the probe, or more than half of the full solves that measure the
        error, do not converge.

    Examples
    --------
    >>> domain = {"reach_mm": 4.0, "force_range_N": (0.3, 1.0)}
    >>> response = build_response("sensor.toml", **domain, tolerance=3e-2)
    >>> response.error_bound
    """
    scene = as_scene(scene)
    make_mechanical_key(scene)  # rejects a scene without a probe, which has no default domain
    default = resolve_response_settings(scene)
    reach_mm = default.domain.reach_mm if reach_mm is None else reach_mm
    if force_range_N is None:
        force_range_N = default.domain.force_N
    else:
        force_range_N = coerce("force_range_N", force_range_N, tuple[float, float])
    domain = Domain(coerce("reach_mm", reach_mm, float), force_range_N)
    tolerance = coerce("tolerance", default.tolerance if tolerance is None else tolerance, float)
    errors = [*find_validation_errors(scene, domain, tolerance, options)]
    if errors:
        raise ValueError("\n".join(errors))
    if options is None:
        options = choose_options(scene, tolerance)
    if file is not None:
        require_writable(coerce("file", file, Path))
    processes = coerce("processes", processes, int | None)
    with show_progress("s of one core", progress) as show:
        runner = TaskRunner(processes, show)
        response = _build_within_tolerance(scene, domain, tolerance, options, runner=runner)
    if file is not None:
        response.save(file)
    return response


@dataclass(frozen=True, eq=False)
class _BuildResults:
    """Results of the tasks of one build."""

    stress_modes: StressModes
    #: Results of the further tasks.
    solves: Sequence[Any]


def _build_within_tolerance(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    options: ResponseOptions,
    runner: TaskRunner,
) -> Response:
    """Build responses with ever finer options until one meets the tolerance.

    Parameters
    ----------
    scene : Scene
        Film, electrodes, probe and load.
    domain : Domain
        Touches for which the response is valid.
    tolerance : float
        Largest error bound.
    options : ResponseOptions
        Those of the first build.
    runner : TaskRunner
        Runs the tasks on processes.

    Returns
    -------
    Response
        The first response that meets the tolerance, or the one with the smallest error bound.
    """
    touches = draw_touches(domain, options.validation_touches)
    # the full solves do not depend on the options: only the first build has them
    solve_tasks = make_solve_tasks(scene, touches, tolerance)
    validation: ValidationSolves | None = None
    best: Response | None = None
    for _ in range(options.max_builds):
        results = _solve_stress_modes(scene, domain, tolerance, options, solve_tasks, runner)
        solve_tasks = []
        if validation is None:
            validation = ValidationSolves.collect(touches, results.solves)
        axes = make_axes(
            scene, domain, options.compute_cell_mm(scene, domain), options.step_fraction
        )
        spline = tabulate_charges(results.stress_modes, scene, domain, axes, runner)
        response = Response(
            scene,
            domain,
            error_bound=0.0,
            spline=spline,
            tolerance=tolerance,
            stress_modes=results.stress_modes,
            validation=validation,
        ).with_measured_error()
        if best is None or response.error_bound < best.error_bound:
            best = response
        if best.status is Status.CONVERGED:
            break
        ratio = max(2.0, 1.5 * response.error_bound / tolerance)
        options = replace(options, error=options.error / ratio)
    assert best is not None
    assert validation is not None
    failed = len(touches) - len(validation.touches)
    if failed:
        note = f"{failed} of the {len(touches)} random touches have no solution"
        best = replace(best, notes=(*best.notes, note))
    return best


def _solve_stress_modes(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    options: ResponseOptions,
    solve_tasks: Sequence[tuple[Any, ...]],
    runner: TaskRunner,
) -> _BuildResults:
    """Solve the stress about the probe at all positions, and further tasks beside it.

    Parameters
    ----------
    scene : Scene
        Film, electrodes, probe and load.
    domain : Domain
        Touches for which the response is valid.
    tolerance : float
        Largest error bound.
    options : ResponseOptions
        Those of the build.
    solve_tasks : sequence of tuple
        Further tasks for the same run of the runner, so that no process is idle.
    runner : TaskRunner
        Runs the tasks on processes.
    """
    centre_grid = options.make_centre_grid(scene, domain)
    polar_grid = options.make_polar_grid(scene, domain, centre_grid)
    forces_N = options.compute_forces_N(domain)
    bare_scene = _replace_electrodes(scene, tolerance)

    def make_task(position: Array) -> tuple[Any, ...]:
        arguments = (bare_scene, position, forces_N, polar_grid, options.size_factor)
        return (solve_mean_stress, *arguments)

    stress_tasks = [make_task(position) for position in centre_grid.probe_positions]
    # a stress task first: these take longest, and the estimate of the remaining time needs one
    first, *others = runner.run([stress_tasks[0], *solve_tasks, *stress_tasks[1:]])
    solves = others[: len(solve_tasks)]
    means = [first, *others[len(solve_tasks) :]]
    stress_modes = StressModes.decompose(centre_grid, polar_grid, means, 1e-3 * options.error)
    return _BuildResults(stress_modes, solves)


def _replace_electrodes(scene: Scene, tolerance: float) -> Scene:
    """Return the scene for solves of the stress, on which electrodes have no effect."""
    # a scene has at least one electrode
    radius_mm = 0.9 * scene.film.radius_mm
    electrode = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius_mm}
    changes = {"electrodes": [electrode], "readout": None, **dict.fromkeys(PLACE, 0.0)}
    # the stiffness of a tip's penalty follows from the tolerance
    return scene.with_(**changes, **{"numerics.tolerance": min(tolerance, 1e-2)})
