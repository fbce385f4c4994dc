"""Axisymmetric membrane of any slope, solved to about 11 digits: a reference for the 2-D code.

Everything is scale-free, with film radius a, Young's modulus E and thickness h: lengths are counted
in a, forces in E h a, tensions (second Piola-Kirchhoff stress times h) in E h. Displacements are u
along the radius r and w along the load. Tensions are N_r along the radius and N_t along the hoop.

Spectral elements are quick: scipy's `solve_bvp` took three times as long for eleven digits of a
dead load.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from pvdf_fem.arrays import Array
from reports.reference.closed_form import require_taut
from reports.reference.spectral_grid import (
    ORDER,
    Piece,
    SpectralGrid,
    grid_of,
    legendre_series,
    pieces_of,
)

Kind = Literal["dead", "follower", "rigid"]
Contact = Literal["sliding", "stuck"]
Strain = Literal["green-lagrange", "foeppl-von-karman"]


class _Fields(NamedTuple):
    """Displacements and their derivatives at some radii."""

    hoop_stretch: Array  # u/r
    radial_stretch: Array  # du/dr
    deflection: Array  # w
    slope: Array  # dw/dr


@dataclass(frozen=True)
class AxisymmetricMembrane:
    """Deflected membrane; lengths in a, tensions in E h.

    Profiles are functions of r/a (any shape). At the edge of the load, where derivatives jump, they
    have the value from within.

    Attributes
    ----------
    centre_deflection, edge_tension : float
        Deflection at r = 0, radial tension at the rim.
    iterations : int
        Number of Newton iterations of the solution.
    """

    pieces: tuple[Piece, ...]
    stretch_series: Array  # Legendre coefficients of u/r, (pieces, degree + 1)
    deflection_series: Array  # Legendre coefficients of w, (pieces, degree + 1)
    poisson_ratio: float
    pretension: float
    nonlinearity: float  # 1: Green-Lagrange, 0: FvK
    iterations: int

    @property
    def centre_deflection(self) -> float:
        """Deflection at the centre over the radius."""
        return float(self.deflection(0.0))

    @property
    def edge_tension(self) -> float:
        """Radial tension at the rim over E h."""
        return float(self.radial_tension(1.0))

    def deflection(self, radius_ratio: ArrayLike) -> Array:
        """Deflection w."""
        return self._fields(radius_ratio).deflection

    def slope(self, radius_ratio: ArrayLike) -> Array:
        """Slope dw/dr."""
        return self._fields(radius_ratio).slope

    def radial_displacement(self, radius_ratio: ArrayLike) -> Array:
        """Radial displacement u, positive outwards."""
        return np.asarray(radius_ratio, dtype=float) * self._fields(radius_ratio).hoop_stretch

    def radial_stretch(self, radius_ratio: ArrayLike) -> Array:
        """Radial stretch du/dr."""
        return self._fields(radius_ratio).radial_stretch

    def radial_tension(self, radius_ratio: ArrayLike) -> Array:
        """Radial tension N_r."""
        return self._tensions(radius_ratio)[0]

    def hoop_tension(self, radius_ratio: ArrayLike) -> Array:
        """Hoop tension N_t."""
        return self._tensions(radius_ratio)[1]

    def _tensions(self, radius_ratio: ArrayLike) -> tuple[Array, Array]:
        hoop, radial, _, slope = self._fields(radius_ratio)
        strains = _strains(hoop, radial, slope, self.nonlinearity)
        n_r, n_t = _elastic(strains, self.poisson_ratio) + self.pretension
        return np.asarray(n_r), np.asarray(n_t)

    def _fields(self, radius_ratio: ArrayLike) -> _Fields:
        radius = np.asarray(radius_ratio, dtype=float)
        if not np.all((radius >= 0) & (radius <= 1)):
            raise ValueError(f"radius_ratio must lie in [0, 1], got {radius_ratio!r}")
        fields = np.empty((4, *radius.shape))
        piece_of = np.searchsorted([piece.outer for piece in self.pieces[:-1]], radius)
        for i, piece in enumerate(self.pieces):
            inside = piece_of == i
            r = radius[inside]
            xi, rate = piece.coordinate(r), piece.rate(r)
            v, w = self.stretch_series[i], self.deflection_series[i]
            hoop = legendre.legval(xi, v)
            fields[0, inside] = hoop
            fields[1, inside] = hoop + r * rate * legendre.legval(xi, legendre.legder(v))
            fields[2, inside] = legendre.legval(xi, w)
            fields[3, inside] = rate * legendre.legval(xi, legendre.legder(w))
        return _Fields(*fields)


def axisymmetric_membrane(
    force: float,
    *,
    poisson_ratio: float,
    patch_radius: float = 1.0,
    pretension: float = 0.0,
    kind: Kind = "dead",
    contact: Contact = "sliding",
    strain: Strain = "green-lagrange",
) -> AxisymmetricMembrane:
    """Clamped membrane pushed on a concentric circle, to about 11 digits.

    Minimises the membrane energy of the St. Venant-Kirchhoff film with the strains
    E_r = u' + (u'^2 + w'^2)/2 and E_t = u/r + (u/r)^2/2 (the squares of u are left out in FvK) by
    the spectral element method. The uniform follower pressure on the whole film is the problem of
    W. B. Fichter, NASA TP-3658 (1997), there with small radial displacements.

    Meaningful up to any slope as a mathematical problem. A film follows it as long as both
    tensions are positive (no wrinkles, check `hoop_tension`), the strains are small enough for
    linear elasticity, and the load acts on a patch much wider than the film is thick.

    Parameters
    ----------
    force : float
        F/(E h a), positive. For a pressure p on the reference patch, F = p pi b^2.
    poisson_ratio : float
        From 0 to below 1.
    patch_radius : float
        b/a, in (0, 1]; below 1 for a rigid punch.
    pretension : float
        N0/(E h), not negative.
    kind : {"dead", "follower", "rigid"}
        ``dead``: vertical force per reference area. ``follower``: pressure normal to the deformed
        film, the same as ``dead`` with FvK strains. ``rigid``: flat punch that keeps its face
        horizontal.
    contact : {"sliding", "stuck"}
        Whether the film below a rigid punch is free in its plane, or has no displacement there.
    strain : {"green-lagrange", "foeppl-von-karman"}
        Geometrically exact strains, or those for small slopes.

    Raises
    ------
    ValueError
        For arguments out of range.
    RuntimeError
        If Newton's method does not converge.
    """
    require_taut(pretension, poisson_ratio)
    _require_load(force, patch_radius, kind)
    _require_one_of("kind", kind, Kind)
    _require_one_of("contact", contact, Contact)
    _require_one_of("strain", strain, Strain)
    exact = 1.0 if strain == "green-lagrange" else 0.0
    # In units in which F = 1 the FvK problem does not depend on the load, and all unknowns are of
    # order one: w = scale W, u = scale^2 U, N = scale^2 n. With Green-Lagrange strains, scale^2
    # remains as a factor of the squares of U.
    scale = force ** (1 / 3)
    pieces = pieces_of(patch_radius)
    problem = _ScaledProblem(
        grid=grid_of(pieces),
        patch_radius=patch_radius,
        poisson_ratio=poisson_ratio,
        pretension=pretension / scale**2,
        nonlinearity=exact * scale**2,
        follower=kind == "follower",
    )
    free = _free_unknowns(len(pieces), rigid=kind == "rigid", stuck=contact == "stuck")
    unknowns, iterations = _newton(problem, free)
    stretch, deflection = unknowns.reshape(2, -1)
    return AxisymmetricMembrane(
        pieces=pieces,
        stretch_series=legendre_series(scale**2 * stretch, len(pieces)),
        deflection_series=legendre_series(scale * deflection, len(pieces)),
        poisson_ratio=poisson_ratio,
        pretension=pretension,
        nonlinearity=exact,
        iterations=iterations,
    )


def _require_load(force: float, patch_radius: float, kind: Kind) -> None:
    """Raise `ValueError` for a load that is none, or that sticks out of the film."""
    if not (math.isfinite(force) and force > 0):
        raise ValueError(f"force must be positive and finite, got {force!r}")
    if not 0 < patch_radius <= 1 or (kind == "rigid" and patch_radius == 1):
        raise ValueError(
            f"patch_radius must lie in (0, 1], below 1 for a rigid punch, got {patch_radius!r}"
        )


def _require_one_of(name: str, value: str, choices: object) -> None:
    """Raise `ValueError` unless a value is one of the choices of a literal type."""
    if value not in get_args(choices):
        raise ValueError(f"{name} must be one of {', '.join(get_args(choices))}, got {value!r}")


def _strains(stretch: Array, radial: Array, slope: Array, nonlinearity: float) -> Array:
    """E_r and E_t, stacked, from u/r, du/dr and dw/dr."""
    return np.stack(
        [
            radial + (nonlinearity * radial**2 + slope**2) / 2,
            stretch + nonlinearity * stretch**2 / 2,
        ]
    )


def _elastic(strains: Array, poisson_ratio: float) -> Array:
    """Plane-stress tensions in E h from strains; both stacked (radial, hoop) on the first axis."""
    return (strains + poisson_ratio * strains[::-1]) / (1 - poisson_ratio**2)


def _free_unknowns(pieces: int, *, rigid: bool, stuck: bool) -> Array:
    """Matrix (2 n, m) that takes the free unknowns to u/r and w at the nodes."""
    nodes = pieces * ORDER + 1
    columns = np.eye(2 * nodes)
    stretch, deflection = columns[:, : nodes - 1], columns[:, nodes:-1]  # the rim is clamped
    if rigid:
        face = deflection[:, : ORDER + 1].sum(axis=1, keepdims=True)
        deflection = np.hstack([face, deflection[:, ORDER + 1 :]])
        if stuck:
            stretch = stretch[:, ORDER + 1 :]
    return np.hstack([stretch, deflection])


@dataclass(frozen=True)
class _ScaledProblem:
    """Discrete equilibrium for F = 1; unknowns are (u/r, w) at the nodes, shape (2 n,).

    A rigid punch is the dead load on unknowns that let the patch move as a whole.
    """

    grid: SpectralGrid
    patch_radius: float
    poisson_ratio: float
    pretension: float
    nonlinearity: float
    follower: bool

    def linear_deflection(self, free: Array) -> Array:
        """Start of Newton's method: a flat film with N0 and the tension of a point load, loaded."""
        grid = self.grid
        nodes = grid.value.shape[1]
        added = 0.24 * np.maximum(grid.radius, self.patch_radius) ** (-2 / 3)
        laplacian = _gram(grid.weight * (self.pretension + added), grid.gradient)
        stiffness = np.eye(2 * nodes)
        stiffness[nodes:, nodes:] = laplacian
        load, _ = self.load(np.zeros(2 * nodes))
        return np.asarray(free @ np.linalg.solve(free.T @ stiffness @ free, free.T @ load))

    def fields(self, unknowns: Array) -> tuple[Array, Array, Array]:
        """u/r, du/dr, dw/dr at the quadrature points."""
        grid = self.grid
        stretch, deflection = unknowns.reshape(2, -1)
        hoop = grid.value @ stretch
        return hoop, hoop + grid.radius * (grid.gradient @ stretch), grid.gradient @ deflection

    def added_tensions(self, unknowns: Array) -> Array:
        """N_r - N0 and N_t - N0 at the quadrature points, shape (2, q)."""
        strains = _strains(*self.fields(unknowns), self.nonlinearity)
        return _elastic(strains, self.poisson_ratio)

    def linear_variation(self) -> Array:
        """Return the derivative of the linear part of E_r and E_t, (2, q, 2 n)."""
        zero = np.zeros_like(self.grid.value)
        return np.stack(
            [np.hstack([self._radial_value(), zero]), np.hstack([self.grid.value, zero])]
        )

    def quadratic_variation(self, unknowns: Array) -> Array:
        """Return the derivative of the quadratic part of E_r and E_t, (2, q, 2 n)."""
        hoop, radial, slope = (field[:, None] for field in self.fields(unknowns))
        grid, g = self.grid, self.nonlinearity
        return np.stack(
            [
                np.hstack([g * radial * self._radial_value(), slope * grid.gradient]),
                np.hstack([g * hoop * grid.value, np.zeros_like(grid.value)]),
            ]
        )

    def stiffness(self, variation: Array, added_tensions: Array) -> Array:
        """Sum (2 n, 2 n) of the elastic stiffness and the geometric stiffness of given tensions."""
        weight = self.grid.weight
        nodes = self.grid.value.shape[1]
        matrix = np.einsum(
            "dqi,dqj->ij",
            weight[:, None] * variation,
            _elastic(variation, self.poisson_ratio),
            optimize=True,
        )
        radial, hoop = weight * (self.pretension + added_tensions)
        matrix[nodes:, nodes:] += _gram(radial, self.grid.gradient)
        matrix[:nodes, :nodes] += self.nonlinearity * (
            _gram(radial, self._radial_value()) + _gram(hoop, self.grid.value)
        )
        return np.asarray(matrix)

    def load(self, unknowns: Array) -> tuple[Array, Array]:
        """Nodal forces and their derivative.

        The follower force per reference area is p (1 + u/r) (-w' e_r + (1 + u') e_z).
        """
        grid = self.grid
        nodes = grid.value.shape[1]
        pressure = grid.weight * grid.in_patch / (math.pi * self.patch_radius**2)
        g = self.nonlinearity if self.follower else 0.0
        hoop, radial, slope = self.fields(unknowns)
        to_hoop, to_radial = 1 + g * hoop, 1 + g * radial
        across = grid.radius[:, None] * grid.value  # u from u/r
        inwards = -g * across.T @ (pressure * to_hoop * slope)
        forwards = grid.value.T @ (pressure * to_hoop * to_radial)
        tangent = np.zeros((2 * nodes, 2 * nodes))
        if g:
            p = pressure[:, None]
            tangent[:nodes, :nodes] = across.T @ (-g * g * p * slope[:, None] * grid.value)
            tangent[:nodes, nodes:] = across.T @ (-g * p * to_hoop[:, None] * grid.gradient)
            tangent[nodes:, :nodes] = grid.value.T @ (
                g * p * (to_radial[:, None] * grid.value + to_hoop[:, None] * self._radial_value())
            )
        return np.concatenate([inwards, forwards]), tangent

    def _radial_value(self) -> Array:
        """Matrix (q, n) that takes u/r at the nodes to du/dr."""
        return self.grid.value + self.grid.radius[:, None] * self.grid.gradient


def _gram(weight: Array, rows: Array) -> Array:
    """Weighted products (n, n) of the columns of a matrix (q, n)."""
    return np.asarray(rows.T @ (weight[:, None] * rows))


def _newton(problem: _ScaledProblem, free: Array, most_iterations: int = 30) -> tuple[Array, int]:
    """Unknowns at equilibrium and the number of iterations.

    The geometric stiffness takes the tensions that the last step predicted (Magisano, Leonetti,
    Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017)): no line search is needed.
    """
    unknowns = problem.linear_deflection(free)
    predicted = problem.added_tensions(unknowns)
    linear = problem.linear_variation()
    weight = problem.grid.weight
    lever = np.concatenate([problem.grid.node_radius, np.ones_like(problem.grid.node_radius)])
    for iteration in range(1, most_iterations + 1):
        quadratic = problem.quadratic_variation(unknowns)
        variation = linear + quadratic
        added = problem.added_tensions(unknowns)
        force, force_tangent = problem.load(unknowns)
        # N0 does no work in the linear part of the strain, whose sum would only be rounding
        imbalance = (
            force
            - np.einsum("dqi,dq->i", variation, weight * added)
            - np.einsum("dqi,q->i", quadratic, weight * problem.pretension)
        )
        tangent = problem.stiffness(variation, predicted) - force_tangent
        step = free @ np.linalg.solve(free.T @ tangent @ free, free.T @ imbalance)
        unknowns = unknowns + step
        predicted = added + _elastic(variation @ step, problem.poisson_ratio)
        # u is compared, not u/r, whose rounding at the centre does not matter
        sizes, steps = (np.abs(lever * x).reshape(2, -1).max(axis=1) for x in (unknowns, step))
        if np.all(steps <= 1e-9 * sizes):  # the error is far smaller: convergence is quadratic
            return unknowns, iteration
    raise RuntimeError(
        f"no equilibrium found in {most_iterations} Newton iterations: strains of order one, "
        "reduce the force or widen the patch"
    )
