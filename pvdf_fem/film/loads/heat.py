"""Heat of probes that are warmer than the film: what it warms while they touch it.

A probe holds the face that it touches at its temperature; the other face and the film beside the
probe lose no heat. Under the probe the mean temperature through the film is that of a plate heated
from one side. Beside it, it falls with the distance d as at a straight edge, erfc(d/√(4 κ t)), and
about a round probe as √(R/(R + d)) besides.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import erfc

from pvdf_fem.arrays import Array
from pvdf_fem.scene.film import Film
from pvdf_fem.scene.scene import LoadedProbe, Scene


def warmed(fourier: float, terms: int = 12) -> float:
    """Mean temperature through a plate over that of the face heated since κ t/h² = `fourier`; the
    other face is insulated (Carslaw and Jaeger, Conduction of Heat in Solids, section 3.4)."""
    if fourier < 0.05:  # nothing has come to the other face
        return 2.0 * float(np.sqrt(fourier / np.pi))
    n = np.pi * (np.arange(terms) + 0.5)
    return 1.0 - 2.0 * float((np.exp(-(n**2) * fourier) / n**2).sum())


@dataclass(frozen=True)
class Warmth:
    """Temperatures of the film about warm probes, less that of the untouched film."""

    film: Film
    probes: tuple[LoadedProbe, ...]

    @classmethod
    def of(cls, scene: Scene) -> Warmth | None:
        """That of a scene; None of one without warm probes."""
        probes = tuple(touch for touch in scene.loaded_probes if touch.probe.temperature_K)
        return cls(scene.film, probes) if probes else None

    def spread(self, touch: LoadedProbe) -> float:
        """√(4 κ t) in m."""
        return float(np.sqrt(4.0 * self.film.diffusivity * (touch.probe.contact_time_s or 0.0)))

    def temperature(self, places: Array) -> Array:
        """Mean through the film in K, (...), at places (..., 2) in m in the scene's axes."""
        points = places.reshape(-1, 2)
        total = np.zeros(len(points))
        for touch in self.probes:
            outline, spread = touch.outline, self.spread(touch)
            d = np.maximum(outline.signed_distance(points), 0.0)
            fall = erfc(d / spread)
            if not len(outline.corners):
                radius = np.sqrt(outline.area / np.pi)
                fall *= np.sqrt(radius / (radius + d))
            mean = warmed(0.25 * (spread / self.film.thickness) ** 2)
            total += (touch.probe.temperature_K or 0.0) * mean * fall
        return total.reshape(places.shape[:-1])

    @property
    def remarks(self) -> tuple[str, ...]:
        """What is left out of heat."""
        film = self.film
        shares = (self.spread(t) ** 2 / t.outline.area for t in self.probes)
        corners = (len(t.outline.corners) for t in self.probes)
        # a square corner gives 2.5 κ t less heat
        excess = max(0.6 * n * share for n, share in zip(corners, shares, strict=True))
        slowest = film.thickness * film.density * HEAT_CAPACITY / (2.0 * HEAT_TRANSFER)
        largest = max(abs(touch.probe.temperature_K or 0.0) for touch in self.probes)
        remarks = [
            f"heat: how it spreads at corners, about {excess:.1e} of it; what the air takes beside"
            f" the probe, within about {slowest:.2g} s"
        ]
        if film.pyroelectric_uC_m2K is None:
            remarks.append(
                "pyroelectric charge (film.pyroelectric_uC_m2K is not given): at 25 uC/(m2 K)"
                f" {25.0 * largest:.3g} pC on each mm2 below the probe"
            )
        return tuple(remarks)


#: Of PVDF, J/(kg K).
HEAT_CAPACITY = 1300.0
#: Of each face to still air, W/(m² K).
HEAT_TRANSFER = 10.0
