"""How a response is built: its solves, its table, and its error at touches held out."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import joblib
import numpy as np
from numpy.polynomial import chebyshev

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import Domain, scene_of_touch
from pvdf_fem.response.probe_stress import PolarRaster, ProbeMesh, mean_stress_about_probe
from pvdf_fem.response.response import Response, force_nodes_N, scaled_force
from pvdf_fem.response.rim_places import ProbeCharges, RimPlaces
from pvdf_fem.response.uniform_spline import UniformAxis, UniformSpline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.gradients import PLACE
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.sweeps.sweep import solve_all


@dataclass(frozen=True)
class ResponseOptions:
    """Resolution of a response, and how its error is measured.

    The defaults give error bounds of about 1e-4 for the thesis's probes within 12 mm of the centre
    and forces from 0.1 to 5 N.
    """

    #: Numbers of distances of the rim's places, tried in turn until the tolerance is met.
    radii: tuple[int, ...] = (4, 5, 6, 7)
    #: Chebyshev polynomials of the force per factor e of the force; their coefficients fall by 4
    #: from one to the next.
    force_polynomials: float = 1.75
    #: Cell of the table over the root of the probe's area.
    cell: float = 1 / 16
    #: The same for a disc, whose table can be finer as it needs no rotations.
    disc_cell: float = 1 / 28
    #: Largest cell.
    largest_cell_mm: float = 0.375
    #: Way of the corners of the probe from one rotation to the next, over the cell.
    rotation_step: float = 0.8
    #: Step of the raster of the stress over the cell.
    raster_step: float = 0.93
    #: Cells by which the table goes beyond the domain.
    margin: int = 3
    #: Number of random touches for the error.
    held_out: int = 40
    #: Tolerance of their full solves over that of the response.
    held_out_tolerance: float = 0.02
    #: Error bound over the largest error at these touches.
    safety: float = 5.0
    #: Finite elements for the stress about the probe.
    elements: ProbeMesh = field(default_factory=ProbeMesh)

    def cell_mm(self, scene: Scene) -> float:
        """Cell of the table of a scene's probe."""
        assert scene.probe is not None
        share = self.cell if scene.probe.period_deg else self.disc_cell
        return min(share * 1e3 * float(np.sqrt(scene.probe.outline.area)), self.largest_cell_mm)

    def polynomial_count(self, domain: Domain) -> int:
        """Number of Chebyshev polynomials for a domain's forces."""
        low, high = domain.log_force
        return max(4, 1 + int(np.ceil(self.force_polynomials * (high - low))))


DEFAULTS = ResponseOptions()


def build_response(
    scene: Scene,
    reach_mm: float = 15.0,
    force_N: tuple[float, float] = (0.05, 7.5),
    tolerance: float = 1e-3,
    processes: int | None = None,
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
    options: ResponseOptions = DEFAULTS,
) -> Response:
    """The response of a sensor to a probe.

    Parameters
    ----------
    scene : Scene
        Film, electrodes and probe.
    reach_mm : float
        Largest distance of the probe from the film's centre.
    force_N : tuple of float
        Least and largest force.
    tolerance : float
        Largest error bound.
    processes : int, optional
        Number of processes, all cores when not given.
    progress : callable
        Called with the numbers of finished and of all solves.
    options : ResponseOptions
        Resolution of the response.

    Raises
    ------
    ValueError
        For a scene that has no such response.
    NotConvergedError
        When a touch has no solution, or the tolerance is not met.
    """
    domain = Domain(reach_mm, force_N)
    processes = processes or -1
    refuse(scene, domain, options)
    touches = random_touches(domain, options.held_out)
    exact, sizes = full_charges(scene, touches, options.held_out_tolerance * tolerance, processes)
    names = tuple(electrode.name for electrode in scene.electrode_list)
    bound = np.inf
    for radii in options.radii:
        table = ResponseTable.of(scene, domain, radii, options)
        spline = table.spline(table.probe_charges(processes, progress), processes)
        response = Response(names, scene, domain, tolerance, tolerance, spline)
        errors = np.abs(response.evaluate(touches)[0] - exact) / sizes
        bound = options.safety * float(errors.max())
        if bound <= tolerance:
            rms = float(np.sqrt((errors**2).mean()))
            return Response(names, scene, domain, bound, rms, spline)
    raise NotConvergedError(
        f"tolerance: {tolerance:g} is missed by the response, whose error bound is {bound:.1e};"
        " raise the tolerance or make the domain smaller"
    )


def refuse(scene: Scene, domain: Domain, options: ResponseOptions = DEFAULTS) -> None:
    """Raise `ValueError` for a scene or a domain without a response."""
    low, high = domain.force_N
    film, probe = scene.film, scene.probe
    if probe is None:
        raise ValueError("scene: has no probe; give it one")
    if not 0.0 < low < high < np.inf:
        raise ValueError(f"force_N: {domain.force_N} is no range of positive forces")
    if isinstance(film.youngs_modulus_GPa, tuple) or film.shear_modulus_GPa is not None:
        raise ValueError(
            f"film.youngs_modulus_GPa: {film.youngs_modulus_GPa} is stiffer in one direction, so"
            " the stress about a probe depends on its rotation; take an isotropic film"
        )
    if scene.load.kind == "rigid":
        raise ValueError(
            "load.kind: 'rigid' makes the stress singular at the probe's edge, which a response"
            " cannot follow; take 'dead' or 'follower'"
        )
    if scene.numerics.observable != "material":
        raise ValueError(
            f"numerics.observable: {scene.numerics.observable!r} is not the integral of a stress"
            " about the probe; take 'material'"
        )
    margin_mm = options.margin * options.cell_mm(scene)
    limit = film.radius_mm - _circumradius_mm(scene) - margin_mm
    if not 0.0 < domain.reach_mm < limit:
        raise ValueError(
            f"reach_mm: {domain.reach_mm:g} is not between zero and where the probe would come too"
            f" near the rim, {limit:.3g}"
        )


def random_touches(domain: Domain, count: int, seed: int = 0) -> Array:
    """Touches (n, 4) all over a domain, evenly by place, rotation and logarithm of the force."""
    u = np.random.default_rng(seed).uniform(size=(count, 4))
    distance, angle = domain.reach_mm * np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
    low, high = domain.force_N
    x, y, forces = distance * np.cos(angle), distance * np.sin(angle), low * (high / low) ** u[:, 3]
    return np.stack([x, y, 360.0 * u[:, 2], forces], axis=-1)


def full_charges(
    scene: Scene, touches: Array, tolerance: float, processes: int
) -> tuple[Array, Array]:
    """Charges in pC of full solves, (n, electrodes), and their sizes |d31 X| + |d32 Y|.

    Raises `NotConvergedError` when a solve fails.
    """
    scenes = [scene_of_touch(scene, touch, tolerance) for touch in touches]
    records = solve_all(scenes, processes=processes)
    for touch, record in zip(touches, records, strict=True):
        if not record.converged:
            x, y, rotation, force = touch
            place = f"x = {x:.6g} mm, y = {y:.6g} mm, {rotation:.6g} deg, {force:.6g} N"
            raise NotConvergedError(f"touch at {place}: {record.status}; {record.reason}")
    terms = np.array([record.forces["material"] for record in records])
    terms = terms * [scene.film.d31_pC_N, scene.film.d32_pC_N]
    return terms.sum(axis=-1), np.abs(terms).sum(axis=-1)


def _circumradius_mm(scene: Scene) -> float:
    """Largest distance of the probe's outline from its centroid."""
    assert scene.probe is not None
    centred = scene.probe.model_copy(update={"x_mm": 0.0, "y_mm": 0.0})
    return 1e3 * float(centred.outline.reach)


@dataclass(frozen=True, eq=False)
class ResponseTable:
    """The grid of a response's table, and what is solved to fill it."""

    scene: Scene
    domain: Domain
    places: RimPlaces
    raster: PolarRaster
    forces_N: Array
    #: x and y in mm, rotation in degrees.
    axes: tuple[UniformAxis, UniformAxis, UniformAxis]
    #: Distance of the probe from the centre, beyond which charges are continued by parabolas.
    limit_mm: float
    elements: ProbeMesh

    @classmethod
    def of(
        cls, scene: Scene, domain: Domain, radii: int, options: ResponseOptions
    ) -> ResponseTable:
        """The table with `radii` distances of the rim's places."""
        assert scene.probe is not None
        cell, axes = options.cell_mm(scene), _axes(scene, domain, options)
        places = RimPlaces(scene.probe, domain.reach_mm + cell, radii)
        limit = domain.reach_mm + options.margin * cell
        reach = limit + 1e3 * max(electrode.outline.reach for electrode in scene.electrode_list)
        step = options.raster_step * cell
        angles = places.angles * int(np.ceil(np.pi * reach / step / places.angles))
        forces = force_nodes_N(domain, options.polynomial_count(domain))
        raster = PolarRaster(reach, step, angles)
        return cls(scene, domain, places, raster, forces, axes, limit, options.elements)

    def probe_charges(self, processes: int, progress: Callable[[int, int], None]) -> ProbeCharges:
        """Solve for the stress about the probe at all places of the rim."""
        scene = self.scene
        # the stress does not depend on the electrodes, but a scene has at least one
        radius = 0.9 * scene.film.radius_mm
        electrode = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": radius}
        upright = scene.with_(**{"electrodes": [electrode], **dict.fromkeys(PLACE, 0.0)})
        stress_at, rest = joblib.delayed(mean_stress_about_probe), (self.raster, self.elements)
        places = -self.places.unique_centres_mm
        tasks = [stress_at(upright, place, self.forces_N, *rest) for place in places]
        fields = []
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            for stress in joblib.Parallel(processes, return_as="generator")(tasks):
                fields.append(stress)
                progress(len(fields), len(tasks))
        uniaxial = scene.film.d31_pC_N != scene.film.d32_pC_N
        return ProbeCharges.of(self.places, self.raster, fields, uniaxial=uniaxial)

    def spline(self, charges: ProbeCharges, processes: int) -> UniformSpline:
        """The spline of the response over place and rotation."""
        x, y, rotations = (axis.values for axis in self.axes)
        positions = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        different = rotations if self.places.probe.period_deg else rotations[:1]
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            by_rotation = joblib.Parallel(processes)(
                joblib.delayed(_continued_charges)(
                    charges, self.scene, positions, np.radians(rotation), self.limit_mm
                )
                for rotation in different
            )
        # (x y, rotations, forces, electrodes), then polynomials of the force
        by_force = np.stack(by_rotation, axis=1)
        nodes, _ = scaled_force(self.domain, self.forces_N)
        inverse = np.linalg.inv(chebyshev.chebvander(nodes, len(nodes) - 1))
        by_order = np.einsum("kf,prfe->prke", inverse, by_force)
        by_order = np.repeat(by_order, len(rotations) // len(different), axis=1)
        shape = (len(x), len(y), len(rotations), -1)
        return UniformSpline.through(self.axes, by_order.reshape(shape), np.float32)


def _axes(
    scene: Scene, domain: Domain, options: ResponseOptions
) -> tuple[UniformAxis, UniformAxis, UniformAxis]:
    assert scene.probe is not None
    cell = options.cell_mm(scene)
    half = int(np.ceil(domain.reach_mm / cell)) + options.margin
    across = UniformAxis(-half * cell, cell, 2 * half + 1)
    period = scene.probe.period_deg
    if not period:
        return across, across, UniformAxis(0.0, 90.0, 4, periodic=True)
    way = np.radians(period) * _circumradius_mm(scene)
    rotations = max(4, int(np.ceil(way / (options.rotation_step * cell))))
    return across, across, UniformAxis(0.0, period / rotations, rotations, periodic=True)


def _continued_charges(
    charges: ProbeCharges, scene: Scene, positions_mm: Array, rotation: float, limit_mm: float
) -> Array:
    """`ProbeCharges.charges_pC`, continued by parabolas along the radius beyond a limit.

    A parabola goes through the charges at the limit, and as far inside of it as the position is
    outside, once and twice.
    """
    distance = np.linalg.norm(positions_mm, axis=-1, keepdims=True)
    far = np.flatnonzero(distance > limit_mm)
    beyond = distance[far] - limit_mm
    held = positions_mm * (limit_mm / np.maximum(distance, limit_mm))
    inner = [held[far] * (1.0 - k * beyond / limit_mm) for k in (1.0, 2.0)]
    outlines = [electrode.outline for electrode in scene.electrode_list]
    d_pC_N = scene.film.d31_pC_N, scene.film.d32_pC_N
    values = charges.charges_pC(outlines, np.concatenate([held, *inner]), rotation, d_pC_N)
    at_limit, once, twice = np.split(values, [len(held), len(held) + len(far)])
    at_limit[far] = 3.0 * at_limit[far] - 3.0 * once + twice
    return at_limit
