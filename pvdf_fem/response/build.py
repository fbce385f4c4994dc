"""How a response is built: its solves, its table, and its error at touches held out."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from pvdf_fem.derivatives.parameters import PLACE
from pvdf_fem.files import require_writable
from pvdf_fem.mesh.symmetry import isotropy
from pvdf_fem.progress import Progress, Work, shown
from pvdf_fem.response.held_out import HeldOut, random_touches, solves_of
from pvdf_fem.response.model import Domain, wanted_model
from pvdf_fem.response.polar_raster import PolarRaster
from pvdf_fem.response.probe_stress import ProbeMesh, mean_stress_about_probe
from pvdf_fem.response.response import Response
from pvdf_fem.response.response_file import mechanics_of
from pvdf_fem.response.rim_places import ProbeCharges, RimPlaces
from pvdf_fem.response.table import MARGIN, Grid, force_nodes_N, pressed_outline
from pvdf_fem.scene.given import SceneLike, scene_of, taken
from pvdf_fem.scene.registry import SPREAD_CLASSES
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solvers.status import Status


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
    #: Cell of the table over the root of the probe's area; a disc needs no rotations. Of a round
    #: tip it is the area of the least contact.
    cell: float = 1 / 9
    disc_cell: float = 1 / 14
    tip_cell: float = 1 / 4.7
    #: Largest cell.
    largest_cell_mm: float = 0.6
    #: Over the cell: the way of the probe's corners from one rotation to the next, the step of the
    #: raster of the stress, and twice the way between its rays at the probe's corners.
    step: float = 0.8
    #: Error for neighbouring places of the rim at no distance; the error falls with every place.
    without_places: float = 80.0
    #: Number of rotations in half a turn, in a film that is stiffer in one direction; more for an
    #: error below 1e-3.
    rotations: int = 6
    #: Finite elements for the stress about the probe.
    elements: ProbeMesh = field(default_factory=ProbeMesh)

    @property
    def decades(self) -> float:
        """Powers of ten by which the error is below 1e-3."""
        return -3.0 - math.log10(self.error)

    @property
    def scale(self) -> float:
        """Sizes over the sizes for an error of 1e-3."""
        return float(10.0 ** (-0.25 * self.decades))

    def cell_mm(self, scene: Scene, domain: Domain) -> float:
        """Cell of the table of a scene's probe, or of a tip's least contact."""
        assert scene.single_probe is not None
        round_cell = self.tip_cell if scene.tips else self.disc_cell
        share = self.cell if scene.single_probe.period_deg else round_cell
        size_mm = 1e3 * float(np.sqrt(pressed_outline(scene, domain.force_N[0]).area))
        return self.scale * min(share * size_mm, self.largest_cell_mm)

    def grid(self, scene: Scene, domain: Domain) -> Grid:
        """The grid of the table.

        Coefficients of Chebyshev polynomials of the force fall by 4 from one to the next, where
        the largest force is e times the least.
        """
        low, high = domain.log_force
        polynomials = 1 + math.ceil((1.25 + 0.5 * self.decades) * (high - low))
        cell_mm = self.cell_mm(scene, domain)
        return Grid.of(scene, domain, cell_mm, self.step, max(4, polynomials))

    def places(self, scene: Scene, domain: Domain) -> RimPlaces:
        """The places of the rim for which the stress is solved.

        Polynomials along diameters of the reach converge by the distance of the rim, where the
        stress is singular: each distance gains exp(2 arccosh(radius / reach)) (Bernstein).
        """
        assert scene.single_probe is not None
        reach_mm = domain.reach_mm + 2.0 * self.cell_mm(scene, domain)
        gain = 2.0 * math.acosh(scene.film.radius_mm / reach_mm)
        radii = max(2, math.ceil(math.log(self.without_places / self.error) / gain))
        rotations = self.rotations + max(0, math.ceil(2.0 * self.decades - 0.2))
        anisotropic = isotropy(scene.film) != "isotropic"
        return RimPlaces(scene.single_probe, reach_mm, radii, rotations if anisotropic else 0)

    def raster(self, scene: Scene, domain: Domain, places: RimPlaces) -> PolarRaster:
        """Points about the probe where the stress is taken; electrodes may be anywhere."""
        cell_mm = self.cell_mm(scene, domain)
        corners_mm = 1e3 * float(pressed_outline(scene, domain.force_N[0]).reach)
        rays = 4.0 * np.pi * corners_mm / (self.step * cell_mm)
        angles = places.angles * math.ceil(rays / places.angles)
        reach_mm = math.sqrt(2.0) * (domain.reach_mm + (MARGIN + 1) * cell_mm)
        reach_mm += scene.film.radius_mm
        return PolarRaster(reach_mm, self.step * cell_mm, angles, 2.5 * corners_mm)


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
        the solves so far; or whether these are shown, see `pvdf_fem.progress.shown`.
    options : ResponseOptions, optional
        By default those for the tolerance.

    Raises
    ------
    ValueError, FileError, NotConvergedError
        For a scene that has no such response, for a file that cannot be written, and when the film
        about the probe, or half of the touches held out, have no solution.
    """
    scene = scene_of(scene)
    mechanics_of(scene)  # refuses what no response is of
    wanted, known = wanted_model(scene)
    reach_mm = wanted.reach_mm if reach_mm is None else reach_mm
    forces = wanted.force_N if force_N is None else taken("force_N", force_N, tuple[float, float])
    domain = Domain(taken("reach_mm", reach_mm, float), forces)
    tolerance = known if tolerance is None else taken("tolerance", tolerance, float)
    refuse(scene, domain, tolerance, options)
    options = ResponseOptions(error=min(tolerance, 1.0)) if options is None else options
    if file is not None:
        require_writable(Path(file))
    with shown("s of one core", progress) as show:
        made = _best(scene, domain, tolerance, options, Work(taken("processes", processes, int | None), show))
    if file is not None:
        made.save(file)
    return made


def _best(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions, work: Work
) -> Response:
    """The first response that meets the tolerance, or the one with the smallest error bound."""
    names = tuple(electrode.name for electrode in scene.electrode_list)
    touches = random_touches(domain, options.held_out)
    solves, best, held_out = solves_of(scene, touches, tolerance), None, None
    for _ in range(options.attempts):
        grid, places = options.grid(scene, domain), options.places(scene, domain)
        raster = options.raster(scene, domain, places)
        # a place first: it takes the longest, and tells soon what the others take
        elements = options.elements.scaled(options.scale)
        # how stiff a tip's penalty is follows from the tolerance
        softened = scene.with_(**{"numerics.tolerance": min(options.error, 1e-2)})
        fields = _solves(softened, grid, places, raster, elements)
        found = [*work.run([fields[0], *solves, *fields[1:]])]
        if held_out is None:
            held_out = HeldOut.of(touches, found[1 : 1 + len(solves)])
        of_places = found[0], *found[1 + len(solves) :]
        solves = []
        stress = ProbeCharges.of(places, raster, of_places, 1e-3 * options.error)
        spline = grid.charges(stress, scene, work)
        made = Response(names, scene, domain, 0.0, 0.0, spline, tolerance, (), stress, held_out)
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


def _solves(
    scene: Scene, grid: Grid, places: RimPlaces, raster: PolarRaster, elements: ProbeMesh
) -> Sequence[tuple[Any, ...]]:
    """Tasks of the stress about the probe at the places of the rim."""
    # the stress does not depend on the electrodes, but a scene has at least one, and their channels
    radius = 0.9 * scene.film.radius_mm
    electrode = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius}
    changes = {"electrodes": [electrode], "readout": None, **dict.fromkeys(PLACE, 0.0)}
    upright = scene.with_(**changes)
    rest = force_nodes_N(grid.domain, grid.polynomials), raster, elements
    return [(mean_stress_about_probe, upright, place, *rest) for place in places.unique_places]


def refuse(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions | None = None
) -> None:
    """Raise `ValueError`, a line for each mistake, for what has no response: by the scene, the
    domain, and a tolerance that full solves could not confirm."""
    mechanics_of(scene)
    wrong = [*_mistakes_of(scene, domain, tolerance)]
    if not wrong:
        options = options or ResponseOptions(error=min(tolerance, 1.0))
        cell_mm = options.cell_mm(scene, domain)
        pressed_mm = 1e3 * pressed_outline(scene, domain.force_N[1]).reach
        limit = scene.film.radius_mm - pressed_mm - 3.0 * cell_mm
        if limit <= 0.0:
            wrong.append(
                "probe: comes too near the rim wherever it is; a response needs a smaller probe, or"
                " a larger film"
            )
        elif not 0.0 < domain.reach_mm < limit:
            wrong.append(
                f"reach_mm: {domain.reach_mm:g} is not between zero and where the probe would come"
                f" too near the rim, {limit:.3g}"
            )
    if wrong:
        raise ValueError("\n".join(wrong))


def _mistakes_of(
    scene: Scene, domain: Domain, tolerance: float, least_tolerance: float = 1e-6
) -> Iterator[str]:
    low, high = domain.force_N
    load, film, observable = scene.load, scene.film, scene.numerics.observable
    if not least_tolerance <= tolerance < np.inf:
        yield f"tolerance: {tolerance} is no number from {least_tolerance:g} on; give another"
    if not 0.0 < low < high < np.inf:
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
