"""Tabulated touches whose charges have about the same ratios: starts for many searches at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from pvdf_fem.arrays import Array
from pvdf_fem.response.model import FORCE, ROTATION, Model
from pvdf_fem.touch.starts import table_of

#: Share by which a touch may be farther than the nearest, for the sake of speed.
NEARLY = 0.5


@dataclass(frozen=True, eq=False)
class NearestTouches:
    """The touches of a table by the ratios of their charges."""

    #: Charges over their size, and where the rotation is known, the rotation as a point of a
    #: circle.
    tree: cKDTree
    #: Coordinates x, y, rotation and logarithm of the force, (touches, 4).
    at: Array
    #: Norms of the charges, (touches,).
    sizes_pC: Array
    #: The power of the force by which the sizes grow, (touches,).
    exponents: Array
    #: Period of the rotation.
    period_deg: float

    def starts(self, charges_pC: Array, rotations_deg: Array | None, count: int) -> Array:
        """Coordinates (n, count, 4) of touches with about the ratios of charges (n, electrodes).

        `rotations_deg` (n,) are known rotations, if they are.
        """
        sizes = np.linalg.norm(charges_pC, axis=1)
        ratios = charges_pC / sizes[:, None]
        if rotations_deg is not None:
            ratios = np.concatenate([ratios, _circle(rotations_deg, self.period_deg)], axis=1)
        _, row = self.tree.query(ratios, np.arange(1, count + 1), eps=NEARLY)
        at = self.at[row]
        at[..., FORCE] += np.log(sizes[:, None] / self.sizes_pC[row]) / self.exponents[row]
        return at


@lru_cache(maxsize=8)
def nearest_touches(
    model: Model, electrodes: tuple[int, ...], with_rotation: bool
) -> NearestTouches:
    """The touches of a model's table; `with_rotation` where the rotation is known."""
    table = table_of(model)
    # (places, rotations, forces, electrodes)
    charges = table.charges_pC[:, list(electrodes)].transpose(3, 0, 2, 1).astype(float)
    sizes = np.linalg.norm(charges, axis=-1)
    growth = np.diff(np.log(sizes), axis=-1) / np.diff(table.log_forces)
    exponents = np.concatenate([growth, growth[..., -1:]], axis=-1)
    at = np.empty((*sizes.shape, 4))
    at[..., :ROTATION] = table.places_mm[:, None, None]
    at[..., ROTATION] = table.rotations_deg[:, None]
    at[..., FORCE] = table.log_forces
    features = (charges / sizes[..., None]).reshape(-1, len(electrodes))
    rows, period = at.reshape(-1, 4), table.period_deg
    if with_rotation:
        features = np.concatenate([features, _circle(rows[:, ROTATION], period)], axis=1)
    return NearestTouches(cKDTree(features), rows, sizes.ravel(), exponents.ravel(), period)


def _circle(rotations_deg: Array, period_deg: float) -> Array:
    """Rotations as points (n, 2) of a circle, the probe's period about it once."""
    angle = 2.0 * np.pi * rotations_deg / period_deg
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
