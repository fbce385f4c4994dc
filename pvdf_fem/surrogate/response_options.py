"""Resolution of a response, and the requirements on its scene."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.mesh.symmetry import classify_isotropy
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES
from pvdf_fem.scene.scene import Scene
from pvdf_fem.surrogate.charge_spline import (
    compute_force_nodes_N,
    estimate_pressed_outline,
)
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.stress.centre_grid import CentreGrid
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid
from pvdf_fem.surrogate.touch_domain import Domain
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS


@dataclass(frozen=True)
class ResponseOptions:
    """Resolution of a response by the error that it is for, and how its true error is measured.

    Numbers of places, forces and modes grow with the logarithm of the error, the sizes of cells and
    elements fall with its fourth root. Sizes here are those for an error of 1e-3.
    """

    #: Largest error of a charge that the resolution is for.
    error: float = 1e-3
    #: Number of random touches for the true error.
    validation_touches: int = 24
    #: Builds with ever finer options until the tolerance is met.
    max_builds: int = 3
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
        size_mm = 1e3 * float(np.sqrt(estimate_pressed_outline(scene, domain.force_N[0]).area))
        share = self.tip_cell if scene.tips else self.cell
        return self.scale * min(share * size_mm, self.largest_cell_mm)

    def forces_N(self, domain: Domain) -> Array:
        """Forces under which the stress is solved.

        Coefficients of polynomials of the force fall by 4 from one to the next, where the largest
        force is e times the least.
        """
        low, high = domain.log_force
        count = 1 + math.ceil((1.25 + 0.5 * self.decades) * (high - low))
        return compute_force_nodes_N(domain, max(4, count))

    def places(
        self, scene: Scene, domain: Domain, no_place: float = 80.0, rotations: int = 6
    ) -> CentreGrid:
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
        anisotropic = classify_isotropy(scene.film) != "isotropic"
        return CentreGrid.of(scene.single_probe, reach_mm, radii, rotations if anisotropic else 0)

    def raster(self, scene: Scene, domain: Domain, places: CentreGrid) -> PolarGrid:
        """Points about the probe where the stress is taken; electrodes may be anywhere."""
        cell_mm = self.cell_mm(scene, domain)
        corners_mm = 1e3 * float(estimate_pressed_outline(scene, domain.force_N[0]).reach)
        rays = 4.0 * np.pi * corners_mm / (self.step * cell_mm)
        angles = places.angles * math.ceil(rays / places.angles)
        reach_mm = math.sqrt(2.0) * (domain.reach_mm + (PADDING_STEPS + 1) * cell_mm)
        reach_mm += scene.film.radius_mm
        return PolarGrid(reach_mm, self.step * cell_mm, angles, 2.5 * corners_mm)


def choose_options(scene: Scene, tolerance: float, of_tip: float = 0.5) -> ResponseOptions:
    """The options for a tolerance; for a part of the tolerance under a tip, whose contact grows
    with the force."""
    return ResponseOptions(error=min(tolerance, 1.0) * (of_tip if scene.tips else 1.0))


def find_validation_errors(
    scene: Scene,
    domain: Domain,
    tolerance: float,
    options: ResponseOptions | None = None,
    least_tolerance: float = 1e-6,
) -> Iterator[str]:
    """What is wrong with a scene and a domain that have no response, and with a tolerance that full
    solves could not confirm."""
    try:
        make_mechanical_key(scene)
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
    if film.is_inhomogeneous:
        yield "film: patches and rim_displacement_um are not for a response; remove them"
    for key in FILM_LOAD_CLASSES:
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
        cell_mm = (options or choose_options(scene, tolerance)).cell_mm(scene, domain)
        pressed_mm = 1e3 * estimate_pressed_outline(scene, high).reach
        limit = scene.film.radius_mm - pressed_mm - 3.0 * cell_mm
        if not 0.0 < domain.reach_mm < limit:
            near = f"{max(limit, 0.0):.3g}, from where on the probe comes too near the rim"
            advice = "give another reach, or a smaller probe"
            yield f"reach_mm: {domain.reach_mm:g} is not between zero and {near}; {advice}"
