"""Strains that vary over the film: due to heat from warm probes, and to rim displacements.

A probe holds the face that it touches at its temperature; the other face and the film beside the
probe lose no heat. Under the probe the temperature, averaged over the thickness, is that of a plate
heated from one side. Beside a straight edge of the probe it falls with the distance d like
erfc(d/√(4 κ t)), with the thermal diffusivity κ and the time of contact t; around a round probe of
radius R it is multiplied by √(R/(R + d)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Self

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.effects import Charges, EffectNote, describe_charge_effect
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline, average_over
from pvdf_fem.scene.scene import LoadedProbe, Scene


def compute_mean_warming(fourier: float, terms: int = 12) -> float:
    """Compute the mean temperature over the thickness of a plate heated on one face.

    Parameters
    ----------
    fourier : float
        Fourier number κ t/h², with the thermal diffusivity κ, the time t since the heating began,
        and the thickness h. The other face is insulated.
    terms : int
        Number of terms of the series.

    Returns
    -------
    float
        Mean temperature as a fraction of that of the heated face, from 0 to 1.

    Notes
    -----
    For small F = κ t/h² it is 2 √(F/π), otherwise 1 - 2 Σ exp(-n² F)/n² with n = π/2, 3π/2, ...
    (Carslaw and Jaeger, Conduction of Heat in Solids, section 3.4).
    """
    if fourier < 0.05:  # the heat has not reached the other face
        return 2.0 * float(np.sqrt(fourier / np.pi))
    n = np.pi * (np.arange(terms) + 0.5)
    return 1.0 - 2.0 * float((np.exp(-(n**2) * fourier) / n**2).sum())


def compute_heat_length(film: Film, probe: LoadedProbe) -> float:
    """Compute the diffusion length √(4 κ t) in m of a warm probe's heat.

    The time t is the probe's ``contact_time_s``, by default 1 s.
    """
    seconds = probe.probe.contact_time_s or 1.0
    return float(np.sqrt(4.0 * film.thermal_diffusivity_m2_s * seconds))


def describe_heat_effects(
    scene: Scene,
    charges_pC: Charges = None,
    typical_uC_m2K: float = 25.0,
    heat_capacity: float = 1300.0,
    heat_transfer: float = 10.0,
) -> Iterator[EffectNote]:
    """Yield notes about the effects of heat on the charges.

    Parameters
    ----------
    scene : Scene
        Scene with the film, its electrodes and the probes that may be warm.
    charges_pC : mapping, optional
        Charges of the solution in pC, with which the charge due to warming is compared.
    typical_uC_m2K : float
        Typical pyroelectric coefficient of PVDF in µC/(m² K), for a film without one.
    heat_capacity : float
        Heat capacity of PVDF in J/(kg K).
    heat_transfer : float
        Heat transfer of each face to still air in W/(m² K).

    Yields
    ------
    EffectNote
        For each warm probe, two effects that are always neglected. Then, unless it is zero, the
        charge due to the warming of the film, on the electrode where it is largest.
    """
    film = scene.film
    seconds = film.thickness * film.density * heat_capacity / (2.0 * heat_transfer)
    for probe in scene.loaded_probes:
        if probe.probe.temperature_K:
            misplaced = _estimate_misplaced_heat(probe.outline, compute_heat_length(film, probe))
            corners = f"how heat of the {probe.patch} spreads at corners or bulges"
            size = f"about {100.0 * misplaced:.2g} % of that heat"
            yield EffectNote(False, f"{corners}: {size}; no key includes it")
            lost = f"heat that the air takes from the film beside the {probe.patch}"
            time = f"most of it after some {seconds:.2g} s"
            yield EffectNote(False, f"{lost}: {time}; no key includes it")
    heat = {
        electrode.name: _integrate_warming(scene, electrode.outline)
        for electrode in scene.electrode_list
    }
    name = max(heat, key=lambda electrode: abs(heat[electrode]), default=None)
    if name is not None and heat[name]:
        yield describe_charge_effect(
            ("pyroelectricity, charge by warming", "film.pyroelectric_uC_m2K"),
            coefficient=film.pyroelectric_uC_m2K,
            typical=typical_uC_m2K,
            per_unit=heat[name],
            name=name,
            charges_pC=charges_pC,
        )


def _estimate_misplaced_heat(outline: Outline, heat_length: float) -> float:
    """Estimate the error of `UnevenStrain` in the heat beside a probe, as a fraction of its heat.

    The formula of `UnevenStrain` is exact for straight edges. At a right-angled corner it misses
    about the heat of an area of 2.5 κ t. For an outline without corners the error grows with the
    deviation of the outline from a circle.
    """
    area = outline.area
    bulge = outline.perimeter**2 / (4.0 * np.pi * area) - 1.0
    by_curvature = 1.6 * bulge + 0.06 * heat_length / float(np.sqrt(area / np.pi))
    by_corners = 0.6 * len(outline.corners)
    return (by_corners or by_curvature) * heat_length**2 / area


def _integrate_warming(scene: Scene, outline: Outline) -> float:
    """Estimate the integral of the warming over an electrode, in K mm² (µC/(m² K) gives pC)."""
    added = UnevenStrain.from_scene(scene)
    mean = scene.film.warming_K or 0.0
    if added and added.warm_probes:
        mean += average_over(outline.equal_area_polygon, added.temperature)
    return 1e6 * outline.area * mean


@dataclass(frozen=True)
class UnevenStrain:
    """The strain that warm probes and rim displacements add to the film's prestrain.

    Parameters
    ----------
    film : Film
        Film with its thermal expansion and rim displacements.
    warm_probes : tuple of LoadedProbe
        The probes with a temperature; the tuple may be empty.
    """

    film: Film
    warm_probes: tuple[LoadedProbe, ...]

    @classmethod
    def from_scene(cls, scene: Scene) -> Self | None:
        """Make the added strain of a scene; None without warm probes and rim displacements."""
        warm = tuple(probe for probe in scene.loaded_probes if probe.probe.temperature_K)
        if warm or scene.film.rim_displacement_um:
            return cls(scene.film, warm)
        return None

    def temperature(self, points: Array) -> Array:
        """Compute the rise in temperature due to probes, averaged over the thickness, in K.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            Points in m in the scene's axes.

        Returns
        -------
        ndarray, shape (...)
        """
        from scipy.special import erfc  # most scenes have no heat

        flat = points.reshape(-1, 2)
        total = np.zeros(len(flat))
        for probe in self.warm_probes:
            outline = probe.outline
            heat_length = compute_heat_length(self.film, probe)
            d = np.maximum(outline.compute_signed_distances(flat), 0.0)
            fall = erfc(d / heat_length)
            if not len(outline.corners):
                radius = np.sqrt(outline.area / np.pi)
                fall *= np.sqrt(radius / (radius + d))
            fourier = 0.25 * (heat_length / self.film.thickness) ** 2
            mean = compute_mean_warming(fourier)
            total += (probe.probe.temperature_K or 0.0) * mean * fall
        return total.reshape(points.shape[:-1])

    def strain(self, points: Array) -> Array:
        """Compute the added elastic strain: the rim strain minus the thermal strain.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            Points in m in the scene's axes.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        thermal = self.film.thermal_expansion_per_K * self.temperature(points)
        return self.film.compute_rim_strain(points) - thermal[..., None] * [1.0, 1.0, 0.0]

    def stress(self, points: Array) -> Array:
        """Compute the linear elastic stress of the added strain in Pa.

        Parameters
        ----------
        points : ndarray, shape (..., 2)
            Points in m in the scene's axes.

        Returns
        -------
        ndarray, shape (..., 3)
        """
        return self.strain(points) @ self.film.stiffness
