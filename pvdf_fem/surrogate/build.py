"""How a response is built: its solves, its table, and its error at touches held out."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.files import require_writable
from pvdf_fem.mesh.symmetry import isotropy
from pvdf_fem.progress import Progress, TaskRunner, show_progress
from pvdf_fem.scene.given import SceneLike, scene_of, taken
from pvdf_fem.scene.registry import SPREAD_CLASSES
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solver.nonlinear.status import Status
from pvdf_fem.solver.sensitivity.parameters import PLACE
from pvdf_fem.surrogate.held_out import HeldOut, random_touches, solves_of
from pvdf_fem.surrogate.model import Domain, wanted_model
from pvdf_fem.surrogate.places import Places
from pvdf_fem.surrogate.probe_charges import PolarRaster, ProbeCharges
from pvdf_fem.surrogate.probe_stress import mean_stress_about_probe
from pvdf_fem.surrogate.response import Response
from pvdf_fem.surrogate.response_file import mechanics_of
from pvdf_fem.surrogate.table import force_nodes_N, pressed_outline, table_axes, tabulated
from pvdf_fem.surrogate.uniform_spline import BEYOND


@dataclass(frozen=True)
class ResponseOptions:
    """Resolution of a response by the error that it is for, and how its true error is measured.

    Numbers of places, forces and modes grow with the logarithm of the error, the sizes of cells and
    elements fall with its fourth root. Sizes here are those for an error of 1e-3.
    """

    #: Largest error of a charge that the resolution is for.
    error: float = 1e-3
    #: Number of random touches for the true error.
    held_out: int = 24
    #: Builds with ever finer options until the tolerance is met.
    attempts: int = 3
    #: Cell of the table over the root of the area of the probe, or of a tip's least contact, at
    #: whose edge the pressure is zero.
    cell: float = 1 / 9
    tip_cell: float = 1 / 5
    #: Largest cell.
    largest_cell_mm: float = 0.6
    #: Over the cell: the way of the probe's corners from one rotation to the next, the step of the
    #: raster of the stress, and twice the way between its rays at the probe's corners.
    step: float = 0.8

    @property
    def decades(self) -> float:
        """Powers of ten by which the error is below 1e-3."""
        return -3.0 - math.log10(self.error)

    @property
    def scale(self) -> float:
        """Sizes over the sizes for an error of 1e-3."""
        return float(10.0 ** (-0.25 * self.decades))

    def cell_mm(self, scene: Scene, domain: Domain) -> float:
        """Cell of the table."""
        size_mm = 1e3 * float(np.sqrt(pressed_outline(scene, domain.force_N[0]).area))
        share = self.tip_cell if scene.tips else self.cell
        return self.scale * min(share * size_mm, self.largest_cell_mm)

    def forces_N(self, domain: Domain) -> Array:
        """Forces under which the stress is solved.

        Coefficients of polynomials of the force fall by 4 from one to the next, where the largest
        force is e times the least.
        """
        low, high = domain.log_force
        count = 1 + math.ceil((1.25 + 0.5 * self.decades) * (high - low))
        return force_nodes_N(domain, max(4, count))

    def places(
        self, scene: Scene, domain: Domain, no_place: float = 80.0, rotations: int = 6
    ) -> Places:
        """The places of the rim for which the stress is solved.

        Polynomials along diameters of the reach converge by the distance of the rim, where the
        stress is singular: each distance gains exp(2 arccosh(radius / reach)) (Bernstein) over
        the error without a place. A film that is stiffer in one direction has some `rotations` in
        half a turn, and more for an error below 1e-3.
        """
        assert scene.single_probe is not None
        reach_mm = domain.reach_mm + 2.0 * self.cell_mm(scene, domain)
        gain = 2.0 * math.acosh(scene.film.radius_mm / reach_mm)
        radii = max(2, math.ceil(math.log(no_place / self.error) / gain))
        rotations += max(0, math.ceil(2.0 * self.decades - 0.2))
        anisotropic = isotropy(scene.film) != "isotropic"
        return Places.of(scene.single_probe, reach_mm, radii, rotations if anisotropic else 0)

    def raster(self, scene: Scene, domain: Domain, places: Places) -> PolarRaster:
        """Points about the probe where the stress is taken; electrodes may be anywhere."""
        cell_mm = self.cell_mm(scene, domain)
        corners_mm = 1e3 * float(pressed_outline(scene, domain.force_N[0]).reach)
        rays = 4.0 * np.pi * corners_mm / (self.step * cell_mm)
        angles = places.angles * math.ceil(rays / places.angles)
        reach_mm = math.sqrt(2.0) * (domain.reach_mm + (BEYOND + 1) * cell_mm)
        reach_mm += scene.film.radius_mm
        return PolarRaster(reach_mm, self.step * cell_mm, angles, 2.5 * corners_mm)


def options_for(scene: Scene, tolerance: float, of_tip: float = 0.5) -> ResponseOptions:
    """The options for a tolerance; for a part of the tolerance under a tip, whose contact grows
    with the force."""
    return ResponseOptions(error=min(tolerance, 1.0) * (of_tip if scene.tips else 1.0))


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
    scene = scene_of(scene)
    mechanics_of(scene)  # refuses a scene without a probe, of which no domain is known
    wanted, known = wanted_model(scene)
    reach_mm = wanted.reach_mm if reach_mm is None else reach_mm
    forces = wanted.force_N if force_N is None else taken("force_N", force_N, tuple[float, float])
    domain = Domain(taken("reach_mm", reach_mm, float), forces)
    tolerance = known if tolerance is None else taken("tolerance", tolerance, float)
    if wrong := [*mistakes(scene, domain, tolerance, options)]:
        raise ValueError("\n".join(wrong))
    options = options_for(scene, tolerance) if options is None else options
    if file is not None:
        require_writable(taken("file", file, Path))
    processes = taken("processes", processes, int | None)
    with show_progress("s of one core", progress) as show:
        made = _best(scene, domain, tolerance, options, TaskRunner(processes, show))
    if file is not None:
        made.save(file)
    return made


def _best(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions, work: TaskRunner
) -> Response:
    """The first response that meets the tolerance, or the one with the smallest error bound."""
    touches = random_touches(domain, options.held_out)
    solves, best, held_out = solves_of(scene, touches, tolerance), None, None
    for _ in range(options.attempts):
        places, forces_N = options.places(scene, domain), options.forces_N(domain)
        raster, rest = options.raster(scene, domain, places), _without_electrodes(scene, tolerance)
        fields = [
            (mean_stress_about_probe, rest, place, forces_N, raster, options.scale)
            for place in places.unique_places
        ]
        # a place first: it takes the longest, and tells soon what the others take
        first, *found = work.run([fields[0], *solves, *fields[1:]])
        if held_out is None:
            held_out = HeldOut.of(touches, found[: len(solves)])
        means = [first, *found[len(solves) :]]
        solves = []
        stress = ProbeCharges.of(places, raster, means, 1e-3 * options.error)
        axes = table_axes(scene, domain, options.cell_mm(scene, domain), options.step)
        spline = tabulated(stress, scene, domain, axes, work)
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


def mistakes(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    options: ResponseOptions | None = None,
    least_tolerance: float = 1e-6,
) -> Iterator[str]:
    """What is wrong with a scene and a domain that have no response, and with a tolerance that full
    solves could not confirm."""
    try:
        mechanics_of(scene)
    except ValueError as error:
        yield from str(error).splitlines()
        return
    low, high = domain.force_N
    load, film, observable = scene.load, scene.film, scene.numerics.observable
    known = least_tolerance <= tolerance < np.inf, 0.0 < low < high < np.inf
    if not known[0]:
        yield f"tolerance: {tolerance} is no number from {least_tolerance:g} on; give another"
    if not known[1]:
        yield f"force_N: {domain.force_N} is no range of positive forces"
    if load.kind == "rigid":
        reason = "makes the stress singular at the probe's edge; take 'dead' or 'follower'"
        yield f"load.kind: 'rigid' {reason}"
    if film.is_uneven:
        yield "film: patches and rim_displacement_um are not for a response; remove them"
    for key in SPREAD_CLASSES:
        if value := getattr(film, key):
            reason = "a response is of a film that is flat before it is touched"
            yield f"film.{key}: {value!r} is not for a response; {reason}; remove it"
    if load.tangential_N is not None or load.profile != "uniform":
        uniform = "remove load.tangential_N and load.profile"
        yield f"load: a response is of a uniform pressure along z; {uniform}"
    if observable != "material":
        reason = "is no integral of a stress about the probe; take 'material'"
        yield f"numerics.observable: {observable!r} {reason}"
    if all(known):
        cell_mm = (options or options_for(scene, tolerance)).cell_mm(scene, domain)
        pressed_mm = 1e3 * pressed_outline(scene, high).reach
        limit = scene.film.radius_mm - pressed_mm - 3.0 * cell_mm
        if not 0.0 < domain.reach_mm < limit:
            near = f"{max(limit, 0.0):.3g}, from where on the probe comes too near the rim"
            advice = "give another reach, or a smaller probe"
            yield f"reach_mm: {domain.reach_mm:g} is not between zero and {near}; {advice}"
