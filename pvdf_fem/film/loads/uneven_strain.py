"""Uneven strains in the film: heat from warm probes, and displacements of the rim.

A probe holds the touched face at its temperature; the other face and the film beside the
probe lose no heat. Under the probe the mean temperature through the film follows a plate heated
from one side. Beside the probe the temperature falls with the distance d like erfc(d/√(4 κ t)) at a
straight edge, and around a round probe by a further factor √(R/(R + d)).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.film.effects import Charges, describe_charge_effect
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.outlines.outline import Outline, average_over
from pvdf_fem.scene.scene import LoadedProbe, Scene


def compute_mean_warming(fourier: float, terms: int = 12) -> float:
    """Mean temperature through a plate over that of the face heated since κ t/h² = `fourier`; the
    other face is insulated (Carslaw and Jaeger, Conduction of Heat in Solids, section 3.4)."""
    if fourier < 0.05:  # nothing has come to the other face
        return 2.0 * float(np.sqrt(fourier / np.pi))
    n = np.pi * (np.arange(terms) + 0.5)
    return 1.0 - 2.0 * float((np.exp(-(n**2) * fourier) / n**2).sum())


def compute_heat_length(film: Film, touch: LoadedProbe) -> float:
    """√(4 κ t) of a warm probe in m."""
    return float(np.sqrt(4.0 * film.thermal_diffusivity_m2_s * (touch.probe.contact_time_s or 1.0)))


def describe_heat_effects(
    scene: Scene,
    charges_pC: Charges = None,
    typical_uC_m2K: float = 25.0,
    heat_capacity: float = 1300.0,
    heat_transfer: float = 10.0,
) -> Iterator[tuple[bool, str]]:
    """Whether the effect by heat is included, and its size relative to given charges.

    What is left out is estimated by a typical pyroelectric coefficient and heat capacity of PVDF in
    J/(kg K), and by the heat transfer of each face to still air in W/(m² K).
    """
    film = scene.film
    seconds = film.thickness * film.density * heat_capacity / (2.0 * heat_transfer)
    for touch in scene.loaded_probes:
        if touch.probe.temperature_K:
            part = 100.0 * _misplaced(touch.outline, compute_heat_length(film, touch))
            corners = f"how heat of the {touch.patch} spreads at corners or bulges"
            yield False, f"{corners}: about {part:.2g} % of that heat; no key includes it"
            lost = f"heat that the air takes from the film beside the {touch.patch}"
            yield False, f"{lost}: most of it after some {seconds:.2g} s; no key includes it"
    given, typical = film.pyroelectric_uC_m2K, typical_uC_m2K
    heated = {e.name: _heated(scene, e.outline) for e in scene.electrode_list}
    name, most = max(heated.items(), key=lambda item: abs(item[1]), default=("", 0.0))
    if most:
        about = "pyroelectricity, charge by warming", "film.pyroelectric_uC_m2K"
        yield describe_charge_effect(about, given, typical, most, name, charges_pC)


def _misplaced(outline: Outline, reach: float) -> float:
    """Ratio: heat spread too far over heat below the probe, approximately. A square corner gives
    2.5 κ t less, and round outlines are the further off the less they are discs."""
    area = outline.area
    bulge = outline.perimeter**2 / (4.0 * np.pi * area) - 1.0
    curved = 1.6 * bulge + 0.06 * reach / float(np.sqrt(area / np.pi))
    return (0.6 * len(outline.corners) or curved) * reach**2 / area


def _heated(scene: Scene, outline: Outline) -> float:
    """About the integral of the temperature over an electrode, in K mm²."""
    added, mean = UnevenStrain.of(scene), scene.film.warming_K or 0.0
    if added and added.warm:
        mean += average_over(outline.polygon, added.temperature)
    return 1e6 * outline.area * mean


@dataclass(frozen=True)
class UnevenStrain:
    """What heat and the rim's displacement add to the film's strain at rest. Places (..., 2) are in
    m in the scene's axes."""

    film: Film
    warm: tuple[LoadedProbe, ...]

    @classmethod
    def of(cls, scene: Scene) -> UnevenStrain | None:
        """That of a scene; None of one without."""
        warm = tuple(touch for touch in scene.loaded_probes if touch.probe.temperature_K)
        return cls(scene.film, warm) if warm or scene.film.rim_displacement_um else None

    def temperature(self, places: Array) -> Array:
        """Mean temperature through the film in K above the untouched film, (...)."""
        from scipy.special import erfc  # most scenes have no heat

        points = places.reshape(-1, 2)
        total = np.zeros(len(points))
        for touch in self.warm:
            outline, reach = touch.outline, compute_heat_length(self.film, touch)
            d = np.maximum(outline.signed_distance(points), 0.0)
            fall = erfc(d / reach)
            if not len(outline.corners):
                radius = np.sqrt(outline.area / np.pi)
                fall *= np.sqrt(radius / (radius + d))
            mean = compute_mean_warming(0.25 * (reach / self.film.thickness) ** 2)
            total += (touch.probe.temperature_K or 0.0) * mean * fall
        return total.reshape(places.shape[:-1])

    def strain(self, places: Array) -> Array:
        """Elastic strain of the film, (..., 3)."""
        thermal = self.film.thermal_expansion_per_K * self.temperature(places)
        return self.film.compute_rim_strain(places) - thermal[..., None] * [1.0, 1.0, 0.0]

    def stress(self, places: Array) -> Array:
        """Stress of the film in Pa, (..., 3)."""
        return self.strain(places) @ self.film.stiffness
