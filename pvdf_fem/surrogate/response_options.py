"""The resolution of a response, and validation of its scene, domain and tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.problem.symmetry import classify_isotropy
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.surrogate.charge_spline import compute_force_nodes_N, estimate_pressed_outline
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.stress.centre_grid import CentreGrid
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid
from pvdf_fem.surrogate.touch_domain import Domain
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS

#: Minimum tolerance of a response, which full solves can still confirm.
MIN_TOLERANCE = 1e-6


@dataclass(frozen=True)
class ResponseOptions:
    """Resolution of a response for a desired error, and measurement of its true error.

    The numbers of positions, forces and modes grow in proportion to -log(error); the sizes of cells
    and elements are proportional to error^(1/4). The sizes below are those for an error of 1e-3.
    """

    #: Relative error of the charges that the resolution is chosen for.
    error: float = 1e-3
    #: Number of random touches that are solved in full to measure the true error.
    validation_touches: int = 24
    #: Maximum number of builds, each with a smaller `error`, until the tolerance is met.
    max_builds: int = 3
    #: Cell size of the spline's grid divided by the square root of the probe's area.
    cell_fraction: float = 1 / 9
    #: Cell size for a tip, divided by the square root of its contact area at the minimum force. The
    #: fraction is larger, since the pressure at the edge of the contact is zero.
    tip_cell_fraction: float = 1 / 5
    #: Maximum cell size of the spline's grid.
    max_cell_mm: float = 0.6
    #: Steps divided by the cell size: the distance that the probe's corners move between two
    #: rotations, the step along the rays of the polar grid, and twice the distance between
    #: neighbouring rays at the probe's corners.
    step_fraction: float = 0.8

    @property
    def decades(self) -> float:
        """Number of decades by which `error` is below 1e-3; negative if it is above."""
        return -3.0 - math.log10(self.error)

    @property
    def size_factor(self) -> float:
        """Factor on the sizes that are stated for an error of 1e-3."""
        return float(10.0 ** (-0.25 * self.decades))

    def compute_cell_mm(self, scene: Scene, domain: Domain) -> float:
        """Compute the cell size in mm of the spline's grid of probe positions.

        Parameters
        ----------
        scene : Scene
            Scene with a single probe.
        domain : Domain
            Domain whose minimum force gives the smallest contact of a tip.
        """
        pressed = estimate_pressed_outline(scene, domain.force_N[0])
        pressed_size_mm = 1e3 * float(np.sqrt(pressed.area))
        fraction = self.tip_cell_fraction if scene.tips else self.cell_fraction
        return self.size_factor * min(fraction * pressed_size_mm, self.max_cell_mm)

    def compute_forces_N(self, domain: Domain) -> Array:
        """Compute the forces in N under which the stress is solved, in descending order.

        Their number grows with log(maximum force/minimum force) and with the number of decades of
        the error; it is at least 4.
        """
        log_lowest, log_highest = domain.log_force
        by_log_range = (1.25 + 0.5 * self.decades) * (log_highest - log_lowest)
        return compute_force_nodes_N(domain, max(4, 1 + math.ceil(by_log_range)))

    def make_centre_grid(
        self, scene: Scene, domain: Domain, prefactor: float = 80.0, rotation_count: int = 6
    ) -> CentreGrid:
        """Make the grid of positions of the film's centre, seen from the probe.

        Parameters
        ----------
        scene : Scene
            Scene with a single probe.
        domain : Domain
            Touches for which the response is valid. The grid reaches two cells farther.
        prefactor : float, optional
            Prefactor C of the interpolation error, see Notes.
        rotation_count : int, optional
            Number of rotations within 180 degrees for an orthotropic film, at an error of 1e-3. It
            is ignored for an isotropic film.

        Notes
        -----
        As a function of the probe's position, the stress is singular where the probe would reach
        the rim, at the distance R from the centre. So the error of a polynomial along a diameter of
        the grid, whose reach is r, is C ρ^(-2n) for n distances, with the parameter of the
        Bernstein ellipse ρ = exp(arccosh(R/r)) (Trefethen, Approximation Theory and Approximation
        Practice, chapter 8).
        """
        assert scene.single_probe is not None
        reach_mm = domain.reach_mm + 2.0 * self.compute_cell_mm(scene, domain)
        log_gain = 2.0 * math.acosh(1e3 * scene.film.radius / reach_mm)
        distance_count = max(2, math.ceil(math.log(prefactor / self.error) / log_gain))
        film_rotation_count = 0
        if classify_isotropy(scene.film) != "isotropic":
            film_rotation_count = rotation_count + max(0, math.ceil(2.0 * self.decades - 0.2))
        return CentreGrid.for_probe(
            scene.single_probe, reach_mm, distance_count, film_rotation_count
        )

    def make_polar_grid(self, scene: Scene, domain: Domain, centre_grid: CentreGrid) -> PolarGrid:
        """Make the polar grid about the probe on which the stress is sampled.

        Parameters
        ----------
        scene : Scene
            Scene with a single probe.
        domain : Domain
            Touches for which the response is valid. The grid covers the whole film with the probe
            at the position of any of these touches, since electrodes may be anywhere.
        centre_grid : CentreGrid
            Grid whose number of angles must divide the number of angles of the polar grid.
        """
        cell_mm = self.compute_cell_mm(scene, domain)
        corners_mm = 1e3 * float(estimate_pressed_outline(scene, domain.force_N[0]).reach)
        rays = 4.0 * np.pi * corners_mm / (self.step_fraction * cell_mm)
        angle_count = centre_grid.angle_count * math.ceil(rays / centre_grid.angle_count)
        # From the corner of the spline's square grid to the rim on the opposite side.
        reach_mm = math.sqrt(2.0) * (domain.reach_mm + (PADDING_STEPS + 1) * cell_mm)
        reach_mm += 1e3 * scene.film.radius
        return PolarGrid(
            reach_mm,
            self.step_fraction * cell_mm,
            angle_count=angle_count,
            stretch_mm=2.5 * corners_mm,
        )


def choose_options(scene: Scene, tolerance: float, tip_factor: float = 0.5) -> ResponseOptions:
    """Choose the resolution of a response by its tolerance.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    tolerance : float
        Maximum error bound of the response.
    tip_factor : float, optional
        Factor on the error that the resolution is chosen for if the probe is a tip, whose contact
        grows with the force and therefore needs a finer resolution.
    """
    error = min(tolerance, 1.0)
    if scene.tips:
        error *= tip_factor
    return ResponseOptions(error=error)


def find_validation_errors(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions | None = None
) -> Iterator[str]:
    """Yield error messages if no response can be built for a scene, a domain and a tolerance.

    Parameters
    ----------
    scene : Scene
        Scene to check.
    domain : Domain
        Touches for which the response should be valid.
    tolerance : float
        Maximum error bound of the response.
    options : ResponseOptions, optional
        Resolution of the response. Default: chosen by the tolerance.

    Yields
    ------
    str
        Message with a key and its value, what is wrong, and what to change.
    """
    try:
        make_mechanical_key(scene)
    except ValueError as error:
        yield from str(error).splitlines()
        return
    lowest, highest = domain.force_N
    has_tolerance = MIN_TOLERANCE <= tolerance < np.inf
    has_forces = 0.0 < lowest < highest < np.inf
    if not has_tolerance:
        reason = f"must be a finite number; give at least {MIN_TOLERANCE:g}"
        yield format_error("tolerance", tolerance, reason)
    if not has_forces:
        reason = "must be a range of positive forces; give the minimum and the maximum"
        yield format_error("force_range_N", domain.force_N, reason)
    yield from _find_incompatible_keys(scene)
    if has_tolerance and has_forces:
        if options is None:
            options = choose_options(scene, tolerance)
        yield from _find_reach_errors(scene, domain, options)


def _find_incompatible_keys(scene: Scene) -> Iterator[str]:
    """Yield an error message for each value of a scene that is incompatible with a response."""
    load = scene.load
    film = scene.film
    observable = scene.numerics.observable
    if load.kind == "rigid":
        reason = "the stress is singular at the edge of the probe; choose 'dead' or 'follower'"
        yield format_error("load.kind", load.kind, f"incompatible with a response: {reason}")
    if film.is_inhomogeneous:
        yield "film: patches and rim_displacement_um are incompatible with a response; remove them"
    for key in FILM_LOAD_CLASSES:
        value = getattr(film, key)
        if value:
            reason = "is incompatible with a response, whose unloaded film is flat; remove it"
            yield format_error(f"film.{key}", value, reason)
    if load.tangential_N is not None or load.profile != "uniform":
        yield (
            "load: a response requires a uniform pressure along z; remove load.tangential_N and"
            " load.profile"
        )
    if observable != "material":
        reason = "is incompatible with a response, which integrates the stress about the probe"
        yield format_error("numerics.observable", observable, f"{reason}; choose 'material'")


def _find_reach_errors(scene: Scene, domain: Domain, options: ResponseOptions) -> Iterator[str]:
    """Yield an error message if a reach is not positive or brings the probe too close to the rim.

    Parameters
    ----------
    scene : Scene
        Scene with a single probe.
    domain : Domain
        Domain with the reach, and with the maximum force that gives the largest contact of a tip.
    options : ResponseOptions
        Resolution; the probe must stay three cells of its spline away from the rim.
    """
    cell_mm = options.compute_cell_mm(scene, domain)
    corners_mm = 1e3 * estimate_pressed_outline(scene, domain.force_N[1]).reach
    limit_mm = 1e3 * scene.film.radius - corners_mm - 3.0 * cell_mm
    if not 0.0 < domain.reach_mm < limit_mm:
        reason = (
            f"must be between 0 and {max(limit_mm, 0.0):.3g}, where the probe comes too close to"
            " the rim; give a value in this range, or a smaller probe"
        )
        yield format_error("reach_mm", domain.reach_mm, reason)
