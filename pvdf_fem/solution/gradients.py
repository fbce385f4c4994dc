"""Derivatives of every charge with respect to the probe's place, the force and the film.

A charge Q(x, θ) of the displacement x that solves R(x, θ) = 0 has the derivative::

    dQ/dθ = ∂Q/∂θ - λ · ∂R/∂θ,    K^T λ = ∂Q/∂x

with the tangent K, so that one adjoint solve λ per electrode serves all parameters.

R depends on the probe's place through the load's patch. The pressure F/A stays, since translations
and rotations keep the area, and the work of the load on λ changes by what the outline sweeps
(Reynolds' transport theorem)::

    -λ · ∂R/∂θ = p ∮ (λ · t) (V · n) ds

with the outline's velocity V, its outward normal n, and the direction t of the pressure per
reference area: e_z for a dead load, F1 x F2 for a follower load.

A film on a tip moves with it: the displacement is x(q, θ) of the unknowns q, and R = P^T f with the
film's forces f and P = ∂x/∂q. Then ∂Q/∂θ and ∂R/∂θ have ∂x/∂θ in them, and ∂R/∂θ what turns P, the
slope of the tip at its nodes. That the contact's edge moves too counts only in the second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse.linalg import SuperLU

from pvdf_fem.arrays import COMPLEX_STEP, Array
from pvdf_fem.charges.forces import charges_of, goal_forces, goal_gradients
from pvdf_fem.charges.goals import Goal, goals_of
from pvdf_fem.film.equilibrium import Equilibrium
from pvdf_fem.film.laws import StVenantKirchhoff
from pvdf_fem.film.loads.contact import Contact
from pvdf_fem.film.loads.kinds import LOADS
from pvdf_fem.film.loads.pressure import DeadPressure
from pvdf_fem.film.membrane import IDENTITY, Membrane
from pvdf_fem.film.models import film_model
from pvdf_fem.film.space import shape_values
from pvdf_fem.film.term import State
from pvdf_fem.mesh.points import facet_quadrature
from pvdf_fem.scene.change import steps_of
from pvdf_fem.scene.film import Film, plane_stress
from pvdf_fem.scene.scene import LoadedProbe, Probe, Scene
from pvdf_fem.scene.shapes import FORCES
from pvdf_fem.solution.attempt import error_indicators
from pvdf_fem.solution.estimate import Correction, corrected
from pvdf_fem.solution.solution import NotConvergedError, Solution
from pvdf_fem.solution.solve import solve
from pvdf_fem.solvers.budget import Budget
from pvdf_fem.solvers.newton import NewtonResult, factorise
from pvdf_fem.solvers.status import Status

_PLACE = ("x_mm", "y_mm", "rotation_deg")
PLACE = tuple(f"probe.{name}" for name in _PLACE)
_IN_PLANE = ("tangential_N[0]", "tangential_N[1]")
COEFFICIENTS = ("film.d31_pC_N", "film.d32_pC_N")
#: Error over what the next order takes away, of which corners leave it the least.
SATURATION = 1.5
#: Least error that is stated of a derivative, over the mean one: an estimate may vanish by chance.
CHANCE = 0.5
#: Derivatives count as no smaller than this part of the largest charge over the parameter's scale.
NEGLIGIBLE = 1e-3
TINY = np.finfo(float).tiny


class Gradients(dict[str, dict[str, float]]):
    """Derivatives of charges by key and electrode, in pC per unit of the key.

    Attributes
    ----------
    errors : dict
        Their estimated discretisation errors, absolute, by key and electrode.
    relative_errors : dict
        By key the largest error over the largest derivative, since that of one electrode may vanish
        by cancellation. Where all nearly do, over a thousandth of the largest charge per scale of
        the parameter: the probe's perimeter over 2 pi, a radian, or the parameter's value.
    solution : Solution
        Whose charges are differentiated.
    """

    errors: dict[str, dict[str, float]]
    relative_errors: dict[str, float]
    solution: Solution


def gradients(
    solution: Solution | Scene,
    parameters: Sequence[str] | None = None,
    *,
    tolerance: float | None = None,
) -> Gradients:
    """Derivative of each charge with respect to parameters of the scene, with estimated errors.

    Parameters
    ----------
    solution : Solution or Scene
        A converged one, or a scene that is solved first.
    parameters : sequence of str, optional
        Keys of the scene file as in `Scene.with_`, by default all of `parameters_of` the scene.
    tolerance : float, optional
        Largest of the `Gradients.relative_errors` wanted. Where the solution's mesh leaves larger
        ones, the scene is solved again to smaller errors of its charges. By default the derivatives
        are those of the solution, whatever their errors.

    Returns
    -------
    Gradients
        A dict: for each key the derivatives by electrode, in pC per unit of the key, which is pC/mm
        for ``probe.x_mm``.

    Raises
    ------
    NotConvergedError
        When the solution is not converged, or no mesh meets the tolerance.
    ValueError
        For a key that is not among `parameters_of` the scene, or a tolerance out of range.
    """
    scene = solution if isinstance(solution, Scene) else solution.scene
    known = parameters_of(scene)
    wanted = known if parameters is None else tuple(parameters)
    for key in wanted:
        if key not in known:
            raise ValueError(f"parameters: {key!r} {_refusal(scene, key)}; take some of {known}")
    if tolerance is not None and not 0.0 < tolerance < 1.0:
        raise ValueError(f"tolerance = {tolerance!r}: is out of range; give a number from 0 to 1")
    found = _gradients_of(solve(scene) if isinstance(solution, Scene) else solution, wanted)
    while tolerance and max(found.relative_errors.values(), default=0.0) > tolerance:
        found = _gradients_of(_finer(found, tolerance), wanted)
    return found


def _finer(found: Gradients, tolerance: float, least: float = 2e-8) -> Solution:
    """The solution to finer charges, not below `least`; errors of derivatives fall as theirs do."""
    worst, key = max((error, key) for key, error in found.relative_errors.items())
    scene, reason = found.solution.scene, "rounding allows no better mesh"
    aim = 0.5 * tolerance / worst * scene.numerics.tolerance
    if aim > least:
        # the tolerance must not choose anew whether the film bends or feels voltages
        model = film_model(scene)
        chosen = {"film.bending": model.bends, "film.coupling": bool(model.floating)}
        finer = solve(scene.with_(**chosen, **{"numerics.tolerance": aim}))
        if finer.status is Status.CONVERGED:
            return finer
        reason = f"with charges to {aim:.1e}: {finer.reason}"
    raise NotConvergedError(
        f"{Status.TOLERANCE}: derivatives by {key} have errors of {worst:.1e}; raise"
        f" tolerance = {tolerance:g} ({reason})"
    )


def _gradients_of(solution: Solution, wanted: Sequence[str]) -> Gradients:
    """Derivatives of the solution's charges, and what the next order changes as their errors.

    All are of one displacement and share its error, so one that nearly vanishes does so by chance:
    none is taken for much smaller, over its `unit`, than the mean of its electrode and of all.
    """
    scene, keys = solution.scene, parameters_of(solution.scene)
    adjoint, rich = _adjoints(solution)
    rates, better = (np.array([_rate(of, key) for key in keys]) for of in (adjoint, rich))
    errors = np.abs(better - rates)
    sizes = np.abs(adjoint.forces) @ np.abs([scene.film.d31, scene.film.d32])
    unit = sizes / np.array([[_scale(scene, key)] for key in keys])
    relative = np.divide(errors, unit, out=np.zeros_like(errors), where=unit > 0.0)
    by_place = np.array([key.endswith(_PLACE) for key in keys])
    for group in (by_place, ~by_place):
        means = relative[group].sum(axis=0) / max(group.sum(), 1)
        floors = CHANCE * np.maximum(means, means @ sizes / max(sizes.sum(), TINY))
        errors[group] = np.maximum(errors[group], floors * unit[group])
    errors *= SATURATION * film_model(scene).saturation
    largest = np.maximum(np.abs(rates), NEGLIGIBLE * unit).max(axis=1, initial=TINY)
    names = [electrode.name for electrode in scene.electrode_list]
    found = Gradients()
    found.errors, found.relative_errors, found.solution = {}, {}, solution
    for key in wanted:
        row = keys.index(key)
        for values, table in ((rates, found), (errors, found.errors)):
            table[key] = dict(zip(names, (1e12 * values[row]).tolist(), strict=True))
        found.relative_errors[key] = float(errors[row].max() / largest[row])
    return found


def _scale(scene: Scene, key: str) -> float:
    """A change of a parameter that matters, in units of its key."""
    touches = _touched(scene).get(key)
    if touches and key.endswith(_PLACE):
        probe = touches[0][0].probe
        if key.endswith("rotation_deg"):
            return float(np.degrees(1.0)) if probe.period_deg else np.inf
        return 1e3 * probe.outline.perimeter / (2.0 * np.pi)
    if touches and "_N" in key:
        return max(float(np.linalg.norm(touch.load.components)) for touch, *_ in touches) or 1.0
    value: Any = scene
    for name in steps_of(key):
        value = value[name] if isinstance(name, int) else getattr(value, name)
    return abs(value) or 1.0


def parameters_of(scene: Scene) -> tuple[str, ...]:
    """Keys of the parameters by which `gradients` differentiates.

    A film with two moduli has ``film.youngs_modulus_GPa.0`` and ``.1``. A film of given
    ``film.pretension_N_m`` has that, or its ``.0`` and ``.1``, in place of
    ``film.temperature_change_K``, and the others at this pretension. A rigid probe has no
    derivative by its place, as the tractions along its edge are singular. Of a film that bends or
    wrinkles, is uneven, or touches a tip with friction, there is none by what its stiffness depends
    on; of one that feels the voltages of electrodes none by d31 and d32 either.
    """
    scene.require_plain_charges("derivatives", "coupling", "warming_K")
    probes = tuple(key for key in _touched(scene) if not _hindrance(scene, key))
    rubs = any(touch.load.friction for touch in scene.loaded_probes)
    model, uneven = film_model(scene), scene.film.is_uneven
    differentiable = model.film_is_differentiable and model.electrodes_only_read
    differentiable = differentiable and not (rubs or uneven)
    film = _film_keys(scene.film) if differentiable else ()
    return (*probes, *film, *(COEFFICIENTS if model.electrodes_only_read else ()))


def _touched(scene: Scene) -> dict[str, list[tuple[LoadedProbe, int, str]]]:
    """By key of a probe or of its load: the probes that it is of, their numbers and its name."""
    found: dict[str, list[tuple[LoadedProbe, int, str]]] = {}
    for i, touch in enumerate(scene.loaded_probes):
        prefix = f"probe[{i}]" if isinstance(scene.probe, tuple) else "probe"
        own = getattr(touch.probe, "load", None)
        for name in (*_PLACE, "force_N" if touch.load.depth_mm is None else "depth_mm", *_IN_PLANE):
            key, _, component = name.partition("[")
            where = prefix if key in _PLACE else f"{prefix}.load" if own else "load"
            if key in FORCES and getattr(touch.probe, key, None) is not None:
                where = prefix
            if not component or touch.load.tangential_N is not None:
                found.setdefault(f"{where}.{name}", []).append((touch, i, name))
    return found


def _hindrance(scene: Scene, key: str) -> str:
    """Why the charges have no derivative by a key of `_touched`; empty if they have."""
    for touch, _, name in _touched(scene)[key]:
        if touch.load.friction:
            return "of a tip with friction has no derivative here; give load.friction = 0"
        if name in _PLACE and (touch.load.profile != "uniform" or touch.pressure):
            return 'of a pressure profile has no derivative here; give load.profile = "uniform"'
        if name in _PLACE and LOADS[touch.load.kind].rigid:
            return "of a rigid probe has no derivative here: the tractions at its edge are singular"
    return ""


def _film_keys(film: Film) -> tuple[str, ...]:
    stretched = "temperature_change_K" if film.pretension_N_m is None else "pretension_N_m"
    names = ("thickness_um", stretched, "youngs_modulus_GPa", "poisson_ratio")
    ends = {tuple: (".0", ".1")}
    return tuple(f"film.{n}{end}" for n in names for end in ends.get(type(getattr(film, n)), ("",)))


def _refusal(scene: Scene, key: str) -> str:
    if key in _touched(scene):
        return _hindrance(scene, key)
    if key in (*_film_keys(scene.film), *COEFFICIENTS):
        return "of a film that bends, wrinkles, sticks or feels voltages has no derivative here"
    return "is not a parameter of this scene that charges are differentiated by"


def force_rates(solution: Solution, keys: Sequence[str]) -> Array:
    """Derivatives of the forces X, Y of each electrode, without errors.

    Parameters
    ----------
    solution : Solution
        A converged one.
    keys : sequence of str
        Of `parameters_of` its scene, but for d31 and d32.

    Returns
    -------
    (keys, electrodes, 2)
        In N per unit of the key.
    """
    units = [(1.0, 0.0), (0.0, 1.0)]
    goals = [replace(goal, d=d) for goal in goals_of(solution.scene) for d in units]
    solved, q, factors = factorised(solution)
    adjoint = _Adjoint.of(solved, goals, q, factors)
    return np.reshape([_rate(adjoint, key) for key in keys], (len(keys), -1, 2))


@dataclass(frozen=True, eq=False)
class _Adjoint:
    """A displacement with the adjoint solutions of its charges."""

    equilibrium: Equilibrium
    goals: Sequence[Goal]
    #: Of the displacement.
    state: State
    #: X and Y in N, (electrodes, 2).
    forces: Array
    #: Derivatives of the charges by the dofs, and λ of the charges there, (dofs, electrodes).
    goal_rates: Array
    dofs: Array

    @classmethod
    def of(
        cls, equilibrium: Equilibrium, goals: Sequence[Goal], q: Array, factors: SuperLU
    ) -> _Adjoint:
        """One solve per electrode with the tangent's `factors` at the unknowns `q`."""
        membrane, state = equilibrium.membrane, equilibrium.state(q)
        rates = goal_gradients(goals, membrane, state.dofs)
        unknowns = factors.solve(equilibrium.on_unknowns(state, rates), "T")
        forces = goal_forces(goals, membrane, state.dofs)
        dofs = np.stack([equilibrium.step(state, column) for column in unknowns.T], axis=-1)
        return cls(equilibrium, goals, state, forces, rates, dofs)

    def of_stress(self, membrane: Membrane) -> Array:
        """∂Q/∂θ - λ · ∂R/∂θ, (electrodes,), where the stress becomes that of `membrane`."""
        x = self.state.dofs
        explicit = charges_of(self.goals, goal_forces(self.goals, membrane, x))
        return explicit - membrane.internal_forces(membrane.state(x)) @ self.dofs


def _adjoints(solution: Solution) -> tuple[_Adjoint, _Adjoint]:
    """The adjoint solutions of a solution, and those of the order above on the same mesh."""
    solved, q, factors = factorised(solution)
    goals = goals_of(solution.scene)
    correction = next_order(solved, q, factors)
    rich, rich_q = correction.rich, correction.q
    rich_factors = factorise(rich.tangent(rich.state(rich_q)))
    coarse = _Adjoint.of(solved, goals, q, factors)
    return coarse, _Adjoint.of(rich, goals, rich_q, rich_factors)


def next_order(solved: Equilibrium, q: Array, factors: SuperLU) -> Correction:
    """The solution in the order above on the same mesh; raises `NotConvergedError`."""
    rich = Equilibrium(solved.scene, solved.space.mesh, solved.space.order + 1)
    correction = corrected(solved, q, factors, rich, Budget.of(solved.scene))
    if isinstance(correction, NewtonResult):
        raise NotConvergedError(f"{correction.status}: {correction.status.advice}")
    return correction


def error_shares(solution: Solution) -> Array:
    """Shares of the elements in the errors of the charges by the mesh, in C, (elements, goals)."""
    solved, q, factors = factorised(solution)
    correction = next_order(solved, q, factors)
    return error_indicators(correction, factors, goals_of(solution.scene))[1]


def factorised(solution: Solution) -> tuple[Equilibrium, Array, SuperLU]:
    """The whole film's equations with their unknowns and the tangent's factors."""
    fields, solved = solution.fields, solution.fields.equilibrium
    q = solved.restrict(fields.displacement)
    try:  # anew, since Newton's last factors may be of an earlier state
        return solved, q, factorise(solved.tangent(fields.state))
    except RuntimeError:  # SuperLU: exactly singular, as for a slack film without a load
        raise NotConvergedError(f"{Status.SINGULAR}: {Status.SINGULAR.advice}") from None


def _rate(adjoint: _Adjoint, key: str) -> Array:
    """dQ/dθ in C per unit of the key, (electrodes,)."""
    equilibrium, state = adjoint.equilibrium, adjoint.state
    film, membrane = equilibrium.film, equilibrium.membrane
    if touches := _touched(equilibrium.scene).get(key):
        return sum((_touch_rate(adjoint, i, name) for _, i, name in touches), np.zeros(1))
    if key in COEFFICIENTS:
        return 1e-12 * adjoint.forces[:, COEFFICIENTS.index(key)]
    rate = adjoint.of_stress(Membrane(membrane.space, film, _stress_rate(film, key)))
    if key == "film.thickness_um":
        rate -= membrane.internal_forces(state) @ adjoint.dofs / film.thickness_um
    return rate


def _stress_rate(film: Film, key: str) -> StVenantKirchhoff:
    """Derivative of the law by a key, in Pa per unit of it; a pretension that is given stays."""
    name, _, index = key.removeprefix("film.").partition(".")
    given, added, zeroed = film.pretension_N_m is not None, np.zeros(3), film.zeroed
    if name == "temperature_change_K":
        added[:] = -film.stiffness[:, :2].sum(axis=1) * film.thermal_expansion_per_K
    elif name == "pretension_N_m":
        added[int(index or 0) : int(index or 1) + 1] = 1.0 / film.thickness
    elif name == "thickness_um":
        added[:] = -given * zeroed.stress_at_rest / film.thickness_um
    else:
        stiffness = _stiffness_rate(film, key)
        return StVenantKirchhoff(stiffness, -given * stiffness @ zeroed.strain_at_rest)
    return StVenantKirchhoff(np.zeros((3, 3)), added)


def _stiffness_rate(film: Film, key: str) -> Array:
    """Derivative of the film's stiffness in Pa per unit of the key, (3, 3)."""
    modulus = film.youngs_modulus_GPa
    E = np.array(modulus if isinstance(modulus, tuple) else (modulus, modulus), dtype=complex)
    nu12 = complex(film.poisson_ratio)
    if key == "film.poisson_ratio":
        nu12 += 1j * COMPLEX_STEP
    else:
        E[{"0": [0], "1": [1]}.get(key[-1], [0, 1])] += 1j * COMPLEX_STEP
    return 1e9 * plane_stress(E[0], E[1], nu12, film.shear_modulus_GPa).imag / COMPLEX_STEP


def _touch_rate(adjoint: _Adjoint, i: int, name: str) -> Array:
    """dQ/dθ by a key of the probe i, or of its load, (electrodes,)."""
    equilibrium, state, load = adjoint.equilibrium, adjoint.state, adjoint.equilibrium.loads[i]
    if not isinstance(load, Contact):
        if name in _PLACE:
            return _swept(adjoint, load, name)
        axis = _IN_PLANE.index(name) if name in _IN_PLANE else 2
        return load.with_components(np.eye(3)[axis]).forces(state) @ adjoint.dofs
    rows = adjoint.dofs.reshape(-1, 3, adjoint.dofs.shape[1])[load.nodes]
    space, moves = equilibrium.space, state.dofs.reshape(-1, 3)[load.nodes, :2]
    places = space.basis.doflocs.T[load.nodes] + moves
    height = load.tip.height(places)
    if name == "force_N":  # it is on the depth
        return rows[0, 2] + height.slope[0] @ rows[0, :2]
    moved, turned = np.zeros(space.dof_count), np.zeros(1)
    if name == "depth_mm":
        moved[load.raised] = 1e-3
    else:
        velocity = _velocity(load.touch.probe, name, places)
        moved[load.raised] = (height.slope * velocity).sum(axis=1)
        slope_rate = -(height.hessian @ velocity[:, :, None])[:, :, 0]
        if name == "rotation_deg" and load.touch.probe.period_deg:
            slope_rate += np.radians(1.0) * height.slope @ np.array([[0.0, 1.0], [-1.0, 0.0]])
        forces = equilibrium.film_forces(state)[load.raised]
        turned = np.einsum("n,na,nae->e", forces, slope_rate, rows[:, :2])
    actions = (term.action(state, moved) for term in equilibrium.terms)
    stiff = sum((a for a in actions if a is not None), np.zeros(len(moved)))
    return moved @ adjoint.goal_rates - stiff @ adjoint.dofs + turned


def _swept(adjoint: _Adjoint, load: DeadPressure, name: str, gauss_points: int = 5) -> Array:
    """The integral p ∮ (λ · t) (V · n) ds in C per unit of the key, (electrodes,).

    The mean of the traces from both sides. Along the clamped rim λ is zero, nothing is swept.
    """
    space = adjoint.equilibrium.space
    probe, mesh, x = load.touch.probe, space.mesh, adjoint.state.dofs
    facets, count = np.unique(mesh.t2f[:, load.patch], return_counts=True)
    facets = facets[(count == 1) & (mesh.f2t[1, facets] >= 0)]
    pair, (start, end) = mesh.f2t[:, facets], mesh.p[:, mesh.facets[:, facets]].swapaxes(0, 1)
    inside = np.where(np.isin(pair[0], load.patch), *pair)
    (a, b), (c, d) = end - start, mesh.p[:, mesh.t[:, inside]].mean(axis=1) - start
    signs, elements = np.tile(np.sign(a * d - b * c), 2)[:, None], pair.ravel()
    traces, tangents = facet_quadrature(mesh, np.tile(facets, 2), elements, gauss_points)
    nodes = space.nodes[elements]
    slopes = space.gradients_at(elements, traces.points)
    F = IDENTITY + np.matmul(x.reshape(-1, 3)[nodes][:, None].swapaxes(2, 3), slopes)
    nodal = adjoint.dofs.reshape(-1, 3, adjoint.dofs.shape[1])[nodes]
    shapes = shape_values(space.basis.elem, traces.points)
    works = np.einsum("fqa,facn,fqc->fqn", shapes, nodal, load.direction(F))
    points = np.moveaxis(mesh.mapping().F(traces.points, elements), 0, -1)
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    swept = signs * traces.weights * (_velocity(probe, name, points) * normals).sum(axis=-1)
    return 0.5 * load.pressure * np.einsum("fq,fqn->n", swept, works)


def _velocity(probe: Probe, name: str, points: Array) -> Array:
    """Velocity of a probe's points (..., 2) in m, in m per unit of the key."""
    if name != "rotation_deg":
        return np.full_like(points, 1e-3 * np.eye(2)[_PLACE.index(name)])
    if probe.period_deg == 0.0:  # a disc turns into itself
        return np.zeros_like(points)
    x, y = np.moveaxis(points - 1e-3 * np.array([probe.x_mm, probe.y_mm]), -1, 0)
    return np.radians(1.0) * np.stack([-y, x], axis=-1)
