"""A response built: solves, the table, and its error on touches that it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import joblib
import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray

from pvdf_fem.response.probe_stress import PolarRaster, mean_stress_about_probe
from pvdf_fem.response.response import Domain, Response
from pvdf_fem.response.rim_places import ProbeCharges, RimPlaces
from pvdf_fem.response.uniform_spline import Axis, CubicSpline
from pvdf_fem.scene.outline import Outline
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.shapes import PERIOD_DEG
from pvdf_fem.solution.gradients import PLACE
from pvdf_fem.solution.solution import NotConvergedError
from pvdf_fem.sweeps.sweep import solve_all
from pvdf_fem.touch.touch import touched

Array = NDArray[np.float64]

# Distances of the rim's places: the first try, and the last.
RADII = (4, 7)
# Polynomials of the force where it varies by e; their coefficients fall by 4 from one to the next.
FORCES_PER_E = 1.75
# Cell of the table over the root of the probe's area, and the largest.
CELL, LARGEST_CELL_MM = 1 / 16, 0.375
# The same of a disc, whose rotation does not count.
DISC_CELL = 1 / 28
# Way of the corners in a step of the rotation, over the cell.
TURN = 0.8
# Step of the raster of stress over the table's cell.
RASTER = 0.93
# Cells by which the table goes beyond the domain.
BEYOND = 3
# Touches for the error, and the tolerance of their solves over that of the response.
HELD_OUT, EXACTER = 40, 0.02
# The bound over the largest error among the touches held out.
MARGIN = 5.0


def build_response(
    scene: Scene,
    reach_mm: float = 15.0,
    force_N: tuple[float, float] = (0.05, 7.5),
    tolerance: float = 1e-3,
    processes: int | None = None,
    *,
    progress: Callable[[int, int], None] = lambda done, total: None,
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

    Raises
    ------
    ValueError
        For a scene that has no such response.
    NotConvergedError
        When a touch has no solution, or the tolerance is not met.
    """
    domain = Domain(reach_mm, force_N)
    processes = processes or -1
    refuse(scene, domain)
    touches = random_touches(domain, HELD_OUT)
    exact, sizes = solved(scene, touches, EXACTER * tolerance, processes)
    names = tuple(electrode.name for electrode in scene.electrode_list)
    for radii in range(RADII[0], RADII[1] + 1):
        plan = Plan.of(scene, domain, radii)
        spline = plan.table(plan.charges(processes, progress), processes)
        response = Response(names, scene, domain, tolerance, tolerance, spline)
        errors = np.abs(response.evaluate(touches)[0] - exact) / sizes
        bound = MARGIN * float(errors.max())
        if bound <= tolerance:
            rms = float(np.sqrt((errors**2).mean()))
            return Response(names, scene, domain, bound, rms, spline)
    raise NotConvergedError(
        f"tolerance: {tolerance:g} is missed by the response, whose error bound is {bound:.1e};"
        " raise the tolerance or make the domain smaller"
    )


def refuse(scene: Scene, domain: Domain) -> None:
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
    outline = probe.model_copy(update={"x_mm": 0.0, "y_mm": 0.0}).outline
    limit = film.radius_mm - 1e3 * outline.reach
    if not 0.0 < domain.reach_mm < limit - BEYOND * _cell_mm(scene):
        raise ValueError(
            f"reach_mm: {domain.reach_mm:g} is not between zero and where the probe would come too"
            f" near the rim, {limit - BEYOND * _cell_mm(scene):.3g}"
        )


def random_touches(domain: Domain, count: int, seed: int = 0) -> Array:
    """Touches (n, 4) all over a domain, evenly by place, rotation and logarithm of the force."""
    u = np.random.default_rng(seed).uniform(size=(count, 4))
    away, angle = domain.reach_mm * np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
    low, high = domain.force_N
    force = low * (high / low) ** u[:, 3]
    return np.stack([away * np.cos(angle), away * np.sin(angle), 360.0 * u[:, 2], force], axis=-1)


def solved(scene: Scene, touches: Array, tolerance: float, processes: int) -> tuple[Array, Array]:
    """Charges in pC of full solves, (n, electrodes), and |d31 X| + |d32 Y| of these.

    Raises
    ------
    NotConvergedError
        When a solve fails.
    """
    scenes = [touched(scene, touch, tolerance) for touch in touches]
    records = solve_all(scenes, processes=processes)
    for touch, record in zip(touches, records, strict=True):
        if not record.converged:
            x, y, rotation, force = touch
            place = f"x = {x:.6g} mm, y = {y:.6g} mm, {rotation:.6g} deg, {force:.6g} N"
            raise NotConvergedError(f"touch at {place}: {record.status}; {record.reason}")
    parts = np.array([record.forces["material"] for record in records])
    parts = parts * [scene.film.d31_pC_N, scene.film.d32_pC_N]
    return parts.sum(axis=-1), np.abs(parts).sum(axis=-1)


def _continued(
    charges: ProbeCharges,
    positions_mm: Array,
    limit_mm: float,
    electrodes: Sequence[Outline],
    rotation: float,
    d31_pC_N: float,
    d32_pC_N: float,
) -> Array:
    """`ProbeCharges.charges_pC`, continued on parabolas along the radius beyond a limit."""
    away = np.linalg.norm(positions_mm, axis=-1, keepdims=True)
    far = np.flatnonzero(away > limit_mm)
    beyond = away[far] - limit_mm
    at = positions_mm * (limit_mm / np.maximum(away, limit_mm))
    rows = [at, *(at[far] * (1.0 - k * beyond / limit_mm) for k in (1.0, 2.0))]
    found = charges.charges_pC(electrodes, np.concatenate(rows), rotation, d31_pC_N, d32_pC_N)
    whole, once, twice = np.split(found, [len(at), len(at) + len(far)])
    whole[far] = 3.0 * whole[far] - 3.0 * once + twice
    return whole


def _cell_mm(scene: Scene) -> float:
    assert scene.probe is not None
    share = CELL if PERIOD_DEG.get(scene.probe.shape, 360.0) else DISC_CELL
    return min(share * 1e3 * float(np.sqrt(scene.probe.outline.area)), LARGEST_CELL_MM)


@dataclass(frozen=True, eq=False)
class Plan:
    """What is solved for a response, and the grid of its table.

    Attributes
    ----------
    scene : Scene
    domain : Domain
    places : RimPlaces
    raster : PolarRaster
    forces_N : ndarray
    axes : tuple of Axis
        x and y in mm, rotation in degrees.
    """

    scene: Scene
    domain: Domain
    places: RimPlaces
    raster: PolarRaster
    forces_N: Array
    axes: tuple[Axis, Axis, Axis]

    @classmethod
    def of(cls, scene: Scene, domain: Domain, radii: int) -> Plan:
        """A plan with `radii` distances of the rim's places."""
        probe, cell = scene.probe, _cell_mm(scene)
        assert probe is not None
        places = RimPlaces(probe, domain.reach_mm + cell, radii)
        electrodes = max(electrode.outline.reach for electrode in scene.electrode_list)
        reach = domain.reach_mm + BEYOND * cell + 1e3 * electrodes
        about = np.ceil(np.pi * reach / (RASTER * cell) / places.angles)
        raster = PolarRaster(reach, RASTER * cell, places.angles * int(about))
        low, high = domain.force_N
        count = max(4, 1 + int(np.ceil(FORCES_PER_E * np.log(high / low))))
        return cls(
            scene, domain, places, raster, domain.force_nodes_N(count), cls._axes(scene, domain)
        )

    @staticmethod
    def _axes(scene: Scene, domain: Domain) -> tuple[Axis, Axis, Axis]:
        probe, cell = scene.probe, _cell_mm(scene)
        assert probe is not None
        half = int(np.ceil(domain.reach_mm / cell)) + BEYOND
        across = Axis(-half * cell, cell, 2 * half + 1)
        period = PERIOD_DEG.get(probe.shape, 360.0)
        if not period:
            return across, across, Axis(0.0, 90.0, 4, periodic=True)
        corners = 1e3 * probe.model_copy(update={"x_mm": 0.0, "y_mm": 0.0}).outline.reach
        turns = max(4, int(np.ceil(np.radians(period) * corners / (TURN * cell))))
        return across, across, Axis(0.0, period / turns, turns, periodic=True)

    def charges(self, processes: int, progress: Callable[[int, int], None]) -> ProbeCharges:
        """Solve for the stress about the probe."""
        scene = self.scene
        assert scene.probe is not None
        # the field does not depend on the electrodes; a scene has at least one
        whole = 0.9 * scene.film.radius_mm
        anywhere = {"name": "A", "shape": "circle", "x_mm": 0.0, "y_mm": 0.0, "radius_mm": whole}
        upright = scene.with_(**{"electrodes": [anywhere], **dict.fromkeys(PLACE, 0.0)})
        tasks = [
            joblib.delayed(mean_stress_about_probe)(upright, place, self.forces_N, self.raster)
            for place in -self.places.unique_centres_mm
        ]
        fields = []
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            for field in joblib.Parallel(processes, return_as="generator")(tasks):
                fields.append(field)
                progress(len(fields), len(tasks))
        uniaxial = scene.film.d31_pC_N != scene.film.d32_pC_N
        return ProbeCharges.of(self.places, self.raster, fields, uniaxial=uniaxial)

    def table(self, charges: ProbeCharges, processes: int) -> CubicSpline:
        """The spline of a response."""
        x, y, rotation = (axis.values for axis in self.axes)
        positions = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
        limit = self.domain.reach_mm + BEYOND * self.axes[0].step
        turns = rotation if PERIOD_DEG.get(self.places.probe.shape, 360.0) else rotation[:1]
        d_pC_N = self.scene.film.d31_pC_N, self.scene.film.d32_pC_N
        outlines = [electrode.outline for electrode in self.scene.electrode_list]
        with joblib.parallel_config("loky", inner_max_num_threads=1):
            found = joblib.Parallel(processes)(
                joblib.delayed(_continued)(
                    charges, positions, limit, outlines, np.radians(turn), *d_pC_N
                )
                for turn in turns
            )
        # (x y, rotations, forces, electrodes) to polynomials of the force
        values = np.stack(found if len(found) > 1 else found * len(rotation), axis=1)
        at = self.domain.scaled(self.forces_N)
        inverse = np.linalg.inv(chebyshev.chebvander(at, len(at) - 1))
        values = np.einsum("kf,prfe->prke", inverse, values)
        shape = (len(x), len(y), len(rotation), -1)
        return CubicSpline.through(self.axes, values.reshape(shape), np.float32)
