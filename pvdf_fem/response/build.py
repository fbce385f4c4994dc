"""How a response is built: its solves, its table, and its error at touches held out."""

from __future__ import annotations

import hashlib
import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Self

import joblib
import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.derivatives.parameters import PLACE
from pvdf_fem.files import FileError, make_directory, replacing, require_writable
from pvdf_fem.mesh.symmetry import isotropy
from pvdf_fem.response.held_out import SHARE, HeldOut, random_touches
from pvdf_fem.response.model import Domain, wanted_model
from pvdf_fem.response.polar_raster import PolarRaster
from pvdf_fem.response.probe_stress import ProbeMesh, mean_stress_about_probe
from pvdf_fem.response.response import Response
from pvdf_fem.response.response_file import mechanics_of, response_key
from pvdf_fem.response.rim_places import ProbeCharges, RimPlaces
from pvdf_fem.response.table import MARGIN, Grid, force_nodes_N, pressed_outline
from pvdf_fem.scene.registry import SPREAD_CLASSES
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solvers.status import Status
from pvdf_fem.sweeps.store import Store
from pvdf_fem.sweeps.sweep import Progress, shown

LEAST_TOLERANCE = 1e-6  #: Least error bound that full solves can confirm.


@dataclass(frozen=True)
class ResponseOptions:
    """Resolution of a response, and how its error is measured.

    The defaults are for an error bound of 1e-3 with the thesis's probes within 12 mm of the centre
    and forces from 0.1 to 5 N.
    """

    #: Number of distances of the rim's places.
    radii: int = 3
    #: Number of rotations in half a turn, in a film that is stiffer in one direction.
    rotations: int = 6
    #: Chebyshev polynomials of the force per factor e of the force; their coefficients fall by 4
    #: from one to the next.
    force_polynomials: float = 1.25
    #: Cell of the table over the root of the probe's area; a disc needs no rotations. Of a round
    #: tip it is the area of the least contact.
    cell: float = 1 / 9
    disc_cell: float = 1 / 14
    tip_cell: float = 1 / 4.7
    #: Largest cell.
    largest_cell_mm: float = 0.6
    #: Over the cell: the way of the probe's corners from one rotation to the next, the step of the
    #: raster of the stress, and the way between its rays at the probe's corners.
    rotation_step: float = 0.8
    raster_step: float = 0.93
    ray_step: float = 0.4
    #: Share of the norm of the largest mode below which modes are left out.
    least_mode: float = 1e-6
    #: Number of random touches for the error.
    held_out: int = 40
    #: Builds with ever finer options until the tolerance is met.
    attempts: int = 3
    #: Finite elements for the stress about the probe.
    elements: ProbeMesh = field(default_factory=ProbeMesh)

    @classmethod
    def of(cls, tolerance: float) -> Self:
        """Options that most likely meet a tolerance."""
        return cls().finer(1e-3 / tolerance) if 0.0 < tolerance < 1e-3 else cls()

    def finer(self, ratio: float) -> Self:
        """Options for an error that is smaller by a ratio above 1."""
        orders, size = math.log10(ratio), ratio**-0.25
        return replace(
            self,
            radii=self.radii + math.ceil(orders - 0.2),
            rotations=self.rotations + math.ceil(2.0 * orders - 0.2),
            force_polynomials=self.force_polynomials + 0.5 * orders,
            cell=size * self.cell,
            disc_cell=size * self.disc_cell,
            tip_cell=size * self.tip_cell,
            largest_cell_mm=size * self.largest_cell_mm,
            least_mode=self.least_mode / ratio,
            elements=self.elements.scaled(size),
        )

    def cell_mm(self, scene: Scene, domain: Domain) -> float:
        """Cell of the table of a scene's probe, or of a tip's least contact."""
        assert scene.single_probe is not None
        round_cell = self.tip_cell if scene.tips else self.disc_cell
        share = self.cell if scene.single_probe.period_deg else round_cell
        size_mm = 1e3 * float(np.sqrt(pressed_outline(scene, domain.force_N[0]).area))
        return min(share * size_mm, self.largest_cell_mm)

    def grid(self, scene: Scene, domain: Domain) -> Grid:
        """The grid of the table."""
        low, high = domain.log_force
        polynomials = max(4, 1 + int(np.ceil(self.force_polynomials * (high - low))))
        cell_mm = self.cell_mm(scene, domain)
        return Grid.of(scene, domain, cell_mm, self.rotation_step, polynomials)

    def places(self, scene: Scene, domain: Domain) -> RimPlaces:
        """The places of the rim for which the stress is solved."""
        assert scene.single_probe is not None
        rotations = 0 if isotropy(scene.film) == "isotropic" else self.rotations
        reach_mm = domain.reach_mm + self.cell_mm(scene, domain)
        return RimPlaces(scene.single_probe, reach_mm, self.radii, rotations)


def build_response(
    scene: Scene,
    reach_mm: float | None = None,
    force_N: tuple[float, float] | None = None,
    tolerance: float | None = None,
    processes: int | None = None,
    *,
    file: Path | str | None = None,
    progress: Progress | None = None,
    options: ResponseOptions | None = None,
) -> Response:
    """The response of a sensor to a probe.

    Parameters
    ----------
    scene : Scene
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
        Where the response is saved. Until then all that is solved is kept beside it in the
        directory ``FILE.part``, from which a build that was killed goes on.
    progress : callable, optional
        Called with the numbers of finished and of all solves. By default a terminal shows a bar.
    options : ResponseOptions, optional
        By default `ResponseOptions.of` the tolerance.

    Raises
    ------
    ValueError, FileError, NotConvergedError
        For a scene that has no such response, for a file or directory that cannot be written, and
        when the film about the probe, or half of the touches held out, have no solution.
    """
    mechanics_of(scene)  # refuses what no response is of
    wanted, known = wanted_model(scene)
    reach_mm = wanted.reach_mm if reach_mm is None else reach_mm
    domain = Domain(reach_mm, wanted.force_N if force_N is None else force_N)
    tolerance = known if tolerance is None else tolerance
    file = None if file is None else Path(file)
    options = ResponseOptions.of(tolerance) if options is None else options
    refuse(scene, domain, tolerance, options)
    bar = shown("solve", lines=False) if progress is None else nullcontext(progress)
    with bar as show, _unfinished(file) as folder:
        made = _best(scene, domain, tolerance, processes or -1, options, folder, show)
        if file is not None:
            made.save(file)
    return made


@contextmanager
def _unfinished(file: Path | None) -> Iterator[Path]:
    """Directory for solved scenes, removed on success; `FileError` if it cannot be made."""
    if file is None:
        with TemporaryDirectory() as temporary:
            yield Path(temporary)
        return
    require_writable(file)
    folder = file.with_name(f"{file.name}.part")
    make_directory(folder, "x")
    yield folder
    shutil.rmtree(folder, ignore_errors=True)


def _best(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    processes: int,
    options: ResponseOptions,
    folder: Path,
    show: Progress,
) -> Response:
    """The first response that meets the tolerance, or the one with the smallest error bound."""
    names = tuple(electrode.name for electrode in scene.electrode_list)
    touches, best = random_touches(domain, options.held_out), None
    places = options.places(scene, domain)
    ahead = len(places.unique_places)
    total = len(touches) + ahead

    def shown(done: int, missing: int) -> None:
        show(total - ahead - missing + done, total)

    with Store(folder / "touches.db") as store:
        held_out = HeldOut.solved(scene, touches, SHARE * tolerance, processes, store, shown)
    ahead = 0
    for _ in range(options.attempts):
        grid = options.grid(scene, domain)
        stress = _stress(scene, grid, places, options, folder, processes, shown)
        spline = grid.charges(stress, scene, processes)
        made = Response(names, scene, domain, 0.0, 0.0, spline, tolerance, (), stress, held_out)
        made = made.measured()
        best = made if best is None or made.error_bound < best.error_bound else best
        if best.status is Status.CONVERGED:
            break
        options = options.finer(max(2.0, 1.5 * made.error_bound / tolerance))
        places = options.places(scene, domain)
        total += len(places.unique_places)
    assert best is not None
    if missing := len(touches) - len(held_out.touches):
        remark = f"{missing} of the {len(touches)} touches held out have no solution"
        best = replace(best, remarks=(*best.remarks, remark))
    return best


def refuse(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions | None = None
) -> None:
    """Raise `ValueError` for a scene, a domain or a tolerance without a response."""
    low, high = domain.force_N
    options = options or ResponseOptions()
    mechanics_of(scene)
    if not LEAST_TOLERANCE <= tolerance < np.inf:
        raise ValueError(
            f"tolerance: {tolerance} is below {LEAST_TOLERANCE:g}, or no number; full solves could"
            " not confirm it"
        )
    if not 0.0 < low < high < np.inf:
        raise ValueError(f"force_N: {domain.force_N} is no range of positive forces")
    if scene.load.kind == "rigid":
        raise ValueError(
            "load.kind: 'rigid' makes the stress singular at the probe's edge, which a response"
            " cannot follow; take 'dead' or 'follower'"
        )
    if scene.film.is_uneven:
        raise ValueError(
            "film: patches and rim_displacement_um make a stress about a probe that is another one"
            " everywhere, which a response does not have; remove them"
        )
    for key in SPREAD_CLASSES:
        if value := getattr(scene.film, key):
            reason = "a response is of a film that is flat before it is touched"
            raise ValueError(f"film.{key}: {value!r} is not for a response; {reason}; remove it")
    if scene.load.tangential_N is not None or scene.load.profile != "uniform":
        uniform = "remove load.tangential_N and load.profile"
        raise ValueError(f"load: a response is of a uniform pressure along z; {uniform}")
    if scene.numerics.observable != "material":
        raise ValueError(
            f"numerics.observable: {scene.numerics.observable!r} is not the integral of a stress"
            " about the probe; take 'material'"
        )
    beyond_mm = 1e3 * pressed_outline(scene, high).reach + MARGIN * options.cell_mm(scene, domain)
    limit = scene.film.radius_mm - beyond_mm
    if limit <= 0.0:
        raise ValueError(
            "probe: comes too near the rim wherever it is; a response needs a smaller probe, or a"
            " larger film"
        )
    if not 0.0 < domain.reach_mm < limit:
        raise ValueError(
            f"reach_mm: {domain.reach_mm:g} is not between zero and where the probe would come too"
            f" near the rim, {limit:.3g}"
        )


def _stress(
    scene: Scene,
    grid: Grid,
    places: RimPlaces,
    options: ResponseOptions,
    folder: Path,
    processes: int,
    show: Progress,
) -> ProbeCharges:
    """The stress about the probe at all places of the rim, as far as it is not in the folder."""
    domain, cell = grid.domain, grid.axes[0].step
    corners_mm = 1e3 * float(pressed_outline(scene, domain.force_N[0]).reach)
    rays = 2.0 * np.pi * corners_mm / (options.ray_step * cell)
    # electrodes may be anywhere on the film
    reach_mm = domain.reach_mm + MARGIN * cell + scene.film.radius_mm
    angles = places.angles * int(np.ceil(rays / places.angles))
    raster = PolarRaster(reach_mm, options.raster_step * cell, angles, 2.5 * corners_mm)
    # the stress does not depend on the electrodes, but a scene has at least one, and their channels
    radius = 0.9 * scene.film.radius_mm
    electrode = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius}
    changes = {"electrodes": [electrode], "readout": None, **dict.fromkeys(PLACE, 0.0)}
    upright = scene.with_(**changes)
    rest = force_nodes_N(domain, grid.polynomials), raster, options.elements
    code = f"{response_key(scene, domain, 0.0)} {rest[0].tolist()} {rest[1:]}"
    keys = [f"{code} {place.tolist()}".encode() for place in places.unique_places]
    files = [folder / f"{hashlib.sha256(key).hexdigest()[:32]}.npy" for key in keys]
    fields = [_read(file) for file in files]
    missing = [i for i, field in enumerate(fields) if field is None]
    show(0, len(missing))
    stress_at = joblib.delayed(mean_stress_about_probe)
    tasks = [stress_at(upright, places.unique_places[i], *rest) for i in missing]
    with joblib.parallel_config("loky", inner_max_num_threads=1):
        solved = joblib.Parallel(processes, return_as="generator")(tasks)
        for done, (i, field) in enumerate(zip(missing, solved, strict=True), start=1):
            fields[i] = field
            # the folder is away when another program has just completed the same response
            with suppress(FileError), replacing(files[i]) as temporary:
                np.save(temporary, field)
            show(done, len(missing))
    known = [field for field in fields if field is not None]
    return ProbeCharges.of(places, raster, known, options.least_mode)


def _read(file: Path) -> Array | None:
    """A field that was kept; None if it was not, or is damaged."""
    with suppress(OSError, ValueError, EOFError):
        return np.asarray(np.load(file, allow_pickle=False))
    return None
