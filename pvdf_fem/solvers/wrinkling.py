"""Newton's method for a film that wrinkles: interior points from afar, the exact law near by.

The energy of the tension field is convex, but its second derivative jumps where the film begins to
wrinkle, and against a small load the film is so stiff that stresses of trial strains mean little.
So the geometric stiffness takes the stress that the last step predicted, not that of the strain
(Magisano, Leonetti, Garcea, Comput. Methods Appl. Mech. Eng. 313 (2017) 496-514), and the start
comes from `pvdf_fem.solvers.interior_point` unless it is known to be near.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.laws import GivenModuli, WrinklingMembrane
from pvdf_fem.film.membrane import Array, strain_rate
from pvdf_fem.scene.scene import Scene
from pvdf_fem.solution.estimate import Correction, correct, prolongation
from pvdf_fem.solvers.arc_length import follow, turned
from pvdf_fem.solvers.interior_point import Iterate, interior_points
from pvdf_fem.solvers.newton import (
    STEP_TOLERANCE,
    Iteration,
    NewtonResult,
    Status,
    balanced,
    compressed,
    factorise,
    full_steps,
    negative_pivots,
    newton,
    seed,
)
from pvdf_fem.solvers.settled import Settled, Watch

MAX_ITERATIONS = 300
# Of a film with many unknowns fewer, whose work is some 5 s of one core. If no more than so many
# interior points are left of that, they would not lead anywhere.
MOST_WORK, FEWEST_POINTS = 7e5, 20
# Integral of S : P over the work, below which Newton's method for the exact law is tried, and again
# when it is smaller by a factor; the last of them.
FIRST_GAP, NARROWER, LAST_GAP = 1e-6, 1e-2, 1e-15
# Damping of Newton's steps, as a part of the mean tension and of the size of the last step, and the
# factor by which it grows after a step shorter than that, until one need not be shortened.
DAMPING, STIFFER, STALLED = 1e-2, 4.0, 0.05
# Of the richer space's residual, after which a correction is taken for its solution.
REMAINDER = 0.2
# Of Newton's last step in the richer space of an error estimate.
RICH_TOLERANCE = 1e-3
# Unknowns of a space in which a solve from afar takes no more than some seconds; and one from near
# by, of a film that bends and of one that does not.
FEW, MANY_BENT, MANY = 12_000, 25_000, 50_000
# Strain of the load over the thermal one below which a film that no solve balances is called slack.
# Its tension runs in lines as wide as the root of that ratio times its radius.
BARELY = 0.1
# Newton's last step, as a part of the tolerance of the charges: where the film's state changes from
# point to point steps shrink but linearly, and rounding in a stiff film ends that early.
LEFT = 1e-2
# The same of interior points: the stress of their strain against that in balance. And of Newton's
# steps after so many, if the charges have been settled in so many of them.
DISAGREEMENT, LATE, QUIET = 1e-1, 12, 3
# Newton's method is given up when a step is larger than that, or after so many; after twice as many
# if the charges have settled.
MOST_STEPS, LARGEST_STEP = 25, 3.0
# Given up after no more than so many, it started from too far away, and another start may help.
FEW_STEPS = 2
# Nor does it lead anywhere if a step larger than one of the two has to be shortened to the other.
MIDDLING, SHORTEST = 0.05, 0.02
# Of the slope of the energy at the start of a step, that which may be left at its end, and the
# lengths that are tried for it.
SLACKENED, MOST_LENGTHS = 0.5, 6


def barely_loaded(scene: Scene) -> bool:
    """Whether a film that wrinkles is much larger than its rim, against the strain of the load."""
    wrinkles = scene.film.compression == "tension-field"
    return wrinkles and load_strain(scene) < BARELY * scene.film.thermal_strain


def load_strain(scene: Scene) -> float:
    """(F/(E h a))^(2/3), of the order of the strain that the load makes in a flat film."""
    film = scene.film
    stiffness = film.thickness * film.stiffness[:2, :2].mean()
    return float(np.cbrt(scene.load.force / (stiffness * film.radius)) ** 2)


def disagreement(scene: Scene) -> float:
    """What a film that wrinkles may lack of balance, in the energy norm."""
    return DISAGREEMENT * scene.numerics.tolerance


def equilibrate(
    equilibrium: Equilibrium,
    q: Array | None,
    tolerance: float = STEP_TOLERANCE,
    *,
    near: bool = False,
    settled: Settled | None = None,
    other: Callable[[], Array | None] | None = None,
) -> NewtonResult:
    """The equilibrium of a scene from the unknowns `q`, or from its seed, whatever the film does.

    Parameters and result are those of `newton.newton`, and:

    Parameters
    ----------
    settled : Settled, optional
        Charges that the last steps must leave as they are, where the film wrinkles.
    other : callable, optional
        Given with a start from another mesh. Makes another one, for when that turns out to be far
        away and the film wrinkles. In a large space the load's path is not followed then.
    """
    result = _equilibrate(equilibrium, q, tolerance, settled, other, near=near)
    if result.status is Status.CONVERGED or equilibrium.load.conservative:
        return result
    if other is not None and equilibrium.unknowns.count > FEW:
        return replace(result, status=Status.MAX_ITERATIONS)
    dead = _equilibrate(turned(equilibrium, 0.0), None, tolerance, near=False)
    if dead.status is not Status.CONVERGED:
        return dead

    def near_by(start: Array) -> NewtonResult:
        if not isinstance(equilibrium.membrane, WrinklingMembrane):
            return full_steps(equilibrium, start, tolerance)
        return _equilibrate(equilibrium, start, tolerance, settled, near=True)

    followed = follow(equilibrium, dead.q, near_by)
    return replace(followed, earlier=len(result.iterations) + len(dead.iterations))


def _equilibrate(
    equilibrium: Equilibrium,
    q: Array | None,
    tolerance: float,
    settled: Settled | None = None,
    other: Callable[[], Array | None] | None = None,
    *,
    near: bool,
) -> NewtonResult:
    if not isinstance(equilibrium.membrane, WrinklingMembrane):
        return newton(equilibrium, seed(equilibrium) if q is None else q, tolerance, near=near)
    if equilibrium.load.force == 0.0:
        flat = np.zeros(equilibrium.unknowns.count)
        return NewtonResult(flat, Status.CONVERGED, (), None)
    table: list[Iteration] = []
    start = deflected(equilibrium) if q is None else q
    tolerance = max(tolerance, LEFT * equilibrium.scene.numerics.tolerance)
    try:
        if q is not None and near:
            if result := _newton(equilibrium, q, None, tolerance, table, settled):
                return result
            if other is not None and len(table) <= FEW_STEPS and (another := other()) is not None:
                start = another
                if result := _newton(equilibrium, start, None, tolerance, table, settled):
                    return result
        if not equilibrium.load.conservative:  # interior points are for a dead load
            return NewtonResult(start, Status.MAX_ITERATIONS, tuple(table), None)
        return _from_afar(equilibrium, start, tolerance, table, settled)
    except (RuntimeError, np.linalg.LinAlgError):  # SuperLU, Cholesky: what rounding leaves
        return NewtonResult(start, Status.MAX_ITERATIONS, tuple(table), None)


def corrected(
    coarse: Equilibrium,
    q: Array,
    factors: SuperLU,
    rich: Equilibrium,
    settled: Settled | None = None,
) -> Correction | Status:
    """The solution `q` of `coarse` in the space of `rich`, or why there is none to be found.

    That is what a few steps of conjugate gradients leave (`estimate.correct`). Where the film is
    too far from linear for them, or too stiff as it wrinkles, it is a solution of its own.
    """
    correction = correct(coarse, q, factors, rich)
    if correction is not None and not _lacking(correction):
        return correction
    prolong = prolongation(coarse, rich)
    start = prolong @ q
    last = settled and replace(settled, start=start)
    wrinkles = isinstance(rich.membrane, WrinklingMembrane)
    if rich.unknowns.count <= FEW:
        result = equilibrate(rich, start, RICH_TOLERANCE, near=True, settled=last)
    elif wrinkles or rich.unknowns.count <= (MANY if rich.bending is None else MANY_BENT):
        result = _equilibrate(rich, start, RICH_TOLERANCE, last, near=True)
    else:
        result = _few_steps(rich, start)
    if result.status is not Status.CONVERGED:
        return result.status
    state = rich.state(start)
    return Correction(rich, start, result.q, state, prolong, result.iteration_count)


def _few_steps(rich: Equilibrium, start: Array) -> NewtonResult:
    """Full steps in a large space.

    Where these lead nowhere, the film is in compression and buckles into waves that its mesh is too
    coarse for, and Newton's method from afar would take minutes to say no more.
    """
    result = full_steps(rich, start, RICH_TOLERANCE)
    unsure = rich.load.conservative and compressed(rich.state(start))
    if unsure and result.factors is not None and negative_pivots(result.factors) > 0:
        return replace(result, status=Status.UNSTABLE)
    return result


def _lacking(correction: Correction) -> bool:
    """Whether a film that wrinkles is still far from balance."""
    rich = correction.rich
    if not isinstance(rich.membrane, WrinklingMembrane):
        return False
    residuals = (rich.residual(rich.state(q)) for q in (correction.q, correction.start))
    left, was = (float(np.linalg.norm(residual)) for residual in residuals)
    return not left <= REMAINDER * was


def deflected(equilibrium: Equilibrium) -> Array:
    """The linear membrane's deflection, scaled to the least energy."""
    deflections = np.flatnonzero(equilibrium.unknowns.deflections())
    flat = equilibrium.membrane.state(np.zeros(equilibrium.membrane.dof_count))
    forces = equilibrium.assembly.vector(equilibrium.load.forces(flat.deformation_gradient))
    laplace = equilibrium.assembly.matrix(equilibrium.membrane.laplace())
    block = laplace[deflections][:, deflections].tocsc()
    q = np.zeros(equilibrium.unknowns.count)
    q[deflections] = factorise(block).solve(forces[deflections])
    q *= equilibrium.film.radius / np.abs(q).max()
    low, high = 1e-12, 1.0
    while high > 1.1 * low:
        middle = np.sqrt(low * high)
        rises = equilibrium.residual(equilibrium.state(middle * q)) @ q > 0.0
        low, high = (low, middle) if rises else (middle, high)
    return low * q


def _from_afar(
    equilibrium: Equilibrium,
    q: Array,
    tolerance: float,
    table: list[Iteration],
    settled: Settled | None,
) -> NewtonResult:
    points, gap = interior_points(equilibrium, q), FIRST_GAP
    most = np.clip(MOST_WORK / equilibrium.iteration_work, MOST_STEPS, MAX_ITERATIONS)
    allowed = max(tolerance, disagreement(equilibrium.scene))
    watch = Watch(settled, equilibrium.state(q))
    if most - len(table) < FEWEST_POINTS:
        most = 0
    while len(table) < most and gap > NARROWER * LAST_GAP:
        point = next(points)
        table.append(Iteration(point.gap, point.length, True, True))
        if 0.0 < point.gap < gap:
            if result := _newton(equilibrium, point.q, point.stress, tolerance, table, settled):
                return result
            gap = NARROWER * point.gap
        left = watch.left(point.state)
        if 0.0 < point.gap < allowed**2 and left <= 1.0 and _agrees(equilibrium, point, allowed):
            return NewtonResult(point.q, Status.CONVERGED, tuple(table), point.factors)
    return NewtonResult(q, Status.MAX_ITERATIONS, tuple(table), None)


def _agrees(equilibrium: Equilibrium, point: Iterate, tolerance: float) -> bool:
    """Whether the stress of the strain is that which is in balance, in the energy norm.

    And whether rim and load balance by it, as every result has to. The distance of the two stresses
    is the error in the constitutive relation (Ladeveze and Leguillon, SIAM J. Numer. Anal. 20
    (1983) 485-509), which bounds that of the solution, also where a slack film has no stiffness.
    """
    membrane = equilibrium.membrane
    assert isinstance(membrane, WrinklingMembrane)
    compliance = membrane.law.compliance

    def square(stress: Array) -> float:
        return float((((stress @ compliance) * stress).sum(axis=-1) * membrane.weights).sum())

    state = point.state
    if not square(state.stress - point.stress) < tolerance**2 * square(state.stress):
        return False
    return point.factors is not None and balanced(equilibrium, state, point.factors, tolerance)


def _newton(
    equilibrium: Equilibrium,
    q: Array,
    predicted: Array | None,
    tolerance: float,
    table: list[Iteration],
    settled: Settled | None,
) -> NewtonResult | None:
    """Newton's method for the exact law with predicted stresses; None if it leads nowhere."""
    membrane = equilibrium.membrane
    assert isinstance(membrane, WrinklingMembrane)
    state, size, quiet, stiffer = equilibrium.state(q), DAMPING, 0, 1.0
    allowed, watch = disagreement(equilibrium.scene), Watch(settled, state)
    if predicted is None:
        predicted = state.stress
    for steps in range(2 * MOST_STEPS):
        if steps >= MOST_STEPS and quiet < QUIET:
            return None
        strain = membrane.elastic(state.strain)
        root = membrane.law.root(strain, state.stress)
        mixed = GivenModuli(state.deformation_gradient, state.strain, predicted, state.dofs, root)
        damping = stiffer * DAMPING * min(size, 1.0)
        factors = factorise(equilibrium.damped_tangent(mixed, damping))
        residual = equilibrium.residual(state)
        step = -factors.solve(residual)
        scale = abs(min(equilibrium.work(state, q), 2.0 * membrane.energy(state)))
        size = float(np.sqrt(abs(residual @ step) / scale)) if scale > 0.0 else np.inf
        length = 1.0
        if size < LARGEST_STEP and equilibrium.load.conservative:
            length = _length(equilibrium, q, step, float(residual @ step))
        table.append(Iteration(size, length, False, True))
        if not size < LARGEST_STEP or (length < SHORTEST and size > MIDDLING):
            return None
        gradient = membrane.gradient(equilibrium.unknowns.expand(length * step))
        strain = strain + strain_rate(state.deformation_gradient, gradient)
        stiffer = _stiffened(stiffer, length)
        predicted = membrane.law.stress(strain)
        q = q + length * step
        state = equilibrium.state(q)
        left = watch.left(state)
        small, quiet = size < tolerance, quiet + 1 if settled and left <= 1.0 else 0
        late = steps >= LATE and quiet >= QUIET and size < allowed
        if late or (small and left <= 1.0):
            factors = factorise(equilibrium.tangent(state))
            if (small and stiffer == 1.0) or balanced(equilibrium, state, factors, allowed):
                return NewtonResult(q, Status.CONVERGED, tuple(table), factors)
    return None


def _stiffened(damping: float, length: float) -> float:
    """The damping of the next step over the usual one, from that of a step of this length."""
    if length < STALLED:
        return STIFFER * damping
    return max(damping / STIFFER, 1.0) if length == 1.0 else damping


def _length(equilibrium: Equilibrium, q: Array, step: Array, slope: float) -> float:
    """Where along a step the energy, which is convex, stops falling; 1 if that is near."""

    def slope_at(length: float) -> float:
        return float(equilibrium.residual(equilibrium.state(q + length * step)) @ step)

    low, high = (0.0, slope), (1.0, slope_at(1.0))
    if not high[1] > SLACKENED * abs(slope):
        return 1.0
    for _ in range(MOST_LENGTHS):
        width = high[0] - low[0]
        length = low[0] - width * low[1] / (high[1] - low[1])
        length = float(np.clip(length, low[0] + 0.1 * width, high[0] - 0.1 * width))
        found = length, slope_at(length)
        if abs(found[1]) < SLACKENED * abs(slope):
            break
        low, high = (low, found) if found[1] > 0.0 else (found, high)
    return length
