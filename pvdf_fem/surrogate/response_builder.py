"""The build of a response: solves of the stress, spline of the charges, measured error."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
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
    scene : Scene, or anything that `solve` accepts as a scene
        Scene with the film, the electrodes and a single probe.
    reach_mm : float, optional
        Reach: maximum distance of a touch from the film's centre. Default: that of the scene's
        ``[model]``, or a reach at which the probe is at least its own width from the rim; see
        `choose_default_reach_mm`.
    force_range_N : tuple of float, optional
        Minimum and maximum force. Default: the ``force_range_N`` of the scene's ``[model]``.
    tolerance : float, optional
        Maximum error bound. Default: that of the scene's ``[model]``, or 1e-3, which is a tenth of
        a relative noise of 1 %. If the tolerance is not met, the response is returned with its
        measured bound, and its `notes` say what would help.
    processes : int, optional
        Number of processes. Default: None, one for each core.
    file : path, optional
        File to save the response to. Default: None, do not save it.
    progress : callable or bool, optional
        Function that is called with the core-seconds that the build has taken and the estimate of
        those that it will take in total, or whether to show these; see
        `pvdf_fem.progress.show_progress`.
    options : ResponseOptions, optional
        Resolution of the first build. Default: chosen by the tolerance.

    Returns
    -------
    Response
        Response with its measured error bound.

    Raises
    ------
    ValueError
        If no response can be built for the scene, the domain or the tolerance; the message has a
        line for each error.
    FileError
        If the file cannot be written, which is also tested before the build.
    NotConvergedError
        If a solve of the stress about the probe does not converge, or more than half of the full
        solves that measure the error.

    Examples
    --------
    >>> domain = {"reach_mm": 4.0, "force_range_N": (0.3, 1.0)}
    >>> response = build_response("sensor.toml", **domain, tolerance=3e-2)
    >>> response.error_bound
    """
    scene = as_scene(scene)
    make_mechanical_key(scene)  # raises for a scene without a probe, which has no default domain
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
    with show_progress("CPU seconds", progress) as show:
        runner = TaskRunner(processes, show)
        response = _build_response_within_tolerance(
            scene, domain, tolerance, options, runner=runner
        )
        # Without these derivatives the response is complete for everything but `locate`, which says
        # so.
        with suppress(ValueError):
            response = response.with_sensitivities(processes, progress=show)
    if file is not None:
        response.save(file)
    return response


@dataclass(frozen=True, eq=False)
class _BuildResults:
    """Results of the tasks of one build."""

    stress_modes: StressModes  #: Stress about the probe at all positions and forces.
    #: Results of the additional tasks `solve_tasks`, in their order.
    solves: Sequence[Any]


def _build_response_within_tolerance(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    options: ResponseOptions,
    runner: TaskRunner,
) -> Response:
    """Build up to `max_builds` responses with increasing resolution until one meets the tolerance.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    domain : Domain
        Touches for which the response is valid.
    tolerance : float
        Maximum error bound.
    options : ResponseOptions
        Resolution of the first build, maximum number of builds, and number of random touches.
    runner : TaskRunner
        Runner of the tasks on several processes.

    Returns
    -------
    Response
        First response that meets the tolerance; if none does, the one with the smallest bound. Its
        notes say how many of the random touches could not be solved, if any.
    """
    touches = draw_touches(domain, options.validation_touches)
    # The full solves do not depend on the options, so that they are part of the first build only.
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
        # The bound is about proportional to the error that the resolution is chosen for.
        ratio = max(2.0, 1.5 * response.error_bound / tolerance)
        options = replace(options, error=options.error / ratio)
    assert best is not None
    assert validation is not None
    failed = len(touches) - len(validation.touches)
    if failed:
        note = f"{failed} of the {len(touches)} random touches could not be solved"
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
    """Solve the stress about the probe at all positions of a grid, and run additional tasks.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe, whose electrodes and position have no effect on the stress.
    domain : Domain
        Touches for which the response is valid.
    tolerance : float
        Maximum error bound of the response, which limits the tolerance of the contact under a tip.
    options : ResponseOptions
        Resolution of the response.
    solve_tasks : sequence of tuple
        Additional tasks, run together with the solves of the stress so that no process is idle.
    runner : TaskRunner
        Runner of the tasks on several processes.
    """
    centre_grid = options.make_centre_grid(scene, domain)
    polar_grid = options.make_polar_grid(scene, domain, centre_grid)
    forces_N = options.compute_forces_N(domain)
    bare_scene = _simplify_scene(scene, tolerance)

    def make_task(position: Array) -> tuple[Any, ...]:
        """Make the task that solves the stress with the probe at one position."""
        arguments = (bare_scene, position, forces_N, polar_grid, options.size_factor)
        return (solve_mean_stress, *arguments)

    stress_tasks = [make_task(position) for position in centre_grid.probe_positions]
    # The first task is a solve of the stress: these take longest, and the estimate of the remaining
    # time needs the duration of one.
    first, *others = runner.run([stress_tasks[0], *solve_tasks, *stress_tasks[1:]])
    solves = others[: len(solve_tasks)]
    means = [first, *others[len(solve_tasks) :]]
    stress_modes = StressModes.decompose(centre_grid, polar_grid, means, 1e-3 * options.error)
    return _BuildResults(stress_modes, solves)


def _simplify_scene(scene: Scene, tolerance: float) -> Scene:
    """Return a copy of the scene without anything that has no effect on the stress.

    Its electrode is a single large circle, it has no readout and no calibration, its probe is at
    the centre without rotation, and its ``numerics.tolerance`` is `tolerance`, but at most 1e-2.
    """
    # A scene must have an electrode; a large circle hardly refines the mesh.
    radius_mm = 900.0 * scene.film.radius
    electrode = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius_mm}
    changes: dict[str, Any] = {"electrodes": [electrode], "readout": None, "calibration": None}
    changes |= dict.fromkeys(PLACE, 0.0)
    # The penalty stiffness of the contact under a tip depends on the tolerance.
    return scene.with_(**changes, **{"numerics.tolerance": min(tolerance, 1e-2)})
