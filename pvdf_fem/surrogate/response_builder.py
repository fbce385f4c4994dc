"""How a response is built: its solves, its table, and its error at touches held out."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from pvdf_fem.files import require_writable
from pvdf_fem.progress import Progress, TaskRunner, show_progress
from pvdf_fem.scene.arguments import SceneLike, as_scene, coerce
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import PLACE
from pvdf_fem.surrogate.charge_spline import (
    make_axes,
    tabulate_charges,
)
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
    force_N: tuple[float, float] | None = None,
    tolerance: float | None = None,
    processes: int | None = None,
    *,
    file: Path | str | None = None,
    progress: Progress | bool | None = None,
    options: ResponseOptions | None = None,
) -> Response:
    """The response of a sensor to a probe.

    Parameters
    ----------
    scene : Scene, or what `solve` takes for a scene
        Film, electrodes and probe.
    reach_mm, force_N : float, tuple of float
        Largest distance of the probe from the film's centre; least and largest force. By default
        those of the scene's ``[model]``, as the tolerance.
    tolerance : float
        Largest error bound. A response that misses it is returned with its true bound, and its
        `remarks` say what would help.
    processes : int, optional
        Number of processes, all cores when not given.
    file : path, optional
        Where the response is saved.
    progress : callable or bool, optional
        Called with the seconds of one core that the build has taken and that it takes in all, by
        the solves so far; or whether these are shown, see `pvdf_fem.progress.show_progress`.
    options : ResponseOptions, optional
        By default those for the tolerance.

    Raises
    ------
    ValueError, FileError, NotConvergedError
        For a scene that has no such response, for a file that cannot be written, and when the film
        about the probe, or half of the touches held out, have no solution.

    Examples
    --------
    >>> response = build_response("sensor.toml", reach_mm=4.0, force_N=(0.3, 1.0), tolerance=3e-2)
    >>> response.error_bound
    """
    scene = as_scene(scene)
    make_mechanical_key(scene)  # refuses a scene without a probe, of which no domain is known
    wanted, known = resolve_response_settings(scene)
    reach_mm = wanted.reach_mm if reach_mm is None else reach_mm
    forces = wanted.force_N if force_N is None else coerce("force_N", force_N, tuple[float, float])
    domain = Domain(coerce("reach_mm", reach_mm, float), forces)
    tolerance = known if tolerance is None else coerce("tolerance", tolerance, float)
    if wrong := [*find_validation_errors(scene, domain, tolerance, options)]:
        raise ValueError("\n".join(wrong))
    options = choose_options(scene, tolerance) if options is None else options
    if file is not None:
        require_writable(coerce("file", file, Path))
    processes = coerce("processes", processes, int | None)
    with show_progress("s of one core", progress) as show:
        made = _best(scene, domain, tolerance, options, TaskRunner(processes, show))
    if file is not None:
        made.save(file)
    return made


def _best(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions, work: TaskRunner
) -> Response:
    """The first response that meets the tolerance, or the one with the smallest error bound."""
    touches = draw_touches(domain, options.validation_touches)
    solves, best, held_out = make_solve_tasks(scene, touches, tolerance), None, None
    for _ in range(options.max_builds):
        places, forces_N = options.places(scene, domain), options.forces_N(domain)
        raster, rest = options.raster(scene, domain, places), _without_electrodes(scene, tolerance)
        fields = [
            (solve_mean_stress, rest, place, forces_N, raster, options.scale)
            for place in places.unique_places
        ]
        # a place first: it takes the longest, and tells soon what the others take
        first, *found = work.run([fields[0], *solves, *fields[1:]])
        if held_out is None:
            held_out = ValidationSolves.of(touches, found[: len(solves)])
        means = [first, *found[len(solves) :]]
        solves = []
        stress = StressModes.of(places, raster, means, 1e-3 * options.error)
        axes = make_axes(scene, domain, options.cell_mm(scene, domain), options.step)
        spline = tabulate_charges(stress, scene, domain, axes, work)
        made = Response(scene, domain, 0.0, spline, tolerance, (), stress, held_out)
        made = made.measured()
        best = made if best is None or made.error_bound < best.error_bound else best
        if best.status is Status.CONVERGED:
            break
        ratio = max(2.0, 1.5 * made.error_bound / tolerance)
        options = replace(options, error=options.error / ratio)
    assert best is not None
    assert held_out is not None
    if missing := len(touches) - len(held_out.touches):
        remark = f"{missing} of the {len(touches)} touches held out have no solution"
        best = replace(best, remarks=(*best.remarks, remark))
    return best


def _without_electrodes(scene: Scene, tolerance: float) -> Scene:
    """The scene of the stress about the probe, whose electrodes do not matter."""
    # a scene has at least one, and their channels
    radius = 0.9 * scene.film.radius_mm
    electrode = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius}
    changes = {"electrodes": [electrode], "readout": None, **dict.fromkeys(PLACE, 0.0)}
    # how stiff a tip's penalty is follows from the tolerance
    return scene.with_(**changes, **{"numerics.tolerance": min(tolerance, 1e-2)})
