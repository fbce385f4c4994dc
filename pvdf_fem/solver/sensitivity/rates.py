"""Charge derivatives with respect to a parameter, by adjoint solutions.

Symbols are those of `pvdf_fem.solver.sensitivity.adjoint`. R depends on the probe's place by the
load's patch. The pressure F/A stays, since translations and rotations keep the area, and the work
of the load on λ changes by what the outline sweeps (Reynolds' transport theorem)::

    -λ · ∂R/∂θ = p ∮ (λ · t) (V · n) ds

with the outline's velocity V, its outward normal n, and the direction t of the pressure per
reference area: e_z for a dead load, F1 x F2 for a follower load.

Further keys do not move the mesh. The displacement is x(q, θ) of the unknowns q, and what a key
does to Q and R at the same unknowns is differenced: the film's keys, forces, the heat of a warm
probe, and the place of a tip, on which the film rests. The edge of a tip's contact moves, too, but
counts only in the second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.outputs import make_outputs
from pvdf_fem.electrodes.unloaded import compute_heat_charges
from pvdf_fem.film.loads.probe_load import PatchLoad
from pvdf_fem.film.membrane import IDENTITY
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.mesh.points import make_facet_quadrature
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Probe, Scene
from pvdf_fem.solver.next_order import factorise_tangent
from pvdf_fem.solver.sensitivity.adjoint import Adjoint
from pvdf_fem.solver.sensitivity.parameters import (
    COEFFICIENTS,
    HEAT,
    PLACE_NAMES,
    map_probe_keys,
)
from pvdf_fem.solver.solution import Solution

Table = TypeVar("Table", bound=Section)


def compute_charge_rates(solution: Solution, keys: Sequence[str]) -> Array:
    """Charge derivatives of a converged solution, without errors, in C per unit of the keys in
    `parameters_of` its scene, (keys, electrodes)."""
    solved, q, factors = factorise_tangent(solution.discrete)
    adjoint = Adjoint.of(solved, make_outputs(solution.scene), q, factors)
    return np.array([compute_rate(adjoint, key) for key in keys])


def compute_integral_rates(solution: Solution, keys: Sequence[str]) -> Array:
    """Derivatives of the electrodes' forces X, Y, without errors.

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
    outputs = [replace(output, d=d) for output in make_outputs(solution.scene) for d in units]
    solved, q, factors = factorise_tangent(solution.discrete)
    adjoint = Adjoint.of(solved, outputs, q, factors)
    rates = [compute_rate(adjoint, key, with_heat=False) for key in keys]
    return np.reshape(rates, (len(keys), -1, 2))


def compute_rate(
    adjoint: Adjoint, key: str, *, with_heat: bool = True, step: float = 1e-3
) -> Array:
    """dQ/dθ in C per unit of the key, (electrodes,), with the pyroelectric charge or without it. A
    differenced key is changed by `step` times its value; a place by `step` in mm or degrees, and a
    temperature in K."""
    scene = adjoint.equilibrium.scene
    if key in COEFFICIENTS:
        return 1e-12 * adjoint.forces[:, COEFFICIENTS.index(key)]
    swept, touches = np.zeros(len(adjoint.outputs)), map_probe_keys(scene).get(key, [])
    for touch, i, name in touches:
        load = adjoint.equilibrium.loads[i]
        if name in PLACE_NAMES and isinstance(load, PatchLoad):
            swept = swept + _swept(adjoint, load, name)
            if not touch.probe.temperature_K:  # nothing else of it has a place
                return swept
    placed = any(name in (*PLACE_NAMES, HEAT) for _, _, name in touches)
    value = 1.0 if placed else abs(get_number(scene, key)) or 1.0
    if scene.tips:  # which press by an overlap that is a small part of the depth
        step *= 1e-2 * scene.numerics.tolerance
    return swept + _differenced(adjoint, key, step * value, with_heat)


def _differenced(adjoint: Adjoint, key: str, step: float, with_heat: bool) -> Array:
    """dQ/dθ on a fixed mesh, (electrodes,), from fourth-order central differences of Q and R at
    fixed unknowns."""
    equilibrium, rate = adjoint.equilibrium, np.zeros(len(adjoint.outputs))
    for weight, change in ((8.0, step), (-8.0, -step), (-1.0, 2.0 * step), (1.0, -2.0 * step)):
        moved = equilibrium.with_(scene=change_number(equilibrium.scene, key, change))
        charges = adjoint.in_other(moved)
        if with_heat:
            charges = charges + compute_heat_charges(moved.scene, equilibrium)
        rate += weight / (12.0 * step) * charges
    return rate


def change_number(scene: Scene, key: str, change: float) -> Scene:
    """The scene with a number changed, beyond the range of its key if need be."""
    if touches := map_probe_keys(scene).get(key):
        probes = list(scene.loaded_probes)
        for _, i, name in touches:
            probe, load = probes[i].probe, probes[i].load
            if name in (*PLACE_NAMES, HEAT):
                probe = _with_number(probe, name, change)
            else:
                load = _with_number(load, name, change)
            probes[i] = replace(probes[i], probe=probe, load=load)
        return scene.with_loaded_probes(probes)
    film = _with_number(scene.film, key.removeprefix("film."), change)
    return scene.model_copy(update={"film": film})


def _with_number(table: Table, name: str, change: float) -> Table:
    """A table with a number changed, or one of a pair: ``key.0`` or ``key[0]``."""
    name, _, index = name.replace("[", ".").rstrip("]").partition(".")
    value = getattr(table, name)
    if index:
        value = tuple(v + change * (i == int(index)) for i, v in enumerate(value))
    else:
        value = value + change
    return table.model_copy(update={name: value})


def _swept(adjoint: Adjoint, load: PatchLoad, name: str, gauss_points: int = 5) -> Array:
    """The integral ∮ (λ · t) (V · n) ds in C per unit of the key, (electrodes,).

    The mean of the traces from both sides. Along the clamped rim λ is zero, nothing is swept.
    """
    space = adjoint.equilibrium.space
    probe, mesh, x = load.spec.probe, space.mesh, adjoint.state.dofs
    facets, count = np.unique(mesh.t2f[:, load.patch], return_counts=True)
    facets = facets[(count == 1) & (mesh.f2t[1, facets] >= 0)]
    if not len(facets):
        return np.zeros(len(adjoint.outputs))
    pair, (start, end) = mesh.f2t[:, facets], mesh.p[:, mesh.facets[:, facets]].swapaxes(0, 1)
    inside = np.where(np.isin(pair[0], load.patch), *pair)
    (a, b), (c, d) = end - start, mesh.p[:, mesh.t[:, inside]].mean(axis=1) - start
    signs, elements = np.tile(np.sign(a * d - b * c), 2)[:, None], pair.ravel()
    traces, tangents = make_facet_quadrature(mesh, np.tile(facets, 2), elements, gauss_points)
    nodes = space.nodes[elements]
    slopes = space.gradients_at(elements, traces.points)
    F = IDENTITY + np.matmul(x.reshape(-1, 3)[nodes][:, None].swapaxes(2, 3), slopes)
    nodal = adjoint.dofs.reshape(-1, 3, adjoint.dofs.shape[1])[nodes]
    shapes = evaluate_shape_functions(space.basis.elem, traces.points)
    works = np.einsum("fqa,facn,fqc->fqn", shapes, nodal, load.traction(F))
    points = np.moveaxis(mesh.mapping().F(traces.points, elements), 0, -1)
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    swept = signs * traces.weights * (_velocity(probe, name, points) * normals).sum(axis=-1)
    return 0.5 * np.einsum("fq,fqn->n", swept, works)


def _velocity(probe: Probe, name: str, points: Array) -> Array:
    """Velocity of a probe's points (..., 2) in m, in m per unit of the key."""
    if name != "rotation_deg":
        return np.full_like(points, 1e-3 * np.eye(2)[PLACE_NAMES.index(name)])
    if probe.period_deg == 0.0:  # a disc turns into itself
        return np.zeros_like(points)
    x, y = np.moveaxis(points - 1e-3 * np.array([probe.x_mm, probe.y_mm]), -1, 0)
    return np.radians(1.0) * np.stack([-y, x], axis=-1)
