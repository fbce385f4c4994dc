"""Charge functions with known contours, and records with known charges."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.sweeps.store import Record
from reports.maps.isocharge import Contour, contour


@dataclass(frozen=True)
class Peak:
    """The charge 1000 pC exp(-r²/200) at r mm from a centre; its contours are circles."""

    x_mm: float
    y_mm: float
    reach_mm: float = 20.0

    def value_and_gradient(self, positions_mm):
        away = positions_mm - np.array([self.x_mm, self.y_mm])
        value = 1000.0 * np.exp(-(away**2).sum(axis=1) / 200.0)
        return value, -value[:, None] * away / 100.0

    def charge(self, place) -> float:
        return float(self.value_and_gradient(np.array([place], dtype=float))[0][0])

    def at_radius(self, radius_mm: float) -> float:
        """Charge at a distance from the centre."""
        return float(1000.0 * np.exp(-(radius_mm**2) / 200.0))

    def circle(self, name: str, radius_mm: float, step_mm: float = 0.5) -> Contour:
        return contour(name, self, self.at_radius(radius_mm), step_mm)


@dataclass(frozen=True)
class Sum:
    """A sum of peaks."""

    peaks: tuple[Peak, ...]
    reach_mm: float = 20.0

    def value_and_gradient(self, positions_mm):
        terms = [peak.value_and_gradient(positions_mm) for peak in self.peaks]
        return sum(charge for charge, _ in terms), sum(slope for _, slope in terms)


def record(charges_pC: dict[str, float], status: str = "converged") -> Record:
    """A record with the given charges for d31 = d32 = 1 pC/N, which stress along x makes."""
    forces = {"material": [[q, 0.0] for q in charges_pC.values()]} if status == "converged" else {}
    return Record(status, "", tuple(charges_pC), forces)
