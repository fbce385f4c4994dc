"""Derivatives of charges with respect to one parameter, by their adjoint solutions.

Symbols are those of `pvdf_fem.derivatives.adjoint`. R depends on the probe's place through the
load's patch. The pressure F/A stays, since translations and rotations keep the area, and the work
of the load on λ changes by what the outline sweeps (Reynolds' transport theorem)::

    -λ · ∂R/∂θ = p ∮ (λ · t) (V · n) ds

with the outline's velocity V, its outward normal n, and the direction t of the pressure per
reference area: e_z for a dead load, F1 x F2 for a follower load.

A film on a tip moves with it: the displacement is x(q, θ) of the unknowns q, and R = P^T f with the
film's forces f and P = ∂x/∂q. Then ∂Q/∂θ and ∂R/∂θ have ∂x/∂θ in them, and ∂R/∂θ what turns P, the
slope of the tip at its nodes. That the contact's edge moves too counts only in the second order.

What the heat of a warm probe, which moves with it, and keys of the film do to Q and R on the same
mesh is differenced.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.charges.goals import goals_of
from pvdf_fem.charges.rest import heat_charges
from pvdf_fem.derivatives.adjoint import Adjoint, factorised
from pvdf_fem.derivatives.parameters import (
    COEFFICIENTS,
    HEAT,
    IN_PLANE,
    PLACE_NAMES,
    touched,
)
from pvdf_fem.film.loads.contact import Contact
from pvdf_fem.film.loads.pressure import DeadPressure
from pvdf_fem.film.membrane import IDENTITY
from pvdf_fem.film.space import shape_values
from pvdf_fem.mesh.points import facet_quadrature
from pvdf_fem.scene.change import number_at
from pvdf_fem.scene.scene import Probe, Scene
from pvdf_fem.solution.solution import Solution

#: Step of a differenced key of the film over its value.
FILM_STEP = 1e-3
#: Step of a differenced key of a warm probe in mm, degrees or K.
HEAT_STEP = 0.01


def charge_rates(solution: Solution, keys: Sequence[str]) -> Array:
    """Derivatives of the charges of a converged solution, without errors, in C per unit of the
    keys, which are of `parameters_of` its scene, (keys, electrodes)."""
    solved, q, factors = factorised(solution)
    adjoint = Adjoint.of(solved, goals_of(solution.scene), q, factors)
    return np.array([rate_of(adjoint, key) for key in keys])


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
    adjoint = Adjoint.of(solved, goals, q, factors)
    return np.reshape([rate_of(adjoint, key) for key in keys], (len(keys), -1, 2))


def rate_of(adjoint: Adjoint, key: str) -> Array:
    """dQ/dθ in C per unit of the key, (electrodes,)."""
    equilibrium = adjoint.equilibrium
    if touches := touched(equilibrium.scene).get(key):
        rate = sum((_touch_rate(adjoint, i, n) for _, i, n in touches if n != HEAT), np.zeros(1))
        moves_heat = any(
            n == HEAT or (n in PLACE_NAMES and t.probe.temperature_K) for t, _, n in touches
        )
        return rate + _film_rate(adjoint, key, HEAT_STEP) if moves_heat else rate
    if key in COEFFICIENTS:
        return 1e-12 * adjoint.forces[:, COEFFICIENTS.index(key)]
    return _film_rate(adjoint, key, FILM_STEP * (abs(number_at(equilibrium.scene, key)) or 1.0))


def _touch_rate(adjoint: Adjoint, i: int, name: str) -> Array:
    """dQ/dθ by a key of the probe i, or of its load, (electrodes,)."""
    equilibrium, state, load = adjoint.equilibrium, adjoint.state, adjoint.equilibrium.loads[i]
    if not isinstance(load, Contact):
        if name in PLACE_NAMES:
            return _swept(adjoint, load, name)
        axis = IN_PLANE.index(name) if name in IN_PLANE else 2
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
    stiff = equilibrium.film_action(state, moved)
    return moved @ adjoint.goal_rates - stiff @ adjoint.dofs + turned


def _film_rate(adjoint: Adjoint, key: str, step: float) -> Array:
    """The part of dQ/dθ by what the membrane and the loads on the whole film are at a displacement
    that stays, (electrodes,), from central differences of the fourth order."""
    equilibrium, rate = adjoint.equilibrium, np.zeros(len(adjoint.goals))
    for weight, change in ((8.0, step), (-8.0, -step), (-1.0, 2.0 * step), (1.0, -2.0 * step)):
        moved = equilibrium.with_(scene=_changed(equilibrium.scene, key, change))
        charges = adjoint.at_displacement(moved) + heat_charges(moved.scene, equilibrium)
        rate += weight / (12.0 * step) * charges
    return rate


def _changed(scene: Scene, key: str, change: float) -> Scene:
    """The scene with a number changed, beyond the range of its key if need be."""
    table, _, rest = key.partition(".")
    if table != "film":
        return scene.with_(**{key: number_at(scene, key) + change})
    name, _, index = rest.partition(".")
    value = getattr(scene.film, name)
    if index:
        value = tuple(v + change * (i == int(index)) for i, v in enumerate(value))
    else:
        value = value + change
    film = scene.film.model_copy(update={name: value})
    return scene.model_copy(update={"film": film})


def _swept(adjoint: Adjoint, load: DeadPressure, name: str, gauss_points: int = 5) -> Array:
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
        return np.full_like(points, 1e-3 * np.eye(2)[PLACE_NAMES.index(name)])
    if probe.period_deg == 0.0:  # a disc turns into itself
        return np.zeros_like(points)
    x, y = np.moveaxis(points - 1e-3 * np.array([probe.x_mm, probe.y_mm]), -1, 0)
    return np.radians(1.0) * np.stack([-y, x], axis=-1)
