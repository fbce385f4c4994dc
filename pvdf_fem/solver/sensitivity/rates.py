"""Charge derivatives with respect to a parameter, by adjoint solutions.

Symbols are those of `pvdf_fem.solver.sensitivity.adjoint`. R depends on the position of a probe
through the area on which its pressure acts. The pressure p = F/A does not change, since the area A
is invariant to translation and rotation. By Reynolds' transport theorem::

    -λ · ∂R/∂θ = p ∮ (λ · t) (V · n) ds

along the outline, with its velocity V per unit of the key, its outward normal n, and the direction
t of the pressure per reference area: e_z for a dead load, F1 x F2 for a follower load.

For all other keys Q - λ · R is differenced on a fixed mesh at fixed unknowns q: keys of the film,
forces, the temperature of a probe, and the position of a tip, on which the film rests. The edge of
a tip's contact moves, too, but its effect is of second order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np

from pvdf_fem.arrays import Array
from pvdf_fem.electrodes.heat import compute_heat_charges
from pvdf_fem.film.loads.probe_load import PatchLoad
from pvdf_fem.film.membrane import IDENTITY
from pvdf_fem.film.space import evaluate_shape_functions
from pvdf_fem.mesh.points import make_facet_quadrature
from pvdf_fem.scene.changes import get_number
from pvdf_fem.scene.keys import Section
from pvdf_fem.scene.scene import Probe, Scene
from pvdf_fem.solver.estimate.next_order import factorise_tangent
from pvdf_fem.solver.sensitivity.adjoint import Adjoint
from pvdf_fem.solver.sensitivity.parameters import (
    COEFFICIENTS,
    HEAT,
    PLACE_NAMES,
    map_probe_keys,
)
from pvdf_fem.solver.solution import Solution

Table = TypeVar("Table", bound=Section)

#: Step of the differences: relative to the value, but absolute in mm, degrees or K for positions,
#: angles and temperatures.
STEP = 1e-3
#: In scenes with tips the steps are multiplied by this factor and by the tolerance, because the
#: contact force depends on an overlap that is much smaller than the depth.
TIP_STEP = 1e-2
#: Weights of the fourth-order central difference, multiplied by 12, by the number of steps.
DIFFERENCE_WEIGHTS = {1: 8.0, -1: -8.0, 2: -1.0, -2: 1.0}
#: Gauss points along a facet of the probe's outline.
GAUSS_POINTS = 5


def compute_charge_rates(solution: Solution, keys: Sequence[str]) -> Array:
    """Compute derivatives of the charges of a solution, without estimating their errors.

    Parameters
    ----------
    solution : Solution
        A converged solution.
    keys : sequence of str
        Keys among `list_parameters` of the problem.

    Returns
    -------
    ndarray, shape (keys, electrodes)
        Derivatives of the total charges in C per unit of the key.
    """
    factorised = factorise_tangent(solution.discrete)
    adjoint = Adjoint.of_solution(factorised, solution.problem.outputs)
    return np.array([compute_rate(adjoint, key) for key in keys])


def differentiate_stress_integrals(solution: Solution, keys: Sequence[str]) -> Array:
    """Compute derivatives of the stress integrals X and Y, without estimating their errors.

    Parameters
    ----------
    solution : Solution
        A converged solution.
    keys : sequence of str
        Keys among `list_parameters` of the problem, except those of d31 and d32.

    Returns
    -------
    ndarray, shape (keys, electrodes, 2)
        Derivatives of X and Y in N per unit of the key.
    """
    outputs = []  # with d = (1, 0) and (0, 1) the charges are X and Y
    for output in solution.problem.outputs:
        outputs.append(replace(output, d=(1.0, 0.0)))
        outputs.append(replace(output, d=(0.0, 1.0)))
    adjoint = Adjoint.of_solution(factorise_tangent(solution.discrete), outputs)
    rates = [compute_rate(adjoint, key, with_heat=False) for key in keys]
    return np.reshape(rates, (len(keys), -1, 2))


def compute_rate(adjoint: Adjoint, key: str, *, with_heat: bool = True) -> Array:
    """Compute the derivative dQ/dθ of every charge with respect to one key.

    Parameters
    ----------
    adjoint : Adjoint
        A solution with the adjoint solutions of its charges.
    key : str
        A key among `list_parameters`.
    with_heat : bool, optional
        Whether the charges include the pyroelectric ones.

    Returns
    -------
    ndarray, shape (outputs,)
        Derivatives in C per unit of the key.
    """
    scene = adjoint.equilibrium.scene
    if key in COEFFICIENTS:
        return 1e-12 * adjoint.stress_integrals[:, COEFFICIENTS.index(key)]
    numbers = map_probe_keys(scene).get(key, [])
    by_outline = np.zeros(len(adjoint.outputs))
    for number in numbers:
        load = adjoint.equilibrium.loads[number.position]
        if number.name in PLACE_NAMES and isinstance(load, PatchLoad):
            by_outline = by_outline + _integrate_swept_work(adjoint, load, number.name)
            if not number.probe.probe.temperature_K:  # only the pressure depends on the position
                return by_outline
    is_place_or_heat = any(number.name in (*PLACE_NAMES, HEAT) for number in numbers)
    magnitude = 1.0
    if not is_place_or_heat:
        magnitude = abs(get_number(scene, key)) or 1.0
    step = STEP * magnitude
    if scene.tips:
        step *= TIP_STEP * scene.numerics.tolerance
    return by_outline + _compute_charge_difference_quotient(
        adjoint, key, step=step, with_heat=with_heat
    )


def _compute_charge_difference_quotient(
    adjoint: Adjoint, key: str, *, step: float, with_heat: bool
) -> Array:
    """Compute the central difference quotient of Q - λ · R for a key, at fixed unknowns.

    Returns an array of shape (outputs,) in C per unit of the key.

    Parameters
    ----------
    adjoint : Adjoint
        Adjoint solutions λ of the charges Q.
    key : str
        Key of a number of the scene.
    step : float
        Step of the differences, in the unit of the key.
    with_heat : bool
        Whether pyroelectric charges are included.
    """
    equilibrium = adjoint.equilibrium
    rate = np.zeros(len(adjoint.outputs))
    for steps, weight in DIFFERENCE_WEIGHTS.items():
        scene = change_number(equilibrium.scene, key, steps * step)
        problem = equilibrium.problem.with_scene(scene)
        charges = adjoint.evaluate_lagrangian(equilibrium.of_problem(problem))
        if with_heat:
            charges = charges + compute_heat_charges(problem, equilibrium)
        rate += weight / (12.0 * step) * charges
    return rate


def change_number(scene: Scene, key: str, change: float) -> Scene:
    """Return a copy of a scene with a changed number, without checking the range of its key.

    Parameters
    ----------
    scene : Scene
        Scene before the change.
    key : str
        A key among `list_parameters`.
    change : float
        Amount that is added to the number, in the unit of the key.
    """
    numbers = map_probe_keys(scene).get(key)
    if not numbers:
        film = _add_to_number(scene.film, key.removeprefix("film."), change)
        return scene.model_copy(update={"film": film})
    probes = list(scene.loaded_probes)
    for number in numbers:
        changed = probes[number.position]
        if number.name in (*PLACE_NAMES, HEAT):
            probe = _add_to_number(changed.probe, number.name, change)
            probes[number.position] = replace(changed, probe=probe)
        else:
            load = _add_to_number(changed.load, number.name, change)
            probes[number.position] = replace(changed, load=load)
    return scene.with_loaded_probes(probes)


def _add_to_number(table: Table, name: str, change: float) -> Table:
    """Return a copy of a table with a changed number, without validation.

    One number of a pair is named ``name.0`` or ``name[0]``.

    Parameters
    ----------
    table : Table
        The table.
    name : str
        Name of the number.
    change : float
        Change of the number.
    """
    name, _, index = name.replace("[", ".").rstrip("]").partition(".")
    value = getattr(table, name)
    if index:
        pair = list(value)
        pair[int(index)] += change
        return table.model_copy(update={name: tuple(pair)})
    return table.model_copy(update={name: value + change})


def _integrate_swept_work(adjoint: Adjoint, load: PatchLoad, name: str) -> Array:
    """Integrate p ∮ (λ · t) (V · n) ds along the outline of a probe.

    The gradients in t jump at the outline, so the mean of the traces from both sides is taken.
    Facets on the clamped rim, where λ is zero, are left out.

    Parameters
    ----------
    adjoint : Adjoint
        The solution with the adjoint solutions λ.
    load : PatchLoad
        The pressure p with its patch, whose outline moves.
    name : str
        One of `PLACE_NAMES`.

    Returns
    -------
    ndarray, shape (outputs,)
        Derivatives in C per unit of the key.
    """
    space = adjoint.equilibrium.space
    mesh = space.mesh
    facets, count = np.unique(mesh.t2f[:, load.patch], return_counts=True)
    is_outline = (count == 1) & (mesh.f2t[1, facets] >= 0)  # on one element of the patch, not rim
    facets = facets[is_outline]
    if not len(facets):
        return np.zeros(len(adjoint.outputs))
    # each facet occurs twice: with the element on either side
    elements = mesh.f2t[:, facets].ravel()
    traces, tangents = make_facet_quadrature(mesh, np.tile(facets, 2), elements, GAUSS_POINTS)
    nodes = space.nodes[elements]
    gradients = space.evaluate_gradients(elements, traces.points)
    displacement = adjoint.state.dofs.reshape(-1, 3)[nodes]
    F = IDENTITY + np.matmul(displacement[:, None].swapaxes(2, 3), gradients)
    nodal_adjoints = adjoint.dofs.reshape(-1, 3, adjoint.dofs.shape[1])[nodes]
    shapes = evaluate_shape_functions(space.basis.elem, traces.points)
    # indices: facet f, Gauss point q, node a, component c, output n
    works = np.einsum("fqa,facn,fqc->fqn", shapes, nodal_adjoints, load.traction(F))
    points = np.moveaxis(mesh.mapping().F(traces.points, elements), 0, -1)
    outward = np.tile(_find_outward_signs(adjoint, load, facets), 2)[:, None]
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    velocity = _compute_velocity(load.spec.probe, name, points)
    swept = outward * traces.weights * (velocity * normals).sum(axis=-1)
    return 0.5 * np.einsum("fq,fqn->n", swept, works)  # 0.5 for the mean of both sides


def _find_outward_signs(adjoint: Adjoint, load: PatchLoad, facets: Array) -> Array:
    """Return the signs by which the right-hand normals of facets point out of the load's patch.

    A sign is +1 if the patch is to the left of the facet, otherwise -1.

    Parameters
    ----------
    adjoint : Adjoint
        Adjoint solutions, for their mesh.
    load : PatchLoad
        The load.
    facets : ndarray of int, shape (n,)
        Indices of facets on the edge of its patch.
    """
    mesh = adjoint.equilibrium.space.mesh
    start, end = mesh.p[:, mesh.facets[:, facets]].swapaxes(0, 1)
    pairs = mesh.f2t[:, facets]
    inside = np.where(np.isin(pairs[0], load.patch), pairs[0], pairs[1])
    centres = mesh.p[:, mesh.t[:, inside]].mean(axis=1)
    along_x, along_y = end - start
    inward_x, inward_y = centres - start
    return np.sign(along_x * inward_y - along_y * inward_x)


def _compute_velocity(probe: Probe, name: str, points: Array) -> Array:
    """Return the velocity of points of a probe in m per unit of the key, shape (..., 2).

    `points` are in m. The velocity is zero for the rotation of a disc.

    Parameters
    ----------
    probe : Probe
        The probe.
    name : str
        Key of its place: ``x_mm``, ``y_mm`` or ``rotation_deg``.
    points : ndarray, shape (..., 2)
        Points in m.
    """
    if name != "rotation_deg":
        direction = np.eye(2)[PLACE_NAMES.index(name)]
        return np.full_like(points, 1e-3 * direction)
    if probe.period_deg == 0.0:  # a disc is invariant to rotation
        return np.zeros_like(points)
    centre = 1e-3 * np.array([probe.x_mm, probe.y_mm])
    x, y = np.moveaxis(points - centre, -1, 0)
    return np.radians(1.0) * np.stack([-y, x], axis=-1)
