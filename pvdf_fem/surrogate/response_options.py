"""The resolution of a response, and the requirements on its scene, domain and tolerance."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.mesh.symmetry import classify_isotropy
from pvdf_fem.scene.registry import FILM_LOAD_CLASSES
from pvdf_fem.scene.scene import Scene
from pvdf_fem.scene.scene_file import format_error
from pvdf_fem.surrogate.charge_spline import compute_force_nodes_N, estimate_pressed_outline
from pvdf_fem.surrogate.response_key import make_mechanical_key
from pvdf_fem.surrogate.stress.centre_grid import CentreGrid
from pvdf_fem.surrogate.stress.polar_grid import PolarGrid
from pvdf_fem.surrogate.touch_domain import Domain
from pvdf_fem.surrogate.uniform_spline import PADDING_STEPS

#: Least tolerance of a response, which full solves can still confirm.
MIN_TOLERANCE = 1e-6


@dataclass(frozen=True)
class ResponseOptions:
    """The resolution of a response for a given error, and how its true error is measured.

    Numbers of positions, forces and modes grow with the logarithm of the error; the sizes of cells
    and elements fall with its fourth root. The sizes below are those for an error of 1e-3.
    """

    #: Largest relative error of a charge for which the resolution is chosen.
    error: float = 1e-3
    #: Number of random touches whose full solves measure the true error.
    validation_touches: int = 24
    #: Largest number of builds, each with finer options, until the tolerance is met.
    max_builds: int = 3
    #: Cell of the spline's grid over the root of the probe's area.
    cell_fraction: float = 1 / 9
    #: The same over the root of the area of a tip's least contact, at whose edge the pressure is
    #: zero.
    tip_cell_fraction: float = 1 / 5
    #: Largest cell of the spline's grid.
    max_cell_mm: float = 0.6
    #: Over the cell: the movement of the probe's corners from one rotation to the next, the step of
    #: the polar grid of the stress, and twice the distance of its rays at the probe's corners.
    step_fraction: float = 0.8

    @property
    def decades(self) -> float:
        """Powers of ten by which the error is below 1e-3."""
        return -3.0 - math.log10(self.error)

    @property
    def size_factor(self) -> float:
        """Sizes over the sizes for an error of 1e-3."""
        return float(10.0 ** (-0.25 * self.decades))

    def compute_cell_mm(self, scene: Scene, domain: Domain) -> float:
        """Return the cell of the spline's grid over the places of the probe."""
        pressed = estimate_pressed_outline(scene, domain.force_N[0])
        pressed_size_mm = 1e3 * float(np.sqrt(pressed.area))
        share = self.tip_cell_fraction if scene.tips else self.cell_fraction
        return self.size_factor * min(share * pressed_size_mm, self.max_cell_mm)

    def compute_forces_N(self, domain: Domain) -> Array:
        """Return the forces under which the stress is solved.

        The coefficients of polynomials of the force fall by a factor of 4 from one to the next
        where the largest force is e times the least.
        """
        log_lowest, log_highest = domain.log_force
        by_log_range = (1.25 + 0.5 * self.decades) * (log_highest - log_lowest)
        return compute_force_nodes_N(domain, max(4, 1 + math.ceil(by_log_range)))

    def make_centre_grid(
        self, scene: Scene, domain: Domain, error_without: float = 80.0, rotation_count: int = 6
    ) -> CentreGrid:
        """Make the grid of film centres about the probe for which the stress is solved.

        Parameters
        ----------
        scene : Scene
            With one probe.
        domain : Domain
            Touches for which the response is valid.
        error_without : float, optional
            Error of the interpolation extrapolated to no distances at all.
        rotation_count : int, optional
            Number of rotations in half a turn for an orthotropic film, at an error of 1e-3.

        Notes
        -----
        Polynomials along diameters of the reach converge by the distance of the rim, where the
        stress is singular: each distance divides the error by exp(2 arccosh(radius / reach)), the
        square of the parameter of Bernstein's ellipse (Trefethen, Approximation Theory and
        Approximation Practice, chapter 8).
        """
        assert scene.single_probe is not None
        reach_mm = domain.reach_mm + 2.0 * self.compute_cell_mm(scene, domain)
        log_gain = 2.0 * math.acosh(scene.film.radius_mm / reach_mm)
        distance_count = max(2, math.ceil(math.log(error_without / self.error) / log_gain))
        film_rotation_count = 0
        if classify_isotropy(scene.film) != "isotropic":
            film_rotation_count = rotation_count + max(0, math.ceil(2.0 * self.decades - 0.2))
        return CentreGrid.for_probe(
            scene.single_probe, reach_mm, distance_count, film_rotation_count
        )

    def make_polar_grid(self, scene: Scene, domain: Domain, centre_grid: CentreGrid) -> PolarGrid:
        """Make the grid about the probe on which the stress is sampled.

        Parameters
        ----------
        scene : Scene
            Film, electrodes, probe and load.
        domain : Domain
            From all of its places the grid covers the film, since electrodes may be anywhere.
        centre_grid : CentreGrid
            Its number of angles divides that of the polar grid.
        """
        cell_mm = self.compute_cell_mm(scene, domain)
        corners_mm = 1e3 * float(estimate_pressed_outline(scene, domain.force_N[0]).reach)
        rays = 4.0 * np.pi * corners_mm / (self.step_fraction * cell_mm)
        angle_count = centre_grid.angle_count * math.ceil(rays / centre_grid.angle_count)
        # from the corner of the spline's square grid to the rim on the other side
        reach_mm = math.sqrt(2.0) * (domain.reach_mm + (PADDING_STEPS + 1) * cell_mm)
        reach_mm += scene.film.radius_mm
        return PolarGrid(
            reach_mm,
            self.step_fraction * cell_mm,
            angle_count=angle_count,
            stretch_mm=2.5 * corners_mm,
        )


def choose_options(scene: Scene, tolerance: float, share_of_tip: float = 0.5) -> ResponseOptions:
    """Choose the options for a tolerance.

    Parameters
    ----------
    scene : Scene
        Film, electrodes, probe and load.
    tolerance : float
        Largest relative error of a charge.
    share_of_tip : float, optional
        Error over tolerance under a tip, whose contact grows with the force.
    """
    error = min(tolerance, 1.0)
    if scene.tips:
        error *= share_of_tip
    return ResponseOptions(error=error)


def find_validation_errors(
    scene: Scene, domain: Domain, tolerance: float, options: ResponseOptions | None = None
) -> Iterator[str]:
    """Yield the reasons for which a response cannot be built.

    Parameters
    ----------
    scene : Scene
        Film, electrodes, probe and load.
    domain : Domain
        Touches for which the response is valid.
    tolerance : float
        Largest relative error of a charge.
    options : ResponseOptions, optional
        By default those for the tolerance.

    Yields
    ------
    str
        The key with its value, the reason, and a change that helps.
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
        reason = f"must be a finite number; give one from {MIN_TOLERANCE:g} on"
        yield format_error("tolerance", tolerance, reason)
    if not has_forces:
        reason = "must be a range of positive forces; give the least and the largest"
        yield format_error("force_range_N", domain.force_N, reason)
    yield from _find_incompatible_keys(scene)
    if has_tolerance and has_forces:
        if options is None:
            options = choose_options(scene, tolerance)
        yield from _find_reach_errors(scene, domain, options)


def _find_incompatible_keys(scene: Scene) -> Iterator[str]:
    """Yield an error for each key of a scene that is incompatible with a response."""
    load = scene.load
    film = scene.film
    observable = scene.numerics.observable
    if load.kind == "rigid":
        reason = "makes the stress singular at the probe's edge; take 'dead' or 'follower'"
        yield format_error("load.kind", load.kind, f"incompatible with a response: {reason}")
    if film.is_inhomogeneous:
        yield "film: patches and rim_displacement_um are incompatible with a response; remove them"
    for key in FILM_LOAD_CLASSES:
        value = getattr(film, key)
        if value:
            reason = "incompatible with a response, whose film is flat without a probe; remove it"
            yield format_error(f"film.{key}", value, reason)
    if load.tangential_N is not None or load.profile != "uniform":
        yield (
            "load: a response needs a uniform pressure along z; remove load.tangential_N and"
            " load.profile"
        )
    if observable != "material":
        reason = "no integral of the stress about the probe, which a response needs"
        yield format_error("numerics.observable", observable, f"{reason}; take 'material'")


def _find_reach_errors(scene: Scene, domain: Domain, options: ResponseOptions) -> Iterator[str]:
    """Yield an error if the probe comes too near the rim."""
    cell_mm = options.compute_cell_mm(scene, domain)
    corners_mm = 1e3 * estimate_pressed_outline(scene, domain.force_N[1]).reach
    limit_mm = scene.film.radius_mm - corners_mm - 3.0 * cell_mm
    if not 0.0 < domain.reach_mm < limit_mm:
        reason = (
            f"must be between zero and {max(limit_mm, 0.0):.3g}, where the probe comes too near"
            " the rim; give another reach, or a smaller probe"
        )
        yield format_error("reach_mm", domain.reach_mm, reason)
