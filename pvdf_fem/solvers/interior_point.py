"""Equilibrium of a film that wrinkles, from any start, by a primal-dual interior-point method.

The tension field (`pvdf_fem.film.laws`) is the convex programme: minimise the elastic energy
less the work of the load, over displacements and elastic strains C^-1 S with e(u) + P = C^-1 S and
P >= 0. Its multiplier is the stress S >= 0, and S : P = 0. Newton's method takes S and P at every
quadrature point as unknowns of their own, strictly inside of their cones, with S P = mu I, mu -> 0.
So the film may be as stiff as it likes against the load: where the stress of a strain would be
useless far from the solution, the stress is known from the balance of forces.

S and P are vectors s = (S11 + S22, S11 - S22, 2 S12)/sqrt 2, likewise p, of the cone x0 >= |x1, x2|
with s . p = S : P. Nesterov and Todd's scaling, Mehrotra's predictor and corrector: Andersen, Roos,
Terlaky, Math. Program. B 95 (2003) 249-277; then Gondzio's corrections for the few points that keep
a step short (Comput. Optim. Appl. 6 (1996) 137-156). The unknowns s and p are eliminated point by
point; what is left is a membrane's tangent with moduli (C^-1 + W^-2)^-1 and the stress S.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import Array, times
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.membrane import (
    IDENTITY,
    PredictedState,
    WrinklingMembrane,
    strain_of,
    strain_rate,
)
from pvdf_fem.film.term import State
from pvdf_fem.solvers.newton import factorise


@dataclass(frozen=True)
class StepRules:
    """How far a step goes, and how it is centred and corrected."""

    to_boundary: float = 0.95  #: Part of the way to the cones' boundary that a step may go.
    #: A predictor shorter than this asks for more centring than Mehrotra's (1 - length)^3.
    short: float = 0.5
    least_centring: float = 1e-6
    corrections: int = 3  #: Largest number of Gondzio's corrections.
    farther: float = 0.3  #: How much longer than the step a correction tries to be.
    #: Eigenvalues of S P over mu that a correction leaves alone, (float, float).
    central: tuple[float, float] = (0.1, 10.0)
    gain: float = 0.1  #: A correction that gains less than this part of its trial ends them.
    #: Part of a step that has to be left when the second order is taken into account.
    shortened: float = 0.7
    #: The exact wrinkling strain replaces one that differs by at most this factor.
    exact: float = 2.0
    #: Factor on the mean stress and strain at the start, since under a small probe means say
    #: little.
    start: float = 100.0


RULES = StepRules()
#: Part by which a tensor's trace exceeds its other components at least, against rounding.
ROUNDING = 1e-15

# p = STRAIN P, Voigt with engineering shear, and S = STRAIN^T s.
STRAIN: Array = np.array([[1.0, 1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 0.0, 1.0]]) / np.sqrt(2.0)
UNIT: Array = np.array([1.0, 0.0, 0.0])


# dq, ds, dp
Step = tuple[Array, Array, Array]


@dataclass(frozen=True)
class Iterate:
    """Displacement, stress and wrinkling strain on the way."""

    q: Array  #: (unknowns,)
    #: s, p: Stress in Pa and wrinkling strain as vectors of the cone, (elements, points, 3).
    s: Array
    p: Array
    gap: float  #: Integral of S : P over the work of the load.
    length: float  #: Part of Newton's step that was taken.
    state: State  #: Of `q`.

    @property
    def stress(self) -> Array:
        """S in Pa, (elements, points, 3)."""
        return self.s @ STRAIN


def interior_points(equilibrium: Equilibrium, q: Array) -> Iterator[Iterate]:
    """Iterates from the unknowns `q`, without end; `q` must not be the flat film. Raises
    `RuntimeError` or `LinAlgError` when rounding allows no further step."""
    points = _InteriorPoint(equilibrium)
    iterate = points.start(q)
    while True:
        iterate = points.next(iterate)
        yield iterate


class _InteriorPoint:
    def __init__(self, equilibrium: Equilibrium) -> None:
        if not isinstance(equilibrium.membrane, WrinklingMembrane):
            raise TypeError("the film of this equilibrium does not wrinkle")
        self.equilibrium, self.membrane = equilibrium, equilibrium.membrane
        self.compliance = STRAIN @ self.membrane.law.compliance @ STRAIN.T
        self.weights = self.membrane.volumes

    def start(self, q: Array) -> Iterate:
        """Stress and wrinkling strain of about the right size, equal in all directions."""
        state, at_rest = self.equilibrium.state(q), np.abs(self.membrane.strain_at_rest).max()
        density = abs(self.equilibrium.work(state, q)) / self.weights.sum()
        elastic = np.sqrt(density * self.compliance[0, 0])
        tension = density / max(at_rest, elastic)
        widest = np.abs(self.membrane.elastic(state.strain)).max()
        strain = max(widest, tension * self.compliance[0, 0])
        ones = np.broadcast_to(RULES.start * UNIT, state.strain.shape)
        return Iterate(q, tension * ones, strain * ones, np.inf, 1.0, state)

    def next(self, at: Iterate) -> Iterate:
        """Mehrotra's step: the predictor's length says how far to go, the corrector goes."""
        step = _Linearised(self, at)
        predicted = step.solve(-step.scaled)
        length = _longest(at, predicted)
        missing = 1.0 - length
        centring = max(missing**3 if length > RULES.short else 0.5 * missing, RULES.least_centring)
        ds, dp = predicted[1:]
        second = _jordan(times(step.inverse, ds), times(step.scaling, dp))
        wanted = centring * step.mu * UNIT - second
        dq, ds, dp = self._corrected(step, wanted, centring * step.mu)
        length = min(1.0, RULES.to_boundary * _longest(at, (dq, ds, dp)))
        q, s, p = at.q + length * dq, at.s + length * ds, at.p + length * dp
        s, p = _inside(s), _inside(p)
        state = self.equilibrium.state(q)
        p = _closer(p, s @ self.compliance - self.membrane.elastic(state.strain) @ STRAIN.T)
        gap = float(((s * p).sum(axis=-1) * self.weights).sum())
        gap /= self.equilibrium.work(state, q)
        return Iterate(q, s, p, gap, length, state)

    def _corrected(self, step: _Linearised, wanted: Array, mu: float) -> Step:
        """The step to the products `wanted`, made longer by Gondzio's corrections. At last the
        strain's and the forces' second order is made up for: where the film is slack steps are so
        large that it would stay in tension somewhere."""
        at = step.at
        best = step.solve(_jordan_inverse(step.scaled, wanted) - step.scaled)
        length = _longest(at, best)
        for _ in range(RULES.corrections):
            if length > 1.0 - RULES.gain:
                break
            trial = min(1.0, length + RULES.farther)
            s, p = at.s + trial * best[1], at.p + trial * best[2]
            products = _jordan(times(step.inverse, s), times(step.scaling, p))
            wanted = wanted + _into(products, RULES.central[0] * mu, RULES.central[1] * mu)
            other = step.solve(_jordan_inverse(step.scaled, wanted) - step.scaled)
            longer = _longest(at, other)
            if longer < length + RULES.gain * RULES.farther:
                break
            best, length = other, longer
        right = _jordan_inverse(step.scaled, wanted) - step.scaled
        other = step.solve(right, step.second_order(best, length))
        return best if _longest(at, other) < RULES.shortened * length else other


class _Linearised:
    """The equations of one step, with s and p eliminated and the tangent factorised."""

    def __init__(self, points: _InteriorPoint, at: Iterate) -> None:
        self.points, self.at = points, at
        weights = points.weights
        self.mu = float(((at.s * at.p).sum(axis=-1) * weights).sum() / weights.sum())
        self.scaling, self.inverse = _nesterov_todd(at.s, at.p)
        self.scaled = times(self.inverse, at.s)
        compliance = self.scaling @ points.compliance @ self.scaling + np.eye(3)
        self.root = np.linalg.solve(np.linalg.cholesky(compliance), self.scaling)
        self.state = at.state
        strain = points.membrane.elastic(self.state.strain) @ STRAIN.T
        self.mismatch = strain + at.p - at.s @ points.compliance
        self.factors = self._factors()

    def _factors(self) -> SuperLU:
        now = self.state
        state = PredictedState(
            now.deformation_gradient, now.strain, self.at.stress, now.dofs, self.root @ STRAIN, 0.0
        )
        return factorise(self.points.equilibrium.tangent(state))

    def solve(
        self, right: Array, second_order: tuple[Array | float, Array | float] = (0.0, 0.0)
    ) -> Step:
        """dq, ds, dp with W^-1 ds + W dp = `right`, and what `second_order` adds."""
        equilibrium, state = self.points.equilibrium, self.state
        mismatch = self.mismatch + second_order[0]
        known = self._moduli(mismatch + times(self.inverse, right))
        stress = replace(state, stress=(self.at.s + known) @ STRAIN)
        dq = -self.factors.solve(equilibrium.residual(stress) + second_order[1])
        gradient = equilibrium.space.gradient(equilibrium.step(state, dq))
        strain = strain_rate(state.deformation_gradient, gradient) @ STRAIN.T
        ds = self._moduli(strain) + known
        return dq, ds, ds @ self.points.compliance - strain - mismatch

    def second_order(self, step: Step, length: float) -> tuple[Array, Array]:
        """Strain and forces in N of second order that a part of `step` adds, over that part."""
        membrane, equilibrium = self.points.membrane, self.points.equilibrium
        gradient = equilibrium.space.gradient(equilibrium.step(self.state, step[0]))
        strain = (strain_of(gradient) - strain_rate(IDENTITY, gradient)) @ STRAIN.T
        state = replace(self.state, deformation_gradient=gradient, stress=step[1] @ STRAIN)
        forces = equilibrium.on_unknowns(self.state, membrane.internal_forces(state))
        return length * strain, length * forces

    def _moduli(self, strain: Array) -> Array:
        return times(self.root.swapaxes(-1, -2), times(self.root, strain))


def _nesterov_todd(s: Array, p: Array) -> tuple[Array, Array]:
    """W and W^-1, symmetric (..., 3, 3), with W p = W^-1 s."""
    size_s, size_p = _determinant(s), _determinant(p)
    if min(size_s.min(), size_p.min()) <= 0.0:
        raise np.linalg.LinAlgError("rounding has left the cone")
    size_s, size_p = np.sqrt(size_s), np.sqrt(size_p)
    s, p = s / size_s[..., None], p / size_p[..., None]
    w = s + p * [1.0, -1.0, -1.0]
    w /= np.sqrt(2.0 * (1.0 + (s * p).sum(axis=-1)))[..., None]
    scaling = np.empty((*s.shape, 3))
    scaling[..., 0, :] = scaling[..., :, 0] = w
    outer = w[..., 1:, None] * w[..., None, 1:] / (1.0 + w[..., :1, None])
    scaling[..., 1:, 1:] = np.eye(2) + outer
    mirror = np.array([[1.0, -1.0, -1.0], [-1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]])
    ratio = np.sqrt(size_s / size_p)[..., None, None]
    return scaling * ratio, scaling * mirror / ratio


def _determinant(x: Array) -> Array:
    """x0^2 - |x1, x2|^2; twice the determinant of the tensor."""
    radius = np.hypot(x[..., 1], x[..., 2])
    return np.asarray((x[..., 0] - radius) * (x[..., 0] + radius))


def _longest(at: Iterate, step: Step) -> float:
    """Longest step, up to 1, that leaves s and p in their cones."""
    return min(1.0, _to_boundary(at.s, step[1]), _to_boundary(at.p, step[2]))


def _to_boundary(x: Array, d: Array) -> float:
    """Least positive root of the determinant of x + t d, a t^2 + 2 b t + c."""
    a, c = _determinant(d), _determinant(x)
    b = x[..., 0] * d[..., 0] - x[..., 1] * d[..., 1] - x[..., 2] * d[..., 2]
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    leaves = (a < 0.0) | ((b < 0.0) & (b * b >= a * c))
    # c/(root - b) and -(root + b)/a are the same; take the one without cancellation
    numerator, denominator = np.where(b <= 0.0, c, -(root + b)), np.where(b <= 0.0, root - b, a)
    with np.errstate(divide="ignore", invalid="ignore"):
        lengths = np.where(leaves, numerator / denominator, np.inf)
    return float(lengths.min())


def _inside(x: Array) -> Array:
    """`x`, which rounding may have moved out of the cone, inside of it."""
    x[..., 0] = np.maximum(x[..., 0], (1.0 + ROUNDING) * np.hypot(x[..., 1], x[..., 2]))
    return x


def _closer(p: Array, exact: Array) -> Array:
    """`exact` where it is in the cone and about as large as `p`, elsewhere `p`."""
    below, above = exact - p / RULES.exact, RULES.exact * p - exact
    inside = [(_determinant(x) > 0.0) & (x[..., 0] > 0.0) for x in (below, above)]
    return np.where((inside[0] & inside[1])[..., None], exact, p)


def _into(x: Array, low: float, high: float) -> Array:
    """What brings the eigenvalues of `x` between the bounds, each down by `high` at the most."""
    radius = np.hypot(x[..., 1], x[..., 2])
    smaller, larger = (
        np.maximum(np.clip(value, low, high) - value, -high)
        for value in (x[..., 0] - radius, x[..., 0] + radius)
    )
    change = np.empty_like(x)
    change[..., 0] = 0.5 * (smaller + larger)
    along = x[..., 1:] / np.where(radius > 0.0, radius, 1.0)[..., None]
    change[..., 1:] = 0.5 * (larger - smaller)[..., None] * along
    return change


def _jordan(a: Array, b: Array) -> Array:
    """The product of the cone's algebra: (a . b, a0 b1 + b0 a1, ...)."""
    product = a[..., :1] * b + b[..., :1] * a
    product[..., 0] = (a * b).sum(axis=-1)
    return np.asarray(product)


def _jordan_inverse(a: Array, b: Array) -> Array:
    """The x whose product with `a` is `b`."""
    x = np.empty(np.broadcast_shapes(a.shape, b.shape))
    dot = (a[..., 1:] * b[..., 1:]).sum(axis=-1)
    x[..., 0] = (a[..., 0] * b[..., 0] - dot) / _determinant(a)
    x[..., 1:] = (b[..., 1:] - a[..., 1:] * x[..., :1]) / a[..., :1]
    return x
