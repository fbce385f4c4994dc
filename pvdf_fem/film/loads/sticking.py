"""Film that sticks to a round tip: it keeps the in-plane displacement that it touched the tip with.

Friction makes no line force along the edge of the contact, so the strain has no jump there: where
the edge comes by, the gradient of what sticks is that of the film outside. So the gradients along
the edges of a few steps of the load, from none at the first touch, give what sticks between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from pvdf_fem.arrays import Array, Indices
from pvdf_fem.film.loads.contact_edge import Edge
from pvdf_fem.scene.outlines.tip import DiscTip

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

#: Highest multiple of the angle.
HIGHEST_MODE = 3
#: Least radius in m that is divided by.
TINY = 1e-15
#: Error of what sticks over what the less exact displacement changes.
SHARE = 0.2


@dataclass(frozen=True, eq=False)
class Sticking:
    """The displacement u + i v in m of film that sticks, about the tip.

    At the radius r it is U with d(r U)/dr = r `stretch`, and zero on the core. The stretch, by the
    distance d in m from the core, has the factors of e^(i m angle), (modes,). `less_exact` has a
    stretch that is linear between the steps and off by its scatter along their edges. The error of
    a result is `SHARE` times its change by `less_exact`.
    """

    tip: DiscTip
    stretch: BSpline | None = None
    less_exact: Sticking | None = None

    @property
    def share(self) -> float:
        """Error of the steps over the change by the `less_exact` displacement."""
        return SHARE if self.less_exact else 0.0

    def fitted(self, edges: Sequence[Edge]) -> Sticking:
        """The least squares of what the film is stretched by outside of the edges of steps.

        The film answers a wrong displacement U by a rate of about -U/r, so that the sum of the rate
        and U/r hardly depends on what was held.
        """
        from scipy.interpolate import BSpline  # slow to import, as below

        points = np.concatenate([edge.facets.points for edge in edges])
        z = (points - self.tip.centre) @ [1.0, 1j]
        away = np.stack([z.real, z.imag], axis=-1) / np.abs(z)[:, None]
        gradient = np.concatenate([edge.gradient for edge in edges])
        rate = np.einsum("nca,na->nc", gradient[:, :2], away) @ [1.0, 1j]
        held = np.concatenate([edge.place for edge in edges])[:, :2] @ [1.0, 1j]
        stretch, steps = rate + held / np.abs(z), [edge.widths.mean() for edge in edges]
        (linear, _), (best, error) = (_spline(k, steps, self.tip, z, stretch) for k in (1, 2))
        off = BSpline(linear.t, (1.0 + error / SHARE) * linear.c, linear.k)
        return Sticking(self.tip, best, Sticking(self.tip, off))

    def change(self, other: Sticking) -> float:
        """Largest difference between two along this one's outermost circle, over its values."""
        angle = np.linspace(0.0, 2.0 * np.pi, 4 * HIGHEST_MODE, endpoint=False)
        radius = self.tip.core + (self.stretch.t[-1] if self.stretch else 0.0)
        points = self.tip.centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
        return float(np.abs(self(points) - other(points)).max() / np.abs(self(points)).max())

    def __call__(self, points: Array) -> Array:
        """Displacements (n, 2) in m at points (n, 2)."""
        if self.stretch is None:
            return np.zeros_like(points)
        z = (points - self.tip.centre) @ [1.0, 1j]
        r = np.maximum(np.abs(z), TINY)
        first, second = (self.stretch.antiderivative(n) for n in (1, 2))
        d = np.maximum(r - self.tip.core, 0.0)
        radial = first(d) - second(d) / r[:, None]
        value = (radial * _waves(z)).sum(axis=1)
        return np.stack([value.real, value.imag], axis=-1)


def _spline(
    degree: int, steps: Sequence[float], tip: DiscTip, z: Array, stretch: Array
) -> tuple[BSpline, float]:
    """The least squares of a stretch at points z, zero on the core, with a piece for each step;
    and its relative standard error by the scatter along the edges, of all waves together."""
    from scipy.interpolate import BSpline

    ends = np.array([0.0, *steps])
    degree = min(degree, len(steps))
    inner = ends[1:-1] if degree == 1 else 0.5 * (ends[1:-2] + ends[2:-1])
    knots = np.concatenate([[0.0] * (degree + 1), inner, [ends[-1]] * (degree + 1)])
    d = np.abs(z) - tip.core
    functions = BSpline.design_matrix(d, knots, degree, extrapolate=True).toarray()[:, 1:]
    rows = (functions[:, :, None] * _waves(z)[:, None]).reshape(len(z), -1)
    found = np.asarray(np.linalg.lstsq(rows, stretch, rcond=None)[0], complex)
    left = np.abs(stretch - rows @ found).mean() / np.abs(stretch).mean()
    error = float(left * np.sqrt((2 * HIGHEST_MODE + 1) / len(z)))
    found = found.reshape(functions.shape[1], -1)
    return BSpline(knots, np.concatenate([np.zeros_like(found[:1]), found]), degree), error


def _waves(z: Array) -> Array:
    modes: Indices = np.arange(-HIGHEST_MODE, HIGHEST_MODE + 1)
    return np.exp(1j * np.angle(z)[:, None] * modes)
