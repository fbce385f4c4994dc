"""The charge of an electrode as a smooth function of the probe's place.

Charges solved at scattered places are interpolated as Q = K (1 + s): K is the leading part that a
`CarriedField` gives, s a polyharmonic spline, s(p) = Σ c_k |p - p_k|^5 + a quadratic polynomial,
the interpolant of least third-order roughness (Duchon 1977). The error that the spline makes at a
place when this place is left out follows from the one fit (Rippa, Adv. Comput. Math. 11 (1999)
193-210).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from pvdf_fem.arrays import Array
from pvdf_fem.scene.scene import Scene
from pvdf_fem.sweeps.lines import placed
from pvdf_fem.sweeps.store import Record
from reports.maps.carried import CarriedField

ValueAndGradient = Callable[[Array], tuple[Array, Array]]


class ChargeFunction(Protocol):
    """A charge in pC within `reach_mm` of the film's centre, by the place of the probe."""

    @property
    def reach_mm(self) -> float:
        """Radius of the disc of places."""

    def value_and_gradient(self, positions_mm: Array) -> tuple[Array, Array]:
        """Charges in pC, (n,), and gradients in pC/mm, (n, 2), at positions (n, 2)."""


@dataclass(frozen=True, eq=False)
class ChargeMap:
    """An interpolated charge."""

    #: Places of the probe, more than six, not all on one conic, (n, 2).
    positions_mm: Array
    #: (n,)
    charges_pC: Array
    #: Radius about the film's centre within which the map is meant to be used.
    reach_mm: float
    #: Value and gradient of a positive function that is about as steep as the charge; the map
    #: interpolates the ratio of the charge to it. The function is 1 if not given.
    leading: ValueAndGradient | None = None

    def value_and_gradient(self, positions_mm: Array) -> tuple[Array, Array]:
        """Charges in pC, (n,), and gradients in pC/mm, (n, 2), at positions (n, 2)."""
        K, dK = self._leading(positions_mm)
        q, dq = self._ratio.value_and_gradient(positions_mm)
        return K * q, dK * q[:, None] + K[:, None] * dq

    def __call__(self, positions_mm: Array) -> Array:
        """Charges in pC, (n,), at positions (n, 2)."""
        return self.value_and_gradient(positions_mm)[0]

    @cached_property
    def left_out_pC(self) -> Array:
        """Charge at each place, (n,), by the map from the other places, less the one given there.

        This is more than the error of the map, since the others leave a hole twice as wide as the
        gaps between places, and far more at the outermost places, where the others extrapolate.
        """
        return self._leading(self.positions_mm)[0] * self._ratio.left_out

    @property
    def error_pC(self) -> float:
        """Root mean square of `left_out_pC` at places within the reach less the widest gap."""
        p = self.positions_mm
        distances = np.linalg.norm(p[:, None] - p, axis=-1) + np.diag(np.full(len(p), np.inf))
        inside = np.linalg.norm(p, axis=1) <= self.reach_mm - distances.min(axis=1).max()
        return float(np.sqrt(np.mean(self.left_out_pC[inside] ** 2)))

    def _leading(self, positions_mm: Array) -> tuple[Array, Array]:
        if self.leading is None:
            return np.ones(len(positions_mm)), np.zeros((len(positions_mm), 2))
        return self.leading(positions_mm)

    @cached_property
    def _ratio(self) -> PolyharmonicSpline:
        values = self.charges_pC / self._leading(self.positions_mm)[0]
        return PolyharmonicSpline(self.positions_mm, values)


@dataclass(frozen=True)
class Calibration:
    """Places of the probe for charge maps: a square lattice about the film's centre.

    The lattice keeps all symmetries of film and electrodes, so that few places need a solve.
    """

    #: The sensor, and the probe with its orientation.
    scene: Scene
    #: Maps are to hold within this distance of the film's centre.
    reach_mm: float = 16.0
    #: Distance of neighbouring places.
    pitch_mm: float = 4.0

    @property
    def positions_mm(self) -> Array:
        """Places of the probe, (n, 2), to half a pitch beyond the reach."""
        count = int(self.reach_mm / self.pitch_mm + 0.5)
        ticks = self.pitch_mm * np.arange(-count, count + 1)
        lattice = np.stack(np.meshgrid(ticks, ticks, indexing="ij"), axis=-1).reshape(-1, 2)
        distances = np.linalg.norm(lattice, axis=1)
        return lattice[distances <= self.reach_mm + 0.5 * self.pitch_mm + 1e-9]

    @property
    def scenes(self) -> list[Scene]:
        """The scenes to solve."""
        return placed(self.scene, self.positions_mm)

    def maps(
        self,
        records: Sequence[Record],
        d31_pC_N: float,
        d32_pC_N: float,
        observable: str = "material",
        field: CarriedField | None = None,
    ) -> dict[str, ChargeMap]:
        """Charge maps by electrode.

        Parameters
        ----------
        records : sequence of Record
            Those of `scenes`, in their order; places whose scene failed are left out.
        d31_pC_N, d32_pC_N : float
        observable : str
        field : CarriedField, optional
            The stress about the scene's probe, for the leading part of the charge.
        """
        solved = [i for i, record in enumerate(records) if record.converged]
        charges = [records[i].charges_pC(d31_pC_N, d32_pC_N, observable) for i in solved]
        maps = {}
        for electrode in self.scene.electrode_list:
            leading = None
            if field is not None:
                carried = field.charge(electrode.outline, d31_pC_N, d32_pC_N, observable)
                leading = carried.value_and_gradient
            values = np.array([by_name[electrode.name] for by_name in charges])
            places = self.positions_mm[solved]
            maps[electrode.name] = ChargeMap(places, values, self.reach_mm, leading)
        return maps


class PolyharmonicSpline:
    """Interpolant Σ c_k |p - p_k|^5 + polynomial of degree 2, with gradients.

    Attributes
    ----------
    left_out : ndarray, shape (n,)
        Value at each point by the interpolant of the other points, less the one given there.

    Parameters
    ----------
    points : ndarray, shape (n, 2)
    values : ndarray, shape (n,)

    Raises
    ------
    ValueError
        When the points are six or fewer, or lie on one conic, so that the polynomial is not unique.
    """

    def __init__(self, points: Array, values: Array) -> None:
        # lengths near one make all terms about equally large
        self._scale = float(np.abs(points).max(initial=0.0)) or 1.0
        self._points = points / self._scale
        P = _quadratics(self._points)
        count = P.shape[1]
        if len(points) <= count or np.linalg.matrix_rank(P) < count:
            reason = "on one conic" if len(points) > count else "too few"
            advice = f"give more than {count} all over the plane"
            raise ValueError(f"points: {len(points)}, {reason}; {advice}")
        # -r^5 is positive definite on coefficients orthogonal to the polynomials: on span N
        Q, R = np.linalg.qr(P, mode="complete")
        N = Q[:, count:]
        radial = _distances(self._points, self._points)[0] ** 5
        definite = -N.T @ radial @ N
        inverse = -N @ cho_solve(cho_factor(definite), N.T)
        self._radials = inverse @ values
        remainder = Q[:, :count].T @ (values - radial @ self._radials)
        self._polynomial = np.linalg.solve(R[:count], remainder)
        self.left_out: Array = -self._radials / np.diag(inverse)

    def value_and_gradient(self, points: Array) -> tuple[Array, Array]:
        """Values (k,) and gradients (k, 2) at points (k, 2)."""
        scaled = points / self._scale
        r, vectors = _distances(scaled, self._points)
        weighted = self._radials * r**3
        value = (weighted * r**2).sum(axis=-1) + _quadratics(scaled) @ self._polynomial
        slope = 5.0 * np.einsum("kni,kn->ki", vectors, weighted)
        slope += np.einsum("kmi,m->ki", _quadratic_slopes(scaled), self._polynomial)
        return value, slope / self._scale


def _distances(points: Array, others: Array) -> tuple[Array, Array]:
    """Distances (k, n) of points (k, 2) from others (n, 2), and the vectors (k, n, 2) from them."""
    vectors = points[:, None] - others
    x, y = vectors[..., 0], vectors[..., 1]
    return np.sqrt(x * x + y * y), vectors


def _quadratics(points: Array) -> Array:
    """The monomials up to degree 2, (k, 6), at points (k, 2)."""
    x, y = points.T
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)


def _quadratic_slopes(points: Array) -> Array:
    """Gradients (k, 6, 2) of the monomials at points (k, 2)."""
    x, y = points.T
    zero, one = np.zeros_like(x), np.ones_like(x)
    along_x = np.stack([zero, one, zero, 2 * x, y, zero], axis=-1)
    along_y = np.stack([zero, zero, one, zero, x, 2 * y], axis=-1)
    return np.stack([along_x, along_y], axis=-1)
