"""Film that sticks to a round tip: it keeps the in-plane displacement that it touched the tip with.

Friction makes no line force along the edge of the contact, so the strain has no jump there: where
the edge comes by, the gradient of what sticks is that of the film outside. So the gradients along
the edges of a few steps of the load give what sticks between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.loads.contact_edge import Edge
from pvdf_fem.scene.outlines.tip import DiscTip

#: Lowest power of the distance from the core: the strain at an edge is about as its square.
LOWEST = 3
#: Most powers: more of them follow the errors of the steps.
MOST_POWERS = 5
#: Highest multiple of the angle.
HIGHEST_MODE = 3
_NONE = np.zeros((1, 2 * HIGHEST_MODE + 1), dtype=complex)


@dataclass(frozen=True, eq=False)
class Sticking:
    """The displacement u + i v in m of film that sticks, a polynomial about the tip.

    `coefficients` (powers, modes) are of (d/`scale`)^i e^(i m angle), d the distance from the core.
    `less_exact` is the polynomial of one degree less. The error is three times what that changes,
    so that it covers the errors of the steps' meshes.
    """

    tip: DiscTip
    coefficients: NDArray[np.complex128] = field(default_factory=lambda: _NONE)
    scale: float = 1.0
    less_exact: Sticking | None = None

    @property
    def share(self) -> float:
        """Error of the steps over the change by the `less_exact` displacement."""
        return 3.0 if self.less_exact else 0.0

    def fitted(self, edges: Sequence[Edge]) -> Sticking:
        """The least squares of what the film is stretched by outside of the edges of steps.

        The film answers a wrong displacement U by a rate of about -U/r, so that the sum of the rate
        and U/r hardly depends on what was held.
        """
        points = np.concatenate([edge.facets.points for edge in edges])
        z = (points - self.tip.centre) @ [1.0, 1j]
        away = np.stack([z.real, z.imag], axis=-1) / np.abs(z)[:, None]
        gradient = np.concatenate([edge.gradient for edge in edges])
        rate = np.einsum("nca,na->nc", gradient[:, :2], away) @ [1.0, 1j]
        held = np.concatenate([edge.place for edge in edges])[:, :2] @ [1.0, 1j]
        stretch, powers = rate + held / np.abs(z), min(len(edges), MOST_POWERS)
        lower = self._least_squares(z, stretch, powers - 1) if powers > 1 else Sticking(self.tip)
        return replace(self._least_squares(z, stretch, powers), less_exact=lower)

    def _least_squares(self, z: Array, stretch: Array, count: int) -> Sticking:
        r, powers = np.abs(z), LOWEST + np.arange(count)
        scale = float((r - self.tip.core).max())
        d = (r[:, None] - self.tip.core) / scale
        radial = (powers / (scale * d) + 1.0 / r[:, None]) * d**powers
        weights = 1.0 / d
        rows = weights * (radial[:, :, None] * _waves(z)[:, None, :]).reshape(len(z), -1)
        found = np.asarray(np.linalg.lstsq(rows, weights[:, 0] * stretch, rcond=None)[0], complex)
        return Sticking(self.tip, found.reshape(count, -1), scale)

    def change(self, other: Sticking) -> float:
        """Largest difference between two along this one's outermost circle, over its values."""
        angle = np.linspace(0.0, 2.0 * np.pi, 4 * HIGHEST_MODE, endpoint=False)
        radius = self.tip.core + self.scale
        points = self.tip.centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return float(np.abs(self(points) - other(points)).max() / np.abs(self(points)).max())

    def __call__(self, points: Array) -> Array:
        """Displacements (n, 2) in m at points (n, 2)."""
        z = (points - self.tip.centre) @ [1.0, 1j]
        d = np.maximum(np.abs(z) - self.tip.core, 0.0) / self.scale
        radial = d[:, None] ** (LOWEST + np.arange(len(self.coefficients)))
        value = np.einsum("np,pm,nm->n", radial, self.coefficients, _waves(z))
        return np.stack([value.real, value.imag], axis=-1)


def _waves(z: Array) -> Array:
    modes: Indices = np.arange(-HIGHEST_MODE, HIGHEST_MODE + 1)
    return np.exp(1j * np.angle(z)[:, None] * modes)
